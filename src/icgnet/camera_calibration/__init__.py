"""Where a camera is on an arm or beside it, from pictures of a printed board.

Needs the package of the extra `icgnet[calibrate]`, which `libraries` imports for all other modules.
"""
