import json
from dataclasses import replace

import pytest

from icgnet.errors import InputError
from icgnet.network.config import NETWORKS, NetworkConfig


@pytest.mark.parametrize("name", NETWORKS)
def test_configuration_survives_json(name):
    config = NETWORKS[name]
    assert config.name == name
    assert NetworkConfig.from_dict(json.loads(json.dumps(config.to_dict()))) == config


def test_unknown_fields_are_named():
    with pytest.raises(InputError, match="colour"):
        NetworkConfig.from_dict({**NETWORKS["tiny"].to_dict(), "colour": True})


@pytest.mark.parametrize("change", [{"heads": 3}, {"dilations": (1, 2)}, {"dense_widths": (4, 4)}])
def test_sizes_that_make_no_network_are_input_errors(change):
    with pytest.raises(InputError):
        replace(NETWORKS["tiny"], **change)
