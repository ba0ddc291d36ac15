import pytest
from PIL import Image

from icgnet.cli.main import main


@pytest.mark.slow
def test_sensors_draws_a_sheet(tmp_path):
    path = tmp_path / "sheet.png"
    assert main(["sensors", "--out", str(path), "--count", "1", "--seed", "3", "--panel", "75", "90"]) == 0
    with Image.open(path) as image:
        assert min(image.size) > 400


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["sheet.jpg"], "end in .png"),
        (["sheet.png", "--count", "0"], "at least 1"),
        (["s.png", "--objects", "no"], "no"),
        (["s.png", "--panel", "0", "90"], "panel must be between 16 and 4000 pixels high and wide, got 0 x 90"),
    ],
)
def test_wrong_use_is_one_line_and_exit_code_2(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["sensors", "--out", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
