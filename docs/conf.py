"""Settings of Sphinx; pages that are generated are written before any is read."""

from __future__ import annotations

import os
import re
import sys
from importlib.metadata import version as version_of
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]
# Notebooks run in processes of their own, with the package that stands beside them.
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
os.environ["PYTHONPATH"] = os.pathsep.join([*sys.path[:2], os.environ.get("PYTHONPATH", "")])

import cells
import generate

if cells.quick() and hasattr(os, "sched_setaffinity"):
    # Tests have all processors at work: what is started here starts no processes of its own.
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

project = "oed"
author = "the authors of oed"
version = release = version_of("oed")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "formulas",
]
exclude_patterns = ["_build"]
default_role = "code"
nitpicky = False
# A term may be defined once, a label stand once: what Sphinx doubts fails the build (`-W`).
# Names that several classes have are left unlinked.
suppress_warnings = ["ref.python"]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "amsmath", "attrs_inline"]
myst_heading_anchors = 3

# What pages show is what the package says now.
nb_execution_mode = "force"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_merge_streams = True

# Sections of every page list each name of the reference; that takes long.
toc_object_entries = not cells.quick()
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
# What a class says of its attributes is what it takes.
napoleon_custom_sections = [("Attributes", "params_style")]

html_theme = "furo"
html_title = "oed"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["oed.css"]
html_show_copyright = False
copybutton_prompt_text = r"\$ |>>> "
copybutton_prompt_is_regexp = True


def plain(_app: Sphinx, _what: str, _name: str, _object: object, _options: object, lines: list[str]) -> None:
    """Docstrings are plain text with `code`: bars, stars and last underscores in them mean themselves."""
    lines[:] = [_line(line) for line in lines]


def _line(text: str) -> str:
    before, *rest = re.split(r"(`[^`]+`)", text)
    # What follows `code` without a blank is no part of it.
    apart = [one if one.startswith("`") else re.sub(r"^(?=\w)", r"\\ ", _escaped(one)) for one in rest]
    return "".join([_escaped(before), *apart])


def _escaped(text: str) -> str:
    return re.sub(r"([|*]|_(?!\w))", r"\\\1", text)


def setup(app: Sphinx) -> None:
    """Pages that are generated are written before any is read."""
    app.connect("autodoc-process-docstring", plain, priority=100)
    app.connect("builder-inited", lambda _: generate.everything(HERE))
