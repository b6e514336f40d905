"""What forcing files are, what they give, and what a run still lacks, in words that a first-day user can act on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.errors import ForcingError
from riftberg.ocean.findings import DataFinding, FieldFinding, Report
from riftberg.ocean.products.axes import goes_round
from riftberg.ocean.products.canonical import QUANTITIES
from riftberg.ocean.products.interpolate import usual_interval
from riftberg.ocean.products.registry import expand, open_all, product_named, recognise
from riftberg.ocean.products.window import cover, longitudes_near, utc, window

Floats = NDArray[np.float64]
Span = tuple[float, float]

NEEDED = ("uo", "vo", "ssh", "ua", "va")
"""Fields that a drift and break-up run needs; sea ice is optional (none = open water), depth only for grounding."""

WHERE_FROM = {
    "uo": "ocean currents: OSCAR v2 (free Earthdata login) or GLORYS12 (free Copernicus Marine login)",
    "vo": "ocean currents: OSCAR v2 (free Earthdata login) or GLORYS12 (free Copernicus Marine login)",
    "ssh": "sea level: DUACS adt or GLORYS12 zos (free Copernicus Marine login)",
    "ua": "wind: NCEP/NCAR R1 uwnd.10m.gauss.YEAR.nc (no login) or ERA5 u10",
    "va": "wind: NCEP/NCAR R1 vwnd.10m.gauss.YEAR.nc (no login) or ERA5 v10",
    "ice_fraction": "sea ice: GLORYS12 siconc, OSI SAF ice_conc or ERA5 siconc",
    "ice_thickness": "sea ice thickness: GLORYS12 sithick",
    "ui": "sea ice drift: GLORYS12 usi",
    "vi": "sea ice drift: GLORYS12 vsi",
    "depth_below_surface": "sea floor: GEBCO grid (free, subset from the GEBCO site), IBCSO south of 50 S",
    "sst": "sea surface temperature: GLORYS12 thetao or ERA5 sst",
    "sss": "salinity: GLORYS12 so",
    "wave_height": "waves: ERA5 swh",
}
_SAMPLE_RECORDS = 3
_LARGE = 2000


def doctor(
    files: Sequence[str | Path] | str | Path,
    *,
    lon: Span | None = None,
    lat: Span | None = None,
    time: tuple[Any, Any] | None = None,
    needed: Sequence[str] = NEEDED,
    path: Sequence[Span] | None = None,
    product: str | None = None,
) -> Report:
    """Tell what files are and whether they serve an experiment; never raises for bad files, it reports them.

    Parameters
    ----------
    files : path or sequence of paths
        Files, patterns or Zarr stores.
    lon, lat : tuple of float, optional
        Box of the experiment (degrees).
    time : tuple, optional
        First and last moment (UTC).
    needed : sequence of str
        Canonical names of the fields that the run needs.
    path : sequence of (lon, lat), optional
        Positions of the berg, where missing values matter.
    product : str, optional
        Name of the product, instead of recognising it.

    Returns
    -------
    Report
    """
    unknown = [name for name in needed if name not in QUANTITIES]
    if unknown:
        raise ForcingError(f"no such fields: {unknown}", where="needed", remedy=f"Choose from: {', '.join(QUANTITIES)}")
    report = Report()
    for ds in _opened(files, product, report):
        report.data.append(_examined(ds, lon, lat, time, path))
    _conclude(report, needed)
    return report


def diagnose(
    files: Sequence[str | Path] | str | Path,
    lon: Span | None = None,
    lat: Span | None = None,
    time: tuple[Any, Any] | None = None,
    needed: Sequence[str] = NEEDED,
    path: Sequence[Span] | None = None,
    product: str | None = None,
) -> Report:
    """Do what `doctor` does, with positional arguments: files, longitudes, latitudes, dates, needed fields."""
    return doctor(files, lon=lon, lat=lat, time=time, needed=needed, path=path, product=product)


def _opened(files: Sequence[str | Path] | str | Path, product: str | None, report: Report) -> list[xr.Dataset]:
    """Open what can be opened; note the rest in the report."""
    usable: list[str] = []
    try:
        names = expand(files)
    except ForcingError as error:
        report.unreadable[error.where] = _without_place(error)
        return []
    for name in names:
        try:
            if product is None:
                recognise(name)
            else:
                product_named(product)
            open_all(name, product)
            usable.append(name)
        except ForcingError as error:
            report.unreadable[name] = _other_kind(name) or _without_place(error)
    if not usable:
        return []
    try:
        return open_all(usable, product)
    except ForcingError as error:  # each is good by itself, together they do not go
        report.clashes.append(f"{error.where}: {_without_place(error)}")
        return [ds for name in usable for ds in open_all(name, product)]


def _other_kind(name: str) -> str:
    """Tell what a file is that belongs to a run but is no forcing; empty if unknown."""
    try:
        with netCDF4.Dataset(name) as file:
            held = set(file.variables)
    except OSError:
        return ""
    if {"trajectory", "break_time"} <= held:
        return "a run of Riftberg, no forcing: 'riftberg plot', 'score' and 'why' read it"
    if {"lon", "lat", "mass", "thickness", "start_mass"} <= held:
        return "an initial state of icebergs (restart of KID), no forcing: 'riftberg kid' and a68a-paper read it"
    if "b_id" in held:
        return "a mask of icebergs, no forcing: Iceberg.from_mask makes a berg of it"
    return ""


def _without_place(error: ForcingError) -> str:
    return f"{error.what}. {error.remedy}" if error.remedy else error.what


def _examined(
    ds: xr.Dataset, lon: Span | None, lat: Span | None, time: tuple[Any, Any] | None, path: Sequence[Span] | None
) -> DataFinding:
    product = product_named(ds.attrs["product"])
    found = DataFinding(
        files=str(ds.attrs["source"]).split(", "),
        product=product.name,
        title=product.title,
        checked_against={"sample": "real file", "layout": "published header", "documentation": "text only"}[
            product.evidence
        ],
        notes=list(product.notes),
        space=cover(ds),
        time=_time_cover(ds),
    )
    part = _part(ds, lon, lat, time, found)
    _space_problems(ds, lon, lat, found)
    _time_problems(ds, time, found)
    if part is not None:
        found.fields = [_field(part[name], path) for name in part.data_vars]
        return found
    found.fields = []
    return found


def _part(
    ds: xr.Dataset, lon: Span | None, lat: Span | None, time: tuple[Any, Any] | None, found: DataFinding
) -> xr.Dataset | None:
    """Return the part of the data in the experiment, or None with the reason noted."""
    try:
        if lon is not None and lat is not None:
            ds = window(ds, lon, lat, time)
        elif time is not None:
            ds = window(ds, (-180.0, 180.0), (-90.0, 90.0), time) if "lat" in ds.dims else ds
    except ForcingError as error:
        found.problems.append(_without_place(error))
        return None
    if lon is None or lat is None:
        ds = _middle(ds, found)
    if "time" in ds.dims and ds.sizes["time"] > _SAMPLE_RECORDS:
        picked = np.unique(np.linspace(0, ds.sizes["time"] - 1, _SAMPLE_RECORDS).astype(int))
        ds = ds.isel(time=picked)
    return ds


def _middle(ds: xr.Dataset, found: DataFinding) -> xr.Dataset:
    """Cut very large fields to their middle, so that nobody waits for a whole globe to be read."""
    large = {name: size for name, size in ds.sizes.items() if name in ("lat", "lon", "y", "x") and size > _LARGE}
    if large:
        found.notes.append("ranges are those of the middle of the data: give the box of the experiment for its own")
    return ds.isel({name: slice(size // 2 - _LARGE // 2, size // 2 + _LARGE // 2) for name, size in large.items()})


def _time_cover(ds: xr.Dataset) -> str:
    if "time" not in ds.dims:
        return "constant in time (no dates in the file)"
    records = ds["time"].values
    first, last = records[0].astype("M8[m]"), records[-1].astype("M8[m]")
    if records.size == 1:
        return f"one record, {first} UTC"
    return f"{first} to {last} UTC, {records.size} records every {_duration(usual_interval(records))}"


def _duration(seconds: float) -> str:
    return f"{seconds / 86400:.3g} days" if seconds >= 86400 else f"{seconds / 3600:.3g} h"


def _space_problems(ds: xr.Dataset, lon: Span | None, lat: Span | None, found: DataFinding) -> None:
    """Note where the experiment's box reaches beyond the data."""
    if lon is None or lat is None or "lat" not in ds.dims or found.problems:
        return
    east = lon[1] if lon[1] >= lon[0] else lon[1] + 360.0
    near = longitudes_near(ds, lon[0], east)
    lats, lons = near["lat"].values, near["lon"].values
    half_lat, half_lon = 0.5 * abs(lats[-1] - lats[-2]), 0.5 * abs(lons[-1] - lons[-2])
    short = []
    if lat[0] < lats[0] - half_lat or lat[1] > lats[-1] + half_lat:
        short.append(f"latitudes {lats[0]:g}..{lats[-1]:g} of {lat[0]:g}..{lat[1]:g}")
    if not goes_round(lons) and (lon[0] < lons[0] - half_lon or east > lons[-1] + half_lon):
        short.append(f"longitudes {lons[0]:g}..{lons[-1]:g} of {lon[0]:g}..{east:g}")
    if short:
        found.problems.append(f"covers only part of the experiment: {'; '.join(short)}. Fetch a larger area")


