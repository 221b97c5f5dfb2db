"""Links of the Markdown pages and lessons that lead out of their folder, made links of the site.

The pages are read on a forge too, where ``[`room.py`](../causal_openlock/physics/room.py)`` leads
to the file. On the site such a link leads to the module's place in the reference, one to a lesson
to its page, one to another file downloads it, and one to a folder, which no page shows, is a name
without a link. A link's title stays.

Lessons are kept in ``notebooks`` and shown in ``lessons``, and the studies behind the results in
``evidence``, which has a link of that name here; their links and pictures are written as seen from
where they are kept. Below the page of all studies stand theirs in the margin.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx

LINK = re.compile(
    r"(?P<mark>!?)\[(?P<text>[^\]]*)\]"
    r'\((?P<path>[^)#:\s]+)(?P<heading>#[^)\s]*)?(?P<title>\s+"[^"]*")?\)'
)
CODE = ("causal_openlock", "openlock_learners")
STUDIES = "evidence/README"
"""The page of all studies."""


def relinked(text: str, page: Path, docs: Path) -> str:
    """The text of a page with its links out of the folder rewritten.

    Args:
        text: The text.
        page: The file that it is from.
        docs: The folder of the documentation.
    """
    root = docs.parent
    lessons, studies = (docs / "lessons").resolve(), (docs / "evidence").resolve()
    elsewhere = not page.resolve().is_relative_to(docs)

    def link(found: re.Match[str]) -> str:
        def to(path: str) -> str:
            rest = f"{found['heading'] or ''}{found['title'] or ''}"
            return f"{found['mark']}[{found['text']}]({path}{rest})"

        target = (page.parent / found["path"]).resolve()
        if not target.exists() or not target.is_relative_to(root):
            return found[0]
        place = target.relative_to(root)
        # The folder that the package of the learners is in.
        inside = place.relative_to("learners") if place.is_relative_to("learners") else place
        if target.parent == lessons and re.match(r"\d", target.name):
            # Not as a path: those are followed through links of the file system.
            return f"{{doc}}`{found['text'].strip('`')} </lessons/{target.stem}>`"
        if target.suffix == ".py" and inside.parts[0] in CODE:
            module = ".".join(inside.with_suffix("").parts).removesuffix(".__init__")
            return f"{{py:mod}}`{found['text'].strip('`')} <{module}>`"
        if target.is_dir():
            return found["text"]
        if target.is_relative_to(studies):
            return to(f"/evidence/{target.relative_to(studies).as_posix()}")
        if elsewhere and target.is_relative_to(docs):
            return to(f"/{target.relative_to(docs).as_posix()}")
        return found[0]

    return LINK.sub(link, text)


def relinked_notebook(text: str, page: Path, docs: Path) -> str:
    """The same of a notebook, in whose cells of text alone there are links."""
    notebook = json.loads(text)
    for cell in notebook["cells"]:
        if cell["cell_type"] == "markdown":
            cell["source"] = relinked("".join(cell["source"]), page, docs)
    return json.dumps(notebook)


def lead_to_studies(doctree: nodes.document, docs: Path) -> None:
    """Let links to pages of studies lead to where these are shown.

    MyST follows links of the file system and takes a page for the file that it is kept in, which
    no page of the site is called after.
    """
    studies = (docs / "evidence").resolve()
    for link in doctree.findall(pending_xref):
        kept = Path(link["reftarget"])
        if link.get("refdomain") == "doc" and kept.is_relative_to(studies):
            link["reftarget"] = f"evidence/{kept.relative_to(studies).as_posix()}"


def setup(app: Sphinx) -> dict[str, bool]:
    """Rewrite each page as it is read."""

    def read(app: Sphinx, name: str, source: list[str]) -> None:
        page = Path(app.env.doc2path(name))
        rewrite = {".md": relinked, ".ipynb": relinked_notebook}.get(page.suffix)
        if rewrite:
            source[0] = rewrite(source[0], page, Path(app.srcdir))
        if name == STUDIES:
            source[0] += "\n```{toctree}\n:hidden:\n:glob:\n\n*/README\n```\n"

    def lead(app: Sphinx, doctree: nodes.document) -> None:
        lead_to_studies(doctree, Path(app.srcdir))

    app.connect("source-read", read)
    app.connect("doctree-read", lead)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
