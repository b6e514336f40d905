"""How far bergs drift from their tracks where the ocean is coarse: eddies by formula, and their means over cells.

    python docs/examples/coarse_oceans.py      prints the table of docs/explanation/coarse-oceans.md
    python docs/build.py                       draws its figure too

The means are what a coarse ocean would hold at best; they are handed over by the exchange. Bergs of one kilometre, and one of
100 km by 40 km, drift in them and in the formula itself.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from riftberg import Exchange, Iceberg, Model, OceanForcing, Parameters, ocean_grid
from riftberg.constants import EARTH_ROTATION, GRAVITY
from riftberg.ocean.formulas import Eddy, Sum, Uniform, metric_offsets

SPACINGS = {"1/12": 1 / 12, "1/4": 1 / 4, "1/2": 1 / 2, "1": 1.0}
"""Cells (degrees of longitude and latitude) of the oceans."""

DAYS = (1, 3, 10)
STEP = 3600.0
BOX = (-44.0, -28.0, -60.0, -52.0)
FINE = 24
"""Points of the formula along each side of a degree, over which cells are averaged."""

RADIUS, SPEED, MEAN_FLOW = 35e3, 0.25, 0.1
CENTRES = [(lon, lat) for lat in np.arange(-59.2, -52.0, 1.35) for lon in np.arange(-43.5, -28.0, 2.4)]


def ocean() -> Sum:
    """Return eddies that turn one way and the other, 150 km apart, in a mean flow to the east."""
    eddies = [Eddy(centre, RADIUS, SPEED * (-1) ** k) for k, centre in enumerate(CENTRES)]
    return Sum([Uniform((MEAN_FLOW, 0.0)), *eddies])


def level(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    """Return the sea level (m) that balances the eddies, with the Coriolis parameter of their centres, and the mean flow."""
    radius = 6_363_827.0  # of the sphere on which bergs drift
    total = 2.0 * EARTH_ROTATION * radius / GRAVITY * MEAN_FLOW * np.cos(np.radians(lat))
    for k, centre in enumerate(CENTRES):
        x, y = metric_offsets(centre, lon, lat, True)
        coriolis = 2.0 * EARTH_ROTATION * np.sin(np.radians(centre[1]))
        stream = -SPEED * (-1) ** k * RADIUS * np.exp(0.5 * (1.0 - (x * x + y * y) / RADIUS**2))
        total = total + coriolis * stream / GRAVITY
    return total


def bergs() -> dict[str, Iceberg]:
    """Return 60 bergs of one element each, and a berg that is wider than most cells."""
    lon, lat = np.meshgrid(np.linspace(-41.3, -35.3, 10), np.linspace(-57.7, -54.3, 6))
    return {
        "1 km": Iceberg.from_points(lon.ravel(), lat.ravel(), thickness=200.0, length=1000.0, width=1000.0),
        "100 km": Iceberg.rectangle("100 km", "40 km", thickness="200 m", radius="5 km", placement=(-38.0, -56.0)),
    }


def made(berg: Iceberg, forcing: Any) -> Model:
    """Return a model of bergs that do not meet."""
    return Model(berg, forcing, Parameters(stepping={"time_step": STEP, "interactions": False}), "2020-12-09")


def track_of(model: Model, step: Any) -> np.ndarray:
    """Return longitude and latitude by day, of each small berg or of the middle of the large one; shape (days, 2, bergs)."""
    alone = len(model.bonds.id) == 0
    places = []
    for number in range(1, round(DAYS[-1] * 86400.0 / STEP) + 1):
        step()
        if number * STEP % 86400.0 == 0.0:
            e = model.elements
            places.append([q.copy() if alone else np.array([q.mean()]) for q in (e.lon, e.lat)])
    return np.array(places)


def in_formula(berg: Iceberg) -> np.ndarray:
    """Return the tracks in the formula itself."""
    model = made(berg, ocean())
    return track_of(model, model.step)


def in_cells(berg: Iceberg, spacing: float) -> np.ndarray:
    """Return the tracks in an ocean of cells, by the exchange."""
    west, east, south, north = BOX
    columns, rows, parts = (
        round((east - west) / spacing),
        round((north - south) / spacing),
        max(round(FINE * spacing), 1),
    )
    grid = ocean_grid(*np.meshgrid(np.linspace(west, east, columns + 1), np.linspace(south, north, rows + 1)))
    step = spacing / parts
    lon, lat = np.meshgrid(
        west + step * (np.arange(columns * parts) + 0.5), south + step * (np.arange(rows * parts) + 0.5)
    )
    fine = (*ocean().currents(lon, lat, 0.0), level(lon, lat))
    names = ("eastward_sea_water_velocity", "northward_sea_water_velocity", "sea_surface_height_above_geoid")
    means = {n: q.reshape(rows, parts, columns, parts).mean(axis=(1, 3)) for n, q in zip(names, fine, strict=True)}
    model = made(berg, OceanForcing(grid, grid.fields()))
    exchange = Exchange(model, staggering="A")
    return track_of(model, lambda: exchange.step(means))


def apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the distance of tracks, km: the root of its mean square over the bergs, by day."""
    north = 111.07 * (one[:, 1] - other[:, 1])
    east = 111.07 * np.cos(np.radians(one[:, 1])) * (one[:, 0] - other[:, 0])
    return np.sqrt((east**2 + north**2).mean(axis=1))


