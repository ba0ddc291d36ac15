"""The guides are true: their blocks run as they are written (most of them only by `make guides`)."""

import importlib.util
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from icgnet.cli.main import parse

ROOT = Path(__file__).parent.parent


def load_runner():
    spec = importlib.util.spec_from_file_location("run_guides", ROOT / "scripts" / "run_guides.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["run_guides"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


guides = load_runner()
PAGES = guides.pages()
RUN_HERE = ("own_robot", "own_planner")
"""All pages take minutes (make guides); these two show that the rest is still understood."""


def test_guides_for_users_are_run():
    assert {page.stem for page in PAGES} >= {
        *("own_camera", "own_robot", "own_gripper", "own_objects", "real_captures"),
        *("first_grasp", "why_no_grasp", "own_planner", "training", "scenes", "reproduce"),
    }


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if page.stem in RUN_HERE], ids=lambda page: page.stem)
def test_a_guide_runs_as_it_is_written(page, tmp_path):
    (folder := tmp_path / "work").mkdir()
    guides.run_page(page, folder, slow=False)


def page_of(tmp_path: Path, text: str) -> Path:
    (tmp_path / "page.md").write_text(guides.TAKES_PART + "\n" + text)
    return tmp_path / "page.md"


def run(tmp_path: Path, text: str, **settings):
    (folder := tmp_path / "work").mkdir()
    return guides.run_page(page_of(tmp_path, text), folder, **settings)


def test_a_page_is_one_session_in_one_folder(tmp_path):
    text = """
<!-- file: words.txt -->
```text
alpha beta
```

<!-- as: "-c" -> "-w" -->
```bash
wc -c words.txt | tee count.txt
echo more
```

<!-- output: 2 -->
```
7 words.txt
```

```python
assert open("count.txt").read().split()[0] == "2"
```

<!-- slow -->
```bash
false
```

```yaml
not: run
```
"""
    shown = run(tmp_path, text, slow=False)
    assert list(shown.values()) == ["2 words.txt\n"]
    guides.write_outputs(tmp_path / "page.md", shown)
    assert "7 words.txt" not in (tmp_path / "page.md").read_text()
    assert guides.blocks(tmp_path / "page.md")[2].code == "2 words.txt\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("```bash\necho here\nfalse\necho there\n```\n", r"page\.md:3: fails with 1\n.*here"),
        ("```python\nraise ValueError('wrong')\n```\n", "ValueError: wrong"),
        ("```bash\necho other 7\n```\n\n<!-- output -->\n```\nwords 3\n```\n", r"page\.md:8: it shows words"),
        ('<!-- as: "a" -> "b" -->\n```bash\necho c\n```\n', '"a" is to be changed and does not stand'),
        ("<!-- as: a b -->\n```bash\necho c\n```\n", 'not "A" -> "B": a b'),
        ("<!-- not run -->\n```bash\necho c\n```\n", "needs a reason"),
        ("<!-- output -->\n```\nc\n```\n", "no block whose output"),
    ],
)
def test_a_page_that_is_not_true_is_named(tmp_path, text, message):
    with pytest.raises(guides.GuideError, match=f"(?s){message}"):
        run(tmp_path, text)


def test_the_docs_site_is_built_without_a_warning(tmp_path):
    pytest.importorskip("mkdocs", reason="needs mkdocs (pip install icgnet[docs])")
    pytest.importorskip("material", reason="needs mkdocs-material (pip install icgnet[docs])")
    pytest.importorskip("mkdocstrings", reason="needs mkdocstrings (pip install icgnet[docs])")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    )
    assert done.returncode == 0, done.stderr[-3000:]
    start = (tmp_path / "site" / "index.html").read_text()
    assert "own_robot.html" in start
    loaded = [line for line in start.splitlines() if "<script src=" in line or 'rel="stylesheet"' in line]
    assert loaded
    assert not any("://" in line for line in loaded), "the site asks another server"


REPORTS = ROOT / "docs" / "results"


def reproduced() -> dict[str, list[str]]:
    """Folder of each result in the guide, and the words of its command."""
    found = {}
    for row in (guides.GUIDES / "reproduce.md").read_text().splitlines():
        if match := re.fullmatch(r"\|[^|]*\| ([a-z]+-[\w-]*){([a-z,]+)}(\S+) \| `icgnet (.+)` \|", row):
            start, kinds, end, line = match.groups()
            first = kinds.split(",")[0]
            assert f"--scene {first} " in line
            for kind in kinds.split(","):
                found[f"{start}{kind}{end}"] = shlex.split(line.replace(f"--scene {first} ", f"--scene {kind} "))
    return found


def test_every_result_has_its_command():
    assert sorted(reproduced()) == sorted(path.parent.name for path in REPORTS.glob("*/report.json"))


SETTINGS = (
    *("scene", "split", "view", "noise", "seed", "protocol", "runs", "rounds", "scenes", "planner", "threads"),
    *("level_table", "opening", "input", "repeats"),
)


@pytest.mark.parametrize("name", sorted(reproduced()))
def test_the_command_of_a_result_has_its_settings(name):
    config = parse(reproduced()[name]).config
    settings = json.loads((REPORTS / name / "report.json").read_text())["settings"]
    told = {key: settings[key] for key in SETTINGS if key in settings}
    assert {key: getattr(config, key) for key in told} == told
    assert {"$ICGNET_OBJECTS": "vgn"}.get(config.objects, config.objects) == settings["objects"]
