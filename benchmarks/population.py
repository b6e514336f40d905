"""A population of bergs around Antarctica on a grid of a quarter of a degree made by formula, in one process: time and memory.

    python benchmarks/population.py                      50,000 bergs and 20 giant ones of bonded elements, 10 days
    python benchmarks/population.py --days 365           the year itself
    python benchmarks/population.py --bergs 2000 --days 1

Writes ``population-monthly.nc`` and a map of fresh water by process, ``population.png``. The figure for a year is the time of the
steps, the first left out (it compiles), times the steps of a year: an extrapolation wherever ``--days`` is less.
"""

from __future__ import annotations

import argparse
import resource
import time
from pathlib import Path

import numpy as np
import xarray as xr

from riftberg import Iceberg, Model, Parameters
from riftberg.bergs.fields import LENGTHS, SHARES, thickness_of
from riftberg.coupling.exchange import ocean_grid
from riftberg.coupling.forcing import OceanForcing
from riftberg.coupling.gridded import GridRecorder
from riftberg.ocean.grid import Grid

CELL = 0.25
SOUTH, NORTH = -78.0, -45.0
ASPECT = 1.5
STEP = 3600.0
GIANTS = 20


def coast(lon: np.ndarray) -> np.ndarray:
    """Latitude of the coast, degrees: a continent with a Peninsula at 60 degrees west."""
    return -70.0 + 2.0 * np.sin(np.radians(3.0 * lon)) + 6.0 * np.exp(-(((lon + 60.0) / 6.0) ** 2))


def ocean() -> OceanForcing:
    """Return grid, land, a circumpolar and a coastal current, wind, temperature, salinity and sea ice."""
    lon, lat = np.meshgrid(np.arange(-180.0, 180.0 + CELL, CELL), np.arange(SOUTH, NORTH + CELL, CELL))
    x, y = 0.25 * (lon[1:, 1:] + lon[:-1, :-1] + lon[1:, :-1] + lon[:-1, 1:]), lat[1:, 1:] - CELL / 2
    mask = (y > coast(x)).astype(float)
    off = y - coast(x)
    temperature = -1.8 + 6.0 / (1.0 + np.exp(-(y + 55.0) / 3.0))
    fields = {
        "uo": 0.25 * np.exp(-(((y + 52.0) / 4.0) ** 2)) - 0.15 * np.exp(-(((off - 1.0) / 1.5) ** 2)),
        "vo": 0.03 * np.exp(-(((off - 1.0) / 1.5) ** 2)) + 0.02,
        "ua": 9.0 * np.exp(-(((y + 52.0) / 7.0) ** 2)) - 4.0 * np.exp(-((off / 3.0) ** 2)),
        "sst": temperature, "sss": np.full_like(x, 34.0), "depth": np.clip(300.0 + 500.0 * off, 300.0, 4000.0),
        "ice_fraction": 0.9 / (1.0 + np.exp((y + 62.0) / 1.5)),
        "ice_thickness": 0.8 / (1.0 + np.exp((y + 62.0) / 1.5)),
    }  # fmt: skip
    grid = ocean_grid(lon, lat, mask=mask)
    return OceanForcing(
        grid, grid.fields(**{name: value * mask if name != "depth" else value for name, value in fields.items()})
    )


def population(grid: Grid, count: int, seed: int = 1) -> Iceberg:
    """Return bergs of the ten classes of Gladstone et al. (2001), one to a cell, and giant ones of bonded elements."""
    random, g = np.random.default_rng(seed), grid.arrays
    lon, lat, wet = (a[grid.domain] for a in (g.lon_centre, g.lat_centre, g.mask))
    off = lat - coast(lon)
    free = (wet > 0.5) & (off > 0.6) & (lat < -52.0)
    places = [(-171.0 + 18.0 * k, -61.0) for k in range(GIANTS)]
    for west, south in places:
        free &= ~((np.abs(lon - west) < 1.5) & (np.abs(lat - south) < 0.7))
    # Rising, so that neighbours in memory are neighbours at sea.
    chosen = np.sort(random.choice(np.flatnonzero(free), count, replace=False))
    length = random.choice(LENGTHS, count, p=SHARES / SHARES.sum())
    width = length / ASPECT
    jitter = random.uniform(-0.05, 0.05, (2, count))
    small = Iceberg.from_points(
        lon.ravel()[chosen] + jitter[0], lat.ravel()[chosen] + jitter[1], thickness=thickness_of(length * width),
        radius=0.5 * np.sqrt(length * width), pieces=np.arange(count),
    )  # fmt: skip
    giants = [Iceberg.rectangle(60e3, 25e3, thickness=220.0, radius=3000.0, placement=place) for place in places]
    return Iceberg.join([small, *giants], names=["population", *(f"G{k + 1}" for k in range(GIANTS))])


def draw(monthly: xr.Dataset, path: Path) -> None:
    """Draw fresh water by process, mean of the run."""
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    names = ("base", "sides", "waves", "bergy_bits")
    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    panels = figure.subplots(len(names), 1, sharex=True)
    for axes, name in zip(panels, names, strict=True):
        water = monthly["ficeberg_process"].sel(process=name).mean("time") * 86400.0
        drawn = axes.pcolormesh(
            monthly["lon"],
            monthly["lat"],
            np.maximum(water, 1e-9),
            norm=LogNorm(1e-5, 1.0),
            cmap="viridis",
            rasterized=True,
        )
        axes.set(ylabel="latitude", title=name.replace("_", " "))
    figure.colorbar(drawn, ax=panels, label="fresh water (kg m$^{-2}$ d$^{-1}$)")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Run, and print time, memory and the ledger."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--bergs", type=int, default=50_000)
    parser.add_argument("--days", type=float, default=10.0)
    options = parser.parse_args()
    began = time.perf_counter()
    forcing = ocean()
    parameters = Parameters(
        stepping={"time_step": STEP}, rolling={"enabled": True},
        melt={"enabled": True, "base": "three_equation", "bits_fraction": 0.3},
    )  # fmt: skip
    model = Model(population(forcing.ocean_grid, options.bergs), forcing, parameters)
    recorder = GridRecorder("population", forcing.ocean_grid, every_hours=24.0 * 30)
    print(
        f"{model.elements.size} elements, {model.bonds.first.size} bonds; made in {time.perf_counter() - began:.1f} s",
        flush=True,
    )
    recorder.start(model)
    marks = []
    for _ in range(round(options.days * 86400.0 / STEP)):
        start = time.perf_counter()
        model.step()
        recorder.record(model)
        marks.append(time.perf_counter() - start)
    recorder.finish(model)
    step, steps = float(np.mean(marks[1:] or marks)), 365 * 86400.0 / STEP
    print(f"{len(marks)} steps of {STEP:g} s: {1e3 * step:.0f} ms each after the first ({marks[0]:.0f} s)")
    print(f"a year at this pace, extrapolated from {options.days:g} days: {step * steps / 60.0:.1f} minutes")
    print(f"largest memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
    assert model.life is not None
    print("\n".join(model.life.balance(model).lines()))
    draw(recorder.monthly(), Path("population.png"))


if __name__ == "__main__":
    main()