def _time_problems(ds: xr.Dataset, time: tuple[Any, Any] | None, found: DataFinding) -> None:
    """Note gaps between records and dates of the experiment without records."""
    if "time" not in ds.dims:
        return
    records = ds["time"].values
    interval = usual_interval(records)
    for k in np.nonzero(np.diff(records) / np.timedelta64(1, "s") > 1.5 * interval)[0] if interval else []:
        lost = round(float((records[k + 1] - records[k]) / np.timedelta64(1, "s")) / interval) - 1
        span = f"{records[k].astype('M8[m]')} and {records[k + 1].astype('M8[m]')}"
        found.problems.append(f"gap: about {lost} record(s) missing between {span}. Add these files")
    if time is None or (found.problems and "no record lies" in found.problems[0]):
        return
    half = np.timedelta64(int(0.5 * float(ds.attrs.get("averaging_seconds", 0.0))), "s")
    first, last = utc(time[0]), utc(time[1])
    if first < records[0] - half:
        found.problems.append(
            f"begins at {records[0].astype('M8[m]')}, after the experiment ({first.astype('M8[m]')}). Add earlier files"
        )
    if last > records[-1] + half:
        found.problems.append(
            f"ends at {records[-1].astype('M8[m]')}, before the experiment ({last.astype('M8[m]')}). Add later files"
        )


