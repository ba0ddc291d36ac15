"""Collisions and clearances against what can be worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

import needs_arm  # noqa: F401
from icgnet.arm.bodies import CollisionBody
from icgnet.arm.scene import CARRIED, CLEARANCE_STEP, HAND, CollisionChecker, Load, Meeting, hand_boxes

OPEN = Load(0.05, 0.05)


def block(x, y, z, size=(0.1, 0.1, 0.1), name="object 0"):
    return CollisionBody(name, trimesh.creation.box(size).apply_translation([x, y, z]), 0)


@pytest.fixture
def tips(fr3, hand):
    """Where the finger tips are at home, in the frame of the base."""
    return fr3.grasp_pose(fr3.home, hand)[:3, 3]


@pytest.mark.parametrize("gap", [0.0, 0.004, 0.02])
def test_the_clearance_below_the_hand_is_the_gap(fr3, hand, tips, gap):
    checker = CollisionChecker(fr3, hand, [block(tips[0], tips[1], tips[2] - gap - 0.05 - 1e-5)], OPEN)
    clearance, nearest = checker.clearance(fr3.home[None])
    assert clearance == pytest.approx(gap, abs=CLEARANCE_STEP)
    assert nearest == Meeting(HAND, "object 0")
    assert not checker.collides(fr3.home)
    assert checker.collides(fr3.home, gap + 0.001)


def test_far_away_nothing_is_near(fr3, hand):
    assert CollisionChecker(fr3, hand, [block(0.3, 0.6, 0.1)], OPEN).clearance(fr3.home[None]) == (0.05, None)


@pytest.mark.parametrize("depth", [0.0005, 0.003])
def test_the_depth_of_a_hand_in_a_block_is_told(fr3, hand, tips, depth):
    checker = CollisionChecker(fr3, hand, [block(tips[0], tips[1], tips[2] + depth - 0.05)], OPEN)
    assert checker.meetings(fr3.home) == (Meeting(HAND, "object 0"),)
    assert checker.clearance(fr3.home[None])[0] == 0.0
    deepest, meeting = checker.deepest(fr3.home)
    assert deepest == pytest.approx(depth, abs=1e-4)
    assert meeting == Meeting(HAND, "object 0")


def test_what_is_untested_or_absent_does_not_count(fr3, hand, tips):
    bodies = [block(tips[0], tips[1], tips[2] - 0.04)]
    for load in (
        Load(0.05, 0.05, untested=frozenset({Meeting(HAND, "object 0")})),
        Load(0.05, 0.05, absent=frozenset({"object 0"})),
    ):
        assert not CollisionChecker(fr3, hand, bodies, load).collides(fr3.home)


def test_between_the_fingers_there_is_room_for_the_opening(fr3, hand, tips):
    bodies = [block(*(tips + [0, 0, 0.01]), size=(0.01, 0.045, 0.02))]
    assert not CollisionChecker(fr3, hand, bodies, OPEN).collides(fr3.home)
    assert CollisionChecker(fr3, hand, bodies, Load(0.04, 0.04)).collides(fr3.home)
    assert CollisionChecker(fr3, hand, bodies, Load(0.04, 0.05)).collides(fr3.home)  # on the way


def test_closing_fingers_cover_all_openings_between(hand):
    swept = hand_boxes(hand, 0.02, 0.06)
    for opening in (0.02, 0.03, 0.06):
        for box, whole in zip(hand.boxes(opening), swept, strict=True):
            assert (np.array(whole.corners()["lower"]) <= np.array(box.corners()["lower"]) + 1e-9).all()
            assert (np.array(whole.corners()["upper"]) >= np.array(box.corners()["upper"]) - 1e-9).all()


def test_the_carried_object_moves_with_the_hand(fr3, hand, tips):
    held = block(tips[0], tips[1], tips[2] - 0.06, name="object 3")
    T_base_gripped = fr3.grasp_pose(fr3.home, hand)
    load = Load(0.05, 0.05, carried=held, T_base_gripped=T_base_gripped)
    shelf = block(0.0, tips[0], tips[2] - 0.06 - 0.1 - 0.02, name="shelf")  # under the hand after a quarter turn
    checker = CollisionChecker(fr3, hand, [held, shelf], load)
    assert not checker.collides(fr3.home)
    turned = fr3.home + np.array([np.pi / 2, 0, 0, 0, 0, 0, 0])
    clearance, nearest = checker.clearance(turned[None])
    assert clearance == pytest.approx(0.02, abs=CLEARANCE_STEP)
    assert nearest == Meeting(CARRIED, "shelf")


def test_a_carried_object_keeps_its_padding_and_clearances_do_not_count_it(fr3, hand, tips):
    held, shelf = block(*(tips - [0, 0, 0.06]), name="object 3"), block(*(tips - [0, 0, 0.162]), name="shelf")
    load = Load(0.05, 0.05, carried=held, T_base_gripped=fr3.grasp_pose(fr3.home, hand), padding=0.004)
    checker = CollisionChecker(fr3, hand, [held, shelf], load)
    assert checker.meetings(fr3.home) == (Meeting(CARRIED, "shelf"),)  # 2 mm apart
    clearance, nearest = checker.clearance(fr3.home[None])
    assert clearance == pytest.approx(0.002, abs=CLEARANCE_STEP)
    assert nearest == Meeting(CARRIED, "shelf")
    near = replace(load, unpadded=frozenset({Meeting(CARRIED, "shelf")}))
    assert not CollisionChecker(fr3, hand, [held, shelf], near).collides(fr3.home)
    assert CollisionChecker(fr3, hand, [held, shelf], near).collides(fr3.home, 0.003)


def test_a_carried_object_meets_every_link_but_the_one_that_holds_it(fr3, hand):
    # A rod on the flange that reaches to the link before the last one, and far beyond.
    flange = fr3.mount_pose(fr3.home)[:3, 3]
    rod = block(*(flange + [-0.088, 0, 0.02]), size=(0.2, 0.02, 0.1), name="object 3")
    load = Load(0.05, 0.05, carried=rod, T_base_gripped=fr3.grasp_pose(fr3.home, hand))
    met = {each.body for each in CollisionChecker(fr3, hand, [], load).meetings(fr3.home) if each.part == CARRIED}
    assert "fr3_link6" in met
    assert "fr3_link7" not in met


def test_the_arm_keeps_the_margin_from_itself_too(fr3, hand):
    checker = CollisionChecker(fr3, hand, [], OPEN)
    drawn = np.random.default_rng(0).uniform(fr3.lower, fr3.upper, (300, 7))
    near = [joints for joints in drawn if not checker.collides(joints) and checker.collides(joints, 0.02)]
    assert 0 < len(near) < 100


def test_the_arm_meets_itself(fr3, hand):
    checker = CollisionChecker(fr3, hand, [], OPEN)
    assert not checker.collides(fr3.home)
    folded = np.array([0.0, 1.5, 0.0, -2.7, 0.0, 0.9, 0.7])
    assert {meeting.part for meeting in checker.meetings(folded)} >= {HAND}


@pytest.mark.parametrize("margin", [0.0, 0.005])
def test_a_path_is_free_if_all_of_it_is_however_few_are_tested(fr3, hand, margin):
    checker = CollisionChecker(fr3, hand, [block(0.0, 0.3, 0.5)], OPEN)
    path = fr3.home + np.linspace(0.0, 1.0, 400)[:, None] * np.array([1.5, 0, 0, 0, 0, 0, 0])
    step = 1.5 / 399 * checker.reaches[0]
    at = checker.first_collision(path, margin)
    tested = []
    meets, checker._meets = checker._meets, lambda joints: tested.append(0) or meets(joints)
    assert checker.is_free(path[:at], margin, step)
    assert len(tested) < 0.7 * at
    assert not checker.is_free(path[: at + 1], margin, step)


def test_the_first_collision_of_a_path_is_found(fr3, hand):
    path = fr3.home + np.linspace(0.0, 1.0, 50)[:, None] * np.array([1.5, 0, 0, 0, 0, 0, 0])
    checker = CollisionChecker(fr3, hand, [block(0.0, 0.3, 0.5)], OPEN)
    at = checker.first_collision(path)
    assert 0 < at < 50
    assert [checker.collides(joints) for joints in path[: at + 1]] == [False] * at + [True]
