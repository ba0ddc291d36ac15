"""From a depth image or a cloud of a cluttered table to objects, complete shapes and ranked grasps."""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import torch
import trimesh
from jaxtyping import Bool, Int

from icgnet.errors import DataError, InputError, TableNotFoundError
from icgnet.geometry.arrays import position, real_array, real_number, truth_array
from icgnet.geometry.camera import check_depth, check_intrinsics, pixel_rays
from icgnet.geometry.clouds import PointCloud, check_points, measured_rows
from icgnet.geometry.depth_scale import LARGEST_ERROR, levelled_depth
from icgnet.geometry.transforms import check_pose
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.grasping.selection import ranked
from icgnet.inference.background import without_background
from icgnet.inference.budget import Budget, Clock
from icgnet.inference.candidates import keep_free, score_contacts, seen_contacts, surface_contacts
from icgnet.inference.grasp_search import DEFAULT_SEARCH, GraspSearch
from icgnet.inference.instances import encode, find_instances
from icgnet.inference.occlusion import joined_behind_others
from icgnet.inference.prediction import NO_INSTANCE, DetectedObject, Prediction, SupportPlane
from icgnet.inference.shapes import SceneOccupancy, Shape
from icgnet.inference.support import Support
from icgnet.inference.tabletop import Tabletop, find_tabletop
from icgnet.network.config import Precision
from icgnet.network.icgnet import IcgNet
from icgnet.network.precision import check_device, use_bfloat16
from icgnet.network.threads import set_threads
from icgnet.network.weights import load_weights
from icgnet.network.weights_header import DEFAULT_WEIGHTS
from icgnet.settings import check_choice

MOST_OBJECTS = 64
"""The largest so many objects are looked at: no table holds more that a hand could tell apart, but noise does."""
MOST_RESAMPLED = 24
"""The largest so many objects are asked for points of their predicted surface."""
RESAMPLING_SHARE = 0.6
"""With a budget, so much of it may be used up before unseen sides are looked at."""
WORLD, CAMERA = "world", "camera"
"""Names of the frames that results are in: a world with z up, unless the caller calls it otherwise, or the camera."""


