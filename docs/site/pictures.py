"""How the gallery finds its pictures: those that an example has written into its folder."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any


def written_pictures(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any], **options: Any) -> str:
    """Return the text that shows the PNG files which a block of an example has written, and take them into the gallery.

    Parameters
    ----------
    block, block_vars, gallery_conf
        As sphinx-gallery gives them to its scrapers.
    """
    from sphinx_gallery.scrapers import figure_rst

    folder = Path(block_vars["src_file"]).parent
    names = []
    for path in sorted(folder.glob("*.png")):
        name = next(block_vars["image_path_iterator"])
        shutil.move(path, name)
        names.append(name)
    return str(figure_rst(names, gallery_conf["src_dir"]))
