"""Every command line in README and documents is one that the command takes."""

import re
import shlex
from pathlib import Path

import pytest

from icgnet.cli.main import COMMANDS, parse

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted(path for path in (ROOT / "docs").rglob("*.md") if path.name != "log.md")]
STARTS = ("icgnet ", "-m icgnet.cli.main -- ")
"""How command lines begin, also behind torchrun."""


def command_lines() -> list[tuple[str, str, bool]]:
    """Page, command line and whether it is to be typed as it stands (in a block of code, not in a sentence)."""
    found = []
    for page in PAGES:
        text = page.read_text().replace("\\\n", " ")
        for block, inline in re.findall(r"^```[a-z]*\n(.*?)^```|`([^`]+)`", text, re.S | re.M):
            for line in (block or inline.replace("\n", " ")).splitlines():
                start = next((line.find(each) + len(each) for each in STARTS if each in line), None)
                words = [] if start is None else line[start:].split()
                if len(words) > 1 and (words[0] in COMMANDS or " ".join(words[:2]) in COMMANDS):
                    found.append((str(page.relative_to(ROOT)), line[start:], bool(block)))
    return found


LINES = command_lines()


def test_documents_have_command_lines():
    assert len(LINES) > 50


@pytest.mark.parametrize(("page", "line", "whole"), LINES, ids=[f"{page}: {line[:60]}" for page, line, _ in LINES])
def test_a_documented_command_line_is_taken(page, line, whole, capsys):
    words = [re.sub(r"\$\w+", "1", word) for word in shlex.split(line, comments=True)]
    words = [word for word in words if word != "..."]
    if message := mistake_in(words, whole, capsys):
        pytest.fail(f"{page}: icgnet {line}\n{message}")


def mistake_in(words: list[str], whole: bool, capsys) -> str:
    """What the parser finds wrong; help is no mistake, and a sentence may name only the options that it speaks of."""
    try:
        parse(words)
    except SystemExit as stop:
        said = capsys.readouterr().err
        return said if stop.code and (whole or "Missing from icgnet" not in said) else ""
    return ""
