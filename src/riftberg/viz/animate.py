"""A run as a film: MP4 where ffmpeg is installed, GIF otherwise.

A GIF is made smaller by default, and its currents are drawn in steps of colour: it compresses by equal pixels only.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from riftberg.errors import InputError
from riftberg.runs.background import water_of
from riftberg.runs.scene import Scene
from riftberg.state import Floats, Ints
from riftberg.system.atomic_files import replacing
from riftberg.viz import colours, style
from riftberg.viz.moments import moment_text
from riftberg.viz.panels import Panel, Water, arrow_key, fragment_colours, fragment_name, speed_bar, speed_top, widened
from riftberg.viz.plots import figure_title
from riftberg.viz.style import new_figure

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
    water: Water | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a film of a run."""
    path = Path(path)
    gif = _is_gif(path)
    fps, dpi = fps or (GIF_FPS if gif else FPS), dpi or (GIF_DPI if gif else DPI)
    scene = Scene(run)
    film = _Film(scene, water or water_of(run), observed or {}, dpi, steps=GIF_STEPS if gif else None)
    records = frame_records(scene, hours, fps)
    writer = _gif_writer(film, records, fps) if gif else _mp4_writer(fps)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path, ending=True) as part, writer.saving(film.figure, str(part), dpi=dpi):
        for done, record in enumerate(records, start=1):
            film.draw(int(record))
            writer.grab_frame()
            if progress is not None:
                progress(done, len(records))
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
    wanted = np.arange(scene.seconds[0], scene.seconds[-1] + 1.0, 3600.0 * hours)
    return np.unique([int(np.argmin(np.abs(scene.seconds - moment))) for moment in wanted])


def _is_gif(path: Path) -> bool:
    """Return whether a GIF is asked for, and refuse what cannot be written."""
    ending = path.suffix.lower()
    if ending not in (".gif", ".mp4"):
        raise InputError(
            f"cannot write {path.suffix or 'a file without ending'}", where=str(path), remedy="Use .mp4 or .gif"
        )
    if ending == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError("ffmpeg is not installed", where=str(path), remedy="Install ffmpeg, or write a .gif")
    return ending == ".gif"


def _mp4_writer(fps: int) -> AbstractMovieWriter:
    from matplotlib.animation import FFMpegWriter

    # Even sizes and 4:2:0 colours are what every player takes.
    return FFMpegWriter(
        fps=fps, codec="libx264", extra_args=["-pix_fmt", "yuv420p", "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2"]
    )


def _gif_writer(film: _Film, records: Ints, fps: int) -> AbstractMovieWriter:
    from riftberg.viz.gif import GifWriter, figure_image, film_palette

    probes = []
    for place in np.unique(np.linspace(0, len(records) - 1, PALETTE_FRAMES).round().astype(int)):
        film.draw(int(records[place]))
        probes.append(figure_image(film.figure))
    exact = (*film.colours.values(), colours.SMALL, colours.GROUND)
    return GifWriter(fps, film_palette(probes, exact))


class _Film:
    """One figure drawn anew for every frame."""

    def __init__(
        self,
        scene: Scene,
        water: Water | None,
        observed: Mapping[str, Sequence[Floats]],
        dpi: int,
        *,
        steps: int | None = None,
    ) -> None:
        self.scene, self.water, self.observed, self.steps = scene, water, observed, steps
        self.box = widened(scene.grown(scene.box(), 0.06), scene, 1.45)
        self.figure = new_figure(9.6, 7.2, dpi)
        self.ax = self.figure.add_axes((0.075, 0.155, 0.905, 0.745))
        style.put_title(self.figure, figure_title(scene.run, "drift and break-up"), size=11.0, left=0.72)
        self.colours = fragment_colours(scene)
        self._legend()
        some = range(0, len(scene.times), max(1, len(scene.times) // 12))
        panels = [Panel(self.ax, scene, self.box, water)] * len(some)
        self.top = speed_top(panels, some)
        self.flows = any(panel.fastest(record) > 0.0 for panel, record in zip(panels, some, strict=True))
        self.keyed = False

    def draw(self, record: int) -> None:
        """Draw one record."""
        self.ax.clear()
        panel = Panel(self.ax, self.scene, self.box, self.water, ticks=6, labels=not self.scene.latlon)
        arrows = panel.draw_currents(record, self.top, arrows=19, steps=self.steps) if self.flows else None
        panel.draw_floor(shaded=arrows is None)
        for number, colour in self.colours.items():
            self.ax.plot(*self.scene.track_line(number, record), color=colour, lw=1.6, zorder=4)
        panel.draw_ice(record, self.colours)
        panel.draw_outlines(self.observed.get(str(self.scene.times[record])[:10], ()), ls="--")
        panel.draw_scale(0.2)
        if arrows is not None:
            arrow_key(arrows, self.figure, 0.9, 0.035, self.top)
            if not self.keyed:
                speed_bar(self.figure, (0.62, 0.06, 0.24, 0.014), self.top)
                self.keyed = True
        moment = moment_text(self.scene.times, self.scene.times[record], year=True)
        self.ax.text(0.015, 0.975, moment, transform=self.ax.transAxes, va="top", fontsize=15, fontweight="bold",
                     zorder=12, bbox={"fc": "white", "ec": "none", "alpha": 0.8, "pad": 3})  # fmt: skip

    def _legend(self) -> None:
        from matplotlib.patches import Patch

        handles = [Patch(fc=c, ec="black", lw=0.5, label=fragment_name(self.scene, n)) for n, c in self.colours.items()]
        self.figure.legend(
            handles=handles,
            fontsize=8,
            loc="lower left",
            bbox_to_anchor=(0.06, 0.0),
            frameon=False,
            ncols=1 if len(handles) <= 4 else 2,
        )
