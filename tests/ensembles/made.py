"""Forecasts made by hand, whose probabilities are known."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
import xarray as xr
from typer.testing import CliRunner

from contract import FRAGMENT
from riftberg.cli.main import app
from riftberg.ensembles.member import Outcome
from riftberg.ensembles.probability import Breaks, with_probabilities
from riftberg.ensembles.result import build_dataset, write_sweep
from riftberg.ensembles.vary import Varied

DAY = 86400.0
START = datetime(2020, 12, 9)

SMALL_BERG = """\
start: 2020-12-09 13:00
days: 0.25
berg: {rectangle: {length: 9 km, width: 6 km}, placement: [-39.25, -55.03], thickness: 200 m}
forcing: {uniform: {current: [0.1, 0.05], wind: [8.0, 3.0], slope: [0, 0]}}
"""


def small_berg(folder: Path) -> Path:
    """Write the experiment of a small berg off South Georgia for six hours."""
    path = folder / "small.yaml"
    path.write_text(SMALL_BERG)
    return path


def outcome(
    number: int, lon: Sequence[float], lat: Sequence[float], *, broken: float | None = None, aground: float = np.nan,
    area: float = 100e6, piece: float = 30e6, means: dict[str, float] | None = None, shape: tuple[float, float] = (0.0, np.nan),
) -> Outcome:  # fmt: skip
    """Return a member whose berg is at these places from day to day, and from which a piece breaks off after some days.

    ``shape``: azimuth of the long axis, and length over width.
    """
    table = {name: [0.0] for name in FRAGMENT} | {"number": [1.0], "area": [area], "lon": [lon[0]], "lat": [lat[0]]}
    track, cracks = [], []
    for k, (x, y) in enumerate(zip(lon, lat, strict=True)):
        parted = broken is not None and k >= broken
        track.append([k * DAY, 1.0, x, y, area - piece if parted else area, 0.0, shape[0], 0.0, shape[1], np.nan])
        if parted:
            track.append([k * DAY, 2.0, x, y + 0.1, piece, 0.0, *[np.nan] * 4])
    if broken is not None:
        for name, value in {"number": 2.0, "parent": 1.0, "birth_time": broken * DAY, "area": piece}.items():
            table[name].append(value)
        for name in FRAGMENT:
            if len(table[name]) < 2:
                table[name].append(0.0)
        cracks = [[broken * DAY - 60.0, 3000.0, 500.0 * j, 500.0] for j in range(-3, 4)]
    totals = {"pieces": 1.0 + (broken is not None), "first_aground": aground * DAY, "largest_area": area}
    if np.isfinite(aground):
        totals |= {"aground_lon": float(lon[int(aground)]), "aground_lat": float(lat[int(aground)])}
    return Outcome(number, "done", "", 0.0, 1.0, totals | (means or {}), table, track, cracks)


def forecast_of(
    outcomes: Sequence[Outcome], days: int, inputs: dict[str, Any] | None = None, weight: Sequence[float] | None = None
) -> xr.Dataset:
    """Return the forecast of some members, all of one weight by default."""
    inputs = inputs or {}
    varied = [Varied(name, (), "m", name) for name in inputs]
    members = [{name: values[k] for name, values in inputs.items()} for k in range(len(outcomes))]
    by_number = {o.number: o for o in outcomes}
    ds = build_dataset(
        varied, members, by_number, start=START, days=float(days), every=DAY, latlon=True, attributes={"title": "made"}
    )
    ice = np.repeat(np.arange(-5e3, 6e3, 1e3), 11), np.tile(np.arange(-5e3, 6e3, 1e3), 11), 1e3
    breaks = Breaks(ice, weight)
    breaks.add(ds, {o.number: o.cracks for o in outcomes})
    return with_probabilities(ds, breaks, weight)


def wilson(share: float, number: float) -> tuple[float, float]:
    """Return the interval of Wilson (1927) at 90 %, the share being one of so many members."""
    z = 1.6448536269514722
    middle, half = share + z * z / (2 * number), z * math.sqrt(share * (1 - share) / number + z * z / (4 * number**2))
    return (middle - half) / (1 + z * z / number), (middle + half) / (1 + z * z / number)


class Limit(NamedTuple):
    """A limit of ice as ``riftberg hazard`` writes it."""

    inside: float  # Share of the members
    shape: Any


def hazards(ds: xr.Dataset, folder: Path) -> Path:
    """Write a forecast, and return the folder with what ``riftberg hazard`` makes of it."""
    write_sweep(ds, folder / "forecast.nc")
    said = CliRunner().invoke(app, ["hazard", str(folder)])
    assert said.exit_code == 0, said.output
    return folder / "hazard"


def limits_of(ds: xr.Dataset, folder: Path, percent: int | None, date: str | None = None) -> list[Limit]:
    """Return the limits that hold a share of the members, of the whole time first, or those of one date.

    ``percent``: None where too few members count for limits, for the range of their ice.
    """
    kind = "range of the members' ice" if percent is None else "limit of ice"
    features = json.loads((hazards(ds, folder) / "hazard.geojson").read_text())["features"]
    return [
        Limit(about.get("members_inside", 1.0), shapely.from_geojson(json.dumps(feature["geometry"])))
        for feature in sorted(features, key=lambda feature: feature["properties"].get("date") != "whole time")
        if (about := feature["properties"])["kind"] == kind
        and about.get("percent") == percent
        and date in (None, about["date"])
    ]


def table_of(ds: xr.Dataset, folder: Path) -> list[dict[str, str]]:
    """Return the table of positions and probabilities by date."""
    return list(csv.DictReader((hazards(ds, folder) / "hazard.csv").read_text().splitlines()))
