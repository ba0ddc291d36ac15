"""Links of the docs that leave them, to code and to folders, for the site that mkdocs builds of them.

On its own, a page may link to a file of the source or to a folder. The site holds neither: such a link becomes the
name of what it leads to, and one that leads nowhere is a warning, which `mkdocs build --strict` does not let pass.
"""

import logging
import posixpath
import re
from pathlib import Path
from typing import Any

LOG = logging.getLogger("mkdocs.hooks.docs")
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#\s]+)(?:#[^)\s]*)?\)")
CODE = re.compile(r"(^```.*?^```|`[^`\n]+`)", re.S | re.M)


def on_page_markdown(markdown: str, *, page: Any, config: Any, **_: Any) -> str:
    """The page without links to what the site does not hold."""
    docs = Path(config["docs_dir"])
    root, folder = docs.parent, posixpath.dirname(page.file.src_uri)

    def named(match: re.Match[str]) -> str:
        text, target = match[1], match[2]
        if "://" in target or target.startswith("mailto:"):
            return match[0]
        path = posixpath.normpath(posixpath.join(docs.name, folder, target))
        if path.startswith(f"{docs.name}/") and not (root / path).is_dir():
            return match[0]
        if path.startswith("..") or not (root / path).exists():
            LOG.warning("%s: the link to %s leads nowhere", page.file.src_uri, target)
        return text if text.strip("`") in (path, target) else f"{text} (`{path}`)"

    # Code keeps its brackets: every other piece is a block or a word of code.
    pieces = CODE.split(markdown)
    return "".join(piece if index % 2 else LINK.sub(named, piece) for index, piece in enumerate(pieces))
