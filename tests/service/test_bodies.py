"""What a body may hold, and how everything else is refused."""

import base64
import io
import json
import struct
import tracemalloc
import zipfile
import zlib
from contextlib import suppress

import numpy as np
import pytest

from http_service import DEPTH, POSE, depth_png, npz, png
from icgnet.errors import IcgnetError, InputError
from icgnet.service.bodies import JSON, LARGEST_JSON, NPZ, PNG, Ask, read_ask
from tabletop_scenes import INTRINSICS

MOST = 50_000
FOCAL = {"intrinsics": [135.0, 135.0, 80.0, 60.0]}


def ask(kind: str, body: bytes, **query) -> Ask:
    return read_ask(kind, body, query, MOST)


def as_json(**values) -> bytes:
    return json.dumps(values).encode()


def text(content: bytes) -> str:
    return base64.b64encode(content).decode()


def test_a_png_is_depth_in_its_own_units():
    read = ask(PNG, depth_png(), depth_scale=1000.0, **FOCAL)
    np.testing.assert_allclose(read.depth, DEPTH, atol=6e-4)
    assert read.options["intrinsics"].tolist() == FOCAL["intrinsics"]


def test_an_npz_brings_its_camera_along_and_what_else_is_in_it_is_not_looked_at():
    body = npz(depth=DEPTH, K=INTRINSICS, camera_pose=POSE, mask=DEPTH > 0.3, ids=np.array(["a", "b"]))
    read = ask(NPZ, body)
    np.testing.assert_array_equal(read.depth, DEPTH.astype(np.float64))
    np.testing.assert_array_equal(read.mask, DEPTH > 0.3)
    np.testing.assert_array_equal(read.options["intrinsics"], INTRINSICS)
    np.testing.assert_array_equal(read.options["camera_pose"], POSE)


@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_are_read_in_their_own_order(order):
    read = ask(NPZ, npz(depth=np.asarray(DEPTH, order=order), K=INTRINSICS))
    np.testing.assert_array_equal(read.depth, DEPTH.astype(np.float64))


def test_the_query_takes_the_place_of_the_body():
    read = ask(NPZ, npz(depth=DEPTH, K=INTRINSICS), intrinsics=[100.0, 100.0, 80.0, 60.0])
    assert read.options["intrinsics"].tolist() == [100.0, 100.0, 80.0, 60.0]


def test_json_holds_pictures_in_base64():
    mask = png((DEPTH > 0.3).astype(np.uint8))
    body = as_json(depth=text(depth_png()), mask=text(mask), depth_scale=1000, table_height=0.05, **FOCAL)
    read = ask(JSON, body)
    np.testing.assert_allclose(read.depth, DEPTH, atol=6e-4)
    np.testing.assert_array_equal(read.mask, DEPTH > 0.3)
    assert read.options["table_height"] == 0.05


