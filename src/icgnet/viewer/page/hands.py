"""Hands on the page: grasps as meshes, which are made when they are first shown."""

from collections.abc import Callable

import numpy as np
import viser
from jaxtyping import Bool, Float, Int

from icgnet.geometry.transforms import matrix_to_quaternion
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import Gripper
from icgnet.viewer.palette import to_bytes
from icgnet.viewer.triangles import hand_mesh, slim_hand_mesh


class Hands:
    """Some grasps, each drawn thin or as the whole hand.

    Args:
        server: of the page.
        name: of the branch of the scene that the hands are in.
        grasps: in the frame of the scene.
        gripper: the hand.
        colours: of each grasp, sRGB in [0, 1].
        opacity: below 1 one sees through the hands; None is opaque.
        on_click: called with the index of the grasp that was clicked.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        name: str,
        grasps: Grasps,
        gripper: Gripper,
        colours: Float[np.ndarray, "g 3"],
        opacity: float | None,
        on_click: Callable[[int], None],
    ) -> None:
        self.grasps = grasps
        self._server, self._name, self._gripper = server, name, gripper
        self._colours, self._opacity, self._on_click = colours, opacity, on_click
        self._meshes: dict[tuple[int, bool], viser.MeshHandle] = {}

    def show(self, wanted: Bool[np.ndarray, "g"], whole: bool) -> None:
        """Shows these grasps and no others, drawn thin or whole."""
        for g in np.flatnonzero(wanted).tolist():
            if (g, whole) not in self._meshes:
                self._meshes[g, whole] = self._add(g, whole)
        for (g, is_whole), mesh in self._meshes.items():
            is_shown = bool(wanted[g]) and is_whole == whole
            if mesh.visible != is_shown:
                mesh.visible = is_shown

    def visible(self) -> Int[np.ndarray, "k"]:
        """Indices of the grasps that the page shows at the moment."""
        return np.array(sorted({g for (g, _), mesh in self._meshes.items() if mesh.visible}), dtype=np.int64)

    def mesh(self, g: int, whole: bool = False) -> viser.MeshHandle | None:
        """The mesh of a grasp; None if it was never shown."""
        return self._meshes.get((g, whole))

    def _add(self, g: int, whole: bool) -> viser.MeshHandle:
        opening, pose = float(self.grasps.openings[g]), self.grasps.poses[g]
        drawn = hand_mesh(self._gripper, opening) if whole else slim_hand_mesh(self._gripper, opening)
        mesh = self._server.scene.add_mesh_simple(
            f"/{self._name}/{g}/{'whole' if whole else 'slim'}",
            drawn.vertices,
            drawn.faces,
            color=to_bytes(tuple(self._colours[g])),
            opacity=self._opacity,
            flat_shading=True,
            wxyz=matrix_to_quaternion(pose[:3, :3]),
            position=pose[:3, 3],
        )
        mesh.on_click(lambda _: self._on_click(g))
        return mesh
