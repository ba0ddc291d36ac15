"""One scene as seen by many sensors: each error alone and strong, and the presets, as pixels and as a fused cloud."""

import numpy as np

from icgnet.errors import InputError
from icgnet.geometry.camera import DEFAULT_INTRINSICS, DEFAULT_SHAPE, sphere_pose
from icgnet.geometry.workspace import CENTRE
from icgnet.objects.object_set import ObjectSet
from icgnet.sensors.config import NOISES, SensorNoise, exactly
from icgnet.simulation.camera import SceneRenderer
from icgnet.simulation.scene import Scene, scene_triangles
from icgnet.training.observation import Exposure, SensedCloud, sense
from icgnet.training.views import CameraView, crop_view

ALONE = {
    "clean": SensorNoise(),
    "Gaussian noise, 2 mm": SensorNoise(gaussian=exactly(0.002)),
    "deformation, 3 mm": SensorNoise(deformation=exactly(0.003)),
    "one in two points dropped": SensorNoise(drop=exactly(0.5)),
    "2 cm blocks erased, p = 0.2": SensorNoise(blocks=exactly(0.2)),
    "one gain, sigma 3 %": SensorNoise(gain=exactly(1000**-0.5)),
    "error field, 5 mm": SensorNoise(field=exactly(0.005)),
    "disparity noise, 0.3 pixels": SensorNoise(disparity_noise=exactly(0.3)),
    "disparity steps, 0.5 pixels": SensorNoise(disparity_step=exactly(0.5), depth_unit=exactly(0.001)),
    "spatial filter, 4 passes": SensorNoise(smoothing=exactly(4.0)),
    "flying pixels": SensorNoise(flying=exactly(1.0)),
    "fattened edges, 3 pixels": SensorNoise(fattening=exactly(3.0)),
    "stereo shadow": SensorNoise(shadow=exactly(1.0)),
    "holes at grazing angles": SensorNoise(grazing=exactly(0.35)),
    "round spots": SensorNoise(spots=exactly(8.0)),
}
"""Each model by itself, mostly stronger than in the presets where it would hardly show."""


DISTANCE, AZIMUTH = 0.6, np.deg2rad(-60.0)
MARGIN = 0.025
"""How much of the table is in the picture around the objects [m]."""


def take_gallery_picture(scene: Scene, object_set: ObjectSet, polar: float) -> Exposure:
    """A picture of a scene and the table around it from 0.6 m, at an angle from the vertical [rad].

    Raises:
        InputError: nothing stands on the table.
    """
    if not scene.objects:
        raise InputError("no object found a place on the table: there is nothing to see")
    pose = sphere_pose(np.array([CENTRE[0], CENTRE[1], 0.10]), DISTANCE, polar, AZIMUTH)
    triangles, owners = scene_triangles(scene, object_set)
    margin = np.array([MARGIN, MARGIN, 0.0])
    lower, upper = triangles.min(axis=(0, 1)) - margin, triangles.max(axis=(0, 1)) + margin
    view = crop_view(CameraView(pose, DEFAULT_INTRINSICS, DEFAULT_SHAPE), lower, upper)
    image = SceneRenderer(triangles, owners).render(view.intrinsics, view.shape, pose)
    return Exposure(image, view, fused=False, noise=NOISES["clean"])


def sense_gallery(picture: Exposure, seed: int) -> dict[str, SensedCloud]:
    """What each sensor makes of the picture, by caption: each error alone, the presets raw, the presets fused.

    Args:
        picture: of a scene, without errors.
        seed: of every sensor's draws.
    """
    gallery = {caption: _sense(picture, noise, False, seed) for caption, noise in ALONE.items()}
    for fused, kind in ((False, "pixels"), (True, "TSDF")):
        gallery |= {f"preset {name}: {kind}": _sense(picture, noise, fused, seed) for name, noise in NOISES.items()}
    return gallery


def _sense(picture: Exposure, noise: SensorNoise, fused: bool, seed: int) -> SensedCloud:
    # The table stays in: shadows and flying pixels are best seen on it.
    return sense(Exposure(picture.image, picture.view, fused, noise), noise, 0.0, np.random.default_rng(seed))
