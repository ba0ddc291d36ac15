"""Errors that a caller can cause. The command line prints them as one line and exits with code 2."""


class IcgnetError(Exception):
    """Base of every error that a caller can cause and mend."""


class InputError(IcgnetError, ValueError):
    """A cloud, depth image, camera, pose or argument is not usable; says what was given and what is valid."""


class TableNotFoundError(InputError):
    """No plane in the cloud is supported by enough points to be the table."""


class TrainingDivergedError(IcgnetError):
    """The gradient stays infinite or NaN."""


class DataError(IcgnetError):
    """A file (recipes, weights, gripper, mesh, calibration) is broken, foreign or of another version."""


class MissingExtraError(IcgnetError, ImportError):
    """A package is not installed that only a part of icgnet needs; the message says how to install it."""
