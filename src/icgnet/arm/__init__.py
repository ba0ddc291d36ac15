"""The arm: from a prediction to a trajectory that picks one object, carries it and lets go of it.

Needs the packages of the extra `icgnet[arm]`, which `libraries` imports for all other modules.
"""
