"""How Sphinx builds the documentation: `docs/build`."""

import sys
from pathlib import Path

import whitted

sys.path.insert(0, str(Path(__file__).parent))

project = "whitted"
author = "the whitted authors"
copyright = "2026, the whitted authors"
release = version = whitted.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    # MathJax as files of this site, in place of another host's
    "sphinx-mathjax-offline",
    "myst_nb",
    # Pictures that are made of the code, in _generated/
    "generate",
]
exclude_patterns = ["_generated"]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

# The tutorial runs at each build
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_ipywidgets_js = {}

smartquotes = False
# In docstrings, `x` is code
default_role = "literal"
napoleon_use_rtype = False
autoclass_content = "both"
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
# Types of other projects, and names for types of our own, have no page here
nitpick_ignore_regex = [("py:(class|obj|data)", r".*")]

html_theme = "furo"
html_title = f"whitted {release}"
html_show_sourcelink = False
html_copy_source = False
