import json
from dataclasses import replace

import pytest

from icgnet.errors import InputError
from icgnet.network.config import NETWORKS, NetworkConfig
from icgnet.objects.classes import CLASSES


@pytest.mark.parametrize("name", NETWORKS)
def test_configuration_survives_json(name):
    config = NETWORKS[name]
    assert config.name == name
    assert NetworkConfig.from_dict(json.loads(json.dumps(config.to_dict()))) == config


def test_unknown_fields_are_named():
    with pytest.raises(InputError, match="colour"):
        NetworkConfig.from_dict({**NETWORKS["tiny"].to_dict(), "colour": True})


@pytest.mark.parametrize(
    "change",
    [
        {"heads": 3},
        {"dilations": (1, 2)},
        {"dense_widths": (4, 4)},
        {"voxel_size": 0.0},
        {"tokens_per_level": (0, 1, 1, 1)},
        {"classes": ()},
        {"reach": 0.0},
        {"seed_spacing": 0.0},
    ],
)
def test_sizes_that_make_no_network_are_input_errors(change):
    with pytest.raises(InputError):
        replace(NETWORKS["tiny"], **change)


def test_presets_have_the_classes_of_the_one_list_and_others_are_kept():
    more = replace(NETWORKS["tiny"], classes=(*CLASSES, "vase"))
    assert NETWORKS["default"].classes == CLASSES
    assert NetworkConfig.from_dict(json.loads(json.dumps(more.to_dict()))).classes[-1] == "vase"


def test_the_same_hand_under_another_name_is_the_same_configuration():
    config = replace(NETWORKS["tiny"], affordance="contact")
    mounted = replace(config.gripper, name="mine", base_offset=(0.0, 0.0, -0.2))
    assert config.differences(replace(config, gripper=mounted)) == []
    wide = replace(config.gripper, name="wide", max_opening=0.1)
    assert NETWORKS["tiny"].differences(replace(NETWORKS["tiny"], gripper=wide)) == []
    assert config.differences(replace(config, gripper=wide, queries=9)) == [
        "its hand is 'wide', wanted 'franka' with max_opening 0.08 instead of 0.1",
        "queries is 9, wanted 8",
    ]


def test_a_hand_that_the_network_does_not_know_is_refused():
    config = replace(NETWORKS["tiny"], affordance="contact")
    config.check_hand(replace(config.gripper, name="mine"), "the scenes")
    message = r"the scenes have the hand 'x', .* know only 'franka' \('x' has friction 1 instead of 0.75\)"
    with pytest.raises(InputError, match=message):
        config.check_hand(replace(config.gripper, name="x", friction=1.0), "the scenes")


def test_a_network_that_reads_at_the_hand_takes_any():
    config = NETWORKS["tiny"]
    assert config.any_hand
    config.check_hand(replace(config.gripper, name="x", friction=1.0), "the scenes")


def test_only_a_network_of_fixed_extent_has_a_number_of_instances():
    assert NETWORKS["paper"].most_instances == 32
    assert NETWORKS["default"].most_instances is None
