"""Three hundred invented layouts of forcing files: a value at the berg is right, or the run is refused or told so.

A layout is one choice each of grid, dates, levels, packing, units, names, order of the dimensions, format and split over
files. Its number is its seed. Most choices are plain habits of real files, which must be read; at most one is such that a
refusal is right too, for its own reason.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fuzz.grids import GRIDS, Placed
from fuzz.judging import NEVER, SOON, Kind, Truth
from fuzz.oceans import (
    ALL,
    DAY,
    PLAIN,
    RUN,
    STANDARD,
    UNITS,
    Ocean,
    dataset,
    differs,
    disagreement,
    experiment,
    stamps,
    store_as,
    written_time,
)  # fmt: skip

LAYOUTS = 300
DRAFT = 200.0 * 850.0 / 1025.0
"""Draft of the berg, m, to some metres."""


@dataclass(frozen=True)
class Choice:
    """One way to write one thing.

    Attributes
    ----------
    reasons : tuple of str
        Regular expressions of the reasons for which it may be refused; empty where it must be read.
    told : tuple of str
        Regular expressions of notices, where a value is as told.
    never : bool
        No value can be right: the files are of another time or place.
    """

    reasons: tuple[str, ...] = ()
    told: tuple[str, ...] = ()
    never: bool = False


FINE = Choice()
HOURS = "hours since 1950-01-01 00:00:00"

TIMES: dict[str, Choice] = {
    "hours since 1950-01-01 00:00:00": FINE, "seconds since 1970-01-01": FINE, "days since 1900-01-01 00:00:00.0": FINE, "minutes since 2000-01-01T00:00:00Z": FINE,
    "days since 0001-01-01 00:00:00": FINE, "days since 1-1-1 proleptic_gregorian": FINE, "seconds since 2020-12-01 00:00:00 +03:00": FINE, "hours since 2020-12-01 00:00:00 -0300": FINE,
    "milliseconds since 1970-01-01": FINE, "HOURS SINCE 1950-1-1 0:0:0": FINE, "calendar noleap": FINE, "calendar 360_day": FINE, "calendar all_leap": FINE, "calendar julian": FINE,
    "calendar GREGORIAN": FINE, "julian days": Choice(("-4713", "date", "time")), "day as %Y%m%d.%f": Choice(("day as",)), "int dates": FINE, "text dates": FINE, "unsorted": FINE,
    "repeated record": Choice(("twice|repeat|date",), ("repeat",)), "repeated date, other values": Choice(("twice|repeat",), ("repeat",)), "means, bounds, start": FINE, "means, bounds, end": FINE, "means, bounds, middle": FINE,
    "daily means without bounds": Choice(("mean",), ("mean",)), "monthly means, bounds": FINE, "monthly means, the first": Choice(("mean|month",), ("mean|month",)),
    "monthly means, the fifteenth": Choice(("mean|month",), ("mean|month",)), "calendar gregorian_proleptic": Choice(("calendar",)), "calendar no_leap": Choice(("calendar",)),
    "2**64 ns later": Choice(("26\\d\\d",), never=True), "2**64 ns earlier": Choice(("143\\d",), never=True), "model year 151": Choice(("151",), never=True), "model year 2600, noleap": Choice(("2600",), never=True),
    "single precision": FINE, "packed": FINE, "reference time beside": FINE, "lead time alone": Choice(("lead|forecast|date|time",)), "time_centered": FINE, "one mean with bounds": FINE,
    "two overlapping files": FINE,
}  # fmt: skip
LEVELS: dict[str, Choice] = {
    "": FINE, "scalar": FINE, "one": FINE, "down": FINE, "up": FINE, "down, negative numbers": Choice(("depth|level|positive",), ("depth|level|positive",)), "negative, no sign": Choice(("depth|level|positive",), ("depth|level|positive|below",)),
    "deepest first": FINE, "centimetres": FINE, "no units": Choice(("depth|level|unit",), ("depth|level|unit",)), "stray sigma": Choice(("sigma",)), "pressure": Choice(("pressure|dbar|level",)), "numbers of levels": Choice(("level|coordinate|units",)),
}  # fmt: skip
PACKINGS: dict[str, Choice] = {
    "f4": FINE, "f8": FINE, "i2": FINE, "i2 missing_value": FINE, "fill declared": FINE, "NaN on land": FINE, "1e20 undeclared, far": Choice(("1e\\+?20|believ|fill|beyond",), ("1e\\+?20|fill|believ|beyond",)),
    "-9999 undeclared, beside": Choice(("9999|fill|believ|beyond",), ("9999|fill|believ|beyond",)), "valid_range": FINE, "scale as text": Choice(("scale_factor",)), "two fills": FINE, "big endian": FINE,
}  # fmt: skip
SPEEDS: dict[str, tuple[str | None, float, Choice]] = {
    "m s-1": ("m s-1", 1.0, FINE), "m/s": ("m/s", 1.0, FINE), "cm s-1": ("cm s-1", 100.0, FINE), "knots": ("knots", 3600.0 / 1852.0, FINE), "km/h": ("km/h", 3.6, FINE), "mm/s": ("mm/s", 1000.0, FINE),
    "none, m/s": (None, 1.0, Choice(("unit",), ("unit",))), "none, knots": (None, 3600.0 / 1852.0, Choice(("unit",), ("unit",))), "none, cm/s": (None, 100.0, Choice(("unit|believ|beyond",), ("unit",))),
    "m s-1, but cm/s": ("m s-1", 100.0, Choice(("believ|beyond|unit|m/s",), ("believ|beyond|unit",))), "misspelt": ("metres_per_sec", 1.0, Choice(("unit",))),
}  # fmt: skip
NAMES: dict[str, Choice] = {
    "standard": FINE, "usual": FINE, "standard names alone": FINE, "long names alone": Choice(("recognised|name",)), "u and v": Choice(("recognised|name",)), "upper case": Choice(("recognised|name",)),
    "both, one strange beside": FINE, "swapped names": FINE,
}  # fmt: skip
ORDERS: dict[str, Choice] = {"time first": FINE, "time last": FINE, "x before y": FINE, "reversed": FINE}
FORMS: dict[str, Choice] = {
    "NETCDF4": FINE, "NETCDF3_CLASSIC": FINE, "NETCDF3_64BIT": FINE, "NETCDF4_CLASSIC": FINE, "compressed chunks": FINE, "unlimited": FINE, "zarr2": FINE, "zarr3": FINE, "odd file name": FINE,
    "zarr zip": Choice(("zip",)), "gz": Choice(("gzip|gz",)), "group": Choice(("group",)),
}  # fmt: skip
SPLITS: dict[str, Choice] = {"one": FINE, "by variable": FINE, "by day": FINE, "by kind": FINE}
MEMBERS: dict[str, Choice] = {"": FINE, "scalar": FINE, "one": FINE, "three": Choice(("member|ensemble|realization",))}
CENTRES = ((-39.0, -55.5), (179.9, -60.2), (0.1, -62.3), (-64.0, -68.1), (-52.3, 58.4), (-179.95, -70.0))
BRANCHES = {
    "west": lambda q: (q + 180.0) % 360.0 - 180.0,
    "east": lambda q: q % 360.0,
    "below": lambda q: q % 360.0 - 360.0,
}


@dataclass(frozen=True)
class Layout:
    """A layout by its choices; `why` are those that may be refused or told."""

    number: int
    grid: str = "axes"
    time: str = HOURS
    level: str = ""
    packing: str = "f4"
    speed: str = "m s-1"
    names: str = "standard"
    order: str = "time first"
    form: str = "NETCDF4"
    split: str = "by kind"
    member: str = ""
    branch: str = "west"
    ocean: Ocean = field(default=PLAIN)

    @property
    def choices(self) -> list[Choice]:
        """All choices of the layout."""
        return [
            GRIDS[self.grid].choice, TIMES[self.time], LEVELS[self.level], PACKINGS[self.packing], SPEEDS[self.speed][2],
            NAMES[self.names], ORDERS[self.order], FORMS[self.form], SPLITS[self.split], MEMBERS[self.member],
        ]  # fmt: skip

    def __str__(self) -> str:
        plain = Layout(self.number)
        parts = [
            str(getattr(self, n))
            for n in (
                "grid",
                "time",
                "level",
                "packing",
                "speed",
                "names",
                "order",
                "form",
                "split",
                "member",
                "branch",
            )
            if n == "grid" or getattr(self, n) != getattr(plain, n)
        ]
        return f"layout {self.number}: {', '.join(parts)}; at {self.ocean.lon:g}, {self.ocean.lat:g}"


def layout(number: int) -> Layout:
    """Return the layout of a number."""
    rng = random.Random(f"layout {number}")
    made = Layout(number, grid=list(GRIDS)[number % len(GRIDS)])
    lon, lat = rng.choice(CENTRES)
    made = replace(made, branch=rng.choice(list(BRANCHES)), ocean=Ocean(lon, lat))
    tables = {
        "time": TIMES,
        "level": LEVELS,
        "packing": PACKINGS,
        "speed": {n: v[2] for n, v in SPEEDS.items()},
        "names": NAMES,
        "order": ORDERS,
        "form": FORMS,
        "split": SPLITS,
        "member": MEMBERS,
    }
    odd = GRIDS[made.grid].choice is not FINE
    chances = {
        "time": 0.85,
        "level": 0.45,
        "packing": 0.4,
        "speed": 0.35,
        "names": 0.3,
        "order": 0.3,
        "form": 0.4,
        "split": 0.4,
        "member": 0.15,
    }
    for key in rng.sample(list(tables), len(tables)):
        if rng.random() > chances[key] or key in GRIDS[made.grid].own:
            continue
        allowed = [name for name, choice in tables[key].items() if not (odd and choice is not FINE)]
        made = replace(made, **{key: rng.choice(allowed)})
        odd = odd or tables[key][getattr(made, key)] is not FINE
    return _possible(made)


def _possible(made: Layout) -> Layout:
    """Return a layout without what cannot be written together."""
    classic = made.form.startswith("NETCDF3")
    if made.time == "text dates" and made.form.startswith("zarr"):
        made = replace(made, form="NETCDF4")
    if made.time in ("one mean with bounds", "two overlapping files", "lead time alone") and made.split == "by day":
        made = replace(made, split="one")
    if made.time in ("two overlapping files",) and made.form in ("zarr zip", "gz"):
        made = replace(made, form="NETCDF4")
    if "month" in made.time:
        made = replace(made, ocean=replace(made.ocean, rate=0.01))
    if made.level in (
        "down",
        "up",
        "down, negative numbers",
        "negative, no sign",
        "deepest first",
        "centimetres",
        "no units",
    ):
        made = replace(made, ocean=replace(made.ocean, shear=1e-3))
    if made.packing == "big endian" and not classic:
        made = replace(made, packing="f8")
    if made.names == "both, one strange beside" and made.split == "by variable":
        made = replace(made, split="by kind")
    if made.level == "scalar":  # a wind holds at no depth
        made = replace(made, split="by variable" if made.split == "by day" else made.split)
    if made.speed == "mm/s" and made.packing.startswith("i2"):
        made = replace(made, packing="f4")
    return made


# --- writing -------------------------------------------------------------------------------------------------------------


def write(folder: Path, made: Layout) -> list[str]:
    """Write the files of a layout and return their names, in the order of naming."""
    grid = GRIDS[made.grid]
    placed = grid.make(made.ocean)
    moments, told = _moments(made)
    kinds = {"": ("uo", "vo", "ssh", "ua", "va")} if grid.wind else {"": ("uo", "vo", "ssh")}
    parts = _parts(made, placed, kinds[""], moments, told)
    files = []
    for label, ds in parts:
        files += _stored(folder, label, ds, made)
    if made.time == "two overlapping files":
        files += _overlapped(folder, made, placed, kinds[""])
    if not grid.wind:
        store_as(dataset(("ua", "va"), made.ocean, moments=stamps("2020-11-25T00:00", 120)), folder / "wind.nc")
        files.append("wind.nc")
    for beside in placed.beside:
        store_as(beside[1], folder / beside[0])
    return files


def _overlapped(folder: Path, made: Layout, placed: Placed, names: tuple[str, ...]) -> list[str]:
    """Write a second file that begins earlier, overlaps the first, and is right; the first one is not."""
    moments = stamps("2020-12-05T00:00", 29)
    files = []
    for label, ds in _parts(made, placed, names, moments, moments):
        files += _stored(folder, f"later_{label}", ds, made)
    return files


def _moments(made: Layout) -> tuple[Any, Any]:
    """Return the dates for which fields hold, and those that the file writes."""
    day = stamps("2020-12-06T00:00", 9, 24.0)
    month = np.array([f"{m}-01T00:00" for m in ("2020-10", "2020-11", "2020-12", "2021-01", "2021-02")], "M8[ns]")
    middle = month[:-1] + (month[1:] - month[:-1]) // 2
    return {
        "means, bounds, start": (day + DAY // 2, day), "means, bounds, end": (day + DAY // 2, day + DAY), "means, bounds, middle": (day + DAY // 2, day + DAY // 2),
        "daily means without bounds": (day + DAY // 2, day), "monthly means, bounds": (middle, middle), "monthly means, the first": (middle, month[:-1]),
        "monthly means, the fifteenth": (middle, month[:-1] + 14 * DAY), "int dates": (day, day), "one mean with bounds": (np.array(["2020-12-09T13:00"], "M8[ns]"),) * 2,
        "two overlapping files": (stamps("2020-12-07T00:00", 21) ,) * 2,
    }.get(made.time, (stamps(),) * 2)  # fmt: skip


def _time_variable(made: Layout, told: Any) -> tuple[Any, dict[str, Any]]:
    """Return raw values and attributes of the time coordinate."""
    kind = made.time
    attributes: dict[str, Any] = {"standard_name": "time", "axis": "T"}
    plain = {"units": HOURS, "calendar": "standard"}
    if kind == "days since 1-1-1 proleptic_gregorian":
        return written_time(told, "days since 0001-01-01", "proleptic_gregorian"), {
            **attributes,
            "units": "days since 1-1-1",
            "calendar": "proleptic_gregorian",
        }
    if kind.startswith("seconds since 2020-12-01 00:00:00 +03:00"):
        return written_time(told, "seconds since 2020-11-30 21:00:00"), {**attributes, "units": kind}
    if kind.startswith("hours since 2020-12-01 00:00:00 -0300"):
        return written_time(told, "hours since 2020-12-01 03:00:00"), {**attributes, "units": kind}
    if kind == "HOURS SINCE 1950-1-1 0:0:0":
        return written_time(told, HOURS), {**attributes, "units": kind}
    if " since " in kind:
        return written_time(told, kind.replace("T", " ").replace("Z", "")), {
            **attributes,
            "units": kind,
            "calendar": "standard",
        }
    if kind.startswith("calendar "):
        calendar = kind.removeprefix("calendar ")
        known = {"gregorian_proleptic": "proleptic_gregorian", "no_leap": "noleap", "GREGORIAN": "standard"}.get(
            calendar, calendar
        )
        return written_time(told, "days since 2000-01-01 00:00:00", known), {
            **attributes,
            "units": "days since 2000-01-01 00:00:00",
            "calendar": calendar,
        }
    if kind == "julian days":
        units = "days since -4713-11-24 12:00:00"
        return written_time(told, "days since 2000-01-01 12:00:00") + 2451545.0, {
            **attributes,
            "units": units,
            "calendar": "proleptic_gregorian",
        }
    if kind == "day as %Y%m%d.%f":
        return np.array([float(str(m)[:10].replace("-", "")) + (m - m.astype("M8[D]")) / DAY for m in told]), {
            **attributes,
            "units": kind,
        }
    if kind == "int dates":
        return np.array([int(str(m)[:10].replace("-", "")) for m in told], "i4"), {
            "long_name": "date YYYYMMDD",
            "standard_name": "time",
        }
    if kind == "text dates":
        return np.array([list(str(m)[:19].encode()) for m in told], "u1").view("S1"), {"standard_name": "time"}
    if kind.startswith("2**64"):
        wrap = 2**64 * (1 if "later" in kind else -1)
        seconds = [(int(m.astype("i8")) + wrap) / 1e9 for m in told]
        return np.array(seconds), {**attributes, "units": "seconds since 1970-01-01", "calendar": "proleptic_gregorian"}
    if kind == "model year 151":
        return written_time(told, HOURS, "noleap") - 8760.0 * 1869, {**attributes, "units": HOURS, "calendar": "noleap"}
    if kind == "model year 2600, noleap":
        return written_time(told, "days since 2000-01-01", "noleap") + 365.0 * 580, {
            **attributes,
            "units": "days since 2000-01-01",
            "calendar": "noleap",
        }
    if kind == "single precision":
        return written_time(told, "days since 2000-01-01").astype("f4"), {
            **attributes,
            "units": "days since 2000-01-01",
        }
    if kind == "packed":
        return ((written_time(told, "hours since 2020-12-01") - 100.0) / 0.5).astype("i2"), {
            **attributes,
            "units": "hours since 2020-12-01",
            "scale_factor": 0.5,
            "add_offset": 100.0,
        }
    return written_time(told, HOURS), {**attributes, **plain}


def _parts(
    made: Layout, placed: Placed, names: tuple[str, ...], moments: Any, told: Any
) -> list[tuple[str, xr.Dataset]]:
    """Return the datasets of a layout, one for each file."""
    values, attributes = _time_variable(made, told)
    ds = placed.coordinates.copy()
    for name in ds.variables:
        if ds[name].attrs.get("standard_name") == "longitude" or str(name).startswith(("lon", "nav_lon")):
            ds = ds.assign_coords({name: (ds[name].dims, BRANCHES[made.branch](ds[name].values), ds[name].attrs)})
    fields = {name: _field(made, placed, name, moments) for name in names}
    if made.time == "unsorted":
        order = np.random.default_rng(made.number).permutation(len(values))
        values = values[order]
        fields = {n: (d, v[order] if d[0] == "time" else v, a) for n, (d, v, a) in fields.items()}
    if made.time.startswith("repeated"):
        again = [0, 1, 1, *range(2, len(values))]
        values = values[again]
        fields = {n: (d, v[again].copy(), a) for n, (d, v, a) in fields.items()}
        for _, v, _ in fields.values():
            v[2] += 0.5 if "other" in made.time else 0.0
    if made.time == "two overlapping files" and moments[0] == np.datetime64("2020-12-07T00:00"):
        fields = {n: (d, v + 0.5, a) for n, (d, v, a) in fields.items()}
    time_dim = placed.time
    for name, (dims, v, a) in fields.items():
        ds[placed.rename.get(name, name)] = (tuple(time_dim if d == "time" else d for d in dims), v, a)
    ds = _with_dates(ds, made, time_dim, values, attributes, told)
    ds = _with_members(ds, made)
    files = _named(_packed(ds, made, placed), made, placed, names)
    return _split(_ordered(files, made, placed), made, placed, time_dim, names)


def _field(made: Layout, placed: Placed, name: str, moments: Any) -> tuple[tuple[str, ...], Any, dict[str, Any]]:
    dims, lon, lat = placed.points(name)
    when = moments.reshape(-1, *([1] * lon.ndim))
    values, sheared = made.ocean(name, lon, lat, when), made.ocean.shear * (name == "uo")
    if placed.angle is not None and name in ("uo", "vo", "ua", "va"):
        east, north = ("uo", "vo") if name in ("uo", "vo") else ("ua", "va")
        angle = placed.angle(name)
        u, v = made.ocean(east, lon, lat, when), made.ocean(north, lon, lat, when)
        values = u * np.cos(angle) + v * np.sin(angle) if name == east else -u * np.sin(angle) + v * np.cos(angle)
        sheared = made.ocean.shear * (np.cos(angle) if name == "uo" else -np.sin(angle))
    dims = ("time", *dims)
    own = placed.attributes.get(name, {})
    attributes = {"units": UNITS[name], "standard_name": STANDARD[name], **own, **placed.attributes.get("", {})}
    if "means" in made.time or made.time == "one mean with bounds":
        attributes["cell_methods"] = f"{placed.time}: mean"
    if name in ("uo", "vo"):
        units, factor, _ = SPEEDS[made.speed]
        values = values * factor
        attributes = (
            {**attributes, "units": units}
            if units is not None
            else {k: v for k, v in attributes.items() if k != "units"}
        )
        if placed.levels is not None:
            values, dims = np.repeat(values[:, None], len(placed.levels), 1), (dims[0], placed.level, *dims[1:])
        elif made.level in _DEPTHS:
            depth = _DEPTHS[made.level]
            values = np.stack([values + sheared * factor * z for z in depth], 1)
            dims = (dims[0], "depth", *dims[1:])
    return dims, values, attributes


_Z = np.array([0.5, 5.0, 15.0, 30.0, 50.0, 75.0, 100.0, 125.0, 150.0, 175.0, 200.0, 250.0, 300.0, 400.0])
_DEPTHS: dict[str, Any] = {
    "one": np.array([0.5]), "down": _Z, "up": _Z, "down, negative numbers": _Z, "negative, no sign": _Z, "deepest first": _Z[::-1], "centimetres": _Z, "no units": _Z,
    "pressure": _Z, "numbers of levels": _Z,
}  # fmt: skip


def _with_dates(
    ds: xr.Dataset, made: Layout, dim: str, values: Any, attributes: dict[str, Any], told: Any
) -> xr.Dataset:
    """Return a dataset with its dates, their bounds, and its levels."""
    kind = made.time
    if kind == "text dates":
        ds = (
            ds.assign_coords({dim: ((dim, "letters"), values, attributes)})
            if False
            else ds.assign({"date": ((dim, "letters"), values, attributes)})
        )
    elif kind == "lead time alone":
        ds = ds.rename({dim: "lead"}).assign_coords(
            lead=(
                "lead",
                written_time(told, "hours since 2020-12-07"),
                {"units": "hours", "standard_name": "forecast_period"},
            )
        )
        ds = ds.assign_coords(
            reference=(
                (),
                written_time(told[:1], HOURS)[0],
                {"units": HOURS, "standard_name": "forecast_reference_time"},
            )
        )
    elif kind == "time_centered":
        ds = ds.assign_coords(time_centered=(dim, values, attributes))
        for name in ds.data_vars:
            if dim in ds[name].dims:
                ds[name].attrs["coordinates"] = " ".join(
                    filter(None, ["time_centered", str(ds[name].attrs.get("coordinates", ""))])
                )
    else:
        ds = ds.assign_coords({dim: (dim, values, attributes)})
    if "bounds" in kind and "without" not in kind:
        width = {"one mean with bounds": 30 * DAY}.get(kind, DAY)
        low = {
            "means, bounds, start": told,
            "means, bounds, end": told - DAY,
            "means, bounds, middle": told - DAY // 2,
        }.get(kind, told - width // 2)
        high = low + width
        if kind == "monthly means, bounds":
            low = told.astype("M8[M]").astype("M8[ns]")
            high = (told.astype("M8[M]") + 1).astype("M8[ns]")
        ds[dim].attrs["bounds"] = "time_bnds"
        ds["time_bnds"] = ((dim, "bnds"), np.stack([written_time(low, HOURS), written_time(high, HOURS)], 1))
    if kind == "reference time beside":
        ds = ds.assign_coords(
            forecast_reference_time=(
                (),
                written_time(told[:1], HOURS)[0],
                {"units": HOURS, "standard_name": "forecast_reference_time"},
            )
        )
    level = made.level
    up, down = {"positive": "up", "axis": "Z"}, {"positive": "down", "axis": "Z"}
    if level == "scalar":
        ds = ds.assign_coords(depth=((), 0.5, {"units": "m", "standard_name": "depth", **down}))
    if level == "stray sigma":
        ds = ds.assign_coords(sigma=((), 0.995, {"units": "1", "standard_name": "ocean_sigma_coordinate"}))
        for name in ds.data_vars:
            if dim in ds[name].dims and name != "time_bnds":
                ds[name].attrs["coordinates"] = " ".join(
                    filter(None, ["sigma", str(ds[name].attrs.get("coordinates", ""))])
                )
    if "depth" in ds.dims and level in _DEPTHS:
        z = _DEPTHS[level]
        attributes = {
            "up": {"units": "m", **up}, "down, negative numbers": {"units": "m", **down}, "negative, no sign": {"units": "m"}, "centimetres": {"units": "cm", **down}, "no units": {**down},
            "pressure": {"units": "dbar", "standard_name": "sea_water_pressure", **down},
        }.get(level, {"units": "m", "standard_name": "depth", **down})  # fmt: skip
        if level == "numbers of levels":
            return ds
        sign = -1.0 if level in ("up", "down, negative numbers", "negative, no sign") else 1.0
        ds = ds.assign_coords(depth=("depth", sign * z * (100.0 if level == "centimetres" else 1.0), attributes))
    return ds


def _with_members(ds: xr.Dataset, made: Layout) -> xr.Dataset:
    if made.member == "scalar":
        return ds.assign_coords(realization=((), 3, {"standard_name": "realization"}))
    count = {"one": 1, "three": 3}.get(made.member, 0)
    if count:
        for name in ds.data_vars:
            if ds[name].ndim > 2 and ds[name].dtype.kind == "f":
                ds[name] = ds[name].expand_dims(realization=count).copy()
        ds = ds.assign_coords(realization=("realization", np.arange(count), {"standard_name": "realization"}))
    return ds


def _fields(ds: xr.Dataset, placed: Placed) -> list[str]:
    """Return the names of currents and sea level in a dataset."""
    return [
        str(placed.rename.get(name, name))
        for name in ("uo", "vo", "ssh", "ua", "va")
        if placed.rename.get(name, name) in ds.variables
    ]


def _packed(ds: xr.Dataset, made: Layout, placed: Placed) -> xr.Dataset:
    """Return a dataset with its fields as the numbers that stand in the file."""
    kind = made.packing
    fields = _fields(ds, placed)
    for number, name in enumerate(fields):
        values, a = np.asarray(ds[name].values, "f8"), dict(ds[name].attrs)
        corner: tuple[Any, ...] = (..., *[slice(0, 2)] * (2 if placed.rank == 2 else 1))
        if kind in ("fill declared", "NaN on land", "1e20 undeclared, far", "i2", "i2 missing_value", "two fills"):
            values[corner] = np.nan
        if kind == "-9999 undeclared, beside" and number < 2:
            values[(..., *[size // 2 for size in values.shape[-placed.rank :]])] = np.nan
        if kind.startswith("i2"):
            scale = np.nanmax(np.abs(values)) / 30000.0
            raw = np.where(np.isnan(values), -32767, np.round((np.nan_to_num(values) - 0.25 * scale) / scale)).astype(
                "i2"
            )
            a |= {
                "scale_factor": scale,
                "add_offset": 0.25 * scale,
                "_FillValue" if kind == "i2" else "missing_value": np.int16(-32767),
            }
            ds[name] = (ds[name].dims, raw, a)
            continue
        fill = {
            "fill declared": 1e20,
            "1e20 undeclared, far": 1e20,
            "-9999 undeclared, beside": -9999.0,
            "two fills": -999.0,
        }.get(kind)
        if fill is not None:
            values = np.where(np.isnan(values), fill, values)
        store = np.dtype({"f8": "f8", "big endian": ">f8"}.get(kind, "f4"))
        if kind in ("fill declared", "two fills"):
            a["_FillValue"] = store.type(fill)
        if kind == "two fills":
            a["missing_value"] = store.type(-32768.0)
        if kind == "valid_range":
            most = np.nanmax(np.abs(values)) * 2.0
            a["valid_range"] = np.array([-most, most], store)
        if kind == "scale as text":
            values, a["scale_factor"] = values / 0.001, "0.001"
        ds[name] = (ds[name].dims, values.astype(store), a)
    return ds


_USUAL = {"uo": "uo", "vo": "vo", "ssh": "zos", "ua": "u10", "va": "v10"}


def _named(ds: xr.Dataset, made: Layout, placed: Placed, names: tuple[str, ...]) -> xr.Dataset:
    if made.names == "standard" or placed.rename:
        return ds
    if made.names == "swapped names":  # the variable called uo is the northward current, as its standard name says
        return ds.rename({"uo": "other_", "vo": "uo"}).rename(other_="vo")
    ds = ds.copy()
    for name in names:
        if made.names in ("usual", "long names alone", "u and v", "upper case"):
            told = ds[name].attrs.pop("standard_name").replace("_", " ")
            if made.names == "long names alone":
                ds[name].attrs["long_name"] = told
    if made.names == "both, one strange beside":
        strange = ds["uo"].copy(data=ds["uo"].values * 0)
        strange.attrs = {
            "units": "m s-1",
            "long_name": "eastward velocity of the tide",
            "standard_name": "eastward_sea_water_velocity_due_to_tides",
        }
        return ds.assign(utide=strange.variable)
    renames = {
        "usual": _USUAL, "standard names alone": {n: f"field_{k}" for k, n in enumerate(names)}, "long names alone": {n: f"var{k}" for k, n in enumerate(names)},
        "u and v": {"uo": "u", "vo": "v", "ssh": "eta", "ua": "uw", "va": "vw"}, "upper case": {n: n.upper() + "_X" for n in names},
    }[made.names]  # fmt: skip
    return ds.rename({old: new for old, new in renames.items() if old in names and old != new})


def _ordered(ds: xr.Dataset, made: Layout, placed: Placed) -> xr.Dataset:
    if made.order == "time first" or made.form in ("unlimited",):
        return ds
    for name in ds.data_vars:
        dims = list(ds[name].dims)
        if len(dims) < 3 or ds[name].dtype.kind == "S" or name == "time_bnds":
            continue
        order = {
            "time last": [*dims[1:], dims[0]],
            "x before y": [*dims[:-2], dims[-1], dims[-2]],
            "reversed": dims[::-1],
        }[made.order]
        ds[name] = ds[name].transpose(*order)
    return ds


def _split(
    ds: xr.Dataset, made: Layout, placed: Placed, time: str, names: tuple[str, ...]
) -> list[tuple[str, xr.Dataset]]:
    """Return the parts of a dataset that become files."""
    time = "lead" if made.time == "lead time alone" else time
    fields = [str(n) for n in ds.data_vars if ds[n].ndim >= 2 and time in ds[n].dims and n not in ("time_bnds", "date")]
    if placed.apart:
        return [
            (
                label,
                ds.drop_vars([n for n in fields if n not in own]).drop_vars(
                    [c for c in drop if c in ds.variables], errors="ignore"
                ),
            )
            for label, own, drop in placed.apart
        ]
    if made.split == "by variable":
        parts = [(name, ds[[name, *[n for n in ds.data_vars if n not in fields]]]) for name in fields]
        return [
            (name, part if fields.index(name) < 3 else part.drop_vars("depth", errors="ignore")) for name, part in parts
        ]
    if made.split == "by day":
        count = ds.sizes[time]
        return [(f"{k:02d}", ds.isel({time: slice(k, min(k + 4, count))})) for k in range(0, count, 4)]
    if (made.split == "by kind" or made.level == "scalar") and len(fields) >= 5:
        wind = fields[-2:] if made.names != "both, one strange beside" else fields[3:5]
        return [
            ("water", ds.drop_vars(wind)),
            ("wind", ds.drop_vars([n for n in fields if n not in wind]).drop_vars("depth", errors="ignore")),
        ]
    return [("all", ds)]


def _stored(folder: Path, label: str, ds: xr.Dataset, made: Layout) -> list[str]:
    """Write one dataset as the layout has it."""
    form = made.form
    ds = _lean(ds)
    if form.startswith("zarr"):
        path = store_as(ds, folder / f"f_{label}.zarr", "zarr2" if form == "zarr zip" else form)
        if form == "zarr zip":
            import shutil

            shutil.make_archive(str(path), "zip", path)
            shutil.rmtree(path)
            return [f"{path.name}.zip"]
        return [path.name]
    if form == "group":
        ds.to_netcdf(
            folder / f"f_{label}.nc",
            group="data",
            engine="netcdf4",
            encoding={
                n: {"_FillValue": None}
                for n in ds.variables
                if ds[n].dtype.kind == "f" and "_FillValue" not in ds[n].attrs
            },
        )
        return [f"f_{label}.nc"]
    name = f"f {label} (2020) \u00fc.nc" if form == "odd file name" else f"f_{label}.nc"
    options: dict[str, Any] = {}
    if form == "compressed chunks":
        options["encoding"] = {
            n: {"zlib": True, "chunksizes": tuple(min(3, s) for s in ds[n].shape)}
            for n in ds.data_vars
            if ds[n].ndim >= 3 and ds[n].dtype.kind in "fi"
        }
    if form == "unlimited":
        options["unlimited_dims"] = [d for d in ("time", "time_counter", "ocean_time") if d in ds.dims]
    store_as(ds, folder / name, form if form.startswith("NETCDF") else "NETCDF4", **options)
    if form == "gz":
        import gzip

        (folder / f"{name}.gz").write_bytes(gzip.compress((folder / name).read_bytes()))
        (folder / name).unlink()
        return [f"{name}.gz"]
    return [name]


def _lean(ds: xr.Dataset) -> xr.Dataset:
    """Return a dataset without coordinates on dimensions that none of its fields has."""
    used = {dim for name in ds.data_vars for dim in ds[name].dims}
    return ds.drop_vars([c for c in ds.coords if ds[c].dims and not set(ds[c].dims) <= used])


# --- judging -------------------------------------------------------------------------------------------------------------


def kind_of(number: int, *, doctor: bool = True) -> Kind:
    """Return the kind of a layout: right at the berg, refused for its own reason, or told."""
    made = layout(number)
    reasons = tuple(reason for choice in made.choices for reason in choice.reasons)
    told = tuple(word for choice in made.choices for word in choice.told)
    if made.names == "usual":  # a component without a standard name on points that make no rows, or on a turned grid
        reasons, told = (*reasons, "scattered points, and the file does not say"), (*told, "is taken along its grid")
    never = any(choice.never for choice in made.choices)

    def make(folder: Path) -> list[str]:
        files = write(folder, made)
        (folder / "bad.yaml").write_text(experiment(files, made.ocean))
        return RUN

    def wrong(folder: Path, text: str) -> str:
        if never:
            return "fields of another time drive the berg"
        fault = values_differ(folder, made)
        return fault or (disagreement(folder) if doctor else "")

    words = ("f_", "f ", *(("wind.nc",) if not GRIDS[made.grid].wind else ()), "bad.yaml")
    return Kind("layouts", str(made), make, words, never, Truth(wrong, told), reasons or NEVER, seconds=SOON)


def values_differ(folder: Path, made: Layout) -> str:
    """Return what is wrong with the values at the berg of a run of a layout."""
    ocean, grid = made.ocean, GRIDS[made.grid]
    wanted: dict[str, Callable[..., Any] | Any] = {}
    if ocean.shear:
        wanted["uo"] = lambda lon, lat, moment: ocean("uo", lon, lat, moment) + 0.5 * ocean.shear * DRAFT
    names = tuple(n for n in ALL if grid.slopes or n != "slope")
    slack = grid.slack * (2.0 if ocean.shear or made.packing.startswith("i2") else 1.0)
    if made.packing in ("-9999 undeclared, beside",):
        slack *= 6.0
    return differs(folder, ocean, names, slack=slack, wanted=wanted)


def layouts(*, doctor: bool = True) -> list[Kind]:
    """Return the kinds of all layouts."""
    return [kind_of(number, doctor=doctor) for number in range(LAYOUTS)]
