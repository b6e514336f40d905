"""Experiments that say the same in other words: moved, turned, mirrored, with bergs or sections in another order, from files.

Each seed draws an experiment from the options of YAML files. Where the ocean, the berg and the Earth are turned together, so
is the run. No tolerance is that of a law: what differs is round-off, which a few steps of contact make larger.
"""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
import yaml
from scipy.spatial import cKDTree

from riftberg import Model, build

DEGREE = 111e3
"""Metres of a degree, near enough to lay bergs out."""
CLOSE, SLOW = 0.5, 1e-4
"""Largest differences of places (m) and velocities (m s-1) after some hours. Bergs that drift go kilometres."""

Experiment = dict[str, Any]


def drawn(seed: int, *, latlon: bool) -> Experiment:
    """Return an experiment of one to three bergs that do not break; on the plane where not ``latlon``."""
    r = random.Random(seed)
    lon, lat = r.choice([-38.0, 0.1, 179.9, -179.95, 359.0]), r.choice([-55.0, -70.0, 62.0, -78.0])
    per_x, per_y = (DEGREE * math.cos(math.radians(lat)), DEGREE) if latlon else (1.0, 1.0)
    origin = (lon, lat) if latlon else (r.uniform(-2e5, 2e5), r.uniform(-2e5, 2e5))

    def some(largest: float, count: int = 2) -> list[float]:
        return [round(r.uniform(-largest, largest), 4) for _ in range(count)]

    def perhaps(chance: float, value: Any) -> Any:
        return value if r.random() < chance else None

    def point(east: float, north: float = 0.0) -> list[float]:
        return [origin[0] + east / per_x, origin[1] + north / per_y]

    def berg(n: int) -> Experiment:
        radius = r.choice([500, 750, 1000])
        sides = {name: 2 * radius * r.randint(2, 4000 // radius) for name in ("length", "width")}
        return {
            "rectangle": sides, "radius": radius, "thickness": round(r.uniform(80, 400), 1),
            "placement": point(11e3 * n, r.uniform(-300, 300)), "rotation": r.uniform(-180, 180), "velocity": some(0.4),
            "spin": perhaps(0.3, r.uniform(-3e-5, 3e-5)),
            "strength": perhaps(0.3, {"normal": 0.3, "seed": r.randint(1, 9)}),
            "rifts": perhaps(0.3, {"points": [point(11e3 * n - 1e4, -3e3), point(11e3 * n + 1e4, 2e3)], "strength": 0.2}),
        }  # fmt: skip

    middle = point(9e3, 2e3)
    profile = {"point": middle, "towards": r.uniform(0, 360), "speed": some(0.8)[0], "width": r.uniform(5e3, 3e4)}
    constant = {
        "current": some(0.5), "wind": some(15), "depth": r.choice([10000, 100, 250]),
        "slope": perhaps(0.5, some(3e-6)) or [0.0, 0.0], "sea_ice": perhaps(0.4, [*some(0.4), 1.0]),
    }  # fmt: skip
    formula = {
        "uniform": {"current": some(0.3), "wind": some(15)},
        "eddy": perhaps(0.6, {"centre": middle, "radius": 2e4, "speed": some(0.8)[0], "velocity": some(0.2)}),
        "jet": perhaps(0.4, profile),
        "front": perhaps(0.4, {"point": middle, "along": 70.0, "step": 0.2, "width": 1e4, "temperature": some(4)}),
        "tide": perhaps(0.4, {"major": 0.3, "minor": 0.1, "towards": 30.0, "phase": 40.0, "level": 1.0}),
        "turning_wind": perhaps(0.4, {"speed": 8.0, "towards": 120.0, "turning": 10.0}),
        "slope": perhaps(0.4, {"point": middle, "towards": 200.0, "gradient": 0.01, "depth": 200.0}),
    }
    scheme = r.choice(["quasi_static", "quasi_static", "quasi_static", "mts"])
    parameters = {
        # The number of sub-steps that is found for a mirrored lattice may be another one by one.
        "stepping": {"scheme": scheme, "time_step": 1800, "substeps": 400 if scheme == "mts" else None},
        "fracture": {"normal_strength": 1e7, "shear_strength": 1e7},
        "bonds": perhaps(0.3, {"poisson": 0.2}),
        "grounding": perhaps(
            0.3, {"law": "quadratic", "quadratic_coefficient": 1e4} if scheme == "mts" else {"sediment": "clay"}
        ),
        "melt": perhaps(0.4, {"enabled": True, "mode": "mixed", "temperature": 3.0, "salinity": 34.5}),
        "drag": perhaps(0.2, {"ocean_scale": 17.8}),
        "earth": None if latlon else {"latlon": False, "reference_latitude": r.choice([-55.0, 60.0])},
    }
    forcing = {"kind": "formula", **({"uniform": constant} if r.random() < 0.5 else formula)}
    bergs = [berg(n) for n in range(r.choice([1, 2, 3]))]
    # A bed throws out a keel that begins a hundred metres inside it, and the run is refused.
    shallowest = 0.87 * max(berg["thickness"] for berg in bergs) - 20.0
    constant["depth"] = max(constant["depth"], shallowest)
    if formula["slope"]:
        formula["slope"]["depth"] = max(formula["slope"]["depth"], shallowest + 150.0)  # it rises by that within 15 km
    return {"start": "2020-12-09 13:00", "days": 0.25, "bergs": bergs, "forcing": forcing, "parameters": parameters}


def sections(experiment: Experiment) -> Iterator[tuple[str, Experiment]]:
    """Yield the sections of the forcing, with their kinds."""
    forcing = experiment["forcing"]
    yield from ((name, part) for name, part in forcing.items() if isinstance(part, dict))


def changed(
    experiment: Experiment, place: Callable[[list[float]], list[float]], vector: Callable[[list[float]], list[float]],
    *, turned: float = 0.0, mirrored: bool = False,
) -> Experiment:  # fmt: skip
    """Return the experiment with all places, vectors and directions changed; ``turned`` in degrees counter-clockwise."""
    new, sign = copy.deepcopy(experiment), -1.0 if mirrored else 1.0
    for berg in new["bergs"]:
        berg["placement"], berg["velocity"] = place(berg["placement"]), vector(berg["velocity"])
        berg["rotation"] = sign * berg["rotation"] + turned
        berg["spin"] = berg["spin"] and sign * berg["spin"]
        if berg["rifts"]:
            berg["rifts"]["points"] = [place(point) for point in berg["rifts"]["points"]]
    done = []  # YAML may hold one list of numbers in two places
    for kind, part in sections(new):
        for name in ("centre", "point"):
            if name in part and not any(part[name] is other for other in done):
                part[name] = place(part[name])
                done.append(part[name])
        for name in ("current", "wind", "slope", "velocity", "sea_ice"):
            if isinstance(part.get(name), list):
                part[name] = [*vector(part[name][:2]), *part[name][2:]]
        for name in ("towards", "along"):
            if name in part:
                part[name] = ((180.0 - part[name] if mirrored else part[name]) - turned) % 360.0
        for name in {"eddy": ("speed",), "tide": ("minor",), "turning_wind": ("turning",), "front": ("step",)}.get(
            kind, ()
        ):
            part[name] *= sign
        if kind == "front" and mirrored:  # left and right of the line
            part["temperature"] = part["temperature"][::-1]
    if mirrored and (earth := new["parameters"]["earth"]):
        earth["reference_latitude"] *= -1.0
    return new


def as_files(experiment: Experiment, folder: Path, seed: int) -> Experiment:
    """Return the experiment with its constant fields in files, in a layout of the seed."""
    r, new, fields = random.Random(seed), copy.deepcopy(experiment), experiment["forcing"]["uniform"]
    lon0, lat0 = (round(x) for x in experiment["bergs"][0]["placement"])
    lon, lat = np.arange(lon0 - 4, lon0 + 4.01, 0.25), np.arange(lat0 - 2, lat0 + 2.01, 0.25)
    lon = np.sort(lon % 360.0) if abs(lon0) > 90 else lon  # on the date line a file counts to 360
    lat = lat[:: r.choice([1, -1])]
    hours = np.arange(0.0, 49.0, 6.0)
    times = {
        "hours since 2020-12-09": hours,
        "days since 1950-01-01": 25910.0 + hours / 24.0,
        "seconds since 2020-12-09 12:00": 3600.0 * (hours - 12.0),
    }
    unit = r.choice(list(times))
    coords = {
        "lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"}),
        "time": ("time", times[unit], {"units": unit}),
    }  # fmt: skip
    slow = r.choice([1.0, 100.0])  # m s-1, or cm s-1
    (u, v), (ua, va), ice = fields["current"], fields["wind"], fields.get("sea_ice") or [0.0, 0.0, 0.0]
    wanted = [
        ("eastward_sea_water_velocity", u * slow, "m s-1" if slow == 1.0 else "cm s-1"),
        ("northward_sea_water_velocity", v * slow, "m s-1" if slow == 1.0 else "cm s-1"),
        ("eastward_wind", ua, "m s-1"), ("northward_wind", va, "m s-1"), ("eastward_sea_ice_velocity", ice[0], "m s-1"),
        ("northward_sea_ice_velocity", ice[1], "m s-1"), ("sea_ice_thickness", ice[2], "m"),
    ]  # fmt: skip
    dims = r.choice([("time", "lat", "lon"), ("time", "lon", "lat")])
    sizes = {"time": hours.size, "lat": lat.size, "lon": lon.size}
    variables = {
        f"v{n}": (dims, np.full([sizes[d] for d in dims], value), {"standard_name": name, "units": units})
        for n, (name, value, units) in enumerate(wanted)
    }
    floor = {"standard_name": "sea_floor_depth_below_geoid", "units": "m"}
    xr.Dataset(variables, coords).to_netcdf(folder / "sea.nc")
    xr.Dataset(
        {"deptho": (("lat", "lon"), np.full((lat.size, lon.size), float(fields["depth"])), floor)},
        {name: coords[name] for name in ("lat", "lon")},
    ).to_netcdf(folder / "floor.nc")
    new["forcing"] = {
        "kind": "files", "files": [str(folder / name) for name in ("sea.nc", "floor.nc")], "sea_level": "none"
    }  # fmt: skip
    return new


