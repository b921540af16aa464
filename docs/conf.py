"""Sphinx's settings of the documentation: ``make docs`` builds it into ``out/docs``, without the network."""

import shutil
import sys
from pathlib import Path

from tfm_cl import __version__

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_extensions"))
shutil.rmtree(HERE / "reference" / "members", ignore_errors=True)  # autosummary makes them, and removes none

project = "tfm_cl"
project_copyright = "the tfm_cl authors, Apache-2.0"
version = release = __version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "generated",
    "library",
]

myst_enable_extensions = ["attrs_inline", "attrs_block", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
copybutton_prompt_text = "$ "
copybutton_only_copy_prompt_lines = True
copybutton_line_continuation_character = "\\"

smartquotes = False
default_role = "py:obj"  # docstrings name code in single backticks
autodoc_typehints = "none"  # numpy docstrings say them in words
autodoc_member_order = "bysource"
autosummary_generate = True
autosummary_ignore_module_all = False
templates_path = ["_templates"]
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"tfm_cl {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True}
