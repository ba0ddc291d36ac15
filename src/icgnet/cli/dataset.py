"""`icgnet dataset inspect`: the card of a folder of labelled scenes, and sheets of some of them."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from icgnet.errors import InputError
from icgnet.output_folder import check_replaceable, output_folder

if TYPE_CHECKING:
    from collections.abc import Sequence

    from icgnet.datagen.card import DataCard
    from icgnet.datagen.recipe import Recipe
    from icgnet.objects.object_set import ObjectSet
    from icgnet.viewer.dataset_sheet import LabelledScene

CARD_JSON, CARD_MARKDOWN = "card.json", "card.md"
GOLDEN_ANGLE = 2.4
"""Between the cameras of one scene and the next [rad]: all sides of the table come up."""


@dataclass(frozen=True)
class Inspect:
    """Print the data card of labelled scenes. With --out some of them are drawn, too."""

    data: Path
    """Folder that `icgnet generate` wrote."""
    objects: str | None = None
    """The object set that the scenes were made of, a folder; not needed for 'procedural'."""
    out: Path | None = None
    """Folder for card.json, card.md and the sheets; an earlier one is replaced."""
    scenes: int = 12
    """Scenes to draw."""
    ids: tuple[int, ...] = ()
    """Numbers of the scenes to draw, in place of random ones."""
    checked: int = 40
    """Scenes to check against the objects' meshes (half a second each)."""
    seed: int = 0
    """Decides which scenes are drawn and checked."""
    overwrite: bool = False
    """Replace a folder --out that holds other files."""
    panel: tuple[int, int] = (380, 440)
    """Height and width of one picture of a sheet [pixels]."""

    def run(self) -> None:
        """Prints the card, and writes the folder if there is one to write.

        Raises:
            IcgnetError: no readable data set there, numbers out of range, or a folder `out` with other files.
        """
        if self.scenes < 0 or self.checked < 1:
            raise InputError(f"scenes must be at least 0 and checked at least 1, got {self.scenes} and {self.checked}")
        from icgnet.viewer.sheet import check_panel

        check_panel(self.panel)
        from icgnet.datagen.card import find_objects, make_card
        from icgnet.datagen.recipe import read_manifest, read_recipes

        if self.out is not None:
            check_replaceable(self.out, CARD_JSON, self.overwrite)
        if not self.data.is_dir():
            raise InputError(f"no such folder: {self.data}")
        manifest, recipes = read_manifest(self.data), read_recipes(self.data)
        if not recipes:
            raise InputError(f"{self.data} holds no scenes")
        drawn = self._drawn(recipes)
        object_set, missing = find_objects(manifest, recipes, self.objects)
        console = Console()
        with console.status("checking scenes"):
            card = make_card(self.data, manifest, recipes, object_set, missing, self.checked, self.seed)
        _print_card(card, console)
        if self.out is None:
            return
        with output_folder(self.out, CARD_JSON, self.overwrite) as folder, console.status("drawing scenes"):
            (folder / CARD_JSON).write_text(json.dumps(card.to_json(), indent=2) + "\n")
            (folder / CARD_MARKDOWN).write_text(card.to_markdown())
            if object_set is not None:
                _draw(drawn, object_set, folder, self.panel)
        console.print(f"wrote {self.out}", soft_wrap=True, markup=False)

    def _drawn(self, recipes: "Sequence[Recipe]") -> "list[Recipe]":
        """The scenes to draw."""
        from icgnet.datagen.card import draw_rows

        if not self.ids:
            return [recipes[row] for row in draw_rows(len(recipes), self.scenes, self.seed)]
        by_id = {recipe.scene_id: recipe for recipe in recipes}
        unknown = [number for number in self.ids if number not in by_id]
        if unknown:
            raise InputError(f"there is no scene {unknown[0]}; the scenes are {min(by_id)} to {max(by_id)}")
        return [by_id[number] for number in self.ids]


def _print_card(card: "DataCard", console: Console) -> None:
    for each in card.tables():
        table = Table(title=each.title, title_justify="left")
        for index, column in enumerate(each.columns):
            is_number = index and all(row[index][:1] in "+-.0123456789" for row in each.rows)
            table.add_column(column, justify="right" if is_number else "left")
        for row in each.rows:
            table.add_row(*row)
        console.print(table)
    if card.unchecked:
        console.print(f"no checks and no sheets: {card.unchecked}", soft_wrap=True, markup=False)


def _draw(recipes: "Sequence[Recipe]", object_set: "ObjectSet", folder: Path, panel: tuple[int, int]) -> None:
    from icgnet.viewer.dataset_sheet import draw_dataset_sheets

    draw_dataset_sheets([_labelled_scene(recipe, object_set, panel) for recipe in recipes], folder)


def _labelled_scene(recipe: "Recipe", object_set: "ObjectSet", panel: tuple[int, int]) -> "LabelledScene":
    import numpy as np

    from icgnet.datagen.checks import successful_grasps
    from icgnet.geometry.workspace import TABLE_HEIGHT
    from icgnet.simulation.camera import SceneRenderer
    from icgnet.simulation.scene import scene_triangles, world_mesh
    from icgnet.viewer.dataset_sheet import LabelledScene, sheet_view

    scene = recipe.scene()
    meshes = tuple(world_mesh(placed, object_set) for placed in scene.objects)
    view = sheet_view(meshes, GOLDEN_ANGLE * recipe.scene_id, panel)
    renderer = SceneRenderer(*scene_triangles(scene, object_set), extent=scene.surroundings.extent)
    image = renderer.render(view.intrinsics(panel), panel, view.T_world_camera)
    return LabelledScene(
        title=f"scene {recipe.scene_id} ({recipe.kind})",
        meshes=meshes,
        view=view,
        depth=image.depth.astype(np.float64),
        ids=image.ids,
        positions=recipe.contacts.positions.astype(np.float64),
        normals=recipe.contacts.normals.astype(np.float64),
        scores=recipe.labels().mean(axis=1),
        grasps=successful_grasps(recipe),
        gripper=recipe.gripper,
        structures=tuple(
            each.mesh() for each in scene.surroundings.structures if each.corners[:, 2].max() > TABLE_HEIGHT
        ),
        extent=scene.surroundings.extent,
    )