class Predictor:
    """Finds objects and grasps in clouds; holds the network and the settings, and nothing of any scene.

    Args:
        network: the network, in evaluation mode.
        gripper: the hand that grasps are wanted for; a network of the published kind knows only one. None is the hand
            of most of the network's labels.
        search: how grasps are looked for.
        seed: of everything that is drawn; the same input then gives the same result.
        precision: in how many bits the U-Nets compute. The default gives the same results on every processor; auto
            takes bfloat16 where the processor or card has instructions for it.
        device: what the network computes on, such as "cpu" or "cuda".

    Raises:
        InputError: a hand that the network does not know, another precision, or a device that is not there.
    """

    def __init__(
        self,
        network: IcgNet,
        gripper: Gripper | None = None,
        search: GraspSearch = DEFAULT_SEARCH,
        seed: Any = 0,
        precision: str = "float32",
        device: str | torch.device = "cpu",
    ) -> None:
        self.network = network.eval().to(check_device(device))
        self.precision: Precision = check_choice("precision", precision, get_args(Precision))
        self.gripper = network.config.gripper if gripper is None else gripper
        network.config.check_hand(self.gripper, "the grasps that are asked for")
        self.search = search
        if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
            raise InputError(f"seed must be a whole number of at least 0, got {seed!r}")
        self.seed = int(seed)

    @staticmethod
    def load(
        weights: str | Path | None = None,
        threads: int | None = None,
        gripper: str | Path | None = None,
        seed: int = 0,
        search: GraspSearch = DEFAULT_SEARCH,
        precision: str = "float32",
        device: str | torch.device = "cpu",
    ) -> "Predictor":
        """The predictor with the shipped weights or those of a file.

        Args:
            weights: a safetensors file that training wrote; the shipped one if None.
            threads: CPU threads of the network, for the whole process; as many as torch takes if None.
            gripper: name of a gripper that ships with the package, or a gripper file: the hand that grasps are wanted
                for. None is the hand of most of the labels that the weights come from.
            seed: of everything that is drawn.
            search: how grasps are looked for.
            precision: see `Predictor`.
            device: see `Predictor`.

        Raises:
            DataError: the weights or the gripper cannot be used.
            InputError: a number of threads below 1, a hand that the weights do not know, or no such device.
        """
        set_threads(threads)
        if weights is None and not DEFAULT_WEIGHTS.is_file():
            raise DataError(f"this installation has no weights ({DEFAULT_WEIGHTS} is missing): give a weights file")
        hand = None if gripper is None else load_gripper(gripper)
        network, _ = load_weights(DEFAULT_WEIGHTS if weights is None else weights)
        return Predictor(network, hand, search, seed, precision, device)

    @property
    def in_bfloat16(self) -> bool:
        """Whether the U-Nets compute in 16 bits here."""
        return use_bfloat16(self.precision, self.network.device)

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the object classes that the network knows."""
        return self.network.config.classes

    def predict_cloud(
        self, points: Any, viewpoint: Any = None, table_height: Any = None, frame_id: str = WORLD
    ) -> Prediction:
        """Objects and grasps in a cloud, in the frame of the cloud.

        Args:
            points: [n 3] positions [m]; rows with NaN, or farther than 1 km away, are ignored. With a viewpoint or a
                table height the frame is a world with z up, without both it is the camera's (x right, y down, z
                forward).
            viewpoint: where the camera stood [m]; None when it is not known.
            table_height: height of the table plane [m]; it is found in the cloud if None.
            frame_id: how the world is called in the result.

        Raises:
            InputError: fewer than 100 finite points, not in metres, a broken viewpoint or table height.
            TableNotFoundError: no plane that could be the table.
        """
        height = None if table_height is None else real_number(table_height, "table_height")
        array = real_array(points, "points", (None, 3), finite=False)
        is_camera = viewpoint is None and height is None
        eye = np.zeros(3) if is_camera else None if viewpoint is None else position(viewpoint, "viewpoint")
        cloud = PointCloud(check_points(array), eye, _frame(frame_id, is_world=not is_camera))
        return self._predict(cloud, not is_camera, height, measured_rows(array), (len(array),), None)

    def predict_depth(
        self,
        depth: Any,
        intrinsics: Any,
        camera_pose: Any = None,
        table_height: Any = None,
        mask: Any = None,
        level_table: bool = False,
        frame_id: str = WORLD,
    ) -> Prediction:
        """Objects and grasps in a depth image: in the world if the camera's pose is given, else in the camera frame.

        Args:
            depth: [h w] distance along the camera's z axis [m]; 0 or NaN where nothing was measured.
            intrinsics: [3 3] camera matrix [pixels].
            camera_pose: T_world_camera, z up in the world, as a [4 4] matrix or as the seven numbers x y z [m] qw qx qy
                qz; None when it is not known.
            table_height: height of the table plane in the world [m]; it is found in the image if None.
            mask: [h w] true where objects may be; everywhere if None.
            level_table: whether the depth is multiplied with what brings the table to its known height, for cameras
                whose depth scale drifts, by up to 15 %; needs `camera_pose` and `table_height`, and a picture in which
                most of what is level is table.
            frame_id: how the world is called in the result.

        Raises:
            InputError: values that are no numbers, wrong shapes or unit, singular intrinsics, a pose that is not rigid
                or left-handed or does not make the table level, or a table that shall be levelled without its height.
            TableNotFoundError: no plane that could be the table, or none near its known height to level.
        """
        if table_height is not None and camera_pose is None:
            raise InputError("table_height is a height in the world: it needs a camera_pose")
        height = None if table_height is None else real_number(table_height, "table_height")
        image, K = check_depth(depth), check_intrinsics(intrinsics)
        pose = None if camera_pose is None else check_pose(camera_pose, "camera_pose")
        allowed = None if mask is None else truth_array(mask, "mask", image.shape).ravel()
        frame = _frame(frame_id, is_world=pose is not None)
        if level_table:
            if pose is None or height is None:
                raise InputError("level_table needs to know where the table is: give camera_pose and table_height")
            levelled = levelled_depth(image, K, pose, height)
            if levelled is None:
                raise TableNotFoundError(
                    f"level_table: too little of a table is seen at height {height:g} m, or the depth is off by "
                    f"more than {LARGEST_ERROR:.0%}"
                )
            image = levelled
        points = (pixel_rays(K, image.shape) * image[..., None]).reshape(-1, 3)
        rows = measured_rows(points)
        cloud = PointCloud(check_points(points), np.zeros(3), CAMERA)
        if pose is not None:
            cloud = cloud.transformed(pose, frame)
        chosen = None if allowed is None else allowed[rows]
        return self._predict(cloud, pose is not None, height, rows, image.shape, chosen, 1.0 / abs(K[0, 0] * K[1, 1]))

    def _predict(
        self,
        cloud: PointCloud,
        is_level: bool,
        table_height: float | None,
        input_rows: Int[np.ndarray, "n"],
        input_shape: tuple[int, ...],
        mask: Bool[np.ndarray, "n"] | None,
        solid_angle: float | None = None,
    ) -> Prediction:
        """Objects and grasps in a checked cloud; of a picture, `solid_angle` is that of a pixel [sr].

        Paper: inference as in "Method" and "Grasp Selection and Reconstruction".
        """
        # Two streams, so that finding the table does not change which contacts are drawn.
        for_table, for_contacts = map(np.random.default_rng, np.random.SeedSequence(self.seed).spawn(2))
        clock, budget = Clock(), Budget(self.search.budget_ms)
        tabletop = find_tabletop(cloud, table_height, for_table, is_level, mask)
        clock.lap("input")

        scene, points_left_out = encode(self.network, tabletop, self.in_bfloat16)
        made_out = [] if scene is None else find_instances(scene, tabletop)
        points = tabletop.cloud.points
        found = without_background(made_out, tabletop, solid_angle)
        left_out = {
            "points": points_left_out,
            "objects": max(0, len(found) - MOST_OBJECTS),
            "background": len(made_out) - len(found),
        }
        whole = joined_behind_others(found[:MOST_OBJECTS], tabletop)
        objects = [[Shape.around(self.network, piece, points[piece.rows]) for piece in item] for item in whole]
        clock.lap("encode")

        grasps, rejected = self._search(tabletop, objects, for_contacts, clock, budget)
        result = Prediction(
            objects=tuple(_detected(number, item, tabletop, cloud) for number, item in enumerate(objects)),
            grasps=grasps.transformed(tabletop.T_frame_table),
            frame_id=cloud.frame_id,
            rejected=rejected,
            timings_ms=clock.laps_ms,
            cloud=cloud,
            cloud_instances=_labels(objects, len(cloud)),
            T_frame_table=tabletop.T_frame_table,
            gripper=self.gripper,
            classes=self.classes,
            input_rows=input_rows,
            input_shape=input_shape,
            left_out=left_out,
            supports=() if tabletop.support is None else _support_planes(tabletop.support),
            warnings=(*tabletop.warnings, *self.network.config.doubts(self.gripper)),
        )
        clock.lap("select")
        return result

    def _search(
        self,
        tabletop: Tabletop,
        objects: list[list[Shape]],
        rng: np.random.Generator,
        clock: Clock,
        budget: Budget,
    ) -> tuple[Grasps, dict[str, int]]:
        """Free grasps in the table frame, ranked; from the predicted surfaces too when the seen ones give few."""
        pieces = [piece for item in objects for piece in item]
        if not pieces:
            return Grasps.empty(), {}
        object_of = np.repeat(np.arange(len(objects)), [len(item) for item in objects])
        contacts = seen_contacts(tabletop, [piece.instance for piece in pieces], self.search.contacts, rng)
        rounds, rejected, occupancy = [], Counter(), SceneOccupancy(pieces)
        while True:
            candidates, dropped = score_contacts(self.network, pieces, contacts, self.gripper, self.search)
            candidates = replace(candidates, instances=object_of[candidates.instances])
            clock.lap("grasps")
            free, hit = keep_free(
                candidates, occupancy, len(objects), tabletop, self.gripper, self.search, budget.is_spent
            )
            clock.lap("collision")
            rounds.append(free)
            rejected.update(dropped)
            rejected.update(hit)
            grasps = Grasps.concatenate(rounds)
            poor = self._with_few_grasps(grasps, len(objects))
            is_last = len(rounds) == 2 or not self.search.resample or budget.is_spent(RESAMPLING_SHARE)
            if is_last or not poor.any():
                return ranked(grasps, self.search.select), dict(rejected)
            chosen = np.flatnonzero(poor[object_of])[:MOST_RESAMPLED]
            contacts = surface_contacts(occupancy, chosen, self.search.contacts, rng)

    def _with_few_grasps(self, grasps: Grasps, objects: int) -> Bool[np.ndarray, "o"]:
        """Which objects are worth a look at their unseen sides.

        All of them if there are too few good grasps; else those without a grasp, unless only a few grasps are wanted.
        """
        good = (grasps.scores >= self.search.good_score).sum()
        if good < min(self.search.few, self.search.most or self.search.few):
            return np.ones(objects, dtype=bool)
        return (np.bincount(grasps.instances, minlength=objects) == 0) & (self.search.most is None)

    def with_search(self, **changes: Any) -> "Predictor":
        """The same predictor with other settings of the search, for example `min_score=0.5`."""
        search = replace(self.search, **changes)
        return Predictor(self.network, self.gripper, search, self.seed, self.precision, self.network.device)


def _support_planes(support: Support) -> tuple[SupportPlane, ...]:
    """The plane that was taken for the table, and its rivals."""
    return tuple(
        SupportPlane(
            normal=tuple(each.plane.normal.tolist()),
            height=-each.plane.offset,
            share=each.share,
            area=each.area,
            tilt_deg=float(np.rad2deg(each.tilt)),
        )
        for each in (support, *support.rivals)
    )


def _detected(number: int, pieces: list[Shape], tabletop: Tabletop, cloud: PointCloud) -> DetectedObject:
    """The object of this number; its score and class are those of its largest piece."""
    largest = pieces[0].instance

    def extract() -> trimesh.Trimesh:
        return trimesh.util.concatenate([piece.mesh.copy() for piece in pieces]).apply_transform(tabletop.T_frame_table)

    return DetectedObject(
        instance_id=number,
        score=largest.score,
        class_name=largest.class_name,
        class_score=largest.class_score,
        points=cloud.points[_rows(pieces)],
        extract=extract,
    )


def _rows(pieces: list[Shape]) -> Int[np.ndarray, "n"]:
    """Points of an object in the tabletop's cloud."""
    return np.sort(np.concatenate([piece.instance.rows for piece in pieces]))


def _labels(objects: list[list[Shape]], count: int) -> Int[np.ndarray, "n"]:
    labels = np.full(count, NO_INSTANCE, dtype=np.int64)
    for number, pieces in enumerate(objects):
        labels[_rows(pieces)] = number
    return labels


def _frame(frame_id: str, is_world: bool) -> str:
    """The frame that results are in: the world by the name that the caller gives it, or the camera's own."""
    if not isinstance(frame_id, str) or not frame_id.strip():
        raise InputError(f"frame_id must be the name of a frame, got {frame_id!r}")
    if not is_world and frame_id != WORLD:
        raise InputError(
            f"frame_id {frame_id!r} names a world that is not known: without a camera pose (of a cloud: a viewpoint or "
            "table height) results are in the camera's frame"
        )
    return frame_id if is_world else CAMERA
