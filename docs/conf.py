"""Sphinx's settings for the site; ``make docs`` builds it."""

from __future__ import annotations

import sys
from pathlib import Path

import rcmqp

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))
(HERE / "generated/run").mkdir(parents=True, exist_ok=True)  # before Sphinx looks for it

project = "rcmqp"
author = "The rcmqp developers"
copyright = "The rcmqp developers"
release = version = rcmqp.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "plain_docstrings",  # before napoleon, which makes lists of Args: and Raises:
    "sphinx.ext.napoleon",
    "generated_pages",
]
exclude_patterns = [
    "_build",
    "generated/channels.md",
    "generated/public_names.md",
]  # parts of pages
suppress_warnings = ["myst.header"]  # the tables' titles in comparisons.md

myst_heading_anchors = 3
myst_enable_extensions = ["deflist"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True}
autodoc_type_aliases = {name: name for name in ("Array", "ArrayLike", "Program", "Vector3")}
python_use_unqualified_type_names = True

toc_object_entries = False

html_theme = "furo"
html_title = f"rcmqp {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_search_scorer = str(HERE / "scorer.js")
html_extra_path = ["generated/run"]
html_show_sphinx = False
