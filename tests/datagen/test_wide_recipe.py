import json
from dataclasses import replace

import numpy as np

from icgnet.datagen.recipe import MANIFEST, read_recipes, write_shard
from icgnet.simulation.config import WideScenes
from icgnet.simulation.furniture import draw_bin
from shape_scenes import HEADER, make_recipe


def test_surroundings_stretch_and_another_hand_survive_the_file(tmp_path):
    hand = replace(HEADER.gripper, name="other", finger_force=HEADER.gripper.finger_force + 1.0)
    around = draw_bin(WideScenes(), np.random.default_rng(3))
    stretch = (1.0, float(np.float32(1.1)), 1.0)
    plain = make_recipe(0)
    objects = (replace(plain.objects[0], stretch=stretch), *plain.objects[1:])
    wide = replace(plain, scene_id=1, kind="bin", gripper=hand, objects=objects, surroundings=around)
    (tmp_path / MANIFEST).write_text(json.dumps(HEADER.to_dict()))
    write_shard(tmp_path / "scenes.parquet", [plain, wide], HEADER)
    first, second = read_recipes(tmp_path)
    assert first.surroundings.extent is None
    assert first.surroundings.structures == ()
    assert first.gripper.same_hand(HEADER.gripper)
    assert second.gripper.differences(hand) == []
    assert not second.gripper.same_hand(HEADER.gripper)
    assert second.kind == "bin"
    assert second.objects[0].stretch == stretch
    assert second.scene().objects[0].stretch == stretch
    assert second.surroundings.extent == around.extent
    for read, written in zip(second.surroundings.structures, around.structures, strict=True):
        assert read.name == written.name
        np.testing.assert_array_equal(read.corners, written.corners)
