"""How Sphinx builds these pages: `make docs`. Nothing is fetched, nothing is run."""

import re
import sys
from importlib import metadata
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]

project = "stratify"
version = release = metadata.version("stratify")
copyright = "the authors of stratify"  # noqa: A001  the name that Sphinx reads
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx_click",
    "sphinx_design",
    "docstrings",
    "generated",
    "mathml",
]
exclude_patterns = ["_build", "_ext"]
nitpicky = True
default_role = "code"
smartquotes = False
highlight_language = "text"
nitpick_ignore_regex = [
    (
        "py:.*",
        r"(collections|concurrent|contextlib|matplotlib|numpy|pathlib|pydantic|typing|xarray|xr)\..*",
    ),
    ("py:.*", r"(Axes|Figure|Floats|Ints)"),
]

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"
html_math_renderer = "mathml"

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints_format = "short"

html_theme = "furo"
html_title = "stratify"
html_static_path = ["_static"]
html_css_files = ["stratify.css"]
html_copy_source = False
html_show_copyright = False

NOTEBOOKS = HERE / "_notebooks"


def copy_notebooks(_app: Sphinx) -> None:
    """The notebooks as they are in the repository, at a place where Sphinx looks."""
    NOTEBOOKS.mkdir(exist_ok=True)
    ours = {path.name: path for path in (HERE.parent / "notebooks").glob("*.ipynb")}
    for stale in NOTEBOOKS.iterdir():
        if stale.name not in ours:
            stale.unlink()
    for name, path in ours.items():
        text = path.read_text(encoding="utf-8").replace("](../docs/", "](../")
        copy = NOTEBOOKS / name
        if not copy.exists() or copy.read_text(encoding="utf-8") != text:
            copy.write_text(text, encoding="utf-8")


def lead_to_notebooks(_app: Sphinx, _page: str, source: list[str]) -> None:
    """Links of pages to notebooks lead to the copies."""
    source[0] = re.sub(r"\]\(((?:\.\./)*)\.\./notebooks/", r"](\1_notebooks/", source[0])


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("builder-inited", copy_notebooks)
    app.connect("source-read", lead_to_notebooks)
