"""What may be said beside the image or cloud."""

import numpy as np
import pytest

from icgnet.errors import InputError
from icgnet.service.options import OPTIONS, checked_options, options_of_query


def test_every_option_is_read_from_a_query():
    texts = {"number": "2.5", "whole": "3", "flag": "true", "text": "npz"}
    pairs = [
        (name, texts.get(option.kind) or ",".join(["1"] * int(np.prod(option.shapes[0]))))
        for name, option in OPTIONS.items()
    ]
    checked = checked_options(options_of_query(pairs))
    assert set(checked) == set(OPTIONS)
    assert checked["depth_scale"] == 2.5
    assert checked["limit"] == 3
    assert checked["level_table"] is True
    assert checked["region"].tolist() == [1.0] * 6


@pytest.mark.parametrize(
    ("pairs", "said"),
    [
        ([("fly", "1")], "no option 'fly'; the options are intrinsics, depth_scale"),
        ([("limit", "1"), ("limit", "2")], "'limit' is given twice"),
        ([("limit", "many")], "limit must be a whole number, got 'many'"),
        ([("limit", "9" * 5000)], "limit must be a whole number"),
        ([("limit", "-1")], "limit must be at least 0, got -1"),
        ([("table_height", "low")], "table_height must be a number, got 'low'"),
        ([("table_height", "nan")], "table_height .* must be finite"),
        ([("depth_scale", "1e300")], "depth_scale must be within 1e\\+09"),
        ([("level_table", "yes")], "level_table must be true or false, got 'yes'"),
        ([("intrinsics", "1,2,x,4")], "intrinsics must be numbers separated by commas, got '1,2,x,4'"),
        ([("intrinsics", "1,2")], "shape \\(3, 3\\), got \\(2,\\); shapes that are taken, too: \\(4,\\), \\(9,\\)"),
        ([("camera_pose", "1,nan,1,1,1,1,1")], "camera_pose"),
        ([("deadline_ms", "0.5")], "deadline_ms must be at least 1, got 0.5"),
        ([("answer", "xml")], "answer must be one of json, npz, csv, got 'xml'"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(pairs, said):
    with pytest.raises(InputError, match=said) as caught:
        checked_options(options_of_query(pairs))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("limit", 1.5),
        ("limit", True),
        ("frame_id", 5),
        ("level_table", "true"),
        ("region", "abc"),
        ("region", [[1], 2]),
    ],
)
def test_values_of_another_kind_are_refused(name, value):
    with pytest.raises(InputError, match=name):
        checked_options({name: value})


def test_none_is_not_given():
    assert checked_options({"limit": None, "viewpoint": None}) == {}
