"""Sphinx: the documentation as a site that needs no network; `make docs` builds it.

The source folder is the root of the repository, so that the links of the documents are the same here and
where the code is hosted.
"""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent.parent)]

import lab  # noqa: E402 - found through the path above

project, version = "INS Lab", lab.__version__
copyright = "The INS Lab developers"
root_doc = "docs/site/index"
include_patterns = [
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "CODE_OF_CONDUCT.md",
    "HOW_TO_RELEASE.md",
    "SECURITY.md",
    "missions/README.md",
    "notebooks/*.py",
    "docs/*.md",
    "docs/theory/*.md",
    "docs/site/*.md",
    "docs/site/reference/*.rst",
]
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "executed",
    "ledger",
    "mathml",
    "page_titles",
    "percent",
    "scoreboard",
    "settings_list",
    "source_links",
    "themed_pictures",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext", ".py": "percent"}

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
myst_dmath_allow_digits = False
myst_dmath_allow_space = False

default_role = "py:obj"
add_module_names = False
autodoc_default_options = {"members": True, "inherited-members": "Parameterized, NotebookCard, ValueError"}
autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
python_use_unqualified_type_names = True

html_theme = "pydata_sphinx_theme"
html_title = "INS Lab"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_extra_path = ["root"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_search_summary = False  # it fetches pages, which a browser refuses in a folder
html_use_index = False
html_domain_indices = False
html_show_sourcelink = False
html_theme_options = {
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "header_links_before_dropdown": 6,
    "show_toc_level": 2,
    "footer_start": ["copyright"],
    "footer_end": [],
    "article_footer_items": [],
}
