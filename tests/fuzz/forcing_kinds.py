"""Faults of forcing files: each a file that a person may really have, with the value that the berg must meet.

The ocean is the closed form of `fuzz.oceans`. What goes through must give its values, or be told; what is refused must
be so for its own reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fuzz.grids import GRIDS, WGS, _spherical, polar, projected, roms
from fuzz.judging import NEVER, SOON, Kind, Truth
from fuzz.oceans import (
    ALL,
    DAY,
    PLAIN,
    RUN,
    STANDARD,
    START,
    Ocean,
    axes,
    dataset,
    experiment,
    stamps,
    store_as,
    truth,
    written_time,
)

Parts = dict[str, Any]
Change = Callable[[Parts], Any]


def plain_parts(ocean: Ocean = PLAIN, *, floor: bool = False, ice: bool = False) -> Parts:
    """Return good datasets by the names of their files."""
    parts: Parts = {
        "ocean.nc": dataset(("uo", "vo"), ocean),
        "level.nc": dataset(("ssh",), ocean),
        "wind.nc": dataset(("ua", "va"), ocean),
    }
    if floor:
        parts["floor.nc"] = dataset(("depth",), ocean, steady=True)
    if ice:
        parts["ice.nc"] = dataset(("siconc", "sithick"), ocean)
    return parts


def written(folder: Path, parts: Parts) -> list[str]:
    """Write datasets, bytes and what writes itself, and return the names; those that begin with a dot are not named."""
    named = []
    for name, content in parts.items():
        path = folder / name.removeprefix(".")
        if isinstance(content, xr.Dataset):
            form = "zarr2" if path.suffix == ".zarr" else "NETCDF4"
            store_as(content, path, form)
        elif isinstance(content, bytes):
            path.write_bytes(content)
        elif content is not None:
            content(path)
        if not name.startswith("."):
            named.append(name)
    return named


def forced(
    family: str, name: str, change: Change, *, names: tuple[str, ...] = ALL, cause: tuple[str, ...] = (), told: tuple[str, ...] = (), as_told: Any = None,
    ocean: Ocean = PLAIN, floor: bool = False, ice: bool = False, never: bool = False, words: tuple[str, ...] = (), slack: float = 1.0, wanted: Any = None,
    listed: Callable[[list[str]], list[str]] | None = None, doctor: bool = False, start: str = "2020-12-09 13:00", days: float = 0.0625, parameters: str = "", check: Callable[[Path, str], str] | None = None, **forcing: Any,
) -> Kind:  # fmt: skip
    """Return a kind: good files with a change, which a run must read right, refuse, or tell of."""
    names = (*names, *(("depth",) if floor else ()), *(("ice_thickness",) if ice else ()))

    def make(folder: Path) -> list[str]:
        parts = plain_parts(ocean, floor=floor, ice=ice)
        got = change(parts)
        files = written(folder, got if isinstance(got, dict) else parts)
        files = listed(files) if listed else files
        (folder / "bad.yaml").write_text(
            experiment(files, ocean, start=start, days=days, parameters=parameters, **forcing)
        )
        return RUN

    known = (
        Truth(check, told, as_told)
        if check
        else truth(ocean, names, told, as_told, slack=slack, doctor=doctor, wanted=wanted)
    )
    if never:
        known = Truth(lambda folder, text: "no value of these files can be right", told, as_told)
    return Kind(family, name, make, (*words, ".nc", ".zarr", "bad.yaml"), False, known, cause, seconds=SOON)


def _each(variables: tuple[str, ...], change: Callable[[xr.Dataset, str], Any], file: str = "ocean.nc") -> Change:
    def apply(parts: Parts) -> None:
        ds = parts[file].copy(deep=True)
        for name in variables:
            got = change(ds, name)
            ds = got if isinstance(got, xr.Dataset) else ds
        parts[file] = ds

    return apply


def _attributes(
    file: str, variables: tuple[str, ...], factor: float = 1.0, offset: float = 0.0, **attributes: Any
) -> Change:
    """Return a change of numbers and attributes; None takes an attribute away."""

    def change(ds: xr.Dataset, name: str) -> xr.Dataset:
        kept = {k: v for k, v in {**ds[name].attrs, **attributes}.items() if v is not None}
        values = ds[name].values
        new = values if factor == 1.0 and offset == 0.0 else (values * factor + offset).astype(values.dtype)
        return (
            ds.assign({name: (ds[name].dims, new, kept)})
            if name not in ds.coords
            else ds.assign_coords({name: (ds[name].dims, new, kept)})
        )

    return _each(variables, change, file)


def _redated(
    moments: Any = None,
    units: str = "hours since 1950-01-01",
    calendar: str = "standard",
    raw: Any = None,
    said: str | None = None,
    *,
    files: tuple[str, ...] = ("ocean.nc", "level.nc", "wind.nc"),
    written_units: str | None = None,
    **attributes: Any,
) -> Change:
    """Return a change of the dates of all files."""

    def change(parts: Parts) -> None:
        for file in files:
            ds = parts[file]
            values = raw if raw is not None else written_time(stamps() if moments is None else moments, units, calendar)
            told: dict[str, Any] = {
                "units": written_units or units,
                "calendar": calendar if said is None else said,
                "standard_name": "time",
                **attributes,
            }
            parts[file] = ds.assign_coords(
                time=("time", values, {k: v for k, v in told.items() if v not in (None, "")})
            )

    return change


WRAP = 2.0**64 / 1e9


def years_beyond() -> Iterator[Kind]:
    """Give dates that 64 bits of nanoseconds cannot hold: none of them is the time of the run."""
    f = "dates beyond nanoseconds"
    day = written_time(stamps(), "days since 2000-01-01")
    for name, units, values, calendar in (
        ("one turn later", "seconds since 1970-01-01", written_time(stamps(), "seconds since 1970-01-01") + WRAP, "proleptic_gregorian"), ("one turn earlier", "seconds since 1970-01-01", written_time(stamps(), "seconds since 1970-01-01") - WRAP, "proleptic_gregorian"),
        ("two turns later", "days since 2000-01-01", day + 2 * WRAP / 86400, "proleptic_gregorian"), ("three turns earlier, julian", "days since 2000-01-01", day - 3 * WRAP / 86400, "julian"), ("year 2605 without leap days", "days since 2000-01-01", written_time(stamps(), "days since 2000-01-01", "noleap") + 365.0 * 585, "noleap"),
        ("control run of year 151", "days since 0001-01-01", written_time(stamps(), "days since 0001-01-01", "noleap") - 365.0 * 1869, "noleap"), ("control run of 360 days, year 251", "days since 0001-01-01", written_time(stamps(), "days since 0001-01-01", "360_day") - 360.0 * 1769, "360_day"), ("year 9020", "days since 2000-01-01", day + 2556697.0, "proleptic_gregorian"),
        ("year 0", "hours since 0000-01-01", written_time(stamps(), "hours since 2020-01-01"), "noleap"), ("one turn later in ocean alone", "seconds since 1970-01-01", written_time(stamps(), "seconds since 1970-01-01") + WRAP, "proleptic_gregorian"),
    ):  # fmt: skip
        files = ("ocean.nc",) if "alone" in name else ("ocean.nc", "level.nc", "wind.nc")
        yield forced(
            f,
            name,
            _redated(raw=values, units=units, calendar=calendar, files=files),
            never=True,
            cause=("year|1678|2262|calendar|0?151-|0?251-|9020|26\\d\\d-|14\\d\\d-|31\\d\\d-",),
        )


def depth_signs() -> Iterator[Kind]:
    """Give sea floors as heights, negative depths, and in other units."""
    f = "sign of the sea floor"
    geoid = {"standard_name": "geoid_height_above_reference_ellipsoid"}

    def floor(name: str, factor: float = -1.0, land: bool = False, **attributes: Any) -> Change:
        def change(parts: Parts) -> None:
            ds = parts["floor.nc"]
            values = ds["depth"].values * factor
            if land:
                values[:3] = -0.05 * factor * 1000.0
            told = {k: v for k, v in {"units": "m", **attributes}.items() if v is not None}
            parts["floor.nc"] = ds.drop_vars("depth").assign({name: (("lat", "lon"), values.astype("f4"), told)})

        return change

    said = ("depth|height|sea floor|deptho|bathymetry|elevation",)
    for name, change in {
        "elevation under a strange standard name": floor("elevation", **geoid), "the same with land": floor("elevation", land=True, **geoid), "deptho negative": floor("deptho", standard_name=STANDARD["depth"]), "deptho negative with land": floor("deptho", land=True, standard_name=STANDARD["depth"]),
        "bathymetry negative": floor("bathymetry", long_name="bathymetry"), "bathymetry negative, positive up": floor("bathymetry", land=True, long_name="bathymetry", positive="up"), "sea_floor_depth called positive up but positive": floor("deptho", 1.0, standard_name=STANDARD["depth"], positive="up"),
        "kilometres": floor("deptho", 1e-3, standard_name=STANDARD["depth"], units="km"), "metres that are kilometres": floor("deptho", 1e-3, standard_name=STANDARD["depth"]), "height above mean sea level in feet": floor("topo", -1.0 / 0.3048, land=True, standard_name="height_above_mean_sea_level", units="feet"),
    }.items():  # fmt: skip
        yield forced(
            f, name, change, floor=True, told=said, cause=("depth|height|sea floor|positive|water|sign|deep|believ",)
        )


def neighbours() -> Iterator[Kind]:
    """Give output of ROMS without positions beside grid files, of which one is right, none, or damaged."""
    f = "neighbour's grid file"
    own = ("ocean_his", *("level.nc", "wind.nc"))

    def model(parts: Parts) -> tuple[xr.Dataset, xr.Dataset]:
        grid = roms(PLAIN, surface=True, apart=True)
        ds = grid.coordinates.copy()
        for name in ("uo", "vo", "ssh"):
            dims, lon, lat = grid.points(name)
            when = stamps()[:, None, None]
            angle = grid.angle(name) if grid.angle else 0.0
            u, v = PLAIN("uo", lon, lat, when), PLAIN("vo", lon, lat, when)
            values = {
                "uo": u * np.cos(angle) + v * np.sin(angle),
                "vo": -u * np.sin(angle) + v * np.cos(angle),
                "ssh": PLAIN("ssh", lon, lat, when),
            }[name]
            ds[grid.rename[name]] = (
                ("ocean_time", *dims),
                values.astype("f4"),
                {"units": "m" if name == "ssh" else "m s-1"},
            )
        units = "hours since 1950-01-01"
        ds = ds.assign_coords(ocean_time=("ocean_time", written_time(stamps(), units), {"units": units}))
        return ds, grid.beside[0][1]

    def moved(grid: xr.Dataset, degrees: float = 3.0) -> xr.Dataset:
        return grid.assign_coords(
            {
                n: (grid[n].dims, grid[n].values + degrees, grid[n].attrs)
                for n in grid.variables
                if str(n).startswith("lon_")
            }
        )

    def with_beside(*beside: tuple[str, Callable[[xr.Dataset], Any]], heading: str = "") -> Change:
        def change(parts: Parts) -> Parts:
            ds, grid = model(parts)
            made: Parts = {
                "ocean_his.nc": ds.assign_attrs(grd_file=heading) if heading else ds,
                "wind.nc": parts["wind.nc"],
            }
            for name, content in beside:
                made[f".{name}"] = content(grid)
            return made

        return change

    def undecodable(grid: xr.Dataset) -> xr.Dataset:
        return grid.assign(
            clock=("t", np.arange(3.0), {"units": "seconds since 2016-01-01", "calendar": "gregorian_proleptic"})
        )

    def deeper(grid: xr.Dataset) -> xr.Dataset:
        return moved(grid).assign(h=(grid["h"].dims, grid["h"].values + 500.0, grid["h"].attrs))

    told = ("grd|grid|background|other",)
    right = ("ocean_grd.nc", lambda g: g)
    kinds: dict[str, tuple[Change, bool]] = {
        "another domain alone": (with_beside(("other_grd.nc", moved)), True), "background.nc of the same size": (with_beside(("background.nc", moved)), True), "two that fit": (with_beside(("a_grd.nc", moved), right), False),
        "two that fit, the right one first": (with_beside(("a_grd.nc", lambda g: g), ("b_grd.nc", moved)), False), "strange calendar beside": (with_beside(("a_bgr_d.nc", undecodable), right), False), "damaged file beside": (with_beside(("a_grd.nc", lambda g: b"CDF\x01" + bytes(300)), right), False),
        "empty file beside": (with_beside(("a_grd.nc", lambda g: b""), right), False), "another size beside": (with_beside(("a_grd.nc", lambda g: g.isel(xi_rho=slice(0, 5))), right), False), "heading names it": (with_beside(("a_grd.nc", moved), right, heading="ocean_grd.nc"), False),
        "another depth": (with_beside(("a_grd.nc", deeper), right), False),
    }  # fmt: skip
    for name, (change, wrong) in kinds.items():
        yield forced(
            f,
            name,
            change,
            told=told,
            cause=("grid|position|grd|background|lat_rho",),
            never=wrong,
            words=own,
            slack=2.0,
        )


def overlaps() -> Iterator[Kind]:
    """Give files that overlap in time: the one named later counts, as the documentation says, or it is told."""
    f = "overlapping files"

    def other(first: str, count: int, hours: float = 6.0, wrong: bool = True, drop: tuple[str, ...] = ()) -> xr.Dataset:
        ds = dataset(("uo", "vo"), moments=stamps(first, count, hours))
        for name in ("uo", "vo"):
            ds[name] = (ds[name].dims, ds[name].values + np.float32(0.5 if wrong else 0.0), ds[name].attrs)
        return ds.drop_vars(drop)

    def chain(*files: tuple[str, xr.Dataset]) -> Change:
        def change(parts: Parts) -> Parts:
            return {**dict(files), "level.nc": parts["level.nc"], "wind.nc": parts["wind.nc"]}

        return change

    told = ("overlap|twice|repeat|both|same date",)
    for name, files in {
        "later named begins earlier": (("b.nc", other("2020-12-07", 21)), ("a.nc", other("2020-12-06", 25, wrong=False))), "later named begins later": (("a.nc", other("2020-12-06", 25)), ("b.nc", other("2020-12-08", 17, wrong=False))),
        "same dates": (("a.nc", other("2020-12-07", 21)), ("b.nc", other("2020-12-07", 21, wrong=False))), "later named inside the first": (("a.nc", other("2020-12-01", 60)), ("b.nc", other("2020-12-08T12", 8, wrong=False))),
        "chain of forecasts": (("f1.nc", other("2020-12-08", 12)), ("f2.nc", other("2020-12-08T12", 12)), ("f3.nc", other("2020-12-09", 12, wrong=False))), "daily below hourly": (("daily.nc", other("2020-12-05", 9, 24.0)), ("hourly.nc", other("2020-12-09", 24, 1.0, wrong=False))),
        "copied by mistake, then mended": (("run1.nc", other("2020-12-07", 21)), ("run1 (copy).nc", other("2020-12-07", 21, wrong=False))), "three of the same dates": (("a.nc", other("2020-12-07", 21)), ("b.nc", other("2020-12-07", 21)), ("c.nc", other("2020-12-07", 21, wrong=False))),
        "one record shared": (("a.nc", other("2020-12-06", 14, wrong=False)), ("b.nc", other("2020-12-09T06", 20, wrong=False))), "another order than the alphabet": (("z.nc", other("2020-12-07", 21)), ("a.nc", other("2020-12-06", 30, wrong=False))),
    }.items():  # fmt: skip
        yield forced(f, name, chain(*files), told=told, cause=("overlap|twice|repeat|same",))


def no_units() -> Iterator[Kind]:
    """Give fields without units: what they are in cannot be known."""
    f = "no units"
    told, cause = ("unit",), ("unit",)
    gone = {"units": None}
    yield forced(f, "currents", _attributes("ocean.nc", ("uo", "vo"), **gone), told=told, cause=cause)
    yield forced(
        f, "currents in knots", _attributes("ocean.nc", ("uo", "vo"), 3600 / 1852, **gone), told=told, cause=cause
    )
    yield forced(
        f,
        "currents in cm/s",
        _attributes("ocean.nc", ("uo", "vo"), 100.0, **gone),
        told=told,
        cause=("unit|believ|beyond",),
    )
    yield forced(
        f,
        "currents by bare names",
        _attributes("ocean.nc", ("uo", "vo"), 3600 / 1852, standard_name=None, **gone),
        told=told,
        cause=cause,
    )
    yield forced(
        f, "sea level", _attributes("level.nc", ("ssh",), 100.0, **gone), told=told, cause=("unit|believ|beyond",)
    )
    yield forced(
        f,
        "sea level in decimetres by bare name",
        _attributes("level.nc", ("ssh",), 10.0, standard_name=None, **gone),
        told=told,
        cause=cause,
    )
    yield forced(f, "wind in knots", _attributes("wind.nc", ("ua", "va"), 3600 / 1852, **gone), told=told, cause=cause)
    yield forced(
        f,
        "wind in km/h, bare names",
        _attributes("wind.nc", ("ua", "va"), 3.6, standard_name=None, **gone),
        told=told,
        cause=("unit|recognised",),
    )
    yield forced(
        f, "one component alone has them", _attributes("ocean.nc", ("vo",), 3600 / 1852, **gone), told=told, cause=cause
    )

    def zeros(parts: Parts) -> None:
        ds = parts["ocean.nc"].copy(deep=True)
        for name in ("uo", "vo"):
            values = ds[name].values
            values[:, 6:11, 6:11] = 0.0
            ds[name] = (ds[name].dims, values, {k: v for k, v in ds[name].attrs.items() if k != "units"})
        parts["ocean.nc"] = ds

    yield forced(f, "still water of exact zeros", zeros, told=told, cause=cause, wanted={"uo": 0.0, "vo": 0.0})


def _means(
    moments: Any,
    bounds: tuple[Any, Any] | None,
    told_at: Any = None,
    *,
    methods: str | None = "time: mean",
    files: tuple[str, ...] = ("ocean.nc", "level.nc", "wind.nc"),
    ocean: Ocean = PLAIN,
    **heading: Any,
) -> Change:
    """Return a change to means: of the values at ``moments``, stamped ``told_at``."""
    names = {"ocean.nc": ("uo", "vo"), "level.nc": ("ssh",), "wind.nc": ("ua", "va")}

    def change(parts: Parts) -> None:
        for file in files:
            ds = dataset(names[file], ocean, moments=moments).assign_attrs(heading)
            stamp = moments if told_at is None else told_at
            ds = ds.assign_coords(time=("time", written_time(stamp), ds["time"].attrs))
            for name in names[file]:
                if methods:
                    ds[name].attrs["cell_methods"] = methods
            if bounds:
                ds["time"].attrs["bounds"] = "time_bnds"
                ds["time_bnds"] = (("time", "nv"), np.stack([written_time(edge) for edge in bounds], 1))
            parts[file] = ds

    return change


MONTHS = np.array([f"{m}-01" for m in ("2020-10", "2020-11", "2020-12", "2021-01", "2021-02")], "M8[ns]")
MIDDLES = MONTHS[:-1] + (MONTHS[1:] - MONTHS[:-1]) // 2
SLOW = Ocean(rate=0.01)


def means_without_bounds() -> Iterator[Kind]:
    """Give means whose span the file does not tell, stamped at one end: half a span aside if they are taken as instants."""
    f = "means without bounds"
    day = stamps("2020-12-05", 9, 24.0)
    told, cause = ("mean|averag|instant",), ("mean|averag|bounds|month",)
    more: dict[str, Any] = {"told": told, "cause": cause}
    yield forced(f, "daily, stamped at midnight", _means(day + DAY // 2, None, day), **more)
    yield forced(f, "daily, stamped at the end", _means(day + DAY // 2, None, day + DAY), **more)
    yield forced(f, "monthly, stamped the first", _means(MIDDLES, None, MONTHS[:-1], ocean=SLOW), ocean=SLOW, **more)
    yield forced(
        f, "monthly, stamped the last", _means(MIDDLES, None, MONTHS[1:] - DAY, ocean=SLOW), ocean=SLOW, **more
    )
    yield forced(
        f,
        "five days, stamped the first",
        _means(stamps("2020-12-03T12", 4, 120.0), None, stamps("2020-12-01", 4, 120.0)),
        **more,
    )
    yield forced(
        f,
        "six hours, stamped at the end",
        _means(stamps("2020-12-07T03", 20), None, stamps("2020-12-07T06", 20)),
        **more,
    )
    yield forced(
        f,
        "daily by the heading",
        _means(day + DAY // 2, None, day, methods=None, frequency="day", title="daily mean"),
        **more,
    )
    yield forced(
        f, "mean over time and depth", _means(day + DAY // 2, None, day, methods="time: mean depth: mean"), **more
    )
    yield forced(
        f, "mean of hourly values", _means(day + DAY // 2, None, day, methods="time: mean (interval: 1 hour)"), **more
    )

    def era5(parts: Parts) -> None:
        ds = dataset(("ua", "va"), SLOW, moments=MIDDLES).rename(
            ua="u10", va="v10", time="valid_time", lat="latitude", lon="longitude"
        )
        units = "seconds since 1970-01-01"
        ds = ds.assign_coords(
            valid_time=("valid_time", written_time(MONTHS[:-1], units), {"units": units, "standard_name": "time"})
        )
        for name in ("u10", "v10"):
            ds[name].attrs |= {"units": "m s**-1", "GRIB_stepType": "avgua", "GRIB_dataType": "an"}
        _means(MIDDLES, (MONTHS[:-1], MONTHS[1:]), files=("ocean.nc", "level.nc"), ocean=SLOW)(parts)
        parts["wind.nc"] = ds.assign_attrs(
            GRIB_centre="ecmf", institution="European Centre for Medium-Range Weather Forecasts"
        )

    yield forced(f, "monthly winds of ERA5", era5, ocean=SLOW, told=told, cause=("mean|averag|month|gap",))


def means_with_bounds() -> Iterator[Kind]:
    """Give means with bounds: held over their span, and true in its middle."""
    f = "means with bounds"

    def one(width: Any, at: float = 0.5, middle: Any = START, **more: Any) -> Change:
        low = np.array([middle - width // 2])
        return _means(
            np.array([middle]), (low, low + width), low + (width * at).astype("m8[ns]") if at != 0.5 else None, **more
        )

    days = lambda n: np.timedelta64(int(n * 86400), "s").astype("m8[ns]")  # noqa: E731
    yield forced(f, "one month alone", one(days(31)), cause=NEVER)
    yield forced(f, "one month, stamped the first", one(days(31), 0.0), cause=NEVER)
    yield forced(f, "one month, stamped the last", one(days(31), 1.0), cause=NEVER)
    yield forced(f, "one day alone", one(days(1)), cause=NEVER)
    yield forced(
        f,
        "one year, of levels alone",
        one(days(366), files=("level.nc",)),
        cause=("mean|366|year|bounds",),
        told=("mean|year",),
    )
    yield forced(
        f,
        "run in the second half of the last month",
        _means(MIDDLES[:3], (MONTHS[:3], MONTHS[1:4]), ocean=SLOW),
        ocean=SLOW,
        start="2020-12-28 13:00",
        cause=NEVER,
        names=(),
        check=lambda folder, text: "" if (folder / "out" / "run.nc").exists() else "no run",
    )
    yield forced(
        f,
        "run in the first half of the first month",
        _means(MIDDLES[2:], (MONTHS[2:4], MONTHS[3:5]), ocean=SLOW),
        ocean=SLOW,
        start="2020-12-04 13:00",
        cause=NEVER,
        check=lambda folder, text: "" if (folder / "out" / "run.nc").exists() else "no run",
    )
    yield forced(
        f,
        "run after the span",
        one(days(31)),
        start="2020-12-30 13:00",
        never=True,
        cause=("lie outside|record|date|cover",),
    )
    yield forced(
        f,
        "bounds that miss their stamps",
        _means(stamps("2020-12-05T12", 9, 24.0), (stamps("2019-12-05", 9, 24.0), stamps("2019-12-06", 9, 24.0))),
        cause=("bounds|bnds",),
        told=("bounds|bnds",),
    )
    yield forced(
        f,
        "bounds the wrong way round",
        _means(stamps("2020-12-05T12", 9, 24.0), (stamps("2020-12-06", 9, 24.0), stamps("2020-12-05", 9, 24.0))),
        cause=("bounds|bnds",),
        told=("bounds|bnds",),
    )


def _on_map(mapping: dict[str, Any], **more: Any) -> Change:
    """Return a change of all files onto the axes of a map projection."""
    from pyproj import CRS

    def change(parts: Parts) -> None:
        placed = projected(PLAIN, mapping, **more)
        _, lon, lat = placed.points("")
        for file, names in (("ocean.nc", ("uo", "vo")), ("level.nc", ("ssh",)), ("wind.nc", ("ua", "va"))):
            ds = placed.coordinates.copy().assign_coords(time=parts[file]["time"])
            for name in names:
                ds[name] = (
                    ("time", "y", "x"),
                    PLAIN(name, lon, lat, stamps()[:, None, None]).astype("f4"),
                    {**parts[file][name].attrs, **placed.attributes[""]},
                )
            parts[file] = ds

    assert CRS is not None
    return change


def projections() -> Iterator[Kind]:
    """Give projections that do not say all: the positions in the file decide, or the distance is told."""
    f = "projection without a radius"
    sphere = _spherical(PLAIN)
    words = ("projection|sphere|radius|ellipsoid|position|km",)
    conic = {
        "grid_mapping_name": "lambert_conformal_conic",
        "standard_parallel": -50.0,
        "longitude_of_central_meridian": -30.0,
        "latitude_of_projection_origin": -50.0,
    }
    conic_sphere = "+proj=lcc +lat_1=-50 +lat_0=-50 +lon_0=-30 +R=6371000 +units=m"
    azimuthal = {
        "grid_mapping_name": "lambert_azimuthal_equal_area",
        "latitude_of_projection_origin": -90.0,
        "longitude_of_projection_origin": 0.0,
    }
    mercator = {"grid_mapping_name": "mercator", "longitude_of_projection_origin": -40.0, "standard_parallel": 0.0}
    for name, mapping, meant, more in (
        ("stereographic, positions of a sphere", polar(PLAIN), sphere, {"positions": True}), ("stereographic, proj4 of a sphere", {**polar(PLAIN), "proj4": sphere}, sphere, {"positions": True}), ("proj4text of a sphere, no positions", {**polar(PLAIN), "proj4text": sphere}, sphere, {}),
        ("conic, positions of a sphere", conic, conic_sphere, {"positions": True}), ("azimuthal, positions of a sphere", azimuthal, "+proj=laea +lat_0=-90 +lon_0=0 +R=6371228 +units=m", {"positions": True}), ("mercator, positions of a sphere", mercator, "+proj=merc +lon_0=-40 +R=6371000 +units=m", {"positions": True}),
        ("another radius than that of the positions", {**polar(PLAIN), "earth_radius": 6400000.0}, sphere, {"positions": True}), ("ellipsoid said, sphere meant", {**polar(PLAIN), **WGS}, sphere, {"positions": True}), ("radius in km", {**polar(PLAIN), "earth_radius": 6371.0}, sphere, {"positions": True}),
        ("standard parallel left out", {k: v for k, v in polar(PLAIN).items() if k != "standard_parallel"}, sphere, {"positions": True}),
    ):  # fmt: skip
        yield forced(f, name, _on_map(mapping, truth=meant, **more), told=words, cause=words, slack=1.5)


def waves() -> Iterator[Kind]:
    """Give waves: they are used, or the run says that they are not."""
    f = "waves"
    height, period, direction = (
        "sea_surface_wave_significant_height",
        "sea_surface_wave_mean_period",
        "sea_surface_wave_from_direction",
    )

    def sea(*fields: tuple[str, float, dict[str, Any]], **heading: Any) -> Change:
        def change(parts: Parts) -> None:
            ds = dataset(("ssh",)).drop_vars("ssh").assign_attrs(heading)
            for name, value, told in fields:
                ds[name] = (
                    ("time", "lat", "lon"),
                    np.full((ds.sizes["time"], ds.sizes["lat"], ds.sizes["lon"]), value, "f4"),
                    told,
                )
            parts["waves.nc"] = ds

        return change

    swh, mwp, mwd = (
        ("VHM0", 6.0, {"units": "m", "standard_name": height}),
        ("VTM02", 9.0, {"units": "s", "standard_name": period}),
        ("VMDR", 200.0, {"units": "degree", "standard_name": direction}),
    )
    melts = "  melt: {enabled: true, temperature: 2 degC, salinity: 34}\n"

    def used(folder: Path, text: str) -> str:
        """Compare with a run without the waves: equal forces mean that nobody read them."""
        from fuzz.judging import call

        (folder / "calm.yaml").write_text((folder / "bad.yaml").read_text().replace(', "waves.nc"', ""))
        call(["run", "calm.yaml", "-o", "calm", "-q", "--no-map"])
        with xr.open_dataset(folder / "out" / "run.nc") as one, xr.open_dataset(folder / "calm" / "run.nc") as other:
            same = np.array_equal(one["lon"].values, other["lon"].values) and np.array_equal(
                one["mass"].values, other["mass"].values
            )
        return "the waves of the file change nothing" if same else ""

    for name, change, parameters in (
        ("height alone", sea(swh), ""), ("height and period", sea(swh, mwp), ""), ("height, period and direction", sea(swh, mwp, mwd), ""), ("a berg that melts", sea(swh, mwp, mwd), melts), ("height in cm", sea(("VHM0", 600.0, {"units": "cm", "standard_name": height})), melts),
        ("ERA5", sea(("swh", 6.0, {"units": "m"}), ("mwp", 9.0, {"units": "s"}), ("mwd", 200.0, {"units": "degrees"}), institution="ECMWF", GRIB_centre="ecmf"), ""), ("direction towards", sea(swh, ("VTDIR", 20.0, {"units": "degree", "standard_name": "sea_surface_wave_to_direction"})), ""),
        ("swell alone", sea(("VHM0_SW1", 3.0, {"units": "m", "standard_name": "sea_surface_primary_swell_wave_significant_height"})), ""), ("height of no sea", sea(("VHM0", 600.0, {"units": "m", "standard_name": height})), melts), ("a calm", sea(("VHM0", 0.0, {"units": "m", "standard_name": height})), ""),
    ):  # fmt: skip
        yield forced(f, name, change, parameters=parameters, check=used, told=("wave",))


def sea_levels() -> Iterator[Kind]:
    """Give heights that are no sea level above the geoid: their slope would drive the berg."""
    f = "heights that are no sea level"
    cause = ("sea level|height|geoid|ellipsoid|recognised|ssh|anomal|adt|tide|steric|pressure|no use|given",)
    told = ("sea level|ssh|height|geoid|ellipsoid|anomal",)

    def named(name: str, **told_of: Any) -> Change:
        def change(parts: Parts) -> None:
            ds = parts["level.nc"].rename(ssh=name) if name != "ssh" else parts["level.nc"]
            ds[name].attrs = {k: v for k, v in {"units": "m", **told_of}.items() if v is not None}
            parts["level.nc"] = ds

        return change

    for name, change in {
        "above the ellipsoid, ssh": named("ssh", standard_name="sea_surface_height_above_reference_ellipsoid"), "above the ellipsoid, zos": named("zos", standard_name="sea_surface_height_above_reference_ellipsoid"), "above the ellipsoid by the long name": named("ssh", long_name="sea surface height above the reference ellipsoid WGS84"),
        "sla": named("sla", standard_name="sea_surface_height_above_sea_level"), "sla called ssh": named("ssh", standard_name="sea_surface_height_above_sea_level"), "mean sea surface": named("ssh", long_name="mean sea surface height (MSS) above ellipsoid"), "the geoid itself": named("geoid", standard_name="geoid_height_above_reference_ellipsoid"),
        "tide": named("ssh", standard_name="sea_surface_height_amplitude_due_to_geocentric_ocean_tide"), "steric": named("zos", standard_name="steric_change_in_sea_surface_height"), "inverse barometer": named("ssh", standard_name="sea_surface_height_correction_due_to_air_pressure_at_low_frequency"),
    }.items():  # fmt: skip
        yield forced(f, name, change, never=True, told=told, cause=cause)


def ice_units() -> Iterator[Kind]:
    """Give sea ice in shares, per cent, tenths and flags that the units do not fit."""
    f = "shares and per cent of sea ice"

    def ice(
        factor: float,
        units: str | None,
        *,
        flags: float | None = None,
        thick: tuple[float, str | None] = (1.0, "m"),
        kind: str = "f4",
    ) -> Change:
        def change(parts: Parts) -> None:
            ds = parts["ice.nc"].copy(deep=True)
            for name, (times, unit) in (("siconc", (factor, units)), ("sithick", thick)):
                values = ds[name].values * times
                if flags is not None and name == "siconc":
                    values[:, 8:, 8:] = flags
                attributes = {k: v for k, v in {**ds[name].attrs, "units": unit}.items() if v is not None}
                ds[name] = (ds[name].dims, values.astype(kind if name == "siconc" else "f4"), attributes)
            parts["ice.nc"] = ds

        return change

    words = ("ice|siconc|sithick|%|share|per cent|percent",)
    for name, change, cause in (
        ("per cent that are shares", ice(1.0, "%"), words), ("shares that are per cent", ice(100.0, "1"), words), ("no units, per cent", ice(100.0, None), words), ("tenths without a word", ice(10.0, "1"), words), ("oktas", ice(8.0, "okta"), words), ("land flag of 254", ice(100.0, "%", flags=254.0), words),
        ("land flag in bytes", ice(100.0, "%", flags=120.0, kind="i1"), words), ("thickness in cm as m", ice(1.0, "1", thick=(100.0, "m")), words), ("thickness without units", ice(1.0, "1", thick=(100.0, None)), words), ("negative thickness", ice(1.0, "1", thick=(-1.0, "m")), words),
    ):  # fmt: skip

        def right(folder: Path, text: str) -> str:
            with xr.open_dataset(folder / "out" / "run.nc") as run:
                thick = run["ice_thickness"].values[:, 0]
                lon, lat = run["lon"].values[:, 0], run["lat"].values[:, 0]
            want = PLAIN("sithick", lon, lat, START)
            shared = want * PLAIN("siconc", lon, lat, START)
            near = min(np.abs(thick - want).max(), np.abs(thick - shared).max())
            if near > 0.05:
                return f"ice_thickness {thick.mean():.3g} for {want.mean():.3g} (or {shared.mean():.3g} over the cell)"
            return ""

        yield forced(
            f,
            name,
            change,
            ice=True,
            told=words,
            cause=cause,
            check=right,
            parameters="  melt: {enabled: true, temperature: 2 degC, salinity: 34}\n",
        )


def calendars() -> Iterator[Kind]:
    """Give calendars that are misspelt: refused as such, or read as what is meant."""
    f = "misspelt calendars"
    for said in (
        "gregorian_proleptic",
        "no_leap",
        "noLeap",
        "365",
        "365day",
        "standard ",
        "UTC",
        "Gregorian (UTC)",
        "prolepticgregorian",
        "360",
    ):
        meant = {"no_leap": "noleap", "noLeap": "noleap", "365": "noleap", "365day": "noleap", "360": "360_day"}.get(
            said, "standard"
        )
        yield forced(
            f, repr(said), _redated(units="days since 2000-01-01", calendar=meant, said=said), cause=("calendar",)
        )


def scalars() -> Iterator[Kind]:
    """Give stray scalars and bystanders, which say nothing of the field."""
    f = "stray coordinates"

    def scalar(
        name: str,
        value: Any,
        listed: bool = True,
        files: tuple[str, ...] = ("ocean.nc", "level.nc", "wind.nc"),
        **told: Any,
    ) -> Change:
        def change(parts: Parts) -> None:
            for file in files:
                ds = parts[file].assign_coords({name: ((), value, told)})
                for field in ds.data_vars:
                    if listed:
                        ds[field].attrs["coordinates"] = name
                parts[file] = ds

        return change

    def level(change: Change) -> Change:
        def both(parts: Parts) -> None:
            change(parts)
            ds = parts["ocean.nc"]
            depth = {"units": "m", "positive": "down", "standard_name": "depth"}
            for name in ("uo", "vo"):
                ds[name] = (("time", "depth", "lat", "lon"), ds[name].values[:, None], ds[name].attrs)
            parts["ocean.nc"] = ds.assign_coords(depth=("depth", np.array([0.494]), depth))

        return both

    for name, change in {
        "sigma of 0.995": scalar("sigma", 0.995), "sigma beside a depth of its own": level(scalar("sigma", 0.995, files=("ocean.nc",), standard_name="atmosphere_sigma_coordinate", units="1")), "height of 2 m of another field": scalar("height", 2.0, False, files=("level.nc",), units="m", standard_name="height"),
        "number 0": scalar("number", np.int32(0)), "crs": scalar("crs", np.int32(0), False), "heightAboveGround of 10 m": scalar("heightAboveGround", 10.0, files=("wind.nc",), units="m"), "surface of 0": scalar("surface", 0.0), "month of 12": scalar("month", np.int32(12)),
        "step of 0": scalar("step", 0.0, units="hours", standard_name="forecast_period"), "meanSea of 0": scalar("meanSea", 0.0, files=("level.nc",)),
    }.items():  # fmt: skip
        yield forced(f, name, change, cause=("sigma",) if name == "sigma of 0.995" else NEVER)


def archives() -> Iterator[Kind]:
    """Give what is no netCDF but looks like it: named as what it is."""
    f = "forcing in other containers"

    def packed(suffix: str, pack: Callable[[Path, xr.Dataset], None]) -> Change:
        def change(parts: Parts) -> Parts:
            ds = parts["ocean.nc"]
            return {
                f"ocean{suffix}": lambda path: pack(path, ds),
                "level.nc": parts["level.nc"],
                "wind.nc": parts["wind.nc"],
            }

        return change

    def data(path: Path, ds: xr.Dataset) -> bytes:
        plain = store_as(ds, path.with_name("plain_.tmp"))
        got = plain.read_bytes()
        plain.unlink()
        return got

    def zarr_zip(path: Path, ds: xr.Dataset) -> None:
        import shutil

        store = store_as(ds, path.with_name("s.zarr"), "zarr2")
        shutil.make_archive(str(path.with_suffix("")), "zip", store)
        shutil.rmtree(store)

    def with_module(module: str) -> Callable[[Path, xr.Dataset], None]:
        import importlib

        return lambda path, ds: path.write_bytes(importlib.import_module(module).compress(data(path, ds))) and None  # type: ignore[func-returns-value]

    def tar(path: Path, ds: xr.Dataset) -> None:
        import io
        import tarfile

        body = data(path, ds)
        with tarfile.open(path, "w") as archive:
            info = tarfile.TarInfo("ocean.nc")
            info.size = len(body)
            archive.addfile(info, io.BytesIO(body))

    def zipped(path: Path, ds: xr.Dataset) -> None:
        import zipfile

        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("ocean.nc", data(path, ds))

    for name, suffix, pack, cause in (
        ("Zarr zip", ".zarr.zip", zarr_zip, "zip"), ("gzip", ".nc.gz", with_module("gzip"), "gzip|gz"), ("gzip called nc", "_.nc", with_module("gzip"), "gzip|gz"), ("bzip2", ".nc.bz2", with_module("bz2"), "bz|not a netCDF"), ("xz", ".nc.xz", with_module("lzma"), "xz|not a netCDF"), ("tar", ".tar", tar, "tar|not a netCDF"),
        ("zip", ".zip", zipped, "zip"), ("GRIB", ".grib", lambda path, ds: path.write_bytes(b"GRIB" + bytes(900)) and None, "GRIB"), ("CSV", ".csv", lambda path, ds: path.write_text("time,lat,lon,uo\n2020-12-09,-55,-39,0.1\n" * 30) and None, "not a netCDF|text|CSV"),
        ("kerchunk", ".json", lambda path, ds: path.write_text('{"version": 1, "refs": {".zgroup": "{}"}}') and None, "not a netCDF|JSON|kerchunk"),
    ):  # fmt: skip
        yield forced(f, name, packed(suffix, pack), cause=(cause,), words=("ocean",))


def companions() -> Iterator[Kind]:
    """Give one file that is unfit among good ones: the message names that file."""
    f = "one unfit file among good ones"

    def unfit(content: Any, name: str = "stray.nc", first: bool = False) -> Change:
        def change(parts: Parts) -> Parts:
            made = content(parts) if callable(content) else content
            return {name: made, **parts} if first else {**parts, name: made}

        return change

    good = lambda parts: dataset(("uo", "vo"), moments=stamps("2020-12-07", 21))  # noqa: E731
    for name, change in {
        "empty": unfit(b""), "cut short": unfit(b"CDF\x01\x00\x00\x00\x00\x00\x00\x00\x0a"), "a log": unfit(b"run started\n" * 40, "stray.nc"), "a web page": unfit(b"<html>login</html>"), "a mask of land": unfit(lambda p: xr.Dataset({"tmask": (("y", "x"), np.ones((4, 4)))})),
        "a run of Riftberg's kind": unfit(lambda p: xr.Dataset({"lon": ("trajectory", np.zeros(3)), "break_time": ("bond", np.zeros(3))})), "dates that cannot be": unfit(lambda p: good(p).assign_coords(time=("time", np.arange(21.0), {"units": "hours since 2020-13-45"}))),
        "no positions": unfit(lambda p: good(p).drop_vars(("lat", "lon"))), "calendar that is none": unfit(lambda p: good(p).assign_coords(time=("time", np.arange(21.0), {"units": "days since 2000-01-01", "calendar": "lunar"}))), "first in the list": unfit(b"\x89HDF\r\n\x1a\n" + bytes(50), first=True),
    }.items():  # fmt: skip
        yield forced(f, name, change, words=("stray",), cause=("stray",), told=("stray",))


def undeclared_fills() -> Iterator[Kind]:
    """Give numbers that mean "missing" and are not declared, at one of the points around the berg or far from it."""
    f = "undeclared fill values"

    def spoilt(
        value: float,
        *,
        far: bool = False,
        file: str = "ocean.nc",
        names: tuple[str, ...] = ("uo", "vo"),
        everywhere: bool = False,
    ) -> Change:
        def change(ds: xr.Dataset, name: str) -> None:
            values = ds[name].values
            if everywhere:
                values[...] = value
            elif far:
                values[..., :3, :3] = value
            else:
                values[..., 8, 8] = value

        return _each(names, change, file)

    said = ("fill|missing|believ|beyond|_FillValue|not finite|value",)
    for name, change, more in (
        ("1e20 beside", spoilt(1e20), {}), ("9.97e36 beside", spoilt(9.969209968386869e36), {}), ("-9999 beside", spoilt(-9999.0), {}), ("-999 beside", spoilt(-999.0), {}), ("-99 beside", spoilt(-99.0), {}), ("32767 far", spoilt(32767.0, far=True), {}), ("infinite beside", spoilt(np.inf), {}),
        ("-1e34 of the sea level", spoilt(-1e34, file="level.nc", names=("ssh",)), {}), ("99.99 of the wind", spoilt(99.99, file="wind.nc", names=("ua", "va")), {}), ("-999 everywhere", spoilt(-999.0, everywhere=True), {"never": True}),
    ):  # fmt: skip
        yield forced(
            f, name, change, told=said, cause=("fill|missing|believ|beyond|finite|value|units",), slack=6.0, **more
        )


def magnitudes() -> Iterator[Kind]:
    """Give numbers of another unit under a right one: what no sea and no wind has is told or refused."""
    f = "numbers of another unit"
    said = ("believ|beyond|unit|usual|m/s|m s-1|high|large|strong",)
    for name, change, more in (
        ("cm/s as m/s", _attributes("ocean.nc", ("uo", "vo"), 100.0), {}), ("mm/s as m/s", _attributes("ocean.nc", ("uo", "vo"), 1000.0), {}), ("cm/s packed as m/s", _attributes("ocean.nc", ("uo", "vo"), 1e4, scale_factor=0.01), {}), ("cm as m of sea level", _attributes("level.nc", ("ssh",), 100.0), {}), ("mm as m of sea level", _attributes("level.nc", ("ssh",), 1000.0), {}),
        ("km/h as m/s of a storm", _attributes("wind.nc", ("ua", "va"), 3.6, 90.0), {}), ("cm/s of wind", _attributes("wind.nc", ("ua", "va"), 100.0), {}), ("one component alone in cm/s", _attributes("ocean.nc", ("vo",), 100.0), {}), ("depth in cm as m", None, {"floor": True}), ("fill without its scale", _attributes("ocean.nc", ("uo", "vo"), 3000.0), {}),
    ):  # fmt: skip
        if change is None:
            change = _attributes("floor.nc", ("depth",), 100.0)
        yield forced(f, name, change, told=said, cause=said, **more)


def packings() -> Iterator[Kind]:
    """Give packing that contradicts itself."""
    f = "packing"

    def raw(
        scale: Any,
        *,
        kind: str = "i2",
        fill: Any = -32767,
        offset: Any = 0.0,
        hole: bool = True,
        true_scale: float = 1e-3,
        **more: Any,
    ) -> Change:
        def change(ds: xr.Dataset, name: str) -> xr.Dataset:
            numbers = np.round(
                (ds[name].values.astype("f8") - (offset if isinstance(offset, float) else 0.0)) / true_scale
            )
            if hole and fill is not None:
                numbers[..., :2, :2] = float(fill)
            told = {
                **ds[name].attrs,
                "scale_factor": scale,
                **({"add_offset": offset} if offset is not None else {}),
                **({"_FillValue": np.dtype(kind).type(fill)} if fill is not None else {}),
                **more,
            }
            return ds.assign(
                {name: (ds[name].dims, numbers.astype(kind), {k: v for k, v in told.items() if v is not None})}
            )

        return _each(("uo", "vo"), change)

    cause = ("scale|packed|packing|offset|fill|valid|believ|beyond|text|number|missing|value",)
    said = ("scale|packed|packing|offset|fill|valid|believ|beyond|missing",)
    for name, change in {
        "scale as text": raw("0.001"), "scale of two numbers": raw(np.array([1e-3, 1e-3])), "scale of zero": raw(0.0), "scale of NaN": raw(np.nan), "scale left out": raw(None), "negative scale": raw(-1e-3, true_scale=-1e-3), "valid_range in unpacked numbers": raw(1e-3, valid_range=np.array([-3.0, 3.0], "f4")), "valid_min in packed numbers": raw(1e-3, valid_min=np.int16(-3000), valid_max=np.int16(3000)),
        "bytes called unsigned": raw(0.01, kind="i2", true_scale=0.01, _Unsigned="true"), "missing_value in unpacked numbers": raw(1e-3, missing_value=np.float32(-32.767)),
    }.items():  # fmt: skip
        yield forced(f, name, change, told=said, cause=cause, slack=2.0)


def dimension_orders() -> Iterator[Kind]:
    """Give dimensions in other orders, and such as tell no order at all."""
    f = "order of dimensions"

    def order(*dims: str) -> Change:
        return _each(("uo", "vo"), lambda ds, name: ds.assign({name: ds[name].transpose(*dims)}))

    def square(swap: bool, named: bool = True) -> Change:
        """Return as many rows as columns, with dimensions whose names mislead."""

        def change(parts: Parts) -> None:
            ds = parts["ocean.nc"]
            made = xr.Dataset(
                coords={
                    "time": ds["time"],
                    "latitude": ("x", ds["lat"].values, ds["lat"].attrs),
                    "longitude": ("y", ds["lon"].values, ds["lon"].attrs),
                },
                attrs=ds.attrs,
            )
            dims = ("time", "y", "x") if swap else ("time", "x", "y")
            for name in ("uo", "vo"):
                values = ds[name].values
                made[name] = (
                    dims,
                    values.transpose(0, 2, 1) if swap else values,
                    {**ds[name].attrs, "coordinates": "latitude longitude"} if named else ds[name].attrs,
                )
            parts["ocean.nc"] = made

        return change

    def wrong_order(parts: Parts) -> None:
        """Write values in the order of longitude, latitude under dimensions in the other order, without coordinates."""
        ds = parts["ocean.nc"]
        for name in ("uo", "vo"):
            ds[name] = (("time", "row", "column"), ds[name].values, ds[name].attrs)
        parts["ocean.nc"] = ds

    def two_dimensional(transposed: bool) -> Change:
        def change(parts: Parts) -> None:
            ds = parts["ocean.nc"]
            rows, columns = np.meshgrid(ds["lat"].values, ds["lon"].values, indexing="ij")
            made = xr.Dataset(
                coords={
                    "time": ds["time"],
                    "glat": (("j", "i"), rows, ds["lat"].attrs),
                    "glon": (
                        ("i", "j") if transposed else ("j", "i"),
                        columns.T if transposed else columns,
                        ds["lon"].attrs,
                    ),
                }
            )
            for name in ("uo", "vo"):
                made[name] = (("time", "j", "i"), ds[name].values, {**ds[name].attrs, "coordinates": "glat glon"})
            parts["ocean.nc"] = made

        return change

    for name, change, cause in (
        ("time last", order("lat", "lon", "time"), NEVER), ("x before y", order("time", "lon", "lat"), NEVER), ("time in the middle", order("lat", "time", "lon"), NEVER), ("reversed", order("lon", "lat", "time"), NEVER), ("x for rows", square(False), NEVER), ("x for rows, swapped", square(True), NEVER), ("x for rows, not listed", square(False, False), NEVER),
        ("rows without coordinates", wrong_order, ("position|coordinate|latitude",)), ("positions transposed", two_dimensional(True), NEVER), ("positions in two dimensions", two_dimensional(False), NEVER),
    ):  # fmt: skip
        yield forced(f, name, change, cause=cause)


def longitudes() -> Iterator[Kind]:
    """Give longitudes on other branches and of other kinds."""
    f = "longitudes"
    east = Ocean(0.1, -60.0)
    date_line = Ocean(179.9, -60.0)

    def onto(turn: Callable[[Any], Any], ocean: Ocean = PLAIN, **told: Any) -> Change:
        def change(parts: Parts) -> None:
            for file, ds in parts.items():
                parts[file] = ds.assign_coords(lon=("lon", turn(ds["lon"].values), {**ds["lon"].attrs, **told}))

        return change

    def globe(repeated: bool = False, step: float = 1.0, first: float = 0.0) -> Callable[[Ocean], Change]:
        def of(ocean: Ocean) -> Change:
            def change(parts: Parts) -> None:
                lon = first + np.arange(0.0, 360.0 + (step if repeated else 0.0), step)
                lat = np.arange(ocean.lat - 4.0, ocean.lat + 4.1, 0.5)
                for file, names in (("ocean.nc", ("uo", "vo")), ("level.nc", ("ssh",)), ("wind.nc", ("ua", "va"))):
                    ds = dataset(names, ocean, lon=lon, lat=lat)
                    away = np.abs((lon - ocean.lon + 180.0) % 360.0 - 180.0) > 60.0
                    for name in names:
                        values = ds[name].values
                        values[..., away] = 0.0
                    parts[file] = ds

            return change

        return of

    for name, change, ocean, cause in (
        ("0 to 360", onto(lambda q: q % 360.0), PLAIN, NEVER), ("-360 to 0", onto(lambda q: q % 360.0 - 360.0), PLAIN, NEVER), ("above 360", onto(lambda q: q % 360.0 + 360.0), PLAIN, NEVER), ("degrees west", onto(lambda q: -q, units="degrees_west"), PLAIN, ("west|longitude",)), ("radians", onto(np.deg2rad, units="radians"), PLAIN, NEVER),
        ("jump at Greenwich", onto(lambda q: q % 360.0, east), east, NEVER), ("jump at the date line", onto(lambda q: (q + 180.0) % 360.0 - 180.0, date_line), date_line, NEVER), ("globe with the first column again", globe(True)(east), east, NEVER), ("globe without", globe(False)(east), east, NEVER), ("globe from 20", globe(False, first=20.0)(PLAIN), PLAIN, NEVER),
    ):  # fmt: skip
        yield forced(f, name, change, ocean=ocean, cause=cause)


def latitudes() -> Iterator[Kind]:
    """Give latitudes of other kinds."""
    f = "latitudes"

    def turned(turn: Callable[[Any], Any], flip: bool = False, **told: Any) -> Change:
        def change(parts: Parts) -> None:
            for file, ds in parts.items():
                ds = ds.isel(lat=slice(None, None, -1)) if flip else ds
                attributes = {k: v for k, v in {**ds["lat"].attrs, **told}.items() if v is not None}
                parts[file] = ds.assign_coords(lat=("lat", turn(ds["lat"].values), attributes))

        return change

    cause = ("latitude|lat|position|degree",)
    for name, change, why in (
        ("from the north", turned(lambda q: q, True), NEVER), ("degrees south", turned(lambda q: -q, units="degrees_south"), cause), ("radians", turned(np.deg2rad, units="radian"), NEVER), ("colatitude", turned(lambda q: 90.0 - q, standard_name=None, long_name="colatitude", units="degrees"), cause), ("colatitude called latitude", turned(lambda q: 90.0 - q), cause),
        ("single precision", turned(lambda q: q.astype("f4")), NEVER), ("shuffled", turned(lambda q: np.random.default_rng(2).permutation(q)), cause), ("one twice", turned(lambda q: np.where(np.arange(q.size) == 5, q[4], q)), cause), ("minutes of arc", turned(lambda q: q * 60.0, units="arc_minutes"), cause), ("hundredths of degrees", turned(lambda q: q * 100.0), cause),
    ):  # fmt: skip
        yield forced(f, name, change, cause=why, told=("latitude|lat",))


def members() -> Iterator[Kind]:
    """Give ensembles and other extra dimensions, whose first entry need not be what is meant."""
    f = "members and extra dimensions"

    def extra(
        dim: str,
        count: int,
        coordinate: Any = None,
        first_right: bool = True,
        file: str = "ocean.nc",
        gaps: bool = False,
        **told: Any,
    ) -> Change:
        def change(parts: Parts) -> None:
            ds = parts[file]
            for name in list(ds.data_vars):
                values = np.repeat(ds[name].values[:, None], count, 1).copy()
                if not first_right:
                    values[:, 0] += 0.5
                if gaps:
                    values[:, 1:] = np.nan
                ds[name] = (("time", dim, "lat", "lon"), values, ds[name].attrs)
            parts[file] = (
                ds.assign_coords({dim: (dim, np.arange(count) if coordinate is None else coordinate, told)})
                if coordinate is not False
                else ds
            )

        return change

    cause = ("entries|member|dimension|ensemble|level|expver|quantile|version",)
    for name, change, why in (
        ("three members", extra("number", 3, first_right=False, standard_name="realization"), cause), ("one member", extra("member", 1, standard_name="realization"), NEVER), ("two versions of ERA5", extra("expver", 2, np.array([1, 5]), file="wind.nc", gaps=True), cause), ("quantiles", extra("quantile", 3, np.array([0.1, 0.5, 0.9]), first_right=False), cause),
        ("percentiles of one", extra("percentile", 1, np.array([50.0])), NEVER), ("scenarios without a name", extra("scen", 2, False, first_right=False), cause), ("two components in one variable", extra("component", 2, first_right=False), cause), ("bands of a raster", extra("band", 1, np.array([1])), NEVER), ("bands of two", extra("band", 2, np.array([1, 2]), first_right=False), cause),
        ("height of 10 m and of 100 m", extra("height", 2, np.array([10.0, 100.0]), file="wind.nc", units="m", positive="up", standard_name="height"), ("height|10 m|entries|level",)),
    ):  # fmt: skip
        yield forced(f, name, change, cause=why, told=("member|level|height|version|quantile",))


def vectors() -> Iterator[Kind]:
    """Give components that are others than they seem."""
    f = "components of vectors"

    def named(
        u: str, v: str, *, file: str = "ocean.nc", sign: tuple[float, float] = (1.0, 1.0), keep: bool = True
    ) -> Change:
        def change(parts: Parts) -> None:
            ds = parts[file]
            first, second = ("uo", "vo") if file == "ocean.nc" else ("ua", "va")
            for name, told, factor in ((first, u, sign[0]), (second, v, sign[1])):
                ds[name] = (
                    ds[name].dims,
                    ds[name].values * np.float32(factor),
                    {**ds[name].attrs, "standard_name": told}
                    if told
                    else {k: a for k, a in ds[name].attrs.items() if k != "standard_name"},
                )
            parts[file] = ds

        return change

    def alone(name: str) -> Change:
        def change(parts: Parts) -> None:
            parts["ocean.nc"] = parts["ocean.nc"].drop_vars(name)

        return change

    def speed(parts: Parts) -> None:
        ds = parts["wind.nc"]
        u, v = ds["ua"].values, ds["va"].values
        ds = ds.drop_vars(["ua", "va"])
        ds["wspd"] = (("time", "lat", "lon"), np.hypot(u, v), {"units": "m s-1", "standard_name": "wind_speed"})
        ds["wdir"] = (
            ("time", "lat", "lon"),
            np.degrees(np.arctan2(-u, -v)) % 360.0,
            {"units": "degree", "standard_name": "wind_from_direction"},
        )
        parts["wind.nc"] = ds

    def crossed(parts: Parts) -> None:
        parts["ocean.nc"] = parts["ocean.nc"].rename(uo="t_", vo="uo").rename(t_="vo")

    cause = (
        "component|eastward|northward|velocity|westward|southward|direction|wind|current|vo|uo|no use|recognised|geostrophic|anomal|tide|stokes|pair",
    )
    for name, change, more in (
        ("eastward alone", alone("vo"), {}), ("westward and southward", named("westward_sea_water_velocity", "southward_sea_water_velocity", sign=(-1.0, -1.0)), {}), ("uo called northward and vo eastward", crossed, {}), ("speed and direction of wind", speed, {"told": ("wind",)}), ("barotropic", named("barotropic_eastward_sea_water_velocity", "barotropic_northward_sea_water_velocity"), {"never": True}),
        ("tide alone", named("eastward_sea_water_velocity_due_to_tides", "northward_sea_water_velocity_due_to_tides"), {"never": True}), ("Stokes drift", named("sea_surface_wave_stokes_drift_x_velocity", "sea_surface_wave_stokes_drift_y_velocity"), {"never": True}), ("anomalies", named("surface_geostrophic_eastward_sea_water_velocity_assuming_sea_level_for_geoid", "surface_geostrophic_northward_sea_water_velocity_assuming_sea_level_for_geoid"), {"never": True}),
        ("gusts", named("wind_speed_of_gust", "wind_speed_of_gust", file="wind.nc"), {"told": ("wind",)}), ("both called eastward", named("eastward_sea_water_velocity", "eastward_sea_water_velocity"), {}),
    ):  # fmt: skip
        yield forced(f, name, change, cause=cause, **more)


def candidates() -> Iterator[Kind]:
    """Give several variables that may be meant."""
    f = "several candidates"

    def beside(
        name: str, shift: float, standard: str | None = STANDARD["uo"], pair: str = "", long: str = ""
    ) -> Change:
        def change(parts: Parts) -> None:
            ds = parts["ocean.nc"]
            for own, other, told in (("uo", name, standard), ("vo", pair, STANDARD["vo"])):
                if other:
                    ds[other] = (
                        ds[own].dims,
                        ds[own].values + np.float32(shift),
                        {
                            k: v
                            for k, v in {"units": "m s-1", "standard_name": told, "long_name": long or None}.items()
                            if v
                        },
                    )
            parts["ocean.nc"] = ds

        return change

    def renamed(*pairs: tuple[str, str]) -> Change:
        def change(parts: Parts) -> None:
            ds = parts["ocean.nc"]
            ds["second_u"], ds["second_v"] = ds["uo"] + np.float32(0.5), ds["vo"] + np.float32(0.5)
            ds["second_u"].attrs, ds["second_v"].attrs = dict(ds["uo"].attrs), dict(ds["vo"].attrs)
            parts["ocean.nc"] = ds.rename(dict(pairs))

        return change

    cause = ("several|candidates|both|two|variables",)
    for name, change, why in (
        ("the tide beside, called alike", beside("utide", 0.5), cause), ("a total beside", beside("utotal", 0.5, pair="vtotal", long="total current"), cause), ("without tide beside", beside("uo_detided", 0.5, pair="vo_detided"), cause), ("an error beside", beside("uo_error", 0.5, "eastward_sea_water_velocity standard_error"), NEVER), ("a quality flag beside", beside("uo_qc", 0.5, "eastward_sea_water_velocity status_flag"), NEVER),
        ("count beside", beside("n_uo", 5.0, "eastward_sea_water_velocity number_of_observations"), NEVER), ("bottom current beside", beside("ubot", 0.5, "eastward_sea_water_velocity_at_sea_floor"), NEVER), ("two unusual names", renamed(("uo", "first_u"), ("vo", "first_v")), cause), ("geostrophic beside", beside("ugos", 0.5, "surface_geostrophic_eastward_sea_water_velocity", long="geostrophic"), NEVER),
        ("upper case beside lower", beside("UO", 0.5, pair="VO"), cause),
    ):  # fmt: skip
        yield forced(f, name, change, cause=why, told=("uo|several|candidates|other|variable",))


def dates() -> Iterator[Kind]:
    """Give dates in forms that real files have."""
    f = "forms of dates"
    day = stamps("2020-12-05", 9, 24.0)

    def daily(raw: Any, **told: Any) -> Change:
        names = {"ocean.nc": ("uo", "vo"), "level.nc": ("ssh",), "wind.nc": ("ua", "va")}

        def change(parts: Parts) -> None:
            for file, fields in names.items():
                parts[file] = dataset(fields, moments=day).assign_coords(time=("time", raw, told))

        return change

    counts = written_time(stamps(), "hours since 2020-12-01")
    for name, change, cause in (
        ("zone of +03:00", _redated(units="hours since 2020-12-01", raw=counts + 3.0, written_units="hours since 2020-12-01 00:00:00+03:00"), ("zone|time",)), ("zone of -0930", _redated(raw=counts - 9.5, units="hours since 2020-12-01 00:00:00 -0930"), ("zone|time",)), ("EST", _redated(raw=counts - 5.0, units="hours since 2020-12-01 00:00:00 EST"), ("EST|zone|time|date",)),
        ("Julian days", daily(written_time(day, "days since 2000-01-01 12:00:00") + 2451545.0, units="days since -4713-11-24 12:00:00", calendar="proleptic_gregorian"), ("date|time|4713",)), ("modified Julian days", daily(written_time(day, "days since 1858-11-17"), units="days since 1858-11-17"), NEVER), ("numbers of days", daily(np.array([20201205 + k for k in range(9)], "i4")), NEVER),
        ("day of the year", daily(340.0 + np.arange(9.0), units="day of year"), ("date|time|since|day of year",)), ("decimal years", daily(2020.0 + (339.0 + np.arange(9.0)) / 366.0, units="years", long_name="decimal year"), ("date|time|since|year",)), ("MATLAB's datenum", daily(written_time(day, "days since 2000-01-01") + 730486.0, units="days since 0000-01-00"), ("date|time|since",)),
        ("no dates at all", daily(np.arange(9.0)), ("date|time|since|unit",)),
    ):  # fmt: skip
        yield forced(f, name, change, cause=cause, told=("date|time",))


def records() -> Iterator[Kind]:
    """Give records that repeat, jump, stand out of order or are missing."""
    f = "records"

    def picked(order: Any, moments: Any = None, spoil: Callable[[Any], None] | None = None) -> Change:
        def change(parts: Parts) -> None:
            for file in list(parts):
                ds = parts[file].isel(time=order)
                if spoil:
                    for name in ds.data_vars:
                        spoil(ds[name].values)
                parts[file] = ds

        return change

    def hole(values: Any) -> None:
        values[9:12] = np.nan

    def later(values: Any) -> None:
        values[10] += 0.5

    all_ = np.arange(21)
    twice = np.array([*range(11), 10, *range(11, 21)])

    def twice_differing(parts: Parts) -> None:
        for file in list(parts):
            ds = parts[file].isel(time=twice).copy(deep=True)
            for name in ds.data_vars:
                ds[name].values[11] += 0.5
            parts[file] = ds

    def apart(parts: Parts) -> None:
        parts["level.nc"] = parts["level.nc"].isel(time=slice(0, 5))

    cause = ("gap|record|date|twice|repeat|missing|value|outside|cover",)
    said = ("gap|record|date|repeat|missing|twice",)
    for name, change, more in (
        ("shuffled", picked(np.random.default_rng(4).permutation(21)), {"cause": NEVER}), ("backwards", picked(all_[::-1]), {"cause": NEVER}), ("one twice", picked(twice), {}), ("one twice with other values", twice_differing, {}), ("a gap of two days", picked(np.r_[0:8, 16:21]), {}), ("empty records around the start", picked(all_, spoil=hole), {}),
        ("sea level ends before the start", apart, {}), ("one record long before", picked([0]), {}), ("two records, years apart", _redated(raw=written_time(np.concatenate([stamps()[:20] - 800 * DAY, stamps()[20:] + 800 * DAY]))), {}), ("NaT among the dates", _redated(raw=np.where(np.arange(21) == 5, np.nan, written_time(stamps()))), {}),
    ):  # fmt: skip
        yield forced(f, name, change, told=said, slack=1.0, never="years" in name, **{"cause": cause, **more})


_Z = np.array([0.5, 5.0, 15.0, 30.0, 50.0, 75.0, 100.0, 125.0, 150.0, 175.0, 200.0, 250.0, 300.0, 400.0])
SHEARED = Ocean(shear=1e-3)


def levels() -> Iterator[Kind]:
    """Give levels whose sign, unit or order is not the usual: the mean over the draft is known."""
    f = "levels"

    def on_levels(depth: Any, order: Any = None, thick: bool = False, holes: bool = False, **told: Any) -> Change:
        def change(parts: Parts) -> None:
            ds = parts["ocean.nc"]
            z = _Z if order is None else _Z[order]
            for name in ("uo", "vo"):
                values = np.stack([ds[name].values + np.float32(1e-3 * level * (name == "uo")) for level in z], 1)
                if holes:
                    values[:, z > 120.0] = np.nan
                ds[name] = (("time", "lev", "lat", "lon"), values, ds[name].attrs)
            parts["ocean.nc"] = (
                ds.assign_coords(lev=("lev", depth, {k: v for k, v in told.items() if v is not None}))
                if depth is not None
                else ds
            )

        return change

    draft = 200.0 * 850.0 / 1025.0
    wanted = {"uo": lambda lon, lat, when: PLAIN("uo", lon, lat, when) + 0.5e-3 * draft}
    back = np.arange(_Z.size)[::-1]
    cause = ("level|depth|positive|lev|pressure|keel|draft|unit",)
    for name, change, more in (
        ("down", on_levels(_Z, units="m", positive="down", axis="Z"), {"cause": NEVER}), ("up", on_levels(-_Z, units="m", positive="up", axis="Z"), {"cause": NEVER}), ("heights called down", on_levels(-_Z, units="m", positive="down"), {}), ("heights without a word", on_levels(-_Z, units="m", axis="Z"), {}), ("deepest first", on_levels(_Z[::-1], back, units="m", positive="down"), {"cause": NEVER}),
        ("depths called up", on_levels(_Z, units="m", positive="up", axis="Z"), {}), ("kilometres", on_levels(_Z / 1000.0, units="km", positive="down"), {}), ("decibar", on_levels(_Z, units="dbar", positive="down", standard_name="sea_water_pressure"), {}), ("no units", on_levels(_Z, axis="Z"), {}), ("numbers of levels", on_levels(np.arange(14.0) + 1.0, long_name="model level number", standard_name="model_level_number"), {}),
    ):  # fmt: skip
        yield forced(
            f, name, change, wanted=wanted, slack=2.0, told=("level|depth|lev|positive",), **{"cause": cause, **more}
        )


def staggered() -> Iterator[Kind]:
    """Give models whose components stand on points of their own: they meet at the berg, or are refused for it."""
    f = "components on points of their own"
    from fuzz.layouts import Layout, values_differ, write

    for number, grid in enumerate(
        (
            "ROMS",
            "ROMS, surface",
            "ROMS, straight axes",
            "ROMS, straight axes, surface",
            "ROMS, grid apart",
            "NEMO",
            "NEMO, straight",
            "MITgcm",
            "MOM6",
            "FVCOM",
        )
    ):
        made = Layout(1000 + number, grid=grid)

        def make(folder: Path, made: Layout = made) -> list[str]:
            (folder / "bad.yaml").write_text(experiment(write(folder, made), made.ocean))
            return RUN

        told = GRIDS[grid].choice.told
        yield Kind(
            f,
            grid,
            make,
            ("f_", "wind.nc"),
            False,
            Truth(lambda folder, text, made=made: values_differ(folder, made), told),
            NEVER,
            seconds=SOON,
        )  # type: ignore[misc]


def agreement() -> Iterator[Kind]:
    """Give files that a run takes: the doctor takes them too, and says what will be assumed."""
    f = "doctor and run"

    def without(file: str) -> Change:
        def change(parts: Parts) -> None:
            del parts[file]

        return change

    def still(parts: Parts) -> None:
        parts["ocean.nc"] = dataset(("uo", "vo"), steady=True)

    def zero(parts: Parts) -> None:
        for name in ("ua", "va"):
            parts["wind.nc"][name] = parts["wind.nc"][name] * np.float32(0.0)

    def stress(parts: Parts) -> None:
        ds = parts["wind.nc"].rename(ua="taux", va="tauy") * np.float32(0.01)
        for name, told in (("taux", "surface_downward_eastward_stress"), ("tauy", "surface_downward_northward_stress")):
            ds[name].attrs = {"units": "Pa", "standard_name": told}
        ds["time"].attrs, ds["lat"].attrs, ds["lon"].attrs = (parts["wind.nc"][n].attrs for n in ("time", "lat", "lon"))
        parts["wind.nc"] = ds

    def ends(parts: Parts) -> None:
        parts["level.nc"] = _held(parts["level.nc"])

    def _held(ds: xr.Dataset) -> xr.Dataset:
        return ds.isel(time=slice(0, 10))

    def small(parts: Parts) -> None:
        for file in parts:
            parts[file] = parts[file].isel(lon=slice(6, 12), lat=slice(6, 12))

    current = ("uo", "vo")
    for name, change, more in (
        ("no sea level", without("level.nc"), {"names": (*current, "ua", "va")}), ("no wind", without("wind.nc"), {"names": current}), ("neither, and on purpose", lambda p: {"ocean.nc": p["ocean.nc"]}, {"names": current, "sea_level": "none", "wind": "none"}), ("currents without dates", still, {"names": ("ua", "va", "slope")}), ("a calm", zero, {"names": (*current, "slope")}),
        ("stress for wind", stress, {"names": (*current, "slope")}), ("ends that are held", ends, {"names": current, "hold": 24}), ("less than the box", small, {}), ("gap that is allowed", lambda p: p.update({"level.nc": p["level.nc"].isel(time=np.r_[0:8, 16:21])}), {"max_gap": 72, "names": current}), ("several sets of currents", lambda p: p.update({"again.nc": dataset(("uo", "vo"), lon=axes()[0] + 0.1)}), {}),
    ):  # fmt: skip
        yield forced(f, name, change, doctor=True, **more)


def stores() -> Iterator[Kind]:
    """Give Zarr stores that lack something."""
    f = "Zarr stores"
    import json
    import shutil

    def store(
        damage: Callable[[Path], Any],
        form: str = "zarr2",
        name: str = "ocean.zarr",
        ds: Callable[[xr.Dataset], xr.Dataset] = lambda d: d,
    ) -> Change:
        def change(parts: Parts) -> Parts:
            good = parts["ocean.nc"]

            def write(path: Path) -> None:
                store_as(ds(good), path, form)
                damage(path)

            return {name: write, "level.nc": parts["level.nc"], "wind.nc": parts["wind.nc"]}

        return change

    def lost_chunks(path: Path) -> None:
        for file in [*path.glob("uo/*"), *path.glob("uo/c/**/*")]:
            if file.is_file() and file.name not in (".zarray", ".zattrs", "zarr.json"):
                file.unlink()

    def cut_chunks(path: Path) -> None:
        for file in [*path.glob("uo/*"), *path.glob("uo/c/**/*")]:
            if file.is_file() and file.name not in (".zarray", ".zattrs", "zarr.json"):
                file.write_bytes(file.read_bytes()[:20])

    def edited(path: Path) -> None:
        file = path / "uo" / ".zattrs"
        told = json.loads(file.read_text())
        file.write_text(json.dumps({**told, "units": "cm s-1"}))

    cause = ("zarr|store|chunk|metadata|missing|value|recognised|holds|opened",)
    nothing = lambda path: None  # noqa: E731
    for name, change, more in (
        ("as it should be", store(nothing), {"cause": NEVER}), ("format 3", store(nothing, "zarr3"), {"cause": NEVER}), ("no consolidated metadata", store(lambda p: (p / ".zmetadata").unlink()), {"cause": NEVER}), ("no group mark", store(lambda p: ((p / ".zmetadata").unlink(), (p / ".zgroup").unlink())), {}), ("chunks lost", store(lost_chunks), {"told": ("missing|value",)}),
        ("chunks cut short", store(cut_chunks), {}), ("metadata of another date", store(edited), {"cause": NEVER}), ("variable lost", store(lambda p: ((p / ".zmetadata").unlink(), shutil.rmtree(p / "vo"))), {"cause": ("vo|component|recognised|pair|alone|velocity",)}), ("an empty folder", store(lambda p: (shutil.rmtree(p), p.mkdir())), {}), ("a file of that name", store(lambda p: (shutil.rmtree(p), p.write_text("x"))), {}),
    ):  # fmt: skip
        yield forced(f, name, change, words=("ocean",), **{"cause": cause, **more})


def coasts() -> Iterator[Kind]:
    """Give land as zeros, masks and steps beside the berg: still water is no land, and land is no still water."""
    f = "land in the fields"

    def land(
        value: float,
        rows: slice,
        names: tuple[str, ...] = ("uo", "vo"),
        file: str = "ocean.nc",
        fill: float | None = None,
        mask: bool = False,
    ) -> Change:
        def change(ds: xr.Dataset, name: str) -> xr.Dataset:
            values = ds[name].values.copy()
            values[:, rows] = value
            told = dict(ds[name].attrs) | ({"_FillValue": np.float32(fill)} if fill is not None else {})
            made = ds.assign({name: (ds[name].dims, values, told)})
            if mask:
                wet = np.ones(values.shape[1:], "i1")
                wet[rows] = 0
                made["mask"] = (("lat", "lon"), wet, {"standard_name": "sea_binary_mask", "units": "1"})
            return made

        return _each(names, change, file)

    cause = ("land|missing|nothing is known|no value|water|zero|berg",)
    said = ("land|missing|zero|mask",)
    half, most, near = slice(0, 8), slice(0, 14), slice(0, 9)
    for name, change, more in (
        ("NaN to the south", land(np.nan, half), {"cause": NEVER}), ("NaN beside the berg", land(np.nan, near), {"slack": 6.0}), ("NaN over the berg", land(np.nan, most), {"never": True}), ("declared fill over the berg", land(1e20, most, fill=1e20), {"never": True}), ("zeros with a mask beside", land(0.0, half, mask=True), {"cause": NEVER}), ("zeros with a mask over the berg", land(0.0, most, mask=True), {"never": True}),
        ("NaN of the sea level over the berg", land(np.nan, most, ("ssh",), "level.nc"), {"never": True}), ("NaN of the wind over the berg", land(np.nan, most, ("ua", "va"), "wind.nc"), {"never": True}), ("NaN of one component", land(np.nan, most, ("vo",)), {"never": True}), ("everything missing", land(np.nan, slice(None)), {"never": True}),
    ):  # fmt: skip
        yield forced(f, name, change, told=said, **{"cause": cause, **more})


def headings() -> Iterator[Kind]:
    """Give files whose product is told wrongly, by name or by heading."""
    f = "files taken for another product"

    def heading(file: str = "ocean.nc", rename: dict[str, str] | None = None, **told: Any) -> Change:
        def change(parts: Parts) -> Parts:
            ds = parts["ocean.nc"].assign_attrs(told).rename(rename or {})
            return {file: ds, "level.nc": parts["level.nc"], "wind.nc": parts["wind.nc"]}

        return change

    def product(name: str) -> Callable[[list[str]], list[str]]:
        return lambda files: [f"{{file: {files[0]}, product: {name}}}", *files[1:]]

    for name, change, more in (
        ("name of a forecast", heading("mercatorpsy4v3r1_gl12_mean_20201209.nc"), {}), ("name of the small files of A68a", heading("a68_experiment_ocean_surf_vel_oscar_dec2020_HOURLY_ll_p125.nc"), {}), ("title of OSCAR", heading(title="Ocean Surface Current Analyses Real-time (OSCAR)", summary="15 m"), {}), ("title of GLORYS", heading(title="GLORYS12V1 daily", source="MERCATOR GLORYS12V1"), {}),
        ("history of grib_to_netcdf", heading(history="grib_to_netcdf ... ERA5"), {}), ("named glorys", heading(), {"listed": product("glorys")}), ("named oscar-v2", heading(), {"listed": product("oscar-v2")}), ("named a68a", heading(), {"listed": product("a68a")}), ("named roms", heading(), {"listed": product("roms")}), ("named era5", heading(), {"listed": product("era5")}),
    ):  # fmt: skip
        yield forced(
            f,
            name,
            change,
            told=("product|taken|mean|daily",),
            cause=("product|recognised|holds|no ocean|variable|uo|not|lacks|roms|glorys|oscar|era5|a68a",),
            words=("ocean",),
            **more,
        )


FAMILIES: tuple[Callable[[], Iterator[Kind]], ...] = (
    years_beyond, depth_signs, neighbours, overlaps, no_units, means_without_bounds, means_with_bounds, projections, waves, sea_levels, ice_units, calendars, scalars, archives, companions, undeclared_fills, magnitudes,
    packings, dimension_orders, longitudes, latitudes, members, vectors, candidates, dates, records, levels, staggered, agreement, stores, coasts, headings,
)  # fmt: skip
"""All families of this module."""
