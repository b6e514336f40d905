"""How the gallery finds its pictures: those that an example has written into its folder."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any


WIDE = 1.8
"""Width over height above which a picture is the map of a run, of which a thumbnail shows the overview on the left."""

OVERVIEW = (0.0, 0.11, 0.4, 0.8)
"""Its place: left, upper, right and lower edge, as parts of width and height."""


def crop_thumbnails(app: Any) -> None:
    """Make thumbnails of wide maps from their overview; called once the gallery has been run."""
    from PIL import Image

    for thumbnail in Path(app.config.sphinx_gallery_conf["gallery_dirs"]).glob("images/thumb/*_thumb.png"):
        first = thumbnail.parents[1] / thumbnail.name.replace("_thumb.png", "_001.png")
        if not first.exists():
            continue
        with Image.open(first) as picture:
            width, height = picture.size
            if width > WIDE * height:
                part = picture.crop(tuple(round(f * (width, height)[k % 2]) for k, f in enumerate(OVERVIEW)))
                part.thumbnail((560, 420))
                part.save(thumbnail)


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
