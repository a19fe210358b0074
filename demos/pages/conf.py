"""The site: `make docs` builds it into build/site."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from pathlib import Path

import tactile_fem

sys.path.insert(0, str(Path(__file__).parent))
sys.argv[0] = "tactile-fem"  # cyclopts takes the name of the program for that of the commands

project = "tactile-fem"
author = "The authors of tactile-fem"
version = release = tactile_fem.__version__

extensions = [
    "myst_nb",
    "sphinx_gallery.gen_gallery",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "numpydoc",
    "sphinx_copybutton",
    "sphinx_design",
    "cyclopts.ext.sphinx",
    "sphinx-mathjax-offline",  # equations without a network
    "site_directives",
]

# The gallery is written here from ../gallery, with a copy of each script.
exclude_patterns = ["gallery/*.ipynb", "gallery/*.py", "gallery/*.zip", "sg_execution_times.rst"]
suppress_warnings = [
    "config.cache",  # functions of sphinx_gallery_conf cannot be stored; nothing is wrong
]

myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # notebooks keep their outputs: `make tutorials` runs them

sphinx_gallery_conf = {
    "examples_dirs": "../gallery",
    "gallery_dirs": "gallery",
    "plot_gallery": False,  # scans are long: each script's picture is kept in pictures/
    "show_memory": False,
    "min_reported_time": 1e9,
    "remove_config_comments": True,
    "download_all_examples": True,
    "thumbnail_size": (800, 560),  # twice as large as they are shown: see site.css
    # A notebook is started with options of its own.
    "first_notebook_cell": "import sys\n\nsys.argv = sys.argv[:1]",
}

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # NumPy docstrings state types and units in words
autosummary_generate = True
autosummary_imported_members = True
autosummary_ignore_module_all = False  # what a module exports is what is listed
autosummary_context = {
    "top": tactile_fem.__all__,
    "at_the_top": lambda module, name: (
        getattr(tactile_fem, name, None) is getattr(import_module(module), name)
    ),
}
numpydoc_show_class_members = False
default_role = "py:obj"
smartquotes = False  # quotes belong to values
templates_path = ["templates"]

html_theme = "pydata_sphinx_theme"
html_title = "tactile-fem"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_theme_options = {
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": [],
    "footer_end": [],
}
html_sidebars = {"index": [], "start/install": []}

os.environ.setdefault("COLUMNS", "100")
