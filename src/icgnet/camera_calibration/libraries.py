"""OpenCV, the package of the extra `icgnet[calibrate]`, or one line that says how to install it. Imported here only."""

from icgnet.errors import MissingExtraError

INSTALL = 'pip install "icgnet[calibrate]"'

try:
    import cv2
except ModuleNotFoundError as error:
    raise MissingExtraError(f"calibrating a camera needs OpenCV, which is not installed: {INSTALL}") from error
if not (hasattr(cv2, "aruco") and hasattr(cv2.aruco, "CharucoDetector") and hasattr(cv2, "calibrateHandEye")):
    # Before 4.8 there is no CharucoDetector, and the wheels of 5.0.0 lack calibrateHandEye (opencv issue 29565).
    raise MissingExtraError(f"OpenCV {cv2.__version__} has no CharucoDetector or no calibrateHandEye: {INSTALL}")

__all__ = ["cv2"]
