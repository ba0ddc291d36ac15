"""The arm: from a prediction to a trajectory that picks one object, carries it and lets go of it.

Needs the packages of the extra `icgnet[arm]`; without them, importing anything here says so in one line.
"""

from importlib.util import find_spec

from icgnet.errors import MissingExtraError

_NEEDED = ("pinocchio", "coal", "frankik", "roboplan")

if any(find_spec(name) is None for name in _NEEDED):
    _missing = ", ".join(name for name in _NEEDED if find_spec(name) is None)
    raise MissingExtraError(f'planning for an arm needs more packages ({_missing}): pip install "icgnet[arm]"')
