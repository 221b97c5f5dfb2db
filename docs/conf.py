"""How Sphinx builds the site from this folder; ``make docs`` calls it."""

from __future__ import annotations

import gc
import sys
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).parent
gc.set_threshold(100_000, 50, 100)  # millions of nodes, which stay: a tenth of the time
sys.path[:0] = [str(HERE / "_extensions")]

from causal_openlock import __version__  # noqa: E402  (the package that is documented)

project = "causal_openlock"
author = "The causal_openlock authors"
copyright = "2026, the causal_openlock authors"
version = release = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "example_report",  # in _extensions: plays what the example report is of
    "from_the_program",  # in _extensions: help texts, file formats, parameters
    "links_into_the_code",  # in _extensions: relative links of the pages and lessons
    "reference",  # in _extensions: what autodoc leaves out
]
exclude_patterns = ["_build", "_extensions", "example_play", "figures"]
exclude_patterns += ["lessons/template.ipynb"]  # nothing to read in it yet
# Two modules may each have a class of one name, such as Table.
suppress_warnings = ["ref.python"]

# -- Markdown ---------------------------------------------------------------------------------
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3

# -- the lessons ------------------------------------------------------------------------------
# The folder lessons is a link to notebooks, which are stored with what they put out: make lessons.
nb_execution_mode = "off"

# -- the reference ----------------------------------------------------------------------------
autodoc_default_options = {"members": True, "member-order": "bysource", "show-inheritance": True}
autodoc_preserve_defaults = True
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
napoleon_use_ivar = True  # attributes of a dataclass are described once, in its docstring

# -- pages --------------------------------------------------------------------------------------
html_theme = "furo"
html_title = "causal_openlock"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": True}


def setup(app: Sphinx) -> None:
    """Keep the lessons' pictures inside the build, which myst-nb puts beside it."""

    def keep_inside(app: Sphinx) -> None:
        folder = str(app.doctreedir / "lessons")
        app.env.mystnb_config = app.env.mystnb_config.copy(output_folder=folder)

    app.connect("builder-inited", keep_inside, priority=900)  # after myst-nb itself
