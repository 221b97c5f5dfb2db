"""Links of the Markdown pages and lessons that lead out of their folder, made links of the site.

The pages are read on a forge too, where ``[`room.py`](../causal_openlock/physics/room.py)`` leads
to the file. On the site such a link leads to the module's place in the reference, one to a lesson
to its page, one to another file downloads it, and one to a folder, which no page shows, is a name
without a link. Lessons are kept in ``notebooks`` and shown in ``lessons``; their links and pictures
are written as seen from ``notebooks``.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

from sphinx.application import Sphinx

LINK = re.compile(r"(?P<mark>!?)\[(?P<text>[^\]]*)\]\((?P<path>[^)#:]+)(?P<heading>#[^)]*)?\)")
CODE = ("causal_openlock", "learners")


def relinked(text: str, page: Path, docs: Path) -> str:
    """The text of a page with its links out of the folder rewritten.

    Args:
        text: The text.
        page: The file that it is from.
        docs: The folder of the documentation.
    """
    root, lessons = docs.parent, (docs / "lessons").resolve()
    elsewhere = not page.resolve().is_relative_to(docs)

    def link(found: re.Match[str]) -> str:
        target = (page.parent / found["path"]).resolve()
        if not target.exists() or not target.is_relative_to(root):
            return found[0]
        place = target.relative_to(root)
        if target.parent == lessons and re.match(r"\d", target.name):
            # Not as a path: those are followed through links of the file system.
            return f"{{doc}}`{found['text'].strip('`')} </lessons/{target.stem}>`"
        if target.suffix == ".py" and place.parts[0] in CODE:
            module = ".".join(place.with_suffix("").parts).removesuffix(".__init__")
            return f"{{py:mod}}`{found['text'].strip('`')} <{module}>`"
        if target.is_dir():
            return found["text"]
        if elsewhere and target.is_relative_to(docs):
            path = f"/{target.relative_to(docs).as_posix()}{found['heading'] or ''}"
            return f"{found['mark']}[{found['text']}]({path})"
        return found[0]

    return LINK.sub(link, text)


def relinked_notebook(text: str, page: Path, docs: Path) -> str:
    """The same of a notebook, in whose cells of text alone there are links."""
    notebook = json.loads(text)
    for cell in notebook["cells"]:
        if cell["cell_type"] == "markdown":
            cell["source"] = relinked("".join(cell["source"]), page, docs)
    return json.dumps(notebook)


def setup(app: Sphinx) -> dict[str, bool]:
    """Rewrite each page as it is read."""

    def read(app: Sphinx, name: str, source: list[str]) -> None:
        page = Path(app.env.doc2path(name))
        rewrite = {".md": relinked, ".ipynb": relinked_notebook}.get(page.suffix)
        if rewrite:
            source[0] = rewrite(source[0], page, Path(app.srcdir))

    app.connect("source-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
