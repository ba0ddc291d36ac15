"""Runs the guides: every block of code of a page, in order, in an empty folder, as it is written.

    python scripts/run_guides.py                    # all pages that say so, slow blocks too
    python scripts/run_guides.py own_robot          # one page
    python scripts/run_guides.py --write own_robot  # and puts what was printed into the page
    python scripts/run_guides.py --list             # what would be run, and what not and why

A page takes part when it holds the line `<!-- guide: run -->`. From then on each of its blocks of bash or Python is
run, unless the comment before the block says otherwise; other blocks are for reading, unless it says more:

    <!-- not run: REASON -->     a block that cannot be run here
    <!-- slow -->                run by this script, not by the tests
    <!-- as: "A" -> "B" -->      run with B in place of A (fewer scenes, say), which may be repeated
    <!-- file: NAME -->          not run but written into the file NAME
    <!-- output -->              what the block before it prints
    <!-- output: A, B -->        those of its lines that begin with A or B
"""

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
GUIDES = ROOT / "docs" / "guides"
TAKES_PART = "<!-- guide: run -->"
LANGUAGES = ("bash", "python")
BLOCK = re.compile(r"((?:^<!-- [^\n]* -->\n)*)^```([a-z]*)\n(.*?)^```$", re.S | re.M)
MARK = re.compile(r"^<!-- (not run|slow|as|file|output)(?:: (.*?))? -->$", re.M)
CHANGE = re.compile(r'^"(.*)" -> "(.*)"$')
SECONDS = 1800
"""No block takes longer."""
LAST_LINES = 30
"""Of what a block printed before it failed, so much is repeated."""


class GuideError(Exception):
    """A page that is not true: a block failed, prints something else, or a mark says nothing."""


@dataclass(frozen=True, eq=False)
class Block:
    """A block of code in a page.

    Attributes:
        page: name of the page.
        line: of its first line of code.
        language: bash, python, or what the page calls it; may be empty.
        code: what stands in it.
        span: where the code stands in the page.
        marks: what the comments before it say.
        changes: what is to be run in place of what.
    """

    page: str
    line: int
    language: str
    code: str
    span: tuple[int, int]
    marks: dict[str, str]
    changes: tuple[tuple[str, str], ...]

    @property
    def where(self) -> str:
        """Page and line, as editors take it."""
        return f"{self.page}.md:{self.line}"

    @property
    def is_run(self) -> bool:
        """Whether it is a program that is to be run."""
        return self.language in LANGUAGES and not {"not run", "file", "output"} & set(self.marks)

    def program(self) -> str:
        """What is run: the code, changed as the comment says.

        Raises:
            GuideError: what is to be changed does not stand there.
        """
        code = self.code
        for old, new in self.changes:
            if old not in code:
                raise GuideError(f'{self.where}: "{old}" is to be changed and does not stand in the block')
            code = code.replace(old, new)
        return code


def pages() -> list[Path]:
    """The guides that are run."""
    return [path for path in sorted(GUIDES.glob("*.md")) if TAKES_PART in path.read_text()]


def blocks(page: Path) -> list[Block]:
    """The blocks of a page, in order.

    Raises:
        GuideError: a mark that says nothing, or an output that follows nothing.
    """
    text, found = page.read_text(), []
    for match in BLOCK.finditer(text):
        marks, changes = {}, []
        for name, value in MARK.findall(match[1]):
            if name != "as":
                marks[name] = value
            elif change := CHANGE.match(value):
                changes.append((change[1], change[2]))
            else:
                raise GuideError(f'{page.stem}.md: not "A" -> "B": {value}')
        line = text.count("\n", 0, match.start(3)) + 1
        block = Block(page.stem, line, match[2], match[3], match.span(3), marks, tuple(changes))
        if ("not run" in marks and not marks["not run"]) or ("file" in marks and not marks["file"]):
            raise GuideError(f"{block.where}: the mark before it needs a reason or a name")
        if "output" in marks and not any(each.is_run for each in found):
            raise GuideError(f"{block.where}: there is no block whose output this could be")
        found.append(block)
    return found


