"""One scene as seen by many sensors: each error alone and strong, the presets, and cameras of each kind."""

from dataclasses import dataclass

import numpy as np

from icgnet.errors import InputError
from icgnet.geometry.camera import DEFAULT_INTRINSICS, DEFAULT_SHAPE, sphere_pose
from icgnet.geometry.workspace import CENTRE, SIZE
from icgnet.objects.object_set import ObjectSet
from icgnet.sensors.config import CAMERAS, NOISES, CameraModel, SensorNoise, exactly
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
    "dark objects": SensorNoise(dark=exactly(1.0)),
    "ragged edges, 2 pixels": SensorNoise(wandering=exactly(2.0)),
    "waves, 0.3 pixels": SensorNoise(ripple=exactly(0.3)),
    "shot noise, 3 mm at 1 m": SensorNoise(shot_noise=exactly(0.003)),
    "wiggling, 6 mm": SensorNoise(wiggle=exactly(0.006)),
    "multipath, albedo 0.8": SensorNoise(multipath=exactly(0.8)),
    "blended edges": SensorNoise(blending=exactly(0.7)),
}
"""Each model by itself, mostly stronger than in the presets where it would hardly show."""


PRESETS = ("clean", "gaussian", "dex", "realsense", "mixed")
SHOWN_CAMERAS = ("d435", "kinect_v1", "azure_kinect")
"""One of each kind ..."""
DISTANCES = (0.5, 0.9, 1.4)
"""... seen from so far [m]."""
DEFAULT_CAMERA = CameraModel("640 x 480", DEFAULT_SHAPE, float(DEFAULT_INTRINSICS[0, 0]), SensorNoise())
DISTANCE, AZIMUTH = 0.6, np.deg2rad(-60.0)
MARGIN = 0.025
"""How much of the table is in the picture around the objects [m]."""


@dataclass(frozen=True, eq=False)
class GalleryCloud:
    """A cloud of the gallery.

    Attributes:
        caption: which sensor it is from, with its distance.
        cloud: what it makes of the scene.
        spacing: distance of neighbouring pixels on what is seen from the front [m].
    """

    caption: str
    cloud: SensedCloud
    spacing: float


def make_gallery(scene: Scene, object_set: ObjectSet, polar: float, seed: int) -> list[GalleryCloud]:
    """What sensors make of a scene: each error alone, the presets raw, the presets fused, and cameras of each kind.

    Args:
        scene: what stands on the table.
        object_set: where the objects come from.
        polar: angle of the cameras from the vertical [rad].
        seed: of every sensor's draws.

    Raises:
        InputError: nothing stands on the table.
    """
    if not scene.objects:
        raise InputError("no object found a place on the table: there is nothing to see")
    triangles, owners = scene_triangles(scene, object_set)
    renderer = SceneRenderer(triangles, owners, extent=scene.surroundings.extent)
    margin = np.array([MARGIN, MARGIN, 0.0])
    lower, upper = triangles.min(axis=(0, 1)) - margin, triangles.max(axis=(0, 1)) + margin
    if scene.surroundings.extent is not None:  # of a whole table or bin, what is in the workspace
        lower, upper = np.maximum(lower, 0.0), np.minimum(upper, SIZE)

    def seen(caption: str, camera: CameraModel, distance: float, noise: SensorNoise, fused: bool) -> GalleryCloud:
        pose = sphere_pose(np.array([CENTRE[0], CENTRE[1], 0.10]), distance, polar, AZIMUTH)
        view = crop_view(CameraView(pose, camera.intrinsics, camera.shape), lower, upper)
        picture = Exposure(renderer.render(view.intrinsics, view.shape, pose), view, fused, noise)
        # The table stays in: shadows and flying pixels are best seen on it.
        cloud = sense(picture, noise, 0.0, np.random.default_rng(seed))
        return GalleryCloud(caption, cloud, distance / camera.focal)

    gallery = [seen(caption, DEFAULT_CAMERA, DISTANCE, noise, False) for caption, noise in ALONE.items()]
    for fused, kind in ((False, "pixels"), (True, "TSDF")):
        gallery += [seen(f"preset {name}: {kind}", DEFAULT_CAMERA, DISTANCE, NOISES[name], fused) for name in PRESETS]
    for camera in (CAMERAS[name] for name in SHOWN_CAMERAS):
        gallery += [seen(f"{camera.name}, {far:g} m", camera, far, camera.noise, False) for far in DISTANCES]
    return gallery
