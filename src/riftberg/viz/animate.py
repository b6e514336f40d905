"""A run as a film: MP4 where ffmpeg is installed, GIF otherwise.

A GIF is smaller by default, and its currents are drawn in steps of colour: it compresses by equal pixels only. It has at most
256 colours. Found from a frame alone they go to the shades of the water, of which there are many pixels, and a fragment of few
pixels, or one that breaks off later, gets the colour of something else. So one palette is made for the whole film, in which the
colours of the fragments are exact. Fewer colours and no dithering also make the file smaller: equal pixels beside each other
and from frame to frame cost next to nothing.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from riftberg.errors import InputError
from riftberg.runs.scene import Scene
from riftberg.state import Floats, Ints
from riftberg.system.atomic_files import replacing
from riftberg.viz import colours, style
from riftberg.viz.panels import (
    Panel,
    Projection,
    Water,
    arrow_key,
    fragment_colours,
    fragment_patches,
    project_run,
    speed_bar,
    speed_scale,
    widen_box,
)
from riftberg.viz.plots import figure_title
from riftberg.viz.style import moment_text, new_figure

if TYPE_CHECKING:
    from matplotlib.animation import AbstractMovieWriter


SECONDS = 20.0
"""Length of a film by default."""

FPS, DPI = 20, 110
"""Frames a second and resolution by default."""

GIF_FPS, GIF_DPI, GIF_STEPS = 10, 80, 16
"""The same of a GIF, and steps of its colours of speed."""

PALETTE_FRAMES = 10
"""Frames, spread over the film, whose colours make the palette of a GIF."""


def write_film(
    run: xr.Dataset,
    path: str | Path,
    *,
    hours: float | None = None,
    fps: int | None = None,
    dpi: int | None = None,
    observed: Mapping[str, Sequence[Floats]] | None = None,
    projection: Projection = "auto",
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a film of a run.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.runs.run_file.open_run` or from `Model.run`.
    path : path
        Film, ``.mp4`` or ``.gif``.
    hours : float, optional
        Time between frames; by default such that the film takes 20 s.
    fps, dpi : int, optional
        Frames a second, and resolution.
    observed : mapping, optional
        Observed outlines by ISO day.
    projection : {"auto", "polar", "degrees"}, optional
        As in `riftberg.draw_map`.
    progress : callable, optional
        Called with the number of frames done, and of all.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in (".gif", ".mp4"):
        raise InputError(
            f"cannot write {path.suffix or 'a file without ending'}", where=str(path), remedy="Use .mp4 or .gif"
        )
    if ending == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError("ffmpeg is not installed", where=str(path), remedy="Install ffmpeg, or write a .gif")
    gif = ending == ".gif"
    fps, dpi = fps or (GIF_FPS if gif else FPS), dpi or (GIF_DPI if gif else DPI)
    scene, water = project_run(run, projection)
    records = frame_records(scene, hours, fps)
    film = _Film(scene, water, observed or {}, dpi, steps=GIF_STEPS if gif else None)
    writer: AbstractMovieWriter
    if gif:
        probes = []
        for index in np.unique(np.linspace(0, len(records) - 1, PALETTE_FRAMES).round().astype(int)):
            film.draw(int(records[index]))
            probes.append(figure_image(film.figure))
        exact = (*film.colours.values(), colours.SMALL, colours.GROUND)
        writer = GifWriter(fps, film_palette(probes, exact))
    else:
        # Every player takes even sizes and 4:2:0 colours.
        extra = ["-pix_fmt", "yuv420p", "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2"]
        writer = FFMpegWriter(fps=fps, codec="libx264", extra_args=extra)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path, ending=True) as temporary, writer.saving(film.figure, str(temporary), dpi=dpi):
        for frames_done, record in enumerate(records, start=1):
            film.draw(int(record))
            writer.grab_frame()
            if progress is not None:
                progress(frames_done, len(records))
    return path


def default_ending() -> str:
    """Return ``.mp4`` where ffmpeg is installed, else ``.gif``."""
    return ".mp4" if shutil.which("ffmpeg") else ".gif"


def frame_records(scene: Scene, hours: float | None, fps: int) -> Ints:
    """Return the records of the frames."""
    count = len(scene.times)
    if hours is None:
        return np.unique(np.linspace(0, count - 1, min(count, round(SECONDS * fps))).round().astype(int))
    if not hours > 0.0:
        raise InputError(f"{hours:g} hours", where="--hours", remedy="Give a number above 0")
    moments = np.arange(scene.seconds[0], scene.seconds[-1] + 1.0, 3600.0 * hours)
    return np.unique([int(np.argmin(np.abs(scene.seconds - moment))) for moment in moments])


class _Film:
    """One figure drawn anew for every frame."""

    def __init__(
        self, scene: Scene, water: Water | None, observed: Mapping[str, Sequence[Floats]], dpi: int, *,
        steps: int | None = None,
    ) -> None:  # fmt: skip
        self.scene, self.water, self.observed, self.steps = scene, water, observed, steps
        self.box = widen_box(scene.box(), scene.latlon, 1.6, margin=0.06)
        self.figure = new_figure(9.6, 7.2, dpi)
        self.ax = self.figure.subplots()
        style.put_title(self.figure, figure_title(scene.run, "drift and break-up"), size=11.0)
        self.colours = fragment_colours(scene)
        handles = fragment_patches(scene)
        columns = 1 if len(handles) <= 4 else 2
        self.figure.legend(handles=handles, fontsize=8, loc="outside lower left", frameon=False, ncols=columns)
        sample_records = range(0, len(scene.times), max(1, len(scene.times) // 12))
        self.top, self.flows = speed_scale([self._panel()] * len(sample_records), sample_records)
        if self.flows:
            speed_bar([self.ax], self.top)
        style.lay_out(self.figure)  # once: axes that move from frame to frame would flicker
        # The date stands in the upper left corner: as many points as all ice keep the inset out of it.
        x, y = scene.x[np.isfinite(scene.x)], scene.y[np.isfinite(scene.y)]
        corner = np.full(x.size, self.box.west), np.full(y.size, self.box.north)
        self.inset = self._panel().draw_place(np.append(x, corner[0]), np.append(y, corner[1]))

    def _panel(self) -> Panel:
        return Panel(self.ax, self.scene, self.box, self.water, ticks=6, labels=not self.scene.latlon)

    def draw(self, record: int) -> None:
        """Draw one record."""
        self.ax.clear()
        if self.inset is not None:
            self.ax.add_child_axes(self.inset)
        rings = self.observed.get(str(self.scene.times[record])[:10], ())
        panel = self._panel()
        quiver = panel.draw_date(record, self.top, self.colours, rings, arrows=19, steps=self.steps, ls="--")
        if quiver is not None and self.flows:
            arrow_key(quiver, self.top)
        for number, colour in self.colours.items():
            self.ax.plot(*self.scene.track_line(number, record), color=colour, lw=1.6, zorder=4)
        moment = moment_text(self.scene.times, self.scene.times[record], year=True)
        self.ax.text(0.015, 0.975, moment, transform=self.ax.transAxes, va="top", fontsize=15, fontweight="bold",
                     zorder=12, bbox={"fc": "white", "ec": "none", "alpha": 0.8, "pad": 3})  # fmt: skip


COLOURS = 128
"""In a palette."""

SHADES = (1.0, 0.8, 0.6)
"""Of each exact colour: plain, and under the thin dark edges of the elements."""

SAME = 8
"""Colours that differ by less than this in each of red, green and blue (of 255) need not both be in a palette."""


def figure_image(figure: Figure) -> Image.Image:
    """Return the present image of a figure, in red, green and blue."""
    pixels = BytesIO()
    figure.savefig(pixels, format="rgba", dpi=figure.dpi)
    size = figure.canvas.get_width_height(physical=True)
    return Image.frombytes("RGBA", size, pixels.getvalue()).convert("RGB")


def film_palette(frames: Sequence[Image.Image], exact: Iterable[str]) -> Image.Image:
    """Return a palette for a film, as an image that carries it."""
    width, height = frames[0].size
    strip = Image.new("RGB", (width, height * len(frames)))
    for index, frame in enumerate(frames):
        strip.paste(frame, (0, index * height))
    fixed = [tuple(round(255.0 * factor * value) for value in to_rgb(colour)) for colour in exact for factor in SHADES]
    fixed = list(dict.fromkeys([*fixed, (0, 0, 0), (255, 255, 255)]))
    shades = strip.quantize(COLOURS - len(fixed), dither=Image.Dither.NONE).getpalette() or []
    for shade in zip(shades[0::3], shades[1::3], shades[2::3], strict=True):
        if all(max(abs(a - b) for a, b in zip(shade, other, strict=True)) >= SAME for other in fixed):
            fixed.append(shade)
    palette = Image.new("P", (1, 1))
    palette.putpalette([channel for colour in fixed for channel in colour])
    return palette


class GifWriter(PillowWriter):
    """Writes frames of a figure as a GIF in a palette (see `film_palette`)."""

    def __init__(self, fps: int, palette: Image.Image) -> None:
        super().__init__(fps=fps)
        self.palette = palette
        self.frames: list[Image.Image] = []

    def grab_frame(self, **savefig_kwargs: Any) -> None:
        """Keep the present image of the figure."""
        self.frames.append(figure_image(self.fig).quantize(palette=self.palette, dither=Image.Dither.NONE))

    def finish(self) -> None:
        """Write the file without the pixels that do not change from a frame to the next."""
        first, *rest = self.frames
        first.save(self.outfile, "GIF", save_all=True, append_images=rest, duration=round(1000 / self.fps), loop=0)
