import numpy as np
import pytest

from icgnet.errors import InputError
from icgnet.objects.object_set import ObjectSet, load_object_set
from icgnet.simulation.config import Physics
from icgnet.simulation.physics import Body
from icgnet.simulation.scene import scene_triangles, world_mesh
from icgnet.simulation.scenes import draw_count, spawn_scene
from icgnet.simulation.world import World


@pytest.fixture(scope="module")
def object_set():
    return load_object_set("procedural")


@pytest.fixture(scope="module")
def scenes(object_set):
    return {
        kind: [spawn_scene(kind, object_set, "train", np.random.default_rng(seed), count=4) for seed in range(3)]
        for kind in ("packed", "pile")
    }


def _bodies(scene, object_set):
    return [Body(object_set.model(o.name), o.scale, o.T_world_object) for o in scene.objects]


@pytest.mark.parametrize("kind", ["packed", "pile"])
def test_objects_rest_on_the_table_inside_the_workspace(scenes, object_set, kind):
    for scene in scenes[kind]:
        assert 1 <= len(scene.objects) <= 4
        for placed in scene.objects:
            mesh = world_mesh(placed, object_set)
            assert mesh.bounds[0, 2] > 0.05 - 0.002
            assert (mesh.center_mass[:2] > 0).all()
            assert (mesh.center_mass[:2] < 0.3).all()


@pytest.mark.parametrize("kind", ["packed", "pile"])
def test_objects_stay_where_the_scene_has_them(scenes, object_set, kind):
    for scene in scenes[kind]:
        world = World(_bodies(scene, object_set), Physics())
        world.step(125)
        before = np.stack([placed.T_world_object[:3, 3] for placed in scene.objects])
        assert np.linalg.norm(world.object_positions() - before, axis=1).max() < 0.01


def test_packed_objects_stand_upright_and_apart(scenes, object_set):
    upright = [o.T_world_object[2, 2] for scene in scenes["packed"] for o in scene.objects]
    assert np.mean(np.array(upright) > np.cos(np.deg2rad(20))) > 0.8
    assert all(0.7 <= o.scale <= 0.8 for scene in scenes["packed"] for o in scene.objects)


def test_pile_objects_lie_in_any_orientation(scenes):
    upright = [abs(o.T_world_object[2, 2]) for scene in scenes["pile"] for o in scene.objects]
    assert min(upright) < 0.7
    assert all(0.8 <= o.scale <= 1.0 for scene in scenes["pile"] for o in scene.objects)


@pytest.mark.parametrize("kind", ["packed", "pile"])
def test_the_same_stream_gives_the_same_scene(scenes, object_set, kind):
    again = spawn_scene(kind, object_set, "train", np.random.default_rng(1), count=4)
    for first, second in zip(scenes[kind][1].objects, again.objects, strict=True):
        assert (first.name, first.scale) == (second.name, second.scale)
        np.testing.assert_array_equal(first.T_world_object, second.T_world_object)


def test_scenes_use_the_objects_of_their_split(scenes, object_set):
    assert all(o.name in object_set.names("pile", "train") for scene in scenes["pile"] for o in scene.objects)


def test_object_counts_are_like_a_poisson_draw():
    rng = np.random.default_rng(0)
    counts = np.array([draw_count(rng) for _ in range(4000)])
    assert counts.min() == 1
    assert counts.max() == 10
    assert counts.mean() == pytest.approx(5.0, abs=0.1)


def test_triangles_know_their_objects(scenes, object_set):
    scene = scenes["packed"][0]
    triangles, owners = scene_triangles(scene, object_set)
    for index, placed in enumerate(scene.objects):
        own = triangles[owners == index].reshape(-1, 3)
        np.testing.assert_allclose([own.min(0), own.max(0)], world_mesh(placed, object_set).bounds)


class NoObjects(ObjectSet):
    """An object set for another kind of scene."""

    def names(self, kind, split):
        return ()

    def class_name(self, key):
        raise NotImplementedError

    def _load(self, key):
        raise NotImplementedError

    def fingerprint(self, key):
        raise NotImplementedError


def test_an_object_set_without_objects_for_the_scene_is_refused(rng):
    with pytest.raises(InputError, match="'empty' has no objects for pile scenes in split 'train'"):
        spawn_scene("pile", NoObjects("empty"), "train", rng)
