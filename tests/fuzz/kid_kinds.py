"""Faults of KID's directories: hourly fields, grids, namelists, restarts. What goes through ends where the good case ends."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import netCDF4
import numpy as np

from experiments.paper_files import GRID_FILE, OCEAN_FILE, SEA_LEVEL_FILE, WIND_FILE
from fuzz.base_files import bond_variables, copied, identified
from fuzz.judging import NEVER, SOON, Kind, Truth, call
from kid.conftest import namelist_text, restart_variables, write_nc

KID = ["kid", "case", "-o", "out", "-q"]
NJ, NI, HOURS = 16, 20, 8
DRIVER = {"a68_test": True, "ibdt": 1800.0, "ibhrs": 3, "transient_a68_data_start_ind": 2, "data_dir": "./data/"}
ICE = {
    "grid_is_latlon": True,
    "Lx": 360.0,
    "A68_test": True,
    "A68_xdisp": 0.0,
    "A68_ydisp": 0.0,
    "tau_is_velocity": True,
    "mts_sub_steps": 60,
}
FILES = {OCEAN_FILE: ("uo", "vo"), WIND_FILE: ("ua", "va"), SEA_LEVEL_FILE: ("SSH",)}


def grid_axes() -> tuple[Any, Any]:
    """Return the corners of the grid, degrees."""
    return np.meshgrid(-41.0 + 0.125 * np.arange(NI), -60.5 + 0.125 * np.arange(NJ))


def hourly() -> dict[str, Any]:
    """Return the fields of the hours."""
    lon, lat = grid_axes()
    hour = np.arange(HOURS)[:, None, None]
    x, y = lon + 39.8, lat + 59.5
    return {
        "uo": 0.3 + 0.05 * x + 0.02 * y + 0.01 * hour, "vo": -0.1 + 0.03 * x - 0.04 * y + 0.0 * hour, "ua": 6.0 + 0.5 * x + 0.1 * hour + 0.0 * y, "va": -3.0 + 0.4 * y + 0.0 * hour + 0.0 * x, "SSH": 0.5 + 0.1 * x + 0.05 * y + 0.01 * hour,
    }  # fmt: skip


def bergs() -> dict[str, Any]:
    """Return a restart of three bonded elements in the middle of the grid."""
    made = restart_variables(3)
    made["lon"] = 320.2 + np.arange(3) * 3000.0 / (np.deg2rad(1.0) * 6.378e6 * np.cos(np.deg2rad(59.5)))
    made["lat"] = np.full(3, -59.5)
    made["width"], made["length"] = np.full(3, 3000.0), np.full(3, 3000.0)
    made["mass"] = np.full(3, 850.0 * 200.0 * 3000.0**2)
    return made


def write_case(folder: Path, *, fields: dict[str, Any] | None = None, grid: tuple[Any, Any] | None = None, driver: dict[str, Any] | None = None, ice: dict[str, Any] | None = None, restart: dict[str, Any] | None = None, attributes: dict[str, dict[str, Any]] | None = None, dims: tuple[str, ...] = ("time", "lat", "lon"), extra: dict[str, Any] | None = None, kind: str = "f8") -> None:  # fmt: skip
    """Write a directory of KID with hourly fields."""
    folder.mkdir(parents=True)
    (folder / "data").mkdir()
    fields = fields or hourly()
    lon, lat = grid or grid_axes()
    with netCDF4.Dataset(folder / "data" / GRID_FILE, "w") as file:
        for name, size in zip(("lat", "lon"), lon.shape, strict=True):
            file.createDimension(name, size)
        for name, values in (("longitude", lon), ("latitude", lat)):
            variable = file.createVariable(name, "f8", ("lat", "lon"))
            variable.setncatts((attributes or {}).get(name, {}))
            variable[:] = values
    for path, names in FILES.items():
        with netCDF4.Dataset(folder / "data" / path, "w") as file:
            for name, size in zip(dims, fields[names[0]].shape, strict=True):
                file.createDimension(name, size)
            for name, (own, values, told) in (extra or {}).items():
                variable = file.createVariable(name, "f8", own)
                variable.setncatts(told)
                variable[:] = values
            for name in names:
                told = dict((attributes or {}).get(name, {}))
                variable = file.createVariable(name, kind, dims, fill_value=told.pop("_FillValue", None))
                variable.set_auto_maskandscale(False)
                variable.setncatts(told)
                variable[:] = fields[name]
    (folder / "input.nml").write_text(namelist_text({**DRIVER, **(driver or {})}, {**ICE, **(ice or {})}))
    write_nc(folder / "INPUT" / "icebergs.res.nc", restart or bergs())


def ends(folder: Path) -> dict[str, Any]:
    """Return the last positions and velocities in the restart that a run of KID writes."""
    for path in sorted(folder.rglob("*.nc"), key=lambda p: ("bond" in p.name, "res" not in p.name)):
        with netCDF4.Dataset(path) as file:
            if {"lon", "lat", "uvel"} <= set(file.variables):
                return {n: np.ma.filled(file[n][:], np.nan)[-3:] for n in ("lon", "lat", "uvel", "vvel")}
    return {}


@cache
def good_ends() -> dict[str, Any]:
    """Return where the good case ends."""
    import os

    folder, here = Path(mkdtemp(prefix="riftberg-kid-")), Path.cwd()
    write_case(folder / "case")
    (folder / "out").mkdir()
    os.chdir(folder)
    try:
        result = call(KID, 600.0)
        assert result.code == 0, (result.text, result.error)
        return ends(folder / "out")
    finally:
        os.chdir(here)
        shutil.rmtree(folder)


def same_end(folder: Path, text: str) -> str:
    """Return how a run of KID ends elsewhere than the good one, empty where it does not."""
    want, got = good_ends(), ends(folder / "out")
    if not got:
        return "no restart was written"
    for name, near in (("lon", 1e-6), ("lat", 1e-6), ("uvel", 1e-4), ("vvel", 1e-4)):
        if got[name].shape != want[name].shape or not np.all(np.abs(got[name] - want[name]) <= near):
            return f"{name} {got[name]} for {want[name]}"
    return ""


def case(family: str, name: str, change: Callable[[], dict[str, Any]], *, cause: tuple[str, ...] = (), told: tuple[str, ...] = (), never: bool = False, words: tuple[str, ...] = (), touch: Callable[[Path], None] | None = None, seconds: float = SOON) -> Kind:  # fmt: skip
    """Return a kind: the good case with a change; ``change`` returns arguments of `write_case`."""

    def make(folder: Path) -> list[str]:
        write_case(folder / "case", **change())
        if touch:
            touch(folder / "case")
        (folder / "out").mkdir()
        return KID

    wrong = (lambda folder, text: "nothing that comes of this can be right") if never else same_end
    return Kind(family, name, make, (*words, "hourly", "HOURLY", "grid", "input.nml", "icebergs.res.nc", "bonds_iceberg", "calving"), False, Truth(wrong, told), cause, seconds=seconds)  # fmt: skip


def _with(names: tuple[str, ...], change: Callable[[Any], Any]) -> Callable[[], dict[str, Any]]:
    def made() -> dict[str, Any]:
        fields = hourly()
        for name in names:
            fields[name] = change(fields[name].copy())
        return {"fields": fields}

    return made


def _put(value: float, where: Any) -> Callable[[Any], Any]:
    def change(values: Any) -> Any:
        values[where] = value
        return values

    return change


BERG = (slice(None), slice(6, 10), slice(7, 13))
CURRENT, WIND, SEA = ("uo", "vo"), ("ua", "va"), ("SSH",)


def hourly_gaps() -> Iterator[Kind]:
    """Give hourly fields with gaps that nothing declares: they are no still water."""
    f = "gaps in KID's hourly fields"
    for name, names, where in (
        ("currents all", CURRENT, ...), ("currents around the berg", CURRENT, BERG), ("one component", ("vo",), ...), ("sea level all", SEA, ...), ("sea level around the berg", SEA, BERG), ("wind all", WIND, ...), ("wind, one component around the berg", ("ua",), BERG),
        ("currents, one hour of the run", CURRENT, 3), ("sea level, the last hour of the run", SEA, 4), ("currents far from the berg", CURRENT, (slice(None), slice(0, 2), slice(0, 2))),
    ):  # fmt: skip
        yield case(
            f,
            name,
            _with(names, _put(np.nan, where)),
            told=("missing|gap|NaN|still",),
            cause=("NaN|not a number|missing|finite|value|gap",),
        )


def hourly_numbers() -> Iterator[Kind]:
    """Give infinite numbers and undeclared fill values in hourly fields."""
    f = "numbers that are none in KID's hourly fields"
    for name, names, value, where in (
        ("inf in currents", CURRENT, np.inf, BERG), ("inf in the sea level", SEA, np.inf, BERG), ("-inf in the wind", WIND, -np.inf, BERG), ("1e20 in currents", CURRENT, 1e20, BERG), ("1e20 in the wind", WIND, 1e20, ...), ("9.97e36 in the sea level", SEA, 9.969209968386869e36, BERG), ("-9999 in currents", CURRENT, -9999.0, BERG), ("-999 in the sea level", SEA, -999.0, ...), ("1e15 in one hour", CURRENT, 1e15, (3, *BERG[1:])), ("32767 in the wind", WIND, 32767.0, BERG),
    ):  # fmt: skip
        yield case(
            f,
            name,
            _with(names, _put(value, where)),
            never=True,
            cause=("finite|inf|beyond|believ|fill|missing|m s-1|m/s",),
        )


def hourly_units() -> Iterator[Kind]:
    """Give hourly fields in other units: no sea and no wind is so fast."""
    f = "units of KID's hourly fields"
    for name, names, factor, told in (
        ("currents in cm/s", CURRENT, 100.0, None), ("currents in cm/s, as they say", CURRENT, 100.0, "cm s-1"), ("one component in cm/s", ("uo",), 100.0, None), ("currents in mm/s", CURRENT, 1000.0, None), ("wind in cm/s", WIND, 100.0, None), ("wind in km/h of a storm", WIND, 36.0, None), ("sea level in cm", SEA, 100.0, None), ("sea level in mm", SEA, 1000.0, None), ("sea level in cm, as it says", SEA, 100.0, "cm"), ("currents in km/h, as they say", CURRENT, 3.6, "km/h"),
    ):  # fmt: skip

        def change(names: tuple[str, ...] = names, factor: float = factor, told: str | None = told) -> dict[str, Any]:
            made = _with(names, lambda v: v * factor)()
            return {**made, "attributes": {n: {"units": told} for n in names}} if told else made

        yield case(f, name, change, told=("unit",), cause=("beyond|believ|unit|m s-1|m/s",))


def grid_corners() -> Iterator[Kind]:
    """Give corners that rise the wrong way, stand out of order, or are in other units."""
    f = "corners of KID's grid"
    lon, lat = grid_axes()
    order = np.random.default_rng(1).permutation(NJ)
    one = lat.copy()
    one[7] = lat[8]
    for name, made in (
        ("latitude reversed", (lon, lat[::-1])), ("longitude reversed", (lon[:, ::-1], lat)), ("latitude shuffled", (lon, lat[order])), ("latitude with NaN", (lon, np.where((np.arange(NJ) == 3)[:, None], np.nan, lat))), ("radians", (np.deg2rad(lon), np.deg2rad(lat))), ("latitude and longitude exchanged", (lat, lon)), ("a row twice", (lon, one)),
        ("all the same", (np.zeros_like(lon), np.zeros_like(lat))), ("transposed", (lon.T.copy(), lat.T.copy())), ("beyond the pole", (lon, lat - 35.0)),
    ):  # fmt: skip
        yield case(
            f,
            name,
            lambda made=made: {"grid": made},
            cause=("corner|latitude|longitude|rise|grid|finite|order|area|shape|lon|lat",),
            never=True,
        )  # type: ignore[misc]


def hourly_axes() -> Iterator[Kind]:
    """Give hourly fields whose rows, dates or sizes are not those of the grid."""
    f = "axes of KID's hourly fields"
    lon, lat = grid_axes()
    rows, columns = lat[:, 0], lon[0]
    hours = np.arange(HOURS) * 1.0

    def rows_of(values: Any, flip: bool = False, name: str = "lat", **told: Any) -> Callable[[], dict[str, Any]]:
        def made() -> dict[str, Any]:
            fields = hourly()
            return {
                "fields": {k: v[:, ::-1] if flip else v for k, v in fields.items()},
                "extra": {
                    name: (
                        ("lat",) if len(values) == NJ else ("lon",) if len(values) == NI else ("time",),
                        values,
                        told,
                    )
                },
            }

        return made

    cause = ("latitude|longitude|lat|lon|rows|grid|shape|time|hour|date|record|order|corner",)
    north, east = {"units": "degrees_north"}, {"units": "degrees_east"}
    for name, change, never in (
        ("rows from the north, as they say", rows_of(rows[::-1], True, **north), False), ("rows of another domain", rows_of(rows + 5.0, **north), True), ("columns of another domain", rows_of(columns + 10.0, name="lon", **east), True), ("columns reversed, as they say", lambda: {"fields": {k: v[..., ::-1] for k, v in hourly().items()}, "extra": {"lon": (("lon",), columns[::-1], east)}}, False), ("half a cell aside", rows_of(rows + 0.0625, **north), False),
        ("every second hour", rows_of(2 * hours, name="time", units="hours since 2020-12-01"), True), ("hours backwards", rows_of(hours[::-1], name="time", units="hours since 2020-12-01"), True), ("time last", lambda: {"fields": {k: v.transpose(1, 2, 0) for k, v in hourly().items()}, "dims": ("lat", "lon", "time")}, False), ("columns before rows", lambda: {"fields": {k: v.transpose(0, 2, 1) for k, v in hourly().items()}, "dims": ("time", "lon", "lat")}, False), ("one hour too few", lambda: {"fields": {k: v[:4] for k, v in hourly().items()}}, False),
    ):  # fmt: skip
        yield case(f, name, change, never=never, cause=cause, told=("row|order|grid|latitude|cell|position|hour",))


def fast_bergs() -> Iterator[Kind]:
    """Give speeds that no ice has: they end a run, with element, date and force."""
    f = "speeds in KID"

    def start(**values: float) -> Callable[[], dict[str, Any]]:
        def made() -> dict[str, Any]:
            restart = bergs()
            for name, value in values.items():
                restart[name] = np.full(3, value)
            return {"restart": restart}

        return made

    def schemes(**ice: Any) -> Callable[[], dict[str, Any]]:
        return lambda: {**_with(CURRENT, lambda v: v * 100.0)(), "ice": ice}

    cause = ("m s-1|m/s|fast|speed|velocity|beyond|believ|uvel|vvel|SSH = .* the most is",)
    for name, change in {
        "uvel of 50": start(uvel=50.0), "vvel of -120": start(vvel=-120.0), "uvel of 999": start(uvel=999.0), "uvel of 1e5": start(uvel=1e5), "a current of 30 with Verlet": schemes(mts=False), "a current of 30 with Runge-Kutta": schemes(mts=False, Runge_not_Verlet=True, iceberg_bonds_on=False, dem=False), "a current of 30 with sub-steps": schemes(), "a current of 30 on springs": schemes(dem=False),
        "a wind of 300": _with(WIND, lambda v: v * 50.0), "a slope of metres a cell": _with(SEA, lambda v: v * 200.0),
    }.items():  # fmt: skip
        yield case(f, name, change, never=True, cause=cause, seconds=240.0 if "current" in name else SOON)


def namelist_texts() -> Iterator[Kind]:
    """Give namelists that say something else than their author thinks."""
    f = "texts of namelists"

    def edited(change: Callable[[str], str]) -> Callable[[Path], None]:
        return lambda folder: (folder / "input.nml").write_text(change((folder / "input.nml").read_text())) and None  # type: ignore[func-returns-value]

    def line(group: str, text: str) -> Callable[[str], str]:
        return lambda s: s.replace(f"&{group}\n", f"&{group}\n  {text}\n")

    ice, drv = "icebergs_nml", "icebergs_driver_nml"
    said = ("input.nml|twice|group|unknown|entry|line|default|no such|ignored",)
    for name, change, more in (
        ("100,000 unknown entries", line(ice, "\n  ".join(f"unknown_{k} = {k}" for k in range(100_000))), {}), ("an entry twice, the later one counts", line(ice, "mts_sub_steps = 30"), {}), ("a group twice", lambda s: s + "&icebergs_nml\n  rho_bergs = 800.\n/\n", {}), ("entry of the other group", line(drv, "rho_bergs = 700."), {}), ("density in g/cm3", line(ice, "rho_bergs = 0.85"), {"never": True}), ("exponent by d", lambda s: s.replace("ibdt = 1800.0", "ibdt = 1.8d3"), {}),
        ("comment behind a value", lambda s: s.replace("ibdt = 1800.0", "ibdt = 1800.0 ! seconds"), {}), ("logical as T", lambda s: s.replace("grid_is_latlon = .true.", "grid_is_latlon = T"), {}), ("decimal comma", lambda s: s.replace("ibdt = 1800.0", "ibdt = 1800,5"), {}), ("Windows line ends and a BOM", lambda s: "\ufeff" + s.replace("\n", "\r\n"), {}),
    ):  # fmt: skip
        yield case(f, name, dict, touch=edited(change), told=said, **more)


def restart_meanings() -> Iterator[Kind]:
    """Give restarts whose numbers mean something else."""
    f = "meaning of KID's restarts"

    def changed(change: Callable[[dict[str, Any]], Any]) -> Callable[[], dict[str, Any]]:
        def made() -> dict[str, Any]:
            restart = bergs()
            change(restart)
            return {"restart": restart}

        return made

    def exchanged(r: dict[str, Any]) -> None:
        r["lon"], r["lat"] = r["lat"], r["lon"]

    for name, change in {
        "longitude and latitude exchanged": exchanged, "thickness in cm": lambda r: r.update(thickness=r["thickness"] * 100.0), "thickness in km": lambda r: r.update(thickness=r["thickness"] / 1000.0), "mass in tonnes": lambda r: r.update(mass=r["mass"] / 1000.0), "mass in Gt": lambda r: r.update(mass=r["mass"] / 1e12), "length in km": lambda r: r.update(length=r["length"] / 1000.0, width=r["width"] / 1000.0),
        "mass that thickness and area do not give": lambda r: r.update(mass=r["mass"] * 5.0), "negative width": lambda r: r.update(width=-r["width"]), "radians": lambda r: r.update(lon=np.deg2rad(r["lon"]), lat=np.deg2rad(r["lat"])), "no scaling": lambda r: r.update(mass_scaling=np.zeros(3)),
    }.items():  # fmt: skip
        yield case(
            f, name, changed(change), never=True, told=("thickness|mass|length|width|usual|lon|lat|scaling|size|area",)
        )


def bond_meanings() -> Iterator[Kind]:
    """Give bond restarts that contradict the elements."""
    f = "meaning of KID's bonds"

    def changed(change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], list[str]]:
        def make(folder: Path) -> list[str]:
            copied(folder, "case")
            (folder / "out").mkdir()
            values = bond_variables()
            change(values)
            write_nc(folder / "case" / "INPUT" / "bonds_iceberg.res.nc", values)
            write_nc(
                folder / "case" / "INPUT" / "icebergs.res.nc", identified(restart_variables(3)), drop=("iceberg_num",)
            )
            return KID

        return make

    def of(name: str, index: int, value: Any) -> Callable[[dict[str, Any]], Any]:
        def change(values: dict[str, Any]) -> None:
            values[name] = values[name].copy()
            values[name][index] = value

        return change

    for name, change in {
        "to itself": of("other_id_cnt", 0, 1), "to nobody": of("other_id_cnt", 0, 99), "of nobody": of("first_id_cnt", 0, 99), "to another rank's element": of("other_id_ij", 0, 8), "negative identifier": of("first_id_cnt", 0, -1), "broken of 7": of("broken", 0, 7), "broken of -1": of("broken", 1, -1), "stress of NaN": of("nstress", 0, np.nan), "stress of 1e30": of("sstress", 0, 1e30), "one side alone": lambda v: v.update({k: x[:3] for k, x in v.items()}),
    }.items():  # fmt: skip
        yield Kind(f, name, changed(change), ("bond", "id_cnt"), name != "one side alone", seconds=SOON)


def calving_files() -> Iterator[Kind]:
    """Give calving restarts of other shapes and with impossible ice."""
    f = "calving restarts of KID"

    def stored(
        shape: tuple[int, ...],
        value: float = 1e6,
        *,
        name: str = "stored_ice",
        kind: str = "f8",
        counter: Any = 0,
        drop: tuple[str, ...] = (),
    ) -> Callable[[Path], list[str]]:
        def make(folder: Path) -> list[str]:
            copied(folder, "case")
            (folder / "out").mkdir()
            with netCDF4.Dataset(folder / "case" / "INPUT" / "calving.res.nc", "w") as file:
                names = [f"axis_{k}" for k in range(len(shape))]
                for axis, size in zip(names, shape, strict=True):
                    file.createDimension(axis, size)
                for own, values, dims in (
                    (name, value, names),
                    ("stored_heat", 0.0, names[-2:] if len(shape) > 1 else names),
                    ("iceberg_counter_grd", counter, names[-2:] if len(shape) > 1 else names),
                ):
                    if own not in drop:
                        file.createVariable(
                            own,
                            "S1"
                            if kind == "S1" and own == name
                            else ("i4" if own == "iceberg_counter_grd" and not isinstance(values, float) else "f8"),
                            dims,
                        )[...] = b"x" if kind == "S1" and own == name else values
            return KID

        return make

    whole = (10, 20, 20)
    for name, make in {
        "one dimension": stored((20,)), "three classes": stored((3, 20, 20)), "another grid": stored((10, 5, 6)), "transposed": stored((20, 20, 10)), "NaN": stored(whole, np.nan), "negative ice": stored(whole, -1e9), "1e36": stored(whole, 1e36), "text": stored(whole, kind="S1"), "counter below zero": stored(whole, counter=-5), "no ice in it": stored(whole, drop=("stored_ice",)),
    }.items():  # fmt: skip
        yield Kind(f, name, make, ("calving",), False, cause=("calving|stored|counter",), seconds=SOON)


FAMILIES: tuple[Callable[[], Iterator[Kind]], ...] = (
    hourly_gaps, hourly_numbers, hourly_units, grid_corners, hourly_axes, fast_bergs, namelist_texts, restart_meanings, bond_meanings, calving_files,
)  # fmt: skip
"""All families of this module."""

assert NEVER
