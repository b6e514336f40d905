"""An ocean in closed form, files of it in any layout, and the comparison of a run with the formula.

All fields are linear in longitude, latitude and time, so that what a berg must meet is known without interpolation, and
a mean over a span of time is the value in its middle.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fuzz.judging import APART, Truth, call

START = np.datetime64("2020-12-09T13:00", "ns")
DAY = np.timedelta64(86400, "s")
EARTH = 6.37e6

STANDARD = {
    "uo": "eastward_sea_water_velocity", "vo": "northward_sea_water_velocity", "ssh": "sea_surface_height_above_geoid",
    "ua": "eastward_wind", "va": "northward_wind", "depth": "sea_floor_depth_below_geoid", "siconc": "sea_ice_area_fraction",
    "sithick": "sea_ice_thickness",
}  # fmt: skip
UNITS = {
    "uo": "m s-1",
    "vo": "m s-1",
    "ssh": "m",
    "ua": "m s-1",
    "va": "m s-1",
    "depth": "m",
    "siconc": "1",
    "sithick": "m",
}


@dataclass(frozen=True)
class Ocean:
    """What the files hold: values at a centre, and their changes by degree and day.

    Attributes
    ----------
    lon, lat : float
        Centre, where the berg lies, degrees.
    rate : float
        Change of the eastward current, m s-1 a day.
    shear : float
        Change of the eastward current by metre of depth, s-1.
    """

    lon: float = -39.0
    lat: float = -55.5
    rate: float = 0.2
    shear: float = 0.0

    def __call__(self, name: str, lon: Any, lat: Any, moment: Any = START) -> Any:
        """Return a field at positions (degrees) and dates."""
        x = (np.asarray(lon) - self.lon + 180.0) % 360.0 - 180.0
        y = np.asarray(lat) - self.lat
        days = self.rate * ((np.asarray(moment, "M8[ns]") - START) / np.timedelta64(86400, "s"))
        return {
            "uo": lambda: 0.3 + 0.05 * x + 0.02 * y + days, "vo": lambda: -0.2 + 0.03 * x - 0.04 * y - 0.5 * days,
            "ssh": lambda: 0.5 + 0.08 * x + 0.1 * y + 0.1 * days, "ua": lambda: 6.0 + 0.5 * x + 0.2 * y + 5.0 * days,
            "va": lambda: -3.0 + 0.3 * x - 0.4 * y + 3.0 * days, "depth": lambda: 1500.0 + 150.0 * x - 200.0 * y + 0.0 * days,
            "siconc": lambda: 0.5 + 0.02 * x + 0.0 * y + 0.0 * days, "sithick": lambda: 1.0 + 0.1 * x + 0.0 * y + 0.0 * days,
        }[name]()  # fmt: skip

    def slope(self, lat: Any) -> tuple[Any, Any]:
        """Return the eastward and northward slope of the sea surface."""
        degree = np.deg2rad(1.0) * EARTH
        return 0.08 / (degree * np.cos(np.deg2rad(lat))), 0.1 / degree + 0.0 * np.asarray(lat)


PLAIN = Ocean()


def axes(ocean: Ocean = PLAIN, half: float = 2.0, step: float = 0.25) -> tuple[Any, Any]:
    """Return longitudes and latitudes around the centre."""
    around = np.arange(-half, half + step / 2, step)
    return ocean.lon + around, ocean.lat + around


def stamps(first: str = "2020-12-07T00:00", count: int = 21, hours: float = 6.0) -> Any:
    """Return dates at equal intervals."""
    return np.datetime64(first, "ns") + (np.arange(count) * hours * 3600.0 * 1e9).astype("m8[ns]")


def written_time(moments: Any, units: str = "hours since 1950-01-01 00:00:00", calendar: str = "standard") -> Any:
    """Return raw numbers of dates, by their label in calendars of other lengths."""
    import cftime

    dates = [cftime.datetime(*_parts(moment), calendar=calendar) for moment in np.atleast_1d(moments)]
    return np.asarray(cftime.date2num(dates, units, calendar=calendar, has_year_zero=None), "f8")


def _parts(moment: Any) -> tuple[int, ...]:
    text = str(np.datetime64(moment, "s"))
    return tuple(int(part) for part in re.split(r"[-T:]", text))


def dataset(
    names: Iterable[str],
    ocean: Ocean = PLAIN,
    *,
    moments: Any = None,
    lon: Any = None,
    lat: Any = None,
    steady: bool = False,
) -> xr.Dataset:
    """Return fields on axes of longitude and latitude as a raw dataset by CF: nothing is left to encode."""
    east, north = axes(ocean)
    east, north = east if lon is None else np.asarray(lon), north if lat is None else np.asarray(lat)
    moments = stamps() if moments is None else moments
    ds = xr.Dataset(
        coords={
            "lat": ("lat", north, {"units": "degrees_north", "standard_name": "latitude"}),
            "lon": ("lon", east, {"units": "degrees_east", "standard_name": "longitude"}),
        },
        attrs={"Conventions": "CF-1.8"},
    )  # fmt: skip
    if not steady:
        units = "hours since 1950-01-01 00:00:00"
        ds = ds.assign_coords(
            time=(
                "time",
                written_time(moments, units),
                {"units": units, "standard_name": "time", "calendar": "standard"},
            )
        )
    for name in names:
        if steady or name == "depth":
            values = ocean(name, east[None, :], north[:, None])
            dims: tuple[str, ...] = ("lat", "lon")
        else:
            values = ocean(name, east[None, None, :], north[None, :, None], moments[:, None, None])
            dims = ("time", "lat", "lon")
        ds[name] = (dims, values.astype("f4"), {"units": UNITS[name], "standard_name": STANDARD[name]})
    return ds


def plain_files(folder: Path, ocean: Ocean = PLAIN, without: Iterable[str] = ()) -> list[str]:
    """Write good files of currents, sea level and wind, and return their names."""
    made = []
    for file, names in (("ocean.nc", ("uo", "vo")), ("level.nc", ("ssh",)), ("wind.nc", ("ua", "va"))):
        if file not in without:
            store_as(dataset(names, ocean), folder / file)
            made.append(file)
    return made


def store_as(ds: xr.Dataset, path: Path, form: str = "NETCDF4", **options: Any) -> Path:
    """Write a raw dataset: numbers and attributes stand in the file as they are here."""
    own: dict[str, Any] = {
        str(name): {"_FillValue": None}
        for name in ds.variables
        if "_FillValue" not in ds[name].attrs and ds[name].dtype.kind == "f"
    }
    for name, how in options.pop("encoding", {}).items():
        own.setdefault(name, {}).update(how)
    if form.startswith("zarr"):
        if path.exists():
            raise FileExistsError(path)
        ds.to_zarr(
            path,
            zarr_format=int(form[4:] or 2),
            encoding={k: v for k, v in own.items() if v != {"_FillValue": None}},
            **options,
        )  # type: ignore[call-overload]
    else:
        ds.to_netcdf(path, format=form, engine="netcdf4", encoding=own, **options)  # type: ignore[call-overload]
    return path


def experiment(
    files: Iterable[Any], ocean: Ocean = PLAIN, *, start: str = "2020-12-09 13:00", days: float = 0.0625, parameters: str = "",
    thickness: float = 200.0, **forcing: Any,
) -> str:  # fmt: skip
    """Return the text of an experiment that is driven by files."""
    listed = ", ".join(entry if entry.startswith("{") else f'"{entry}"' for entry in map(str, files))
    east, west = ocean.lon + 1.0, ocean.lon - 1.0
    extra = "".join(f"  {key}: {value}\n" for key, value in forcing.items())
    return (
        f"start: {start}\ndays: {days}\noutput_every_hours: 0.5\nberg:\n  rectangle: {{length: 9 km, width: 6 km}}\n"
        f"  placement: [{(ocean.lon + 180) % 360 - 180}, {ocean.lat}]\n  thickness: {thickness}\n  radius: 1500\n"
        "forcing:\n  kind: files\n"
        f"  files: [{listed}]\n  longitude: [{(west + 180) % 360 - 180}, {(east + 180) % 360 - 180}]\n"
        f"  latitude: [{ocean.lat - 1.0}, {ocean.lat + 1.0}]\n{extra}"
        + (f"parameters:\n{parameters}" if parameters else "")
    )


RUN = ["run", "bad.yaml", "-o", "out", "-q", "--no-map"]
ALL = ("uo", "vo", "ua", "va", "slope")
LIMITS = {"uo": 6e-3, "vo": 6e-3, "ua": 0.08, "va": 0.08, "depth": 12.0, "slope": 4e-8, "ice_thickness": 0.02}
"""How far a value may lie from the formula: interpolation in curved cells, packing, and the time that a step lasts."""


def differs(
    folder: Path,
    ocean: Ocean = PLAIN,
    names: Iterable[str] = ALL,
    *,
    slack: float = 1.0,
    wanted: dict[str, Any] | None = None,
) -> str:
    """Return what is wrong with the values that the berg of a run met, empty where all are those of the formula.

    ``wanted`` gives functions of longitude, latitude and date instead of the formula's, or numbers.
    """
    path = folder / "out" / "run.nc"
    if not path.exists():
        return "no run.nc"
    with xr.open_dataset(path) as run:
        lon, lat, moment = run["lon"].values[:, 0], run["lat"].values[:, 0], run["time"].values[0]
        found = {
            n: run[n].values[:, 0] for n in ("uo", "vo", "ua", "va", "depth", "slope_x", "slope_y", "ice_thickness")
        }
    wrong = []
    for name in names:
        given = (wanted or {}).get(name)
        if name == "slope":
            for got, want in zip((found["slope_x"], found["slope_y"]), given or ocean.slope(lat), strict=True):
                if not np.all(np.abs(got - want) <= slack * LIMITS["slope"]):
                    wrong.append(f"slope {got.mean():.3g} for {np.mean(want):.3g}")
            continue
        want = (
            given(lon, lat, moment)
            if callable(given)
            else given
            if given is not None
            else ocean(name, lon, lat, moment)
        )
        if not np.all(np.abs(found[name] - want) <= slack * LIMITS[name]):
            wrong.append(f"{name} {found[name].mean():.4g} for {np.mean(want):.4g}")
    return "; ".join(wrong)


def truth(
    ocean: Ocean = PLAIN,
    names: Iterable[str] = ALL,
    told: tuple[str, ...] = (),
    as_told: Callable[[Path, str], str] | None = None,
    *,
    slack: float = 1.0,
    doctor: bool = False,
    wanted: dict[str, Any] | None = None,
) -> Truth:
    """Return what is known of a run that these files drive; ``doctor`` asks the doctor too, who must agree."""
    names = tuple(names)

    def wrong(folder: Path, text: str) -> str:
        fault = differs(folder, ocean, names, slack=slack, wanted=wanted)
        return fault or (disagreement(folder) if doctor else "")

    return Truth(wrong, told, as_told)


def disagreement(folder: Path) -> str:
    """Return what the doctor says against a run that goes, empty if it agrees."""
    said = call(["doctor", "--for", "bad.yaml"])
    return "" if said.code == 0 else f"{APART}: the doctor says {said.text[-400:]}"


__all__ = [
    "ALL",
    "PLAIN",
    "RUN",
    "START",
    "Ocean",
    "axes",
    "dataset",
    "differs",
    "experiment",
    "field",
    "plain_files",
    "replace",
    "stamps",
    "store_as",
    "truth",
    "written_time",
]
