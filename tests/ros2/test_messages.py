"""The bytes of every message are those that another library makes from the definitions of Jazzy."""

import dataclasses
import struct
from typing import get_type_hints

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

pytest.importorskip("cyclonedds", reason="needs icgnet[ros2]")
pytest.importorskip("rosbags", reason="needs rosbags, of icgnet[dev]")

from icgnet.ros2.messages import MESSAGES, Header, Image, Time
from jazzy_messages import KNOWN, OTHERS, STORE, fields, same, theirs, values

NAMES = sorted(MESSAGES)


def ours(kind: type, content: dict):
    """Our message with this content: its own defaults tell what its fields are made of."""
    blank = kind()
    made = {}
    for field in dataclasses.fields(kind):
        value = content[field.name]
        if dataclasses.is_dataclass(getattr(blank, field.name)):
            value = ours(type(getattr(blank, field.name)), value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            value = [ours(element_of(kind, field.name), each) for each in value]
        made[field.name] = value
    return kind(**made)


def element_of(kind: type, name: str) -> type:
    """What the list of this name holds, by the definitions of Jazzy."""
    ros_name = next(ros for ros, known in MESSAGES.items() if known is kind)
    (_, (_, (element, _))) = next(each for each in fields(ros_name) if each[0] == name)
    return MESSAGES[element[1]]


def content_of(message) -> dict:
    if dataclasses.is_dataclass(message):
        return {field.name: content_of(getattr(message, field.name)) for field in dataclasses.fields(message)}
    return [content_of(each) for each in message] if isinstance(message, list | np.ndarray) else message


def test_only_what_the_other_library_does_not_know_is_written_down_here():
    assert set(NAMES) - KNOWN == set(OTHERS)


@pytest.mark.parametrize("name", NAMES)
def test_fields_have_the_names_of_jazzy_in_their_order(name):
    assert [field.name for field in dataclasses.fields(MESSAGES[name])] == [field for field, _ in fields(name)]


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_bytes_are_those_of_the_other_library(name, data):
    content = data.draw(values(name))
    message = ours(MESSAGES[name], content)
    expected = bytes(STORE.serialize_cdr(theirs(name, content), name))
    assert message.serialize() == expected
    assert same(content_of(MESSAGES[name].deserialize(expected)), content)


def test_no_field_is_of_a_deprecated_type():
    hints = [repr(get_type_hints(kind, include_extras=True)) for kind in MESSAGES.values()]
    assert any("Sequence" in hint for hint in hints)
    assert not any("typing.Sequence" in hint for hint in hints)


@pytest.mark.parametrize("name", NAMES)
def test_a_new_message_holds_what_a_new_one_of_ros_holds(name):
    def blank(of: str) -> dict:
        made = {}
        for field, (node, about) in fields(of):
            if node == 2:
                made[field] = blank(about)
            elif node == 3:
                made[field] = [0] * about[1]
            elif node == 4:
                made[field] = []
            else:
                made[field] = {"string": "", "bool": False}.get(about[0], 0)
        return made | ({"w": 1.0} if of == "geometry_msgs/msg/Quaternion" else {})

    assert same(content_of(MESSAGES[name]()), blank(name))


@pytest.mark.parametrize("frame_id", ["", "c", "ca", "cam", "came", "camera", "kamerä"])
@pytest.mark.parametrize("encoding", ["", "16UC1", "32FC1", "mono16"])
def test_an_image_is_read_whatever_stands_before_its_pixels(frame_id, encoding):
    pixels = list(range(24))
    image = Image(Header(Time(1, 2), frame_id), 3, 4, encoding, 0, 8, pixels)
    content = image.serialize()
    read = Image.deserialize(content + b"\0" * (-len(content) % 4))
    np.testing.assert_array_equal(read.data, pixels)
    assert (read.header, read.width, read.encoding, read.step) == (image.header, 4, encoding, 8)


def test_an_image_of_the_other_byte_order_is_read():
    head = b"\x00\x00\x00\x00" + struct.pack(">iII4sII", 5, 6, 4, b"cam\0", 1, 2)
    content = head + struct.pack(">I6sBxII4B", 6, b"16UC1\0", 1, 4, 4, 1, 2, 3, 4)
    read = Image.deserialize(content)
    assert (read.header.stamp.sec, read.header.frame_id, read.height, read.width) == (5, "cam", 1, 2)
    assert (read.encoding, read.is_bigendian, read.step, read.data.tolist()) == ("16UC1", 1, 4, [1, 2, 3, 4])


def test_an_image_that_is_cut_short_is_refused():
    content = Image(Header(Time(), "camera"), 1, 4, "16UC1", 0, 8, list(range(8))).serialize()
    with pytest.raises(ValueError, match="smaller"):
        Image.deserialize(content[:-3])