def _field(data: xr.DataArray, path: Sequence[Span] | None) -> FieldFinding:
    """Return range, missing share and problems of one field in the experiment."""
    quantity = QUANTITIES[str(data.name)]
    values = data.values
    known = np.isfinite(values)
    low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (np.nan, np.nan)
    found = FieldFinding(
        name=quantity.name,
        original_name=str(data.attrs.get("original_name", "")),
        original_units=str(data.attrs.get("original_units", "")),
        units=quantity.units,
        positive=quantity.sign,
        low=low,
        high=high,
        missing_share=float(1.0 - known.mean()) if known.size else 1.0,
        missing_on_path=_missing_on(data, path),
    )
    _judge(found, quantity.limit, len(path or ()))
    return found


def _judge(found: FieldFinding, limit: float, points: int) -> None:
    """Add what looks wrong about a field."""
    if found.missing_share == 1.0:
        found.problems.append("holds no value at all in the experiment: all land or missing")
        return
    if max(abs(found.low), abs(found.high)) > limit:
        found.problems.append(f"values beyond {limit:g} {found.units} are not believable: check the units in the file")
    if found.low == found.high == 0.0:
        found.problems.append("is zero everywhere in the experiment: check that the right variable was written")
    if found.missing_on_path:
        found.problems.append(
            f"missing (land, ice or gap) at {found.missing_on_path} of {points} positions of the berg: "
            "values from the nearest water will be used there"
        )


def _missing_on(data: xr.DataArray, path: Sequence[Span] | None) -> int:
    """Count positions of the berg whose nearest grid point is missing in any of the sampled records."""
    if not path or not {"lat", "lon"} <= set(data.dims):
        return 0
    positions = np.asarray(path, float)
    lons, lats = data["lon"].values, data["lat"].values
    shifted = (positions[:, 0] - lons[0] + 180.0) % 360.0 + lons[0] - 180.0 if not goes_round(lons) else positions[:, 0]
    i = np.abs((lons[None, :] - shifted[:, None] + 180.0) % 360.0 - 180.0).argmin(axis=1)
    j = np.abs(lats[None, :] - positions[:, 1][:, None]).argmin(axis=1)
    lead = [name for name in data.dims if name not in ("lat", "lon", "depth")]
    surface = data.isel(depth=0) if "depth" in data.dims else data
    missing = surface.isnull().any(lead) if lead else surface.isnull()
    return int(missing.transpose("lat", "lon").values[j, i].sum())


def _conclude(report: Report, needed: Sequence[str]) -> None:
    """Say what is missing and what to do, the most pressing first."""
    good = {item.name for found in report.data for item in found.fields if item.missing_share < 1.0}
    report.missing = [name for name in needed if name not in good]
    for name in report.missing:
        source = WHERE_FROM.get(name, "any CF file with standard name " + QUANTITIES[name].standard_name)
        report.advice.append(f"No file gives {name} ({QUANTITIES[name].long_name}). Get {source}")
    # A stray file beside a complete set is told about, but does not stop the run.
    if report.missing:
        report.advice += [f"{Path(name).name}: {reason}" for name, reason in report.unreadable.items()]
    report.advice += report.clashes
    for found in report.data:
        wanted = [item for item in found.fields if item.name in needed]
        if wanted or not found.fields:
            report.advice += [f"{Path(found.files[0]).name}: {problem}" for problem in found.problems]
        for item in wanted:
            serious = [text for text in item.problems if "nearest water" not in text]
            report.advice += [f"{Path(found.files[0]).name}, {item.name}: {problem}" for problem in serious]
