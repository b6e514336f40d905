"""A population of bergs around Antarctica on a grid of a quarter of a degree made by formula, in one process: time and memory.

    python benchmarks/population.py                      50,000 bergs and 20 giant ones of bonded elements, 10 days
    python benchmarks/population.py --days 365           the year itself
    python benchmarks/population.py --bergs 2000 --days 1
    python benchmarks/population.py --days 90 --save a.nc
    python benchmarks/population.py --days 90 --go-on a.nc --save b.nc     the year in parts

Writes ``population-monthly.nc``, named by the day where it begins, and from all of these a map of fresh water by process,
``population.png``. The figure for a year is the processor time of the steps, the first left out (it compiles), times the steps
of a year: an extrapolation wherever ``--days`` is less.
"""

from __future__ import annotations

import argparse
import resource
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from riftberg import Iceberg, Model, Parameters
from riftberg.bergs.populations import LENGTHS, SHARES, usual_thickness
from riftberg.constants import EARTH_RADIUS_KID, EARTH_ROTATION, GRAVITY
from riftberg.coupling.exchange import ocean_grid
from riftberg.coupling.fields import OceanForcing
from riftberg.coupling.gridded import GridRecorder
from riftberg.ocean.grid import Grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CELL = 0.25
SOUTH, NORTH = -78.0, -45.0
ASPECT = 1.5
STEP = 10800.0
GIANTS = 20


def coast(lon: np.ndarray) -> np.ndarray:
    """Latitude of the coast, degrees: a continent with a Peninsula at 60 degrees west."""
    return -70.0 + 2.0 * np.sin(np.radians(3.0 * lon)) + 6.0 * np.exp(-(((lon + 60.0) / 6.0) ** 2))