def run_page(
    page: Path, folder: Path, slow: bool = True, compare: bool = True, report=lambda line: None
) -> dict[Block, str]:
    """Runs the blocks of a page in a folder.

    Args:
        page: the page.
        folder: an empty one.
        slow: whether blocks that are marked as slow are run, too.
        compare: whether a page that shows something else than what is printed is an error.
        report: is told what was run, and how long it took.

    Returns:
        For each block that shows an output, what was printed really.

    Raises:
        GuideError: a block fails, or prints something else than the page says.
    """
    programs = folder.with_name(folder.name + "_bin")
    _write_programs(programs)
    printed, shown = None, {}
    for block in blocks(page):
        if "file" in block.marks:
            path = folder / block.marks["file"]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.program())
        elif block.is_run:
            printed = None
            if slow or "slow" not in block.marks:
                start = time.monotonic()
                printed = _run(block, folder, programs)
                report(f"{block.where}: {time.monotonic() - start:.1f} s")
        elif "output" in block.marks and printed is not None:
            shown[block] = _lines(printed, block.marks["output"])
            missing = _words(block.code) - _words(shown[block])
            if missing and compare:
                raise GuideError(
                    f"{block.where}: it shows {', '.join(sorted(missing))}, which the block before does not print "
                    f"(scripts/run_guides.py --write {page.stem} renews it); it prints\n{shown[block]}"
                )
    return shown


def write_outputs(page: Path, shown: dict[Block, str]) -> None:
    """Puts what was printed into the page.

    Raises:
        GuideError: the page is another one by now.
    """
    text = page.read_text()
    for block in sorted(shown, key=lambda each: each.span, reverse=True):
        if text[slice(*block.span)] != block.code:
            raise GuideError(f"{block.where}: the page was changed while it was run")
        text = text[: block.span[0]] + shown[block] + text[block.span[1] :]
    page.write_text(text)


def _run(block: Block, folder: Path, programs: Path) -> str:
    script = programs / ("block.sh" if block.language == "bash" else "block.py")
    script.write_text(block.program())  # a file, for Python starts further processes from it
    command = ["bash", "-euo", "pipefail"] if block.language == "bash" else [sys.executable]
    done = subprocess.run(
        [*command, str(script)],
        cwd=folder,
        env=_environment(programs),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=SECONDS,
    )
    if done.returncode:
        last = "\n".join(done.stdout.splitlines()[-LAST_LINES:])
        raise GuideError(f"{block.where}: fails with {done.returncode}\n{block.program()}\n{last}")
    return done.stdout


def _write_programs(folder: Path) -> None:
    """`icgnet` and `python`, as they are typed: those that run this."""
    folder.mkdir(exist_ok=True)
    python = shlex.quote(sys.executable)
    for name, words in (("icgnet", f"{python} -m icgnet.cli.main"), ("python", python)):
        program = folder / name
        program.write_text(f'#!/bin/sh\nexec {words} "$@"\n')
        program.chmod(0o755)


def _environment(programs: Path) -> dict[str, str]:
    path = os.pathsep.join((str(programs), str(Path(sys.executable).parent), os.environ.get("PATH", "")))
    sources = os.pathsep.join(filter(None, (str(ROOT / "src"), os.environ.get("PYTHONPATH"))))
    plain = {"COLUMNS": "120", "NO_COLOR": "1", "TERM": "dumb", "MPLBACKEND": "Agg", "ICGNET_ROOT": str(ROOT)}
    return {**os.environ, **plain, "PATH": path, "PYTHONPATH": sources}


def _lines(printed: str, starts: str) -> str:
    """The lines that begin with any of the words; all of them if there are none."""
    wanted = tuple(each.strip() for each in starts.split(",") if each.strip())
    lines = [line.rstrip() for line in printed.splitlines() if not wanted or line.lstrip().startswith(wanted)]
    return "".join(line + "\n" for line in lines)


def _words(text: str) -> set[str]:
    """What must be the same everywhere; numbers differ from one processor to the other."""
    return set(re.findall(r"[a-z]{3,}", text.lower()))


def main() -> int:
    """Runs the pages that were asked for; 1 if one is not true."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="*", help="names of pages; all that are run if there are none")
    parser.add_argument("--fast", action="store_true", help="leave out what is slow, as the tests do")
    parser.add_argument("--write", action="store_true", help="put what is printed into the pages")
    parser.add_argument("--list", action="store_true", help="say what would be run, and run nothing")
    wanted = parser.parse_args()
    known = {page.stem: page for page in pages()}
    if unknown := sorted(set(wanted.pages) - set(known)):
        print(f"error: no such page: {', '.join(unknown)}; those that are run are {', '.join(known)}", file=sys.stderr)
        return 2
    failed = False
    for name in wanted.pages or known:
        if wanted.list:
            for block in blocks(known[name]):
                what = "run" if block.is_run else ", ".join(f"{mark} {value}" for mark, value in block.marks.items())
                print(f"{block.where}: {block.language or 'text'}: {what or 'for reading'}")
            continue
        with tempfile.TemporaryDirectory() as folder:
            (work := Path(folder) / name).mkdir()
            try:
                shown = run_page(
                    known[name], work, not wanted.fast, not wanted.write, lambda line: print(line, flush=True)
                )
            except GuideError as error:
                failed = True
                print(f"error: {error}", file=sys.stderr)
            else:
                if wanted.write:
                    write_outputs(known[name], shown)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
