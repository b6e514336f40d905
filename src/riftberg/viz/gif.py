"""GIF films: one palette for the whole film, in which the colours of the fragments are exact.

A GIF knows at most 256 colours. Found from a frame alone they go to the shades of the water, of which there are many
pixels, and a fragment of few pixels, or one that is born later, gets the colour of something else. Fewer colours and
no dithering also make the file smaller: equal pixels beside each other and from frame to frame cost next to nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from io import BytesIO
from typing import Any

from matplotlib.animation import PillowWriter
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

COLOURS = 128
"""In a palette."""

SHADES = (1.0, 0.8, 0.6)
"""Of each exact colour: as it is, and under the thin dark edges of the elements."""

SAME = 8
"""Colours that differ by less than this in each of red, green and blue (of 255) need not both be in a palette."""

Colour = tuple[int, int, int]


def figure_image(figure: Figure) -> Image.Image:
    """Return a figure as it is drawn now, in red, green and blue."""
    pixels = BytesIO()
    figure.savefig(pixels, format="rgba", dpi=figure.dpi)
    size = figure.canvas.get_width_height(physical=True)
    return Image.frombytes("RGBA", size, pixels.getvalue()).convert("RGB")


def film_palette(frames: Sequence[Image.Image], exact: Iterable[str]) -> Image.Image:
    """Return a palette for a film, as an image that carries it."""
    width, height = frames[0].size
    together = Image.new("RGB", (width, height * len(frames)))
    for place, frame in enumerate(frames):
        together.paste(frame, (0, place * height))
    kept = [_shade(colour, part) for colour in exact for part in SHADES]
    kept = list(dict.fromkeys([*kept, (0, 0, 0), (255, 255, 255)]))
    shades = together.quantize(COLOURS - len(kept), dither=Image.Dither.NONE).getpalette() or []
    kept += [c for c in zip(shades[0::3], shades[1::3], shades[2::3], strict=True) if not _alike(c, kept)]
    palette = Image.new("P", (1, 1))
    palette.putpalette([part for colour in kept for part in colour])
    return palette


def _shade(colour: str, part: float) -> Colour:
    red, green, blue = (round(255.0 * part * value) for value in to_rgb(colour))
    return red, green, blue


def _alike(colour: Colour, others: Sequence[Colour]) -> bool:
    return any(max(abs(a - b) for a, b in zip(colour, other, strict=True)) < SAME for other in others)


class GifWriter(PillowWriter):
    """Writes frames of a figure as a GIF in a palette (see `film_palette`)."""

    def __init__(self, fps: int, palette: Image.Image) -> None:
        super().__init__(fps=fps)
        self.palette = palette
        self.frames: list[Image.Image] = []

    def grab_frame(self, **savefig_kwargs: Any) -> None:
        """Keep the figure as it is now."""
        self.frames.append(figure_image(self.fig).quantize(palette=self.palette, dither=Image.Dither.NONE))

    def finish(self) -> None:
        """Write the file; what did not change from a frame to the next is left out of it."""
        first, *rest = self.frames
        first.save(self.outfile, "GIF", save_all=True, append_images=rest, duration=round(1000 / self.fps), loop=0)
