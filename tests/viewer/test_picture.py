from dataclasses import replace

import numpy as np
from PIL import Image

from icgnet.geometry.camera import look_at
from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.transforms import invert_transform
from icgnet.inference.prediction import Prediction
from icgnet.viewer.describe import best_per_object, summary
from icgnet.viewer.palette import instance_colour
from icgnet.viewer.picture import draw_prediction, prediction_picture

SIZE = (450, 800)
"""A quarter of the pixels: nothing that is tested here depends on how many there are."""


def drawn(prediction: Prediction, title: str | None = None) -> Image.Image:
    return prediction_picture(prediction, title, SIZE)


def hue_share(image: Image.Image, colour: tuple[float, float, float]) -> np.ndarray:
    """Which pixels have the hue of a colour, whatever the light."""
    pixels = np.asarray(image).astype(float)
    pixels -= pixels.min(axis=2, keepdims=True)
    wanted = np.array(colour) - min(colour)
    strength = np.linalg.norm(pixels, axis=2)
    cosine = pixels @ wanted / (np.linalg.norm(wanted) * np.maximum(strength, 1e-9))
    return (cosine > 0.985) & (strength > 60)


def halves(image: Image.Image) -> tuple[Image.Image, Image.Image]:
    middle = image.width // 2
    return image.crop((0, 0, middle, image.height)), image.crop((middle, 0, image.width, image.height))


def test_both_panels_show_every_object_in_its_colour_at_the_same_place(make_prediction):
    bare = replace(make_prediction(), grasps=make_prediction(grasps_each=0).grasps)
    panels = halves(drawn(bare))
    for instance in (0, 1):
        places = []
        for panel in panels:
            found = hue_share(panel, instance_colour(instance))
            assert found.sum() > 300
            places.append(np.median(np.argwhere(found), axis=0))
        assert np.linalg.norm(places[0] - places[1]) < 25


def test_hands_are_visible_and_green_or_yellow(make_prediction):
    """Scores are high, so the hands are at the green end of the scale, which no object uses."""

    def greenish(image: Image.Image) -> int:
        red, green, blue = np.moveaxis(np.asarray(image).astype(int)[:-60], 2, 0)
        return int(((green > blue + 60) & (green > red + 10)).sum())

    with_hands, without = make_prediction(), make_prediction(grasps_each=0)
    assert greenish(drawn(with_hands)) > 500
    assert greenish(drawn(without)) == 0


def test_a_prediction_in_a_camera_frame_gives_the_same_picture(make_prediction):
    T_camera_table = invert_transform(look_at(np.array([0.5, -0.3, 0.6]), np.array([0.15, 0.15, 0.05])))
    upright = np.asarray(drawn(make_prediction())).astype(int)
    camera = np.asarray(drawn(make_prediction(T_camera_table))).astype(int)
    assert (np.abs(upright - camera).max(axis=2) > 8).mean() < 0.01


def test_an_empty_prediction_is_a_picture_too(make_prediction, tmp_path):
    found = make_prediction(grasps_each=0)
    nothing = np.zeros(0, dtype=np.int64)
    empty = replace(
        found,
        objects=(),
        cloud=PointCloud(np.zeros((0, 3)), None),
        cloud_instances=nothing,
        input_rows=nothing,
        timings_ms={},
    )
    draw_prediction(empty, tmp_path / "empty.png", size=SIZE)
    with Image.open(tmp_path / "empty.png") as image:
        assert image.size == (800, 450)
    assert summary(empty) == "0 objects  ·  0 grasps"


def test_without_objects_the_cloud_is_drawn_grey(make_prediction):
    found = make_prediction(grasps_each=0)
    unassigned = replace(found, objects=(), cloud_instances=np.full_like(found.cloud_instances, -1))
    left = np.asarray(halves(drawn(unassigned))[0])[60:-60].astype(int)
    assert np.ptp(left, axis=2).max() < 25
    assert (left.max(axis=2) < 200).sum() > 300


def test_long_names_and_titles_stay_in_the_picture_and_keep_the_numbers(make_prediction):
    found = make_prediction(names=("ball " * 40, "box"))
    image = np.asarray(drawn(found, "a very long file name " * 20))
    frame = np.concatenate([image[:3].ravel(), image[-3:].ravel(), image[:, :3].ravel(), image[:, -3:].ravel()])
    assert frame.min() > 200
    # The numbers end the title line, in the same pixels wherever they stand.
    short = np.asarray(drawn(found))[:60].min(axis=2) < 200
    columns = np.flatnonzero(short.any(axis=0))
    numbers = short[:, columns[0] : columns[-1] + 1]
    ends = np.flatnonzero((image[:60].min(axis=2) < 200).any(axis=0))[-1] + 1
    title = image[:60, ends - numbers.shape[1] : ends].min(axis=2) < 200
    assert (title == numbers).mean() > 0.98


def test_best_per_object_keeps_the_best_of_each(make_prediction):
    grasps = make_prediction(grasps_each=5).grasps
    best = best_per_object(grasps, 2)
    assert sorted(best.instances.tolist()) == [0, 0, 1, 1]
    assert (np.diff(best.scores) <= 0).all()
    for k in (0, 1):
        of_object = np.sort(grasps.scores[grasps.instances == k])[::-1]
        assert np.array_equal(best.scores[best.instances == k], of_object[:2])


def test_the_summary_counts_and_adds_up_the_stages(make_prediction):
    assert summary(make_prediction(grasps_each=1)) == "2 objects  ·  2 grasps  ·  200 ms"


def test_hands_are_drawn_as_far_open_as_they_were_checked(make_prediction):
    found = make_prediction()
    fully = replace(found, grasps=replace(found.grasps, openings=np.full(len(found.grasps), 0.08)))
    differing = np.asarray(drawn(found)) != np.asarray(drawn(fully))
    assert differing.any(axis=2).sum() > 200