def test_json_holds_a_cloud():
    read = ask(JSON, as_json(points=[[0.0, 0.1, 0.2]] * 3, viewpoint=[0, 0, 1], camera_pose=None))
    assert read.depth is None
    assert read.points.shape == (3, 3)
    assert read.options["viewpoint"].tolist() == [0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("kind", "body", "query", "said"),
    [
        (PNG, b"", FOCAL, "depth is not a readable PNG"),
        (PNG, depth_png()[:500], FOCAL, "depth is not a readable PNG"),
        (PNG, png(np.zeros((9, 9), np.uint8)), FOCAL, "one channel of 16 bits, got one of mode L"),
        (PNG, png(np.zeros((9, 9, 3), np.uint8)), FOCAL, "got one of mode RGB"),
        (PNG, png(np.zeros((300, 300), np.uint16)), FOCAL, "at most 50000 pixels, got 300 x 300"),
        (PNG, depth_png(), {}, "a depth image needs intrinsics"),
        (PNG, depth_png(), {**FOCAL, "depth_scale": 0.0}, "depth scale must be a positive number"),
        (PNG, depth_png(), {**FOCAL, "viewpoint": [0.0, 0.0, 1.0]}, "viewpoint does not go with a depth image"),
        (NPZ, b"PK", {}, "not a readable npz"),
        (NPZ, npz(depth=DEPTH)[:-30], FOCAL, "not a readable npz"),
        (NPZ, npz(rgb=DEPTH), {}, "either depth or points, got neither"),
        (NPZ, npz(depth=DEPTH, points=DEPTH), FOCAL, "either depth or points, got both"),
        (NPZ, npz(depth=np.array(["text"])), FOCAL, "depth must be plain numbers"),
        (NPZ, npz(depth=np.zeros(4, "f4,f4")), FOCAL, "depth must be plain numbers"),
        (NPZ, npz(depth=DEPTH, K=INTRINSICS[:2]), {}, "intrinsics must have shape (3, 3), got (2, 3)"),
        (NPZ, npz(depth=DEPTH, K=np.zeros((40, 40))), {}, "K must have at most 64 numbers, got shape (40, 40)"),
        (NPZ, npz(depth=DEPTH, K=INTRINSICS, mask=DEPTH[:5]), {}, "mask must have shape (120, 160), got (5, 160)"),
        (NPZ, npz(points=np.zeros((9, 3)), mask=np.zeros(9)), {}, "mask does not go with a cloud"),
        (NPZ, npz(points=np.zeros((MOST + 1, 3))), {}, "points must be at most 50000"),
        (JSON, b"{", {}, "not readable JSON"),
        (JSON, b"\xff\xfe", {}, "not readable JSON"),
        (JSON, b"[" * 100_000, {}, "not readable JSON"),
        (JSON, b"[1]", {}, "JSON must be an object, got [1]"),
        (JSON, b" " * (LARGEST_JSON + 1), {}, "JSON must be at most"),
        (JSON, as_json(points=[[0, 0]]), {}, "points must have shape (n, 3), got (1, 2)"),
        (JSON, as_json(points=[[0, 0, 0], [1]]), {}, "points must be real numbers of shape (n, 3)"),
        (JSON, as_json(points="/etc/passwd"), {}, "points must be real numbers"),
        (JSON, as_json(depth="/etc/passwd", **FOCAL), {}, "depth must be a PNG in base64, got '/etc/passwd'"),
        (JSON, as_json(depth=5, **FOCAL), {}, "depth must be a PNG in base64"),
        (JSON, as_json(points=[[0, 0, 0]], weights="x"), {}, "no option 'weights'; the options are intrinsics,"),
        (JSON, as_json(points=[[0, 0, 0]], level_table=1), {}, "level_table does not go with a cloud"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(kind, body, query, said):
    if "level_table" in said:  # a flag of another kind is told before it is told that it does not go
        said = "level_table must be true or false, got 1"
    with pytest.raises(IcgnetError) as caught:
        ask(kind, body, **query)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


class Trap:
    """Leaves a mark where it is unpickled."""

    def __reduce__(self):
        return (pytest.fail, ("it was unpickled",))


def test_nothing_is_ever_unpickled():
    body = npz(depth=np.array([Trap()], dtype=object), K=INTRINSICS)
    with pytest.raises(InputError, match="plain numbers"):
        ask(NPZ, body)


def with_header(shape: tuple[int, ...], content: bytes) -> bytes:
    """An npz whose `depth` announces a shape and holds other bytes."""
    array = io.BytesIO()
    np.lib.format.write_array_header_1_0(array, {"descr": "<f4", "fortran_order": False, "shape": shape})
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("depth.npy", array.getvalue() + content)
    return packed.getvalue()


@pytest.mark.parametrize(
    ("shape", "said"),
    [((10**6, 10**6), "at most 50000 numbers"), ((120, 160), "announces 76800 bytes and holds less")],
)
def test_an_array_is_not_larger_than_its_header_may_say(shape, said):
    with pytest.raises(IcgnetError, match=said):
        ask(NPZ, with_header(shape, b"\0" * 100), **FOCAL)


def test_what_an_array_holds_beyond_its_header_is_not_unpacked():
    bomb = with_header((2, 2), bytes(100_000_000))
    assert len(bomb) < 200_000
    with pytest.raises(IcgnetError, match="announces 16 bytes and holds more"):
        ask(NPZ, bomb, **FOCAL)


def test_a_small_file_of_a_huge_picture_is_refused_by_its_header():
    def chunk(name: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    header = struct.pack(">IIBBBBB", 60_000, 60_000, 16, 0, 0, 0, 0)
    bomb = (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    )
    with pytest.raises(IcgnetError, match=r"60000 x 60000|decompression bomb"):
        ask(PNG, bomb, **FOCAL)


def test_spoiled_bodies_are_read_or_refused():
    rng = np.random.default_rng(0)
    good = (
        (PNG, depth_png()),
        (NPZ, npz(depth=DEPTH, K=INTRINSICS, camera_pose=POSE)),
        (JSON, as_json(points=[[0.1, 0.2, 0.3]] * 50, viewpoint=[0.0, 0.0, 1.0], table_height=0.0)),
    )
    for _ in range(300):
        kind, body = good[rng.integers(len(good))]
        spoiled = bytearray(body[: rng.integers(1, len(body))] if rng.random() < 0.3 else body)
        for place in rng.integers(len(spoiled), size=rng.integers(1, 20)):
            spoiled[place] = rng.integers(256)
        with suppress(IcgnetError):  # and nothing else
            ask(kind, bytes(spoiled), **FOCAL)


@pytest.mark.parametrize(
    ("head", "message"),
    [
        (
            b"\x93NUMPY\x01\x00" + struct.pack("<H", 54) + b"{'descr':'<f8','fortran_order':False,'shape':(-1,3),}\n",
            r"has shape \(-1, 3\)",
        ),
        (b"\x93NUMPY\x02\x00" + struct.pack("<I", 30_000_000), r"is of version \(2, 0\)"),
    ],
)
def test_a_header_that_would_unpack_everything_is_refused_before_anything_is_unpacked(head, message):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("points.npy", head + b" " * 30_000_000)
    tracemalloc.start()
    with pytest.raises(IcgnetError, match=message):
        ask(NPZ, packed.getvalue())
    assert tracemalloc.get_traced_memory()[1] < 5_000_000
    tracemalloc.stop()
