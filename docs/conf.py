"""The documentation's settings for Sphinx: `make docs` builds it into build/docs, warnings being errors.

A new page in `tutorials`, `how-to`, `explanation`, its `decisions` or its `model-cards` needs no line anywhere: the
contents of those folders are globs (`[!d]**` is all but the decisions, which have a list of their own). Nothing is
fetched, at build time or by the reader's browser: equations become MathML, and fonts are the system's.
"""

import os
import sys
from importlib.metadata import version as installed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).with_name("_ext")))

project = "millisight"
author = "The millisight authors"
copyright = author
version = release = installed("millisight")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "mathml",
    "docstrings",
    "command_line",
    "gallery",
    "notebooks",
    "offline",
]
exclude_patterns = ["_ext", "_static"]
html_theme = "furo"
html_title = "millisight"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": True, "top_of_page_buttons": []}

myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 4
html_math_renderer = "mathml"

# Every notebook runs, in an empty folder: before the pages are read, into a cache that is emptied first (see _ext). A
# cell that raises, or says something on stderr, is a warning with its text, and so fails the build.
nb_execution_mode = "cache"
# In CI they take turns, one with every commit, as slow tests do (see conftest.py).
if part := os.environ.get("MILLISIGHT_PART"):
    nb_execution_excludepatterns = [f"tutorials/{n:02}_*.ipynb" for n in range(1, 9) if n != int(part)]
nb_execution_in_temp = True
nb_execution_timeout = 600  # seconds for a cell: the machine may be busy with other things
nb_execution_show_tb = True
nb_output_stderr = "warn"
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
maximum_signature_line_length = 88
default_role = "py:obj"
python_use_unqualified_type_names = True
