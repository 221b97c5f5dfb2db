"""How Sphinx builds the site; ``make docs`` calls it.

The folder of sources is the project's own, so that pages, lessons (``notebooks/``) and studies
(``evidence/``) lead to each other on the site as they do on a forge.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path.append(str(HERE))

from causal_openlock import __version__  # noqa: E402  (the package that is documented)

project = "causal_openlock"
author = "The causal_openlock authors"
copyright = "2026, the causal_openlock authors"
version = release = __version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "from_the_program"]
root_doc = "docs/index"
include_patterns = ["docs/**", "notebooks/0*.ipynb", "evidence/**.md"]
exclude_patterns = ["docs/_build", "docs/example_play", ".venv*", ".git", "results", "learners"]
exclude_patterns += ["causal_openlock", "tests", "dist", "build"]
suppress_warnings = [
    "ref.python",  # two modules may each have a class of one name, such as Table
    "toc.not_included",  # a study is reached from the page of all studies
]

# -- Markdown and lessons -----------------------------------------------------------------------
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # they are stored with what they put out: make lessons

# -- the reference ----------------------------------------------------------------------------
autodoc_default_options = {"members": True, "member-order": "bysource", "show-inheritance": True}
autodoc_preserve_defaults = True
autodoc_mock_imports = ["mcp", "mcp_types"]  # which pydantic cannot read as autodoc imports it
autodoc_use_type_comments = False
autodoc_typehints_format = "short"
# Named as they are in the code, and not spelled out wherever they occur.
autodoc_type_aliases = {
    name: name
    for name in ("BoolArray", "FloatArray", "IntArray", "Observations", "RewardFunction", "Where")
}
toc_object_entries = False  # modules in the margin, and not every function
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True  # attributes in a docstring are described there alone

# -- pages --------------------------------------------------------------------------------------
html_theme = "furo"
html_title = "causal_openlock"
html_static_path = ["_static"]
html_extra_path = ["_static/index.html"]  # leads to docs/index.html
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": True}

LINK_TO_CODE = re.compile(
    r"\[(?P<text>[^\]]*)\]\((?:\.\./)+(?:learners/)?"
    r"(?P<module>(?:causal_openlock|openlock_learners)[\w/]*)(?:\.py)?(?:\s+\"[^\"]*\")?\)"
)
LINK_TO_FOLDER = re.compile(r"\[([^\]]*)\]\((?:\.\./)*(?:experiments|schemas|example_play)/?\)")


def lead_to_reference(app: Sphinx, page: str, source: list[str]) -> None:
    """Let links to modules lead to their place in the reference, and links to folders nowhere."""

    def link(found: re.Match[str]) -> str:
        module = found["module"].strip("/").removesuffix("/__init__").replace("/", ".")
        return f"{{py:mod}}`{found['text'].strip('`')} <{module}>`"

    source[0] = LINK_TO_FOLDER.sub(r"\1", LINK_TO_CODE.sub(link, source[0]))


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect with the steps of Sphinx."""
    app.connect("source-read", lead_to_reference)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
