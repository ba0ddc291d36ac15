"""Predicted shapes, with a network that predicts a ball."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from icgnet.geometry.clouds import PointCloud
from icgnet.grasping.collision import Collisions, Reason
from icgnet.grasping.frame import grasp_poses
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import load_gripper
from icgnet.grasping.selection import ranked
from icgnet.inference.budget import Budget, Clock
from icgnet.inference.candidates import GraspContacts, keep_free, score_contacts, seen_contacts, surface_contacts
from icgnet.inference.grasp_search import GraspSearch
from icgnet.inference.instances import Instance, encode
from icgnet.inference.rejections import Rejections
from icgnet.inference.shapes import SceneOccupancy, Shape
from icgnet.inference.tabletop import Tabletop
from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.predictor import Predictor

ORIGIN = np.array([0.4, -0.2, 0.0])
CENTRES = np.array([[0.15, 0.15, 0.09], [0.22, 0.15, 0.09]])
RADIUS = 0.03


class BallNetwork(IcgNet):
    """Query k is the ball k; logits are metric."""

    def decode_occupancy(self, embedding, queries, points, stage=-1):
        centres = torch.from_numpy(ORIGIN + CENTRES).float()[queries]
        return 200.0 * (RADIUS - torch.cdist(centres, points))

    def decode_occupancy_pairs(self, embedding, queries, points, instances, stage=-1):
        return self.decode_occupancy(embedding, queries, points, stage).t().gather(1, instances)


def half_ball(centre: np.ndarray) -> np.ndarray:
    """The side of a ball that a camera sees from above."""
    directions = np.random.default_rng(0).normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return centre + RADIUS * directions[directions[:, 2] > 0.1]


@pytest.fixture(scope="module")
def tabletop() -> Tabletop:
    points = ORIGIN + np.concatenate([half_ball(centre) for centre in CENTRES])
    cloud, rows = PointCloud(points, ORIGIN + np.array([0.15, 0.0, 0.6]), "table"), np.arange(len(points))
    return Tabletop(cloud, rows, rows, np.eye(4))


@pytest.fixture(scope="module")
def shapes(tabletop) -> list[Shape]:
    """Both balls, away from the origin."""
    torch.manual_seed(0)
    network = BallNetwork(NETWORKS["tiny"]).eval()
    points = tabletop.cloud.points
    scene, _ = encode(network, tabletop)
    rows = np.array_split(np.arange(len(points)), 2)
    return [Shape.around(network, Instance(scene, k, 1.0, "ball", 1.0, rows[k]), points[rows[k]]) for k in range(2)]


def test_the_mesh_is_the_whole_ball_in_the_table_frame(shapes):
    mesh = shapes[0].mesh
    assert mesh.is_watertight
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices - ORIGIN - CENTRES[0], axis=1), RADIUS, atol=2e-4)


@pytest.mark.parametrize(("doubt", "level"), [(-1.0, 0.0), (0.0, 0.0), (0.3, -0.3), (4.0, -0.5)])
def test_the_surface_goes_through_what_was_seen_where_the_network_doubts_it(tabletop, shapes, doubt, level):
    class DoubtfulNetwork(BallNetwork):
        def decode_occupancy(self, embedding, queries, points, stage=-1):
            return super().decode_occupancy(embedding, queries, points, stage) - doubt

    network = DoubtfulNetwork(NETWORKS["tiny"]).eval()
    shape = Shape.around(network, shapes[0].instance, shapes[0].seen)
    assert shape.level == pytest.approx(level, abs=1e-3)
    # Logits fall by 0.2 a millimetre.
    radius = RADIUS - (doubt + level) / 200.0
    distances = np.linalg.norm(shape.mesh.vertices - ORIGIN - CENTRES[0], axis=1)
    np.testing.assert_allclose(distances, radius, atol=4e-4)


def test_the_lattice_agrees_with_the_network_near_the_surface(shapes):
    directions = np.random.default_rng(1).normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    radii = np.random.default_rng(2).uniform(RADIUS - 0.006, RADIUS + 0.006, (500, 1))
    points = ORIGIN + CENTRES[0] + radii * directions
    exact = 1 / (1 + np.exp(-shapes[0].logits(points)))
    np.testing.assert_allclose(shapes[0].occupancy(points), exact, atol=0.05)


def test_nothing_is_occupied_outside_of_the_box(shapes):
    far = np.stack([shapes[0].lower - 0.01, shapes[0].upper + 0.01])
    np.testing.assert_array_equal(shapes[0].occupancy(far), 0.0)


def test_the_scene_is_the_union_of_its_shapes(shapes):
    probability = SceneOccupancy(shapes)(ORIGIN + np.array([*CENTRES, [0.185, 0.15, 0.09]]))
    assert (probability[:2] > 0.9).all()
    assert probability[2] < 0.5


def test_the_width_by_a_ray_is_the_chord_of_the_ball(shapes):
    normals = np.array([[0.0, -1.0, 0.0], [0.0, -0.8, 0.6]])
    contacts = ORIGIN + CENTRES[0] + np.array([[0.0, -RADIUS, 0.0], RADIUS * np.array([0.0, -0.8, 0.6])])
    np.testing.assert_allclose(shapes[0].widths(contacts, normals, 0.08), 2 * RADIUS, atol=0.003)


@pytest.mark.parametrize("source", ["network", "shape"])
def test_widths_come_from_the_shapes_where_a_ray_hits_them_if_that_is_wanted(shapes, source):
    offsets = np.array([[0.0, -RADIUS, 0.0], [0.0, -RADIUS - 0.02, 0.0]])
    normals, instances = np.array([[0.0, -1.0, 0.0]] * 2), np.zeros(2, dtype=np.int64)
    contacts = GraspContacts(ORIGIN + CENTRES[0] + offsets, normals, instances)
    search = GraspSearch(min_score=0.0, width_from=source)
    grasps, _ = score_contacts(shapes[0].network, shapes, contacts, load_gripper(), search)
    by_network, _ = score_contacts(
        shapes[0].network, shapes, contacts, load_gripper(), replace(search, width_from="network")
    )
    hits = np.isclose(grasps.contacts, contacts.points[0]).all(axis=1)
    assert 0 < hits.sum() < len(hits)
    if source == "shape":
        np.testing.assert_allclose(grasps.widths[hits], 2 * RADIUS, atol=0.003)
        assert not np.isclose(by_network.widths, 2 * RADIUS, atol=0.003).any()
    assert set(grasps.widths[~hits]) <= set(by_network.widths)


def test_a_grasp_is_worth_as_much_as_what_it_is_on_is_an_object(shapes):
    doubted = [shapes[0], replace(shapes[1], instance=replace(shapes[1].instance, score=0.25))]
    normals, instances = np.array([[0.0, -1.0, 0.0]] * 2), np.array([0, 1])
    contacts = GraspContacts(ORIGIN + CENTRES + np.array([0.0, -RADIUS, 0.0]), normals, instances)
    search = GraspSearch(min_score=0.0)
    sure, unsure = (
        score_contacts(each[0].network, each, contacts, load_gripper(), search)[0] for each in (shapes, doubted)
    )
    for angle in range(12):
        before, after = (each.select((each.instances == 1) & (each.angles == angle)).scores for each in (sure, unsure))
        np.testing.assert_allclose(after, 0.25 * before)
    np.testing.assert_array_equal(
        np.sort(sure.scores[sure.instances == 0]), np.sort(unsure.scores[unsure.instances == 0])
    )
    dropped = score_contacts(shapes[0].network, doubted, contacts, load_gripper(), GraspSearch(min_score=0.25))[0]
    assert 1 not in dropped.instances


def test_every_object_gets_a_contact_however_few_are_wanted(shapes, tabletop):
    instances = [shape.instance for shape in shapes]
    contacts = seen_contacts(tabletop, instances, 1, np.random.default_rng(0))
    assert contacts.instances.tolist() == [0, 1]
    assert set(surface_contacts(SceneOccupancy(shapes), np.arange(2), 1, np.random.default_rng(0)).instances) == {0, 1}


def test_a_ray_that_misses_the_shape_has_no_width_and_one_that_never_leaves_is_too_wide(shapes):
    normal = np.array([[0.0, -1.0, 0.0]])
    beside = ORIGIN + CENTRES[:1] + np.array([[0.0, -RADIUS - 0.02, 0.0]])
    assert np.isnan(shapes[0].widths(beside, normal, 0.08)).all()
    touching = ORIGIN + CENTRES[:1] + np.array([[0.0, -RADIUS, 0.0]])
    assert np.isinf(shapes[0].widths(touching, normal, 0.04)).all()


def test_surface_contacts_lie_on_the_ball_with_outward_normals(shapes):
    contacts = surface_contacts(SceneOccupancy(shapes), np.arange(2), 128, np.random.default_rng(0))
    offsets = contacts.points - ORIGIN - CENTRES[contacts.instances]
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), RADIUS, atol=5e-4)
    assert (np.einsum("cd,cd->c", offsets, contacts.normals) > 0.98 * RADIUS).all()
    assert (offsets[:, 2] < 0).sum() > 20, "also the side that the camera does not see"


def from_above(ball: int, direction: np.ndarray) -> Grasps:
    """A grasp from straight above whose fingers close on a ball along a direction."""
    contact = ORIGIN + CENTRES[ball] + RADIUS * direction
    width = np.array([2 * RADIUS])
    poses = grasp_poses(contact[None], direction[None], width)[0]
    vertical = int(poses[:, 2, 2].argmin())
    return Grasps(
        poses=poses[[vertical]],
        widths=width,
        openings=load_gripper().opening(width),
        scores=np.array([0.9]),
        instances=np.array([ball]),
        contacts=contact[None],
        angles=np.array([vertical]),
    )


def check(grasps: Grasps, shapes: list[Shape], tabletop: Tabletop) -> tuple[Grasps, Rejections]:
    return keep_free(grasps, SceneOccupancy(shapes), 2, tabletop, load_gripper(), GraspSearch())


def test_a_grasp_across_two_balls_in_a_row_is_free(shapes, tabletop):
    free, rejected = check(from_above(0, np.array([0.0, -1.0, 0.0])), shapes, tabletop)
    assert len(free) == 1
    assert not rejected.counts.any()


def test_a_grasp_with_a_finger_in_the_neighbour_is_rejected(shapes, tabletop):
    free, rejected = check(from_above(0, np.array([1.0, 0.0, 0.0])), shapes, tabletop)
    assert len(free) == 0
    assert rejected.total()["points"] + rejected.total()["object"] == 1


def test_a_grasp_through_the_table_is_rejected(shapes, tabletop):
    low = from_above(0, np.array([0.0, -1.0, 0.0]))
    low.poses[:, 2, 3] -= 0.05
    free, rejected = check(low, shapes, tabletop)
    assert len(free) == 0
    assert rejected.total()["table"] == 1


def test_the_hand_is_opened_wider_than_predicted_where_nothing_is_in_the_way(tabletop):
    gripper, grasp = load_gripper(), from_above(0, np.array([0.0, -1.0, 0.0]))
    tabletop = replace(tabletop, above=tabletop.above[:0])
    opening, spare = 0.05, GraspSearch().spare_opening
    grasp = replace(grasp, openings=np.array([opening]))
    assert 0.0 < spare <= gripper.max_opening - opening
    tip = gripper.boxes(opening)[-1]
    outside = abs(tip.centre[1]) + tip.size[1] / 2

    def walls(points: np.ndarray) -> np.ndarray:
        low = points[:, 2] < grasp.poses[0, 2, 3] + 0.005  # beside the finger tips, below the palm
        return 1.0 * (low & (np.abs(points[:, 1] - grasp.poses[0, 1, 3]) > outside + 0.001))

    for occupancy, wanted in ((lambda points: np.zeros(len(points)), opening + spare), (walls, opening)):
        free, _ = keep_free(grasp, occupancy, 1, tabletop, gripper, GraspSearch())
        np.testing.assert_allclose(free.openings, wanted)
    free, _ = keep_free(grasp, occupancy, 1, tabletop, gripper, GraspSearch(spare_opening=0.0))
    np.testing.assert_allclose(free.openings, opening)


def test_checking_stops_when_every_object_has_enough_and_the_rest_is_counted(shapes, tabletop):
    free_one = from_above(0, np.array([0.0, -1.0, 0.0]))
    many = Grasps.concatenate([free_one] * 120)
    kept, rejected = keep_free(many, SceneOccupancy(shapes), 2, tabletop, load_gripper(), GraspSearch(per_object=4))
    assert len(kept) == 48, "one batch"
    assert rejected.total()["unchecked"] == 72


@pytest.mark.parametrize(("good_score", "resampled"), [(1.0, True), (0.0, False)])
def test_unseen_sides_are_tried_only_when_the_seen_ones_give_too_few_good_grasps(
    shapes, tabletop, good_score, resampled
):
    few = 5 if resampled else 0
    search = GraspSearch(contacts=48, max_checked=48, min_score=0.0, most=5, few=few, good_score=good_score)
    rejected = search_for(shapes, tabletop, search)
    assert (rejected["unchecked"] > 100 * 12) == resampled


def search_for(shapes: list[Shape], tabletop: Tabletop, search: GraspSearch) -> dict[str, int]:
    """How many candidates a search drops, by reason; each ball is an object."""
    predictor = Predictor(shapes[0].network, load_gripper(), search)
    return predictor._search(tabletop, [[shape] for shape in shapes], np.random.default_rng(0), Clock(), Budget())[
        1
    ].total()


@pytest.mark.parametrize(("min_score", "resampled"), [(0.0, False), (1.0, True)])
def test_unseen_sides_are_tried_of_every_object_that_has_no_grasp(shapes, tabletop, min_score, resampled, monkeypatch):
    asked = []

    def spy(occupancy, chosen, budget, rng):
        asked.extend(chosen.tolist())
        return surface_contacts(occupancy, chosen, budget, rng)

    monkeypatch.setattr("icgnet.predictor.surface_contacts", spy)
    monkeypatch.setattr(
        "icgnet.inference.candidates.check_collisions",
        lambda poses, *_, **__: Collisions(np.full(len(poses), Reason.FREE, dtype=np.int8)),
    )
    search_for(shapes, tabletop, GraspSearch(contacts=48, per_object=4, min_score=min_score, few=0))
    assert asked == ([0, 1] if resampled else [])


def test_no_more_candidates_are_checked_than_asked_for(shapes, tabletop):
    many = Grasps.concatenate([from_above(0, np.array([0.0, -1.0, 0.0]))] * 120)
    kept, rejected = keep_free(
        many, SceneOccupancy(shapes), 2, tabletop, load_gripper(), GraspSearch(per_object=100, max_checked=70)
    )
    assert len(kept) == 70
    assert rejected.total()["unchecked"] == 50


def test_contacts_join_in_order():
    one = GraspContacts(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(2, dtype=np.int64))
    both = GraspContacts.concatenate([one, GraspContacts(np.ones((1, 3)), np.ones((1, 3)), np.ones(1, dtype=np.int64))])
    np.testing.assert_array_equal(both.instances, (0, 0, 1))


def test_the_highest_free_grasp_is_found_below_as_many_others_as_there_are(shapes, tabletop):
    best, many = from_above(0, np.array([0.0, 1.0, 0.0])), 40
    grasps = Grasps.concatenate([best] * many)
    poses, scores = grasps.poses.copy(), np.linspace(0.99, 0.91, many)
    poses[:, 2, 3] += 1e-5 * np.arange(many)  # the lower the score, the higher the hand
    grasps = replace(grasps, poses=poses, scores=scores)
    for rule, first in (("best", 0), ("highest", many - 1)):
        search = GraspSearch(per_object=4, most=4, select=rule)
        free, _ = keep_free(ranked(grasps, rule), SceneOccupancy(shapes), 2, tabletop, load_gripper(), search)
        assert free.scores[0] == scores[first]