def balanced(u: np.ndarray, lat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the sea level (m) whose slope balances an eastward current (m s-1), and the northward current that it drives too.

    ``f u = -g deta/dy``, summed up from the south, and ``f v = g deta/dx``.
    """
    f = 2.0 * EARTH_ROTATION * np.sin(np.radians(lat))
    side = EARTH_RADIUS_KID * np.radians(CELL)
    slope = -f * u / GRAVITY * side
    level = np.cumsum(slope, axis=0) - 0.5 * slope
    eastward = (np.roll(level, -1, axis=1) - np.roll(level, 1, axis=1)) / (2.0 * side * np.cos(np.radians(lat)))
    return level, GRAVITY / f * eastward


def ocean() -> OceanForcing:
    """Return grid, land, a circumpolar and a coastal current with their sea level, wind, temperature, salinity and sea ice."""
    lon, lat = np.meshgrid(np.arange(-180.0, 180.0 + CELL, CELL), np.arange(SOUTH, NORTH + CELL, CELL))
    x, y = 0.25 * (lon[1:, 1:] + lon[:-1, :-1] + lon[1:, :-1] + lon[:-1, 1:]), lat[1:, 1:] - CELL / 2
    mask = (y > coast(x)).astype(float)
    off = y - coast(x)
    temperature = -1.8 + 6.0 / (1.0 + np.exp(-(y + 55.0) / 3.0))
    u = 0.25 * np.exp(-(((y + 54.0) / 6.0) ** 2)) - 0.15 * np.exp(-(((off - 1.0) / 1.5) ** 2))
    level, v = balanced(u, y)
    # What leaves the coast is not balanced: it is driven by the wind, and ends before the grid does.
    northward = (0.03 * np.exp(-(((off - 1.0) / 1.5) ** 2)) + 0.02) / (1.0 + np.exp((y + 52.0) / 1.5))
    fields = {
        "uo": u, "vo": v + northward, "ssh": level,
        "ua": 9.0 * np.exp(-(((y + 52.0) / 7.0) ** 2)) - 4.0 * np.exp(-((off / 3.0) ** 2)),
        "sst": temperature, "sss": np.full_like(x, 34.0), "depth": np.clip(300.0 + 500.0 * off, 300.0, 4000.0),
        "ice_fraction": 0.9 / (1.0 + np.exp((y + 62.0) / 1.5)),
        "ice_thickness": 0.8 / (1.0 + np.exp((y + 62.0) / 1.5)),
    }  # fmt: skip
    grid = ocean_grid(lon, lat, mask=mask)
    return OceanForcing(
        grid,
        grid.fields(**{name: value if name in ("depth", "ssh") else value * mask for name, value in fields.items()}),
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
        lon.ravel()[chosen] + jitter[0], lat.ravel()[chosen] + jitter[1], thickness=usual_thickness(length * width),
        radius=0.5 * np.sqrt(length * width), pieces=np.arange(count),
    )  # fmt: skip
    giants = [Iceberg.rectangle(60e3, 25e3, thickness=220.0, radius=3000.0, placement=place) for place in places]
    return Iceberg.join([small, *giants], names=["population", *(f"G{k + 1}" for k in range(GIANTS))])


def all_water(files: list[Path], grid: Grid) -> tuple[np.ndarray, list[str], float]:
    """Return fresh water by process (kg m-2) on the cells of the grid, the processes, and the time of all months (s)."""
    spans: dict[np.datetime64, tuple[float, np.ndarray, tuple[int, int]]] = {}
    names, seconds = [], 0.0
    for file in files:  # a part that goes on in the middle of a month has all of that month
        with xr.open_dataset(file) as monthly:
            bounds, names = monthly["time_bnds"].values, [str(name) for name in monthly["process"].values]
            water = monthly["ficeberg_process"].transpose("time", "process", "j", "i").values
            west, south = float(monthly["lon"][0, 0]), float(monthly["lat"][0, 0])
        corner = round((south - SOUTH) / CELL - 0.5), round((west + 180.0) / CELL - 0.5)
        for (since, end), mean in zip(bounds, water, strict=True):
            spans[since] = (end - since) / np.timedelta64(1, "s"), mean, corner
    total = np.zeros((len(names), grid.arrays.nj, grid.arrays.ni))
    for length, mean, (j, i) in spans.values():
        total[:, j : j + mean.shape[1], i : i + mean.shape[2]] += length * mean
        seconds += length
    return total, names, seconds


def on_map(lon: np.ndarray, lat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points of a map from above the South Pole, Greenwich up, as far from the middle as they are from the pole."""
    return (90.0 + lat) * np.sin(np.radians(lon)), (90.0 + lat) * np.cos(np.radians(lon))


def corners_of(grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of all cells on the map."""
    g = grid.arrays
    rows, columns = (slice(g.halo - 1, g.halo + count) for count in (g.nj, g.ni))
    return on_map(g.lon[rows, columns], g.lat[rows, columns])


def draw_frame(axes: Axes, grid: Grid) -> None:
    """Draw land, parallels and meridians."""
    land = np.where(grid.arrays.mask[grid.domain] < 0.5, 1.0, np.nan)
    axes.pcolormesh(*corners_of(grid), land, cmap="Greys", vmin=0.0, vmax=2.5, rasterized=True)
    around = np.linspace(-180.0, 180.0, 361)
    axes.fill(*on_map(around, np.full(361, SOUTH + 0.3)), color="0.72", linewidth=0.0)
    for south in (-50.0, -60.0, -70.0):
        axes.plot(*on_map(around, np.full(361, south)), color="0.5", linewidth=0.4)
        x, y = on_map(np.array(45.0), np.array(south))
        axes.text(x, y, f"{-south:.0f}° S", fontsize=7, color="0.3")
    for west in range(0, 360, 90):
        axes.plot(*on_map(np.full(2, west), np.array([SOUTH, NORTH])), color="0.5", linewidth=0.4)
    axes.set(aspect="equal", xlim=(-45.5, 45.5), ylim=(-45.5, 45.5))
    axes.set_axis_off()


def draw(water: np.ndarray, names: list[str], seconds: float, grid: Grid, path: Path) -> None:
    """Draw fresh water by process from above the South Pole, where there is any, with its sum."""
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    shown = [k for k, name in enumerate(names) if water[k].any()]
    figure = Figure(figsize=(8.0, 4.1 * -(-len(shown) // 2)), layout="constrained")
    panels = np.atleast_1d(figure.subplots(-(-len(shown) // 2), 2)).ravel()
    area = grid.arrays.area[grid.domain]
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    for axes, k in zip(panels, shown, strict=False):
        draw_frame(axes, grid)
        daily = np.where(water[k] > 0.0, 86400.0 / seconds * water[k], np.nan)
        drawn = axes.pcolormesh(*corners_of(grid), daily, norm=LogNorm(1e-4, 1.0), cmap="YlGnBu", rasterized=True)
        axes.set_title(f"{names[k].replace('_', ' ')}: {(water[k] * area).sum() / 1e12:.3g} Gt", fontsize=10)
    figure.suptitle(f"Fresh water of {seconds / 86400.0:.0f} days by the way in which the ice melts", fontsize=11)
    figure.colorbar(
        drawn, ax=panels, label="mean flux (mm a day); white: none", shrink=0.7, extend="both", orientation="horizontal"
    )
    figure.savefig(path, dpi=110)


def begun(forcing: OceanForcing, bergs: int, restart: Path | None) -> Model:
    """Return the model at its start, or where a part of the year ended."""
    if restart is not None:
        return Model.resume(restart, forcing)
    parameters = Parameters(
        stepping={"time_step": STEP}, rolling={"enabled": True},
        melt={"enabled": True, "base": "three_equation", "bits_fraction": 0.3},
    )  # fmt: skip
    return Model(population(forcing.ocean_grid, bergs), forcing, parameters)


def main() -> None:
    """Run, and print time, memory and the ledger."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--bergs", type=int, default=50_000)
    parser.add_argument("--days", type=float, default=10.0)
    parser.add_argument("--go-on", type=Path, help="restart file of the part before")
    parser.add_argument("--save", type=Path, help="restart file to write at the end")
    options = parser.parse_args()
    began = time.perf_counter()
    forcing = ocean()
    model = begun(forcing, options.bergs, options.go_on)
    first_day = model.time / 86400.0
    print(
        f"{model.elements.size} elements, {model.bonds.first.size} bonds; made in {time.perf_counter() - began:.1f} s",
        flush=True,
    )
    recorder = GridRecorder(f"population-{first_day:03.0f}", forcing.ocean_grid, every_hours=24.0 * 30)
    recorder.start(model)
    marks, walls = [], []
    for _ in range(round(options.days * 86400.0 / STEP)):
        start, wall = time.process_time(), time.perf_counter()
        model.step()
        recorder.record(model)
        marks.append(time.process_time() - start)
        walls.append(time.perf_counter() - wall)
        if len(marks) % 100 == 0:
            recent = np.mean(marks[-99:])
            print(
                f"day {model.time / 86400.0:.1f}: {1e3 * recent:.0f} ms a step, {model.elements.size} elements",
                flush=True,
            )
    recorder.finish(model)
    step, wall_step, steps = (
        float(np.mean(marks[1:] or marks)),
        float(np.mean(walls[1:] or walls)),
        365 * 86400.0 / STEP,
    )
    print(
        f"{len(marks)} steps of {STEP:g} s: {1e3 * step:.0f} ms each of processor time, {1e3 * wall_step:.0f} ms on the wall, "
        f"after the first ({marks[0]:.0f} s); all {sum(marks):.0f} s"
    )
    whole = "measured" if options.days >= 365 else f"extrapolated from {options.days:g} days"
    print(f"a year at this pace, {whole}: {step * steps / 60.0:.1f} minutes")
    print(f"largest memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
    assert model.life is not None
    print("\n".join([*model.life.balance(model).lines(), *model.motion.balance(model, model.remembered).lines()]))
    print(f"{len(model.contacts.rows)} meetings, {model.bonds_broken} bonds broken")
    if options.save is not None:
        model.save(options.save)
    files = sorted(Path().glob("population-*-monthly.nc"))
    draw(*all_water(files, forcing.ocean_grid), forcing.ocean_grid, Path("population.png"))


if __name__ == "__main__":
    main()
