import numpy as np
import pytest

from icgnet.sensors.fields import LOSS, image_field, space_field


def rng():
    return np.random.default_rng(0)


def test_image_field_goes_straight_from_sample_to_sample():
    field = image_field((41, 61), 1.0, 4, rng())
    for line in (field[:, 20], field[20]):
        second = np.diff(line, n=2).reshape(-1)
        # Slopes change at the samples only.
        assert np.abs(np.delete(second, np.arange(3, len(second), 4))).max() < 1e-5
        assert np.abs(second[3::4]).max() > 0.1


def test_image_field_has_a_pitch_along_columns_and_one_along_rows():
    field = image_field((41, 61), 1.0, (4, 10), rng())
    for line, pitch in ((field[:, 20], 4), (field[20], 10)):
        bends = np.flatnonzero(np.abs(np.diff(line, n=2)) > 1e-5) + 1
        assert len(bends) > 3
        assert (bends % pitch == 0).all()


@pytest.mark.parametrize(("shape", "pitch"), [((480, 640), 4), ((201, 203), 5), ((1, 1), 4), ((2, 7), 3)])
def test_image_field_has_the_size_of_the_image_and_its_sigma(shape, pitch):
    field = image_field(shape, 0.005, pitch, rng())
    assert field.shape == shape
    assert np.isfinite(field).all()
    if min(shape) > 100:
        assert field.std() == pytest.approx(LOSS * 0.005, rel=0.05)


def test_space_field_has_its_sigma_and_is_alike_for_neighbours():
    points = rng().uniform(0, 0.3, (4000, 3))
    fields = [space_field(points, 0.002, 0.05, np.random.default_rng(seed)) for seed in range(40)]
    assert np.std(fields) == pytest.approx(0.002, rel=0.1)
    moved = space_field(points + [0.005, 0, 0], 0.002, 0.05, np.random.default_rng(3))
    assert np.abs(moved - fields[3]).mean() < 0.15 * 0.002
    far = space_field(points + [0.15, 0, 0], 0.002, 0.05, np.random.default_rng(3))
    assert np.abs(np.corrcoef(far[:, 0], fields[3][:, 0])[0, 1]) < 0.5
