"""Links of the Markdown pages that lead out of this folder, made into links within the site.

The pages are read on a forge too, where ``[`room.py`](../causal_openlock/physics/room.py)`` leads
to the file. On the site such a link leads to the module's place in the reference, one to a notebook
or another file downloads it, and one to a folder, which no page shows, is a name without a link.
"""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx

LINK = re.compile(r"(?<!!)\[(?P<text>[^\]]*)\]\((?P<path>[^)#:]+)\)")
CODE = ("causal_openlock", "learners")


def relinked(text: str, page: Path, root: Path) -> str:
    """The text of a page with its links out of the folder rewritten.

    Args:
        text: The text.
        page: The file that it is from.
        root: The root of the repository.
    """

    def link(found: re.Match[str]) -> str:
        target = (page.parent / found["path"]).resolve()
        if not target.exists() or not target.is_relative_to(root):
            return found[0]
        place = target.relative_to(root)
        if target.suffix == ".py" and place.parts[0] in CODE:
            module = ".".join(place.with_suffix("").parts).removesuffix(".__init__")
            return f"{{py:mod}}`{found['text'].strip('`')} <{module}>`"
        return found["text"] if target.is_dir() else found[0]

    return LINK.sub(link, text)


def setup(app: Sphinx) -> dict[str, bool]:
    """Rewrite each Markdown page as it is read."""

    def read(app: Sphinx, name: str, source: list[str]) -> None:
        page = Path(app.env.doc2path(name))
        if page.suffix == ".md":
            source[0] = relinked(source[0], page, Path(app.srcdir).parent)

    app.connect("source-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
