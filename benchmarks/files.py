"""Cost of forcing from files beside a formula: a day, a further member of a forecast, the start of a run, a berg on a shelf.

    python benchmarks/files.py [--days 4] [--members 4] [--starts 3] [--shelf]

A berg of 66 x 54 km and 300 m in an eddy, afloat, on files of the layout of GLORYS (daily, 1/12 degree, packed, 12 levels to 640
m, sea level), ERA5 (6-hourly, 1/4 degree) and GEBCO, which are made here. Processor seconds, the least of some by turns.
``--shelf``: 24 days instead, in which it comes to a rough shelf, as whole commands: without floor, unbroken, and breaking.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np
import xarray as xr

from riftberg.ensembles.forecast import forecast_plan
from riftberg.ensembles.member import run_member
from riftberg.ensembles.vary import Draws
from riftberg.experiments import Options, build
from riftberg.runs.model import Model

BERG = "{rectangle: {length: 66 km, width: 54 km}, placement: [-39.0, -56.0], thickness: 300 m}"
FORCING = {
    "formula": "{kind: formula, uniform: {current: [0.15, 0.1], wind: [7, 1]}, "
    "eddy: {centre: [-40, -56.5], radius: 60 km, speed: 0.2}}",
    "files": "[glorys.nc, era5.nc, gebco.nc]",
}
DATES = np.arange("2025-02-10", "2025-03-12", dtype="datetime64[D]").astype("datetime64[ns]")
SHELF = {
    "none": "{grounding: {law: none}, fracture: {enabled: false}}",
    "bed, unbroken": "{fracture: {enabled: false}}",
    "bed, breaking": "{}",
}
"""Parameters of the runs to the shelf."""

LEVELS = np.array([0.5, 5.0, 15.8, 29.4, 47.4, 77.9, 109.7, 155.9, 222.5, 318.1, 453.9, 643.6])


def axes(step: float, south: float = -58.5, north: float = -52.0) -> dict[str, tuple[str, np.ndarray, dict[str, str]]]:
    """Return latitudes and longitudes of a product, degrees."""
    return {
        "latitude": ("latitude", np.arange(south, north, step), {"units": "degrees_north"}),
        "longitude": ("longitude", np.arange(-43.0, -32.0, step), {"units": "degrees_east"}),
    }


def write_files(folder: Path) -> None:
    """Write an eddy that moves to the east, a wind that turns, and a floor with land in the north-east."""
    points = axes(1.0 / 12.0)
    y, x = np.meshgrid(points["latitude"][1], points["longitude"][1], indexing="ij")
    day = np.arange(DATES.size)[:, None, None]
    level = 0.1 * (y + 55.0) + 0.15 * np.exp(-(((x + 40.5 - 0.05 * day) / 0.8) ** 2 + ((y + 56.5) / 0.45) ** 2))
    land = (x + 35.0) ** 2 + ((y + 54.3) * 1.7) ** 2 < 1.0
    # Geostrophic: g / f at 56 S, over the spacing of the nodes (m).
    balance = 9.81 / (1.458e-4 * np.sin(np.radians(56.0)))
    u, v = balance / 9266.0 * np.gradient(level, axis=1), -balance / 5181.0 * np.gradient(level, axis=2)
    profile = np.exp(-LEVELS / 900.0)[:, None, None]
    ocean = {
        "uo": ("eastward_sea_water_velocity", "m s-1", u[:, None] * profile),
        "vo": ("northward_sea_water_velocity", "m s-1", v[:, None] * profile),
        "thetao": ("sea_water_potential_temperature", "degrees_C", 1.0 + profile + 0.0 * u[:, None]),
        "so": ("sea_water_salinity", "1e-3", 34.5 - profile + 0.0 * u[:, None]),
        "zos": ("sea_surface_height_above_geoid", "m", level),
    }
    times = {"time": ("time", DATES, {"standard_name": "time"})}
    depth = {"depth": ("depth", LEVELS, {"units": "m", "positive": "down", "standard_name": "depth"})}
    dims = {4: ("time", "depth", "latitude", "longitude"), 3: ("time", "latitude", "longitude")}
    packed = {"dtype": "int16", "scale_factor": 0.001, "_FillValue": -32767, "zlib": True}
    xr.Dataset(
        {
            name: (dims[values.ndim], np.where(land, np.nan, values), {"standard_name": standard, "units": units})
            for name, (standard, units, values) in ocean.items()
        },
        {**times, **depth, **points},
        {"title": "daily mean fields", "source": "MERCATOR GLO12", "institution": "MERCATOR OCEAN"},
    ).to_netcdf(folder / "glorys.nc", encoding={name: packed | {"scale_factor": 0.002} for name in ocean})
    hours = np.arange(DATES[0], DATES[-1], np.timedelta64(6, "h"))
    shape = (hours.size, *(values.size for _, values, _ in axes(0.25).values()))
    turn = (2.0 * np.pi * np.arange(hours.size) / 18.0)[:, None, None]
    wind = {"u10": 7.0 + 5.0 * np.sin(turn), "v10": 1.0 + 4.0 * np.cos(turn)}
    xr.Dataset(
        {
            name: (
                ("valid_time", "latitude", "longitude"),
                np.broadcast_to(values, shape).astype("f4"),
                {"units": "m s**-1", "long_name": f"10 metre {name[0].upper()} wind component"},
            )
            for name, values in wind.items()
        },
        {"valid_time": ("valid_time", hours, {"standard_name": "time"}), **axes(0.25)},
        {"GRIB_centre": "ecmf", "institution": "European Centre for Medium-Range Weather Forecasts"},
    ).to_netcdf(folder / "era5.nc")
    fine = axes(1.0 / 60.0)
    y, x = np.meshgrid(fine["latitude"][1], fine["longitude"][1], indexing="ij")
    island = 100.0 - 4000.0 * np.minimum(1.0, (x + 35.0) ** 2 + ((y + 54.3) * 1.7) ** 2)
    # A shelf that rises by 4 m in a km to the east, with banks of 15 m some kilometres apart.
    banks = 15.0 * np.sin(2.0 * np.pi * x / 0.21) * np.sin(2.0 * np.pi * y / 0.13)
    shelf = np.clip(250.0 * (x + 37.5) - 400.0 - banks, -3900.0, -100.0)
    for name, floor in {"gebco": island, "shelf": shelf}.items():
        attributes = {"standard_name": "height_above_mean_sea_level", "units": "m"}
        xr.Dataset({"elevation": (("latitude", "longitude"), floor.astype("i2"), attributes)}, fine).to_netcdf(
            folder / f"{name}.nc"
        )


def write_experiment(name: str, start: str, days: int, forcing: str, parameters: str = "{}") -> None:
    """Write an experiment with the berg into the working folder."""
    text = f"name: {name}\nstart: {start}\ndays: {days}\nberg: {BERG}\nforcing: {forcing}\nparameters: {parameters}\n"
    Path(f"{name}.yaml").write_text(text)


def seconds_per_day(models: dict[str, Model], days: int) -> dict[str, float]:
    """Return processor seconds of the quickest day of each model, days by turns."""
    costs: dict[str, list[float]] = {name: [] for name in models}
    for _ in range(days):
        for name, model in models.items():
            began = time.process_time()
            model.advance(1)
            costs[name].append(time.process_time() - began)
    return {name: min(seconds) for name, seconds in costs.items()}


def member_seconds(folder: Path, members: int, days: float) -> list[float]:
    """Return processor seconds a day of the members of a forecast after the first two, one after the other."""
    plan = forecast_plan(str(folder / "files.yaml"), (), Options(days=days), None, Draws(members + 2, "random"))
    costs = []
    for number in range(members + 2):
        began = time.process_time()
        outcome = run_member(plan.job(number, folder, save_seconds=1e9))
        assert outcome.status == "done", outcome.message
        costs.append((time.process_time() - began) / days)
    return costs[2:]


def command_seconds(experiment: str, folder: Path, *words: str) -> float:
    """Return processor seconds of a process that runs an experiment."""
    command = [sys.executable, "-m", "riftberg", "run", experiment, *words, "--no-map", "--quiet"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([*command, "-o", str(folder / f"run-{time.monotonic_ns()}")], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def print_shelf(folder: Path) -> None:
    """Print what 24 days to the shelf cost."""
    for name, parameters in SHELF.items():
        write_experiment(name, "2025-02-10", 24, "[glorys.nc, era5.nc, shelf.nc]", parameters)
    costs = [{name: command_seconds(f"{name}.yaml", folder) for name in SHELF} for _ in range(2)]
    least = {name: min(cost[name] for cost in costs) for name in SHELF}
    for name, seconds in least.items():
        print(f"24 days to a shelf, {name}: {seconds:.2f} s, {seconds / least['none']:.2f} times")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--days", type=int, default=4, help="days of each model that are timed")
    parser.add_argument("--members", type=int, default=4, help="further members that are timed")
    parser.add_argument("--starts", type=int, default=3, help="how often each start is timed")
    parser.add_argument("--shelf", action="store_true", help="time 24 days to a shelf, and nothing else")
    given = parser.parse_args()
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_files(folder)
        os.chdir(folder)
        if given.shelf:
            print_shelf(folder)
            return
        for kind, forcing in FORCING.items():
            write_experiment(kind, "2025-02-15", given.days + 2, forcing)
        models = {kind: build(f"{kind}.yaml", Options())[0] for kind in FORCING}
        for model in models.values():
            model.advance(1)
        size = models["files"].elements.size
        cost = seconds_per_day(models, given.days)
        print(
            f"a day of {size} elements, s: formula {cost['formula']:.4f}, files {cost['files']:.4f} "
            f"({cost['files'] / cost['formula']:.2f} times)", flush=True,
        )  # fmt: skip
        members = member_seconds(folder, given.members, given.days)
        print(
            f"a further member, s a day: median {median(members):.3f}, {min(members):.3f} to {max(members):.3f}",
            flush=True,
        )
        starts = [
            {kind: command_seconds(f"{kind}.yaml", folder, "--days", "0.05") for kind in FORCING}
            for _ in range(given.starts)
        ]
        least = {kind: min(start[kind] for start in starts) for kind in FORCING}
        print(f"start and first step, s: formula {least['formula']:.2f}, three files {least['files']:.2f}")


if __name__ == "__main__":
    main()
