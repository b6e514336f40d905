"""GIF films: a fragment has its colour in every frame, however few its pixels and however late it is born."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from fakes import FakeModel
from riftberg import open_run
from riftberg.runs.run_file import RunWriter
from riftberg.viz.animate import film_palette, write_film
from riftberg.viz.colours import FRAGMENTS as FRAGMENT_COLOURS

COLOURS = 128
GIF_FPS = 10


def bytes_of(colour: str) -> tuple[int, ...]:
    """Return red, green and blue from 0 to 255."""
    return tuple(round(255 * part) for part in to_rgb(colour))


def count(frame: Image.Image, colour: str) -> int:
    """Return the pixels of a frame that are exactly of a colour."""
    return int((np.asarray(frame.convert("RGB")) == bytes_of(colour)).all(axis=-1).sum())


def water(seed: int) -> Image.Image:
    """Return a frame of many shades of blue and white."""
    depth = np.random.default_rng(seed).uniform(0.3, 1.0, (60, 80, 1))
    return Image.fromarray((255 * np.concatenate([depth, depth**0.6, depth**0.1], axis=-1)).astype("u1"))


def with_specks() -> Image.Image:
    """Return a frame of water with three pixels of the colour of each fragment."""
    frame = water(3)
    for row, colour in enumerate(FRAGMENT_COLOURS):
        for x in (10, 11, 12):
            frame.putpixel((x, 5 * row), bytes_of(colour))
    return frame


def test_colours_of_fragments_are_exact_even_if_no_frame_of_the_palette_shows_them() -> None:
    palette = film_palette([water(1), water(2)], FRAGMENT_COLOURS)
    shown = with_specks().quantize(palette=palette, dither=Image.Dither.NONE)
    assert [count(shown, colour) for colour in FRAGMENT_COLOURS] == [3] * len(FRAGMENT_COLOURS)
    # A palette from the pixels alone, even of this very frame, is none, which is why there is one of our own.
    assert 0 in [count(with_specks().quantize(COLOURS), colour) for colour in FRAGMENT_COLOURS]


def test_water_keeps_its_shades_beside_the_exact_colours() -> None:
    frames = [water(1), water(2)]
    shown = frames[1].quantize(palette=film_palette(frames, FRAGMENT_COLOURS), dither=Image.Dither.NONE).convert("RGB")
    apart = np.abs(np.asarray(shown).astype(int) - np.asarray(frames[1]).astype(int))
    assert apart.max() <= 12
    assert len(np.unique(np.asarray(shown).reshape(-1, 3), axis=0)) <= COLOURS


@pytest.mark.slow
def test_a_fragment_has_its_colour_from_its_birth_on(tmp_path: Path) -> None:
    FakeModel().advance(2, recorders=[RunWriter(tmp_path / "run.nc", every_hours=6)])
    with open_run(tmp_path) as run:
        write_film(run, tmp_path / "film.gif", hours=24, dpi=60)
    with Image.open(tmp_path / "film.gif") as film:
        assert film.info["duration"] == 1000 / GIF_FPS
        assert film.n_frames == 3  # type: ignore[attr-defined]
        film.seek(0)
        legend = count(film, FRAGMENT_COLOURS[1])
        assert count(film, FRAGMENT_COLOURS[0]) > 2 * legend > 20
        film.seek(2)
        assert count(film, FRAGMENT_COLOURS[1]) > legend