def built(experiment: Experiment, folder: Path) -> Model:
    """Return the model of an experiment, from a file."""

    def given(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: given(part) for name, part in value.items() if part is not None}
        return [given(part) for part in value] if isinstance(value, list) else value

    (folder / "e.yaml").write_text(yaml.safe_dump(given(experiment)))
    return build(str(folder / "e.yaml"))[0]


def ran(experiment: Experiment, folder: Path) -> Model:
    """Return the model at the end of its run."""
    model = built(experiment, folder)
    model.advance(experiment["days"])
    return model


def differences(
    one: Model, other: Model, back: Callable[[np.ndarray, np.ndarray, bool], tuple[np.ndarray, np.ndarray]]
) -> list[str]:
    """Say in what two runs differ; ``back`` takes places and vectors (True) of the other to those of the first."""
    a, b, latlon = one.elements, other.elements, one.parameters.earth.latlon
    (x, y), (u, v) = back(b.lon, b.lat, False), back(b.u, b.v, True)
    per_x, per_y = (DEGREE * math.cos(math.radians(float(a.lat.mean()))), DEGREE) if latlon else (1.0, 1.0)

    def metres(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
        east = lon - a.lon[0]
        return np.column_stack([((east + 180.0) % 360.0 - 180.0 if latlon else east) * per_x, lat * per_y])

    far, row = cKDTree(metres(x, y)).query(metres(a.lon, a.lat))
    found = {
        "place, m": (far.max(), CLOSE), "velocity, m s-1": (np.hypot(u[row] - a.u, v[row] - a.v).max(), SLOW),
        "mass": (np.abs(b.mass[row] / a.mass - 1.0).max(), 1e-6),
        "bonds that broke": (abs(int(one.bonds.status.sum()) - int(other.bonds.status.sum())), 0),
        "fragments": (abs(len(one.fragments.rows) - len(other.fragments.rows)), 0),
    }  # fmt: skip
    return [f"{name}: {value:.3g}" for name, (value, most) in found.items() if not value <= most]


def same(*arrays: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return places or vectors as they are."""
    return arrays[:2]


SEEDS = [pytest.param(n, marks=[pytest.mark.slow] if n > 0 else []) for n in range(40)]


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_an_ocean_further_east(seed: int, tmp_path: Path) -> None:
    """The same around the Earth, over the date line too."""
    experiment = drawn(seed, latlon=True)
    east = random.Random(seed).choice([43.7, -142.3, 80.1])
    moved = changed(experiment, lambda p: [(p[0] + east + 180.0) % 360.0 - 180.0, p[1]], list)
    one, other = ran(experiment, tmp_path), ran(moved, tmp_path)
    assert not differences(one, other, lambda x, y, vector: (x if vector else x - east, y))


def afloat(experiment: dict[str, Any]) -> dict[str, Any]:
    """Leave the bed out, whose pads are cut from one corner: aground a mirrored berg differs by metres."""
    if experiment["parameters"]["stepping"]["scheme"] == "quasi_static":
        experiment["parameters"]["grounding"] = {"law": "none"}
    return experiment


@pytest.mark.parametrize("seed", SEEDS)
def test_an_ocean_mirrored_at_the_equator(seed: int, tmp_path: Path) -> None:
    experiment = afloat(drawn(seed, latlon=seed % 2 == 0))

    def mirror(p: list[float]) -> list[float]:
        return [p[0], -p[1]]

    one, other = ran(experiment, tmp_path), ran(changed(experiment, mirror, mirror, mirrored=True), tmp_path)
    assert not differences(one, other, lambda x, y, vector: (x, -y))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_plane_turned_and_moved(seed: int, tmp_path: Path) -> None:
    """The lattice turns with its berg, so the results do."""
    experiment, angle = drawn(seed, latlon=False), random.Random(seed).choice([90.0, 180.0, 33.0])
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))

    def turn(p: list[float]) -> list[float]:
        return [c * p[0] - s * p[1], s * p[0] + c * p[1]]

    def place(p: list[float]) -> list[float]:
        x, y = turn(p)
        return [x + 1.1e5, y - 7e4]

    def back(x: np.ndarray, y: np.ndarray, vector: bool) -> tuple[np.ndarray, np.ndarray]:
        if not vector:
            x, y = x - 1.1e5, y + 7e4
        return c * x + s * y, -s * x + c * y

    one, other = ran(experiment, tmp_path), ran(changed(experiment, place, turn, turned=angle), tmp_path)
    assert not differences(one, other, back)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_bergs_and_sections_in_another_order(seed: int, tmp_path: Path) -> None:
    experiment = drawn(seed, latlon=seed % 2 == 0)
    other = {**experiment, "bergs": experiment["bergs"][::-1]}
    other["forcing"] = dict(reversed(experiment["forcing"].items()))
    assert not differences(ran(experiment, tmp_path), ran(other, tmp_path), same)


@pytest.mark.parametrize("seed", SEEDS)
def test_constant_fields_in_files(seed: int, tmp_path: Path) -> None:
    """In any layout: latitudes either way round, other units, times and orders of the dimensions."""
    experiment = afloat(drawn(seed, latlon=True))
    if "eddy" in experiment["forcing"]:
        uniform = {"current": [0.2, -0.1], "wind": [5.0, 3.0], "depth": 150}
        experiment["forcing"] = {"kind": "formula", "uniform": uniform}
    experiment["forcing"]["uniform"]["slope"] = [0.0, 0.0]  # a plane slope is no field on a sphere
    one, other = ran(experiment, tmp_path), ran(as_files(experiment, tmp_path, seed), tmp_path)
    assert not differences(one, other, same)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_a_run_in_pieces_and_from_a_restart(seed: int, tmp_path: Path) -> None:
    """Bit for bit."""
    experiment = drawn(seed, latlon=seed % 2 == 0)
    one, other = ran(experiment, tmp_path), built(experiment, tmp_path)
    other.advance(steps=4)
    other.save(tmp_path / "half.nc")
    resumed = Model.resume(tmp_path / "half.nc", built(experiment, tmp_path).forcing)
    for rest in (other, resumed):
        rest.advance(steps=one.step_number - 4)
        for name, array in one.elements.arrays().items():
            np.testing.assert_array_equal(rest.elements.arrays()[name], array, name)
        np.testing.assert_array_equal(rest.bonds.peak_stress, one.bonds.peak_stress)
