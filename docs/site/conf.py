"""Settings of the documentation site; `python docs/build.py --site` builds it.

The source folder is the repository itself, so that links between pages work on the site as they do where the repository is read.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "src"))
sys.path.insert(0, str(Path(__file__).resolve().parent))

from riftberg.version import __version__  # noqa: E402

project, author, release = "Riftberg", "The Riftberg developers", __version__
copyright = author  # noqa: A001

root_doc = "docs/index"
include_patterns = [
    "docs/*.md", "docs/tutorials/*.md", "docs/howto/*.md", "docs/explanation/*.md", "docs/reference/*.md", "docs/evidence/*.md",
    "CONTRIBUTING.md", "CHANGELOG.md", "benchmarks/README.md", "docs/made-notebooks/*.md", "docs/made-gallery/*.rst", "docs/made-gallery/**/*.rst",
]  # fmt: skip
exclude_patterns = [".venv", ".git", "src", "tests", "build", "**/sg_execution_times.rst",
                    "sg_execution_times.rst"]  # fmt: skip
extensions = [
    "myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml", "sphinx_design", "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]  # fmt: skip

myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 4
myst_dmath_allow_digits = False

autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_ivar = True

sphinx_gallery_conf: dict[str, Any] = {
    "examples_dirs": str(ROOT / "docs" / "gallery"),
    "gallery_dirs": str(ROOT / "docs" / "made-gallery"),
    "filename_pattern": r"/[a-z]",
    "within_subsection_order": "FileNameSortKey",
    # Real forcing: where its files are, or can be fetched.
    "ignore_pattern": r"__init__\.py" if {"RIFTBERG_DATA", "CI"} & set(os.environ) else r"__init__\.py|oras5\.py",
    "plot_gallery": os.environ.get("RIFTBERG_GALLERY", "1") == "1",
    "image_scrapers": ("pictures.written_pictures",),
    "abort_on_example_error": True,
    "remove_config_comments": True,
    "download_all_examples": False,
    "show_memory": False,
    "min_reported_time": 1e9,
    "thumbnail_size": (560, 420),
    "copyfile_regex": "",
}

html_math_renderer = "mathml"
html_theme = "pydata_sphinx_theme"
html_title = "Riftberg"
html_extra_path = [os.environ["RIFTBERG_SITE_EXTRA"]]
html_static_path = [str(ROOT / "docs" / "site" / "static")]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_theme_options = {
    "show_prev_next": False,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "header_links_before_dropdown": 6,
}
copybutton_exclude = ".linenos, .gp, .go"


def setup(app: Any) -> None:
    """Crop thumbnails after sphinx-gallery, which runs with the usual priority of 500, has written them."""
    from pictures import crop_thumbnails

    app.connect("builder-inited", crop_thumbnails, priority=900)