def travelled(track: np.ndarray, berg: Iceberg) -> np.ndarray:
    """Return how far the bergs are from their starts, km, by day."""
    e = berg.elements
    start = np.array([[e.lon, e.lat]]) if track.shape[2] > 1 else np.array([[[e.lon.mean()], [e.lat.mean()]]])
    return apart(track, np.broadcast_to(start, track.shape))


def table(names: tuple[str, ...] = tuple(SPACINGS)) -> list[tuple[str, ...]]:
    """Return the rows of the page: berg, cells, distance (km) after each of `DAYS`."""
    rows = []
    for size, berg in bergs().items():
        true = in_formula(berg)
        rows.append((size, "drifts", *(f"{travelled(true, berg)[day - 1]:.1f}" for day in DAYS)))
        for name in names:
            error = apart(in_cells(berg, SPACINGS[name]), true)
            rows.append((size, f"{name}°", *(f"{error[day - 1]:.1f}" for day in DAYS)))
    return rows


def draw(path: Path) -> Path:
    """Draw small bergs' tracks in the formula and in cells of a degree over the current, and the distances by day."""
    from riftberg.viz.style import geographic_axes, letters, new_figure

    figure = new_figure(10.5, 4.2, 110)
    left, right = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    lon, lat = np.meshgrid(np.linspace(-42, -33, 180), np.linspace(-58.5, -53.5, 120))
    u, v = ocean().currents(lon, lat, 0.0)
    shade = left.pcolormesh(lon, lat, np.hypot(u, v), cmap="Blues", shading="auto")
    figure.colorbar(shade, ax=left, label="speed of the current (m s$^{-1}$)")
    small, large = bergs().values()
    start = np.array([[small.elements.lon, small.elements.lat]])
    true = {berg_size: in_formula(berg) for berg_size, berg in bergs().items()}
    for name, colour in (("1/4", "#2a9d3a"), ("1", "#d1495b")):
        tracks = np.concatenate([start, in_cells(small, SPACINGS[name])])
        for k in range(0, 60, 7):
            left.plot(*tracks[:, :, k].T, color=colour, lw=1.4, marker=".", ms=4, label=f"in cells of {name}°" if k == 0 else None)
    tracks = np.concatenate([start, true["1 km"]])
    for k in range(0, 60, 7):
        left.plot(*tracks[:, :, k].T, color="black", lw=1.4, marker=".", ms=4, label="in the formula" if k == 0 else None)
    left.set(xlim=(-42, -33), ylim=(-58.5, -53.5), aspect=1.0 / np.cos(np.radians(56.0)))
    left.set_title("bergs of 1 km, ten days (dots: daily)", fontsize=10)
    geographic_axes(left, latlon=True, ticks=5)
    left.legend(loc="lower right", fontsize=8, framealpha=0.9)
    days = np.arange(1, DAYS[-1] + 1)
    for (name, spacing), colour in zip(SPACINGS.items(), ("#00798c", "#2a9d3a", "#edae49", "#d1495b"), strict=True):
        right.plot(days, apart(in_cells(small, spacing), true["1 km"]), color=colour, label=f"1 km, {name}°")
        right.plot(days, apart(in_cells(large, spacing), true["100 km"]), color=colour, ls="--", label=f"100 km, {name}°")
    right.plot(days, travelled(true["1 km"], small), color="black", lw=0.8, label="1 km, distance drifted")
    right.set(xlabel="days since the start", ylabel="distance from the track in the formula (km)", yscale="log")
    right.set_title("length of the berg, width of the cells", fontsize=10)
    right.legend(fontsize=7, ncols=2, loc="lower right")
    letters([left, right])
    figure.savefig(path)
    return path


if __name__ == "__main__":
    for row in table():
        print("| " + " | ".join(row) + " |")
