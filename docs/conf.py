"""Sphinx configuration. The build needs no network; `make docs` treats every warning as an error."""

from __future__ import annotations

import navopt

project = "navopt"
author = "The navopt developers"
project_copyright = "2026, The navopt developers"
version = release = navopt.__version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
]
exclude_patterns = ["_build", "_templates"]
templates_path = ["_templates"]
root_doc = "index"

html_theme = "furo"
html_title = f"navopt {version}"
html_show_sphinx = False

myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3

# Single backticks in docstrings are names; those that are documented become links.
default_role = "py:obj"
add_module_names = False
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autosummary_generate = True
autosummary_ignore_module_all = True  # for the lists of modules only: `automodule` keeps to `__all__`
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
