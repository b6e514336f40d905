"""Faults of people: magnitudes, dates, sections, outlines, tracks, and what they type."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from fuzz.base_files import EXPERIMENT, RING, copied, store
from fuzz.judging import NEVER, SOON, Kind, Truth
from fuzz.oceans import PLAIN, RUN

SHAPE = "rectangle: {length: 9 km, width: 6 km}"


def _text(
    family: str,
    name: str,
    text: str,
    truth: Truth | None = None,
    *,
    cause: tuple[str, ...] = (),
    impossible: bool = False,
    words: tuple[str, ...] = (),
    arguments: list[str] | None = None,
    files: dict[str, str | bytes] | None = None,
) -> Kind:
    def make(folder: Path) -> list[str]:
        (folder / "bad.yaml").write_text(text)
        for file, content in (files or {}).items():
            (folder / file).write_bytes(content if isinstance(content, bytes) else content.encode())
        return arguments or RUN

    return Kind(family, name, make, words or ("bad.yaml", "--"), impossible, truth, cause, seconds=SOON)


def replaced(*pairs: tuple[str, str]) -> str:
    """Return the good experiment with texts replaced, each of which stands in it."""
    text = EXPERIMENT
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    return text


SILENT = Truth(lambda folder, text: "no notice names it", ())


def _untold(*told: str) -> Truth:
    return Truth(lambda folder, text: "carried out without a word", told)


def magnitudes() -> Iterator[Kind]:
    """Give magnitudes without sense: a notice names the usual range, or an error."""
    f = "magnitudes"
    strength = "fracture: {normal_strength: 20 kPa}"
    for name, text, told in (
        ("thickness of 0.3 m", replaced(("thickness: 200", "thickness: 0.3")), "thick"), ("thickness of 3000 m", replaced(("thickness: 200", "thickness: 3000"), ("depth: 1000", "depth: 5000")), "thick"), ("strength of 18 Pa", replaced(("20 kPa", "18")), "strength"), ("strength of 18 GPa", replaced(("20 kPa", "18e9")), "strength"),
        ("modulus of 5 Pa", replaced((strength, "bonds: {youngs_modulus: 5}")), "modulus|youngs"), ("density of 85", replaced((strength, "ice: {density: 85}")), "density"), ("a current of 8 m/s", replaced(("current: [0.2, 0.0]", "current: [8.0, 0.0]")), "current"), ("a slope of 1 in 1000", replaced(("slope: [0, 0]", "slope: [0.001, 0]")), "slope"), ("sea ice of 60 m", replaced(("sea_ice: [0, 0, 0]", "sea_ice: [0, 0, 60]")), "ice"),
        ("half a day beside a tide", EXPERIMENT[: EXPERIMENT.index("  kind: formula")].replace("days: 0.0625", "days: 1").replace("output_every_hours: 0.5", "output_every_hours: 12") + "  kind: formula\n  tide: [{major: 0.2}]\nparameters:\n  stepping: {time_step: 0.5 d}\n", "step|tide"),
    ):  # fmt: skip
        yield _text(
            f,
            name,
            text,
            _untold(told),
            cause=(told,),
            words=("bad.yaml", "element", "parameters", "stepping", "thick", "berg"),
        )


def starts() -> Iterator[Kind]:
    """Give dates of the start in all sorts of forms: taken as what they say, or refused."""
    f = "dates of the start"

    def starting(date: str) -> Truth:
        def wrong(folder: Path, text: str) -> str:
            with xr.open_dataset(folder / "out" / "run.nc", decode_times=False) as run:
                since = str(run["time"].attrs["units"])
            return "" if date in since else f"starts {since} for {date}"

        return Truth(wrong)

    for name, given, meant in (
        ("zone before year 1", "'0001-01-01 00:00:00+05:00'", None), ("zone after year 9999", "'9999-12-31 23:30:00-05:00'", None), ("zone", "'2020-12-09 13:00:00+03:00'", "2020-12-09 10:00"), ("T and Z", "2020-12-09T13:00:00Z", "2020-12-09 13:00"), ("day first", "09.12.2020", None), ("day and month with strokes", "'09/12/2020'", None), ("month in letters", "'9 Dec 2020'", "2020-12-09"),
        ("seconds with fraction", "'2020-12-09 13:00:00.25'", "2020-12-09 13:00:00"), ("leap second", "'2016-12-31 23:59:60'", None), ("hour 24", "'2020-12-09 24:00'", "2020-12-10 00:00"),
    ):  # fmt: skip
        text = replaced(("start: 2020-12-09 13:00", f"start: {given}"))
        yield _text(
            f,
            name,
            text,
            starting(meant) if meant else Truth(lambda folder, text: "no such date"),
            cause=("date|start|year|day|hour|zone|second",),
        )


def sections() -> Iterator[Kind]:
    """Give a section where the documentation says "a section or a list of sections", and a file name for an outline."""
    f = "one section for a list, and a name for a section"
    head = EXPERIMENT[: EXPERIMENT.index("  kind: formula")]

    def went(folder: Path, text: str) -> str:
        return "" if (folder / "out" / "run.nc").exists() else "no run.nc"

    eddy = "{centre: [-39.0, -55.0], radius: 40 km, speed: 0.3}"
    parts = {
        "eddy": eddy, "tide": "{major: 0.1}", "jet": "{point: [-39.0, -55.5], towards: 90, speed: 0.3, width: 30 km}", "shear": "{point: [-39.0, -55.5], towards: 90, speed: 0.3, width: 30 km}", "turning_wind": "{speed: 8, towards: 90, turning: 5}",
        "seamount": "{centre: [-39.5, -55.0], height: 300, width: 10 km, depth: 1000}", "slope": "{point: [-39.0, -55.5], towards: 90, gradient: 0.001, depth: 1000}",
    }  # fmt: skip
    for part, values in parts.items():
        yield _text(f, part, f"{head}  kind: formula\n  {part}: {values}\n", Truth(went), cause=NEVER)
    from fuzz.base_files import CSV, GEOJSON, KML

    for file, content in (("ring.geojson", json.dumps(GEOJSON)), ("ring.kml", KML), ("ring.csv", CSV)):
        yield _text(
            f,
            f"outline: {file}",
            replaced((SHAPE, f"outline: {file}"), ("  placement: [-39.0, -55.5]\n", "")),
            Truth(went),
            cause=NEVER,
            files={file: content},
        )


def collected() -> Iterator[Kind]:
    """Give two mistakes in one file: both are named at once."""
    f = "two mistakes at once"
    faults = {
        "thickness": ("thickness: 200", "thickness: [1, 2]"), "radius": ("radius: 1500", "radius: -5"), "rotation": ("rotation: 10", "rotation: round"), "wind": ("wind: [5, 1]", "wind: [5]"), "depth": ("depth: 1000", "depth: -3"), "days": ("days: 0.0625", "days: long"), "output_every_hours": ("output_every_hours: 0.5", "output_every_hours: -1"), "length": ("length: 9 km", "length: 0"),
        "curent": ("current: [0.2, 0.0]", "curent: [0.2, 0.0]"), "normal_strength": ("20 kPa", "20 m"),
    }  # fmt: skip
    names = list(faults)
    for k, name in enumerate(names):
        other = names[(k + 3) % len(names)]

        def both(name: str = name, other: str = other) -> tuple[str, ...]:
            return (f"(?s){name}.*{other}|{other}.*{name}",)

        yield _text(f, f"{name} and {other}", replaced(faults[name], faults[other]), impossible=True, cause=both())


def patterns() -> Iterator[Kind]:
    """Give files and patterns that match nothing: the message names the folder where it looked."""
    f = "patterns of files that match nothing"
    head = EXPERIMENT[: EXPERIMENT.index("  kind: formula")]
    for listed, told in (
        ("[none_*.nc]", "none_"), ("[data/none.nc]", "data"), ("['~/none.nc']", "none.nc"), ("['$HOME/none.nc']", "none.nc"), ("[../none.nc]", "none.nc"), ("[none.NC]", "none.NC"), ("['none[1].nc']", "none"), ("['none?.nc', 'other.nc']", "none|other"), ("['**/none.nc']", "none"), ("[{file: none.nc, product: glorys}]", "none.nc"),
    ):  # fmt: skip
        text = f"{head}  kind: files\n  files: {listed}\n  longitude: [-40, -38]\n  latitude: [-56, -55]\n"

        def make(folder: Path, text: str = text) -> list[str]:
            (folder / "case").mkdir()
            (folder / "case" / "bad.yaml").write_text(text)
            return ["run", "case/bad.yaml", "-o", "out", "-q", "--no-map"]

        yield Kind(
            f, listed, make, ("bad.yaml", "none"), True, None, (f"(?s)case.*({told})|({told}).*case",), seconds=SOON
        )


def steps() -> Iterator[Kind]:
    """Give steps and lengths that cannot be: the answer is in the words of the key."""
    f = "steps and lengths that cannot be"
    cause = ("time_step|substeps|safety|days|every|landing|threads|step",)
    strength = "fracture: {normal_strength: 20 kPa}"
    for name, pair in {
        "a negative step": (strength, "stepping: {time_step: -30 min}"), "a step of nothing": (strength, "stepping: {time_step: 0 s}"), "a step of a month": (strength, "stepping: {time_step: 30 days}"), "a step longer than the run": (strength, "stepping: {time_step: 5 h}"), "a step that is no part of an hour": (strength, "stepping: {time_step: 1234.5}"), "minus two sub-steps": (strength, "stepping: {scheme: mts, substeps: -2}"),
        "half a sub-step": (strength, "stepping: {scheme: mts, substeps: 0.5}"), "a safety of 1.5": (strength, "stepping: {scheme: mts, safety: 1.5}"), "minus days": ("days: 0.0625", "days: -2"), "records between steps": ("output_every_hours: 0.5", "output_every_hours: 0.1"),
    }.items():  # fmt: skip
        went = Truth(lambda folder, text: "" if (folder / "out" / "run.nc").exists() else "no run.nc")
        yield _text(
            f,
            name,
            replaced(pair),
            went
            if name in ("a step longer than the run", "a step that is no part of an hour", "records between steps")
            else None,
            cause=cause,
            impossible=True,
            words=("bad.yaml", "stepping", "step", "--every"),
        )


def _ring(points: Any) -> str:
    return json.dumps(
        {
            "type": "FeatureCollection",
            "features": [
                {
                    "type": "Feature",
                    "properties": {"date": "2020-12-10"},
                    "geometry": {"type": "Polygon", "coordinates": [points]},
                }
            ],
        }
    )


def _area(folder: Path) -> float:
    """Return the area of the berg of a run, km2."""
    with xr.open_dataset(folder / "out" / "run.nc") as run:
        return float((run["length"] * run["width"]).sum()) / 1e6


def lattices() -> Iterator[Kind]:
    """Give outlines that a coarse lattice cannot hold: area and mass that are lost are told."""
    f = "area lost to the lattice"

    def told(want: float) -> Truth:
        def wrong(folder: Path, text: str) -> str:
            got = _area(folder)
            return "" if abs(got / want - 1.0) < 0.01 else f"{got:.1f} km2 for {want:.1f}"

        return Truth(wrong, ("area|mass|lattice|km2|shape",))

    for length, width, radius, rotation in (
        (9, 6, 1400, 0),
        (10, 7, 1500, 0),
        (9.5, 6.2, 1000, 0),
        (20, 3.5, 1500, 30),
        (7, 7, 2000, 45),
        (31, 12, 2500, 10),
    ):
        yield _text(
            f,
            f"{length} by {width} km in cells of {2 * radius} m",
            replaced(
                (SHAPE, f"rectangle: {{length: {length} km, width: {width} km}}"),
                ("radius: 1500", f"radius: {radius}"),
                ("rotation: 10", f"rotation: {rotation}"),
            ),
            told(length * width),
        )
    degree = np.deg2rad(1.0) * 6.371e3
    for name, sides, size in (
        ("a circle", 40, 6.0),
        ("a triangle", 3, 9.0),
        ("a hexagon", 6, 4.5),
        ("a sliver", 2, 9.0),
    ):
        turn = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
        x, y = (
            (size * np.cos(turn), size * np.sin(turn))
            if sides > 2
            else (np.array([-9.0, 9.0, 9.0, -9.0]), np.array([-1.6, -1.6, 1.6, 1.6]))
        )
        area = 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
        ring = [
            [-39.0 + a / (degree * np.cos(np.deg2rad(-55.5))), -55.5 + b / degree] for a, b in zip(x, y, strict=True)
        ]
        yield _text(
            f,
            name,
            replaced(
                (SHAPE, "outline: {file: ring.geojson}"),
                ("  placement: [-39.0, -55.5]\n", ""),
                ("  rotation: 10\n", ""),
            ),
            told(float(area)),
            files={"ring.geojson": _ring([*ring, ring[0]])},
        )


def outlines() -> Iterator[Kind]:
    """Give outlines in other orders, units and systems: the berg has the area and the place of the ring, or it is refused."""
    f = "outlines that mean something else"
    right = 25.2 * 22.24 * 1.0

    def here(folder: Path, text: str) -> str:
        with xr.open_dataset(folder / "out" / "run.nc") as run:
            lon, lat = float(run["lon"].values[:, 0].mean()), float(run["lat"].values[:, 0].mean())
        got = _area(folder)
        if abs(got / right - 1.0) > 0.08:
            return f"{got:.1f} km2 for {right:.1f}"
        return (
            ""
            if abs((lon + 219.0) % 360.0 - 180.0) < 0.05 and abs(lat + 55.5) < 0.05
            else f"lies at {lon:.2f}, {lat:.2f}"
        )

    def named(name: str, content: str | bytes, extra: str = "", cause: tuple[str, ...] = ()) -> Kind:
        file = {"C": "ring.csv", "G": "ring.geojson"}[name[0]]
        text = replaced(
            (SHAPE, f"outline: {{file: {file}{extra}}}"),
            ("  placement: [-39.0, -55.5]\n", ""),
            ("  rotation: 10\n", ""),
        )
        return _text(
            f,
            name[2:],
            text,
            Truth(here, ("outline|ring|area|lattice",)),
            cause=cause,
            files={file: content},
            words=(file, "bad.yaml", "berg"),
        )

    csv = [f"{x},{y}" for x, y in RING]
    yield named("G latitude first, beyond the pole", _ring([[y, x - 100.0] for x, y in RING]))
    yield named("G 0 to 360", _ring([[x + 360.0, y] for x, y in RING]), cause=NEVER)
    yield named(
        "G metres without a system",
        _ring([[-2.2e6 + 1e3 * k, 2.7e6 + 1e3 * m] for k, m in ((0, 0), (25, 0), (25, 22), (0, 22), (0, 0))]),
    )
    yield named("G heights as a third number", _ring([[x, y, 30.0] for x, y in RING]), cause=NEVER)
    yield named("G not closed", _ring(RING[:-1]))
    yield named("G radians", _ring([list(np.deg2rad(p)) for p in RING]))
    yield named(
        "C latitude first, as the heading says", "lat,lon\n" + "\n".join(f"{y},{x}" for x, y in RING), cause=NEVER
    )
    yield named("C decimal commas", "lon;lat\n" + "\n".join(line.replace(",", ";").replace(".", ",") for line in csv))
    yield named(
        "C byte order mark and tabs",
        ("\ufefflon\tlat\r\n" + "\r\n".join(line.replace(",", "\t") for line in csv)).encode(),
    )
    yield named("C degrees and letters", "lon,lat\n" + "\n".join(f"{-x}W,{-y}S" for x, y in RING))


def _positions() -> list[tuple[str, float, float]]:
    """Return dates and positions of the largest fragment of the good run, as it is scored."""
    with xr.open_dataset(store() / "run.nc") as run:
        moments = run["time"].values
        lon, lat = run["lon"].values, run["lat"].values
        mass = run["mass"].values if "mass" in run else np.ones(lon.shape[0])
    mass = mass if mass.ndim == 1 else mass[:, 0]
    made = []
    for k in range(0, moments.size, 2):
        made.append(
            (
                str(moments[k])[:16],
                float((lon[:, k] * mass).sum() / mass.sum()),
                float((lat[:, k] * mass).sum() / mass.sum()),
            )
        )
    return made


def tracks() -> Iterator[Kind]:
    """Give observed tracks in all forms: the distance from the run is that of the plain form, or they are refused."""
    f = "tracks for the score"

    def written(form: Callable[[str, float, float], str], head: str = "date,lat,lon") -> Callable[[], str]:
        return lambda: head + "\n" + "\n".join(form(*row) for row in _positions()) + "\n"

    plain = written(lambda d, x, y: f"{d},{y:.5f},{x:.5f}")

    def distance(folder: Path) -> list[float]:
        days = json.loads((folder / "scored" / "score.json").read_text())["days"]
        return [match["distance_km"] for day in days for match in day["matches"] if match["distance_km"] is not None]

    def same(folder: Path, text: str) -> str:
        from fuzz.judging import call

        (folder / "plain").mkdir()
        (folder / "plain" / "seen.csv").write_text(plain())
        call(["score", "run.nc", "plain/seen.csv", "--no-figure", "-o", "plain/scored"])
        got, want = distance(folder), distance(folder / "plain")
        near = len(got) == len(want) and np.allclose(got, want, atol=0.2)
        return "" if near else f"distances {np.round(got, 1)} km for {np.round(want, 1)}"

    for name, content in {
        "0 to 360": written(lambda d, x, y: f"{d},{y:.5f},{x + 360:.5f}"), "letters": written(lambda d, x, y: f"{d},{-y:.5f}S,{-x:.5f}W"), "longitude and latitude exchanged": written(lambda d, x, y: f"{d},{x + 360:.5f},{y:.5f}"), "decimal commas": written(lambda d, x, y: f"{d};{y:.5f};{x:.5f}".replace(".", ","), "date;lat;lon"), "day first": written(lambda d, x, y: f"{d[8:10]}/{d[5:7]}/{d[:4]} {d[11:]},{y:.5f},{x:.5f}"),
        "zone of +03:00": written(lambda d, x, y: f"{np.datetime64(d) + np.timedelta64(3, 'h')}+03:00,{y:.5f},{x:.5f}"), "day of the year": written(lambda d, x, y: f"{d[:4]}{(np.datetime64(d[:10]) - np.datetime64(d[:4] + '-01-01')).astype(int) + 1:03d}T{d[11:]},{y:.5f},{x:.5f}"), "degrees, minutes and seconds": written(lambda d, x, y: f"{d},{int(-y)}°{(-y % 1) * 60:.3f}'S,{int(-x)}°{(-x % 1) * 60:.3f}'W"), "backwards": lambda: "date,lat,lon\n" + "\n".join(reversed(plain().splitlines()[1:])) + "\n", "each line twice": lambda: "date,lat,lon\n" + "\n".join(line for row in plain().splitlines()[1:] for line in (row, row)) + "\n",
    }.items():  # fmt: skip

        def make(folder: Path, content: Callable[[], str] = content) -> list[str]:
            copied(folder, "run.nc")
            (folder / "seen.csv").write_text(content())
            return ["score", "run.nc", "seen.csv", "--no-figure", "-o", "scored"]

        yield Kind(
            f, name, make, ("seen.csv",), False, Truth(same, ("date|twice|position|longitude|latitude",)), seconds=SOON
        )


def large_tables() -> Iterator[Kind]:
    """Give tables and outlines of a million rows: scored in seconds, or refused."""
    f = "large tables"

    def of(
        name: str,
        content: Callable[[], str],
        command: Callable[[str], list[str]] = lambda n: ["score", "run.nc", n, "--no-figure", "-o", "scored"],
    ) -> Kind:
        file = {"geojson": "many.geojson", "outline": "ring.csv"}.get(name.split()[0], "many.csv")

        def make(folder: Path) -> list[str]:
            copied(folder, "run.nc")
            (folder / file).write_text(content())
            if "berg" in name:
                (folder / "bad.yaml").write_text(
                    replaced((SHAPE, f"outline: {{file: {file}}}"), ("  placement: [-39.0, -55.5]\n", ""))
                )
                return RUN
            return command(file)

        return Kind(f, name, make, (file,), False, seconds=SOON)

    def rows(count: int, form: Callable[[int], str], head: str = "date,lat,lon") -> Callable[[], str]:
        return lambda: head + "\n" + "\n".join(form(k) for k in range(count)) + "\n"

    def circle(count: int) -> Callable[[], str]:
        turn = np.linspace(0.0, 2.0 * np.pi, count)
        return lambda: (
            "lon,lat\n" + "\n".join(f"{-39 + 0.1 * np.cos(t):.7f},{-55.5 + 0.06 * np.sin(t):.7f}" for t in turn) + "\n"
        )

    day = lambda k: str(np.datetime64("2020-12-10T00:00") + np.timedelta64(k, "m"))  # noqa: E731
    yield of("a million positions by the minute", rows(1_000_000, lambda k: f"{day(k)},-55.0,-39.0"))
    yield of("a million positions of one day", rows(1_000_000, lambda k: "2020-12-10,-55.0,-39.0"))
    yield of("a million positions of other years", rows(1_000_000, lambda k: f"{1950 + k % 60}-12-10,-55.0,-39.0"))
    yield of("300,000 bergs", rows(300_000, lambda k: f"2020-12-10,-55.0,-39.0,B{k}", "date,lat,lon,berg"))
    yield of(
        "300,000 bergs far away", rows(300_000, lambda k: f"2020-12-10,65.0,{k % 360},B{k % 999}", "date,lat,lon,berg")
    )
    yield of(
        "corners of one outline, 300,000",
        rows(
            300_000,
            lambda k: f"2020-12-10,{k},{-55.5 + 0.1 * np.sin(k * 2e-5):.6f},{-39 + 0.2 * np.cos(k * 2e-5):.6f}",
            "date,vertex,lat,lon",
        ),
    )
    yield of(
        "20,000 small outlines",
        rows(
            80_000,
            lambda k: (
                f"2020-12-10,{k % 4},{-55.5 + 0.001 * (k % 4 > 1):.6f},{-39 + 0.001 * (k % 4 in (1, 2)) + 1e-4 * (k // 4 % 300):.6f},P{k // 4}"
            ),
            "date,vertex,lat,lon,berg",
        ),
    )
    yield of("outline of a berg of 300,000 corners", circle(300_000))
    yield of(
        "outline of a berg of 300,000 corners that cross",
        rows(300_000, lambda k: f"{-39 + 0.1 * np.cos(7.1 * k):.6f},{-55.5 + 0.05 * np.sin(11.3 * k):.6f}", "lon,lat"),
    )
    yield of("a row of a million columns", lambda: "date,lat,lon\n2020-12-10,-55,-39" + ",1" * 1_000_000 + "\n")


def typed() -> Iterator[Kind]:
    """Give values as people type them: taken as what they say, or refused in the words of the option."""
    f = "values as people type them"

    def lasts(hours: float) -> Truth:
        def wrong(folder: Path, text: str) -> str:
            with xr.open_dataset(folder / "out" / "run.nc") as run:
                got = float((run["time"].values[-1] - run["time"].values[0]) / np.timedelta64(3600, "s"))
            return "" if abs(got - hours) < 0.51 else f"lasts {got:g} h for {hours:g}"

        return Truth(wrong)

    def set_to(group: str, name: str, value: Any) -> Truth:
        def wrong(folder: Path, text: str) -> str:
            with xr.open_dataset(folder / "out" / "run.nc") as run:
                got = json.loads(run.attrs["parameters_json"])[group][name]
            return (
                ""
                if got == value or (isinstance(value, float) and abs(got / value - 1.0) < 1e-9)
                else f"{name} = {got} for {value}"
            )

        return Truth(wrong)

    run = ["run", "good.yaml", "-o", "out", "-q", "--no-map"]
    for name, extra, truth in (
        ("days with a comma", ["--days", "0,0625"], lasts(1.5)), ("days with a unit", ["--days", "90 min"], lasts(1.5)), ("days with a unit of days", ["--days", "0.0625d"], lasts(1.5)), ("strength in kPa", ["--set", "fracture.normal_strength=25 kPa"], set_to("fracture", "normal_strength", 25e3)), ("strength in kPa without a space", ["--set", "fracture.normal_strength=25kPa"], set_to("fracture", "normal_strength", 25e3)), ("a thousand with a line below", ["--set", "fracture.normal_strength=25_000"], set_to("fracture", "normal_strength", 25e3)),
        ("a thousand with a comma", ["--set", "fracture.normal_strength=25,000"], set_to("fracture", "normal_strength", 25e3)), ("spaces around the sign", ["--set", "fracture.normal_strength = 25 kPa"], set_to("fracture", "normal_strength", 25e3)), ("the same twice, the later counts", ["--set", "ice.density=900", "--set", "ice.density=880"], set_to("ice", "density", 880.0)), ("minutes of a step as m", ["--set", "stepping.time_step=30 m"], set_to("stepping", "time_step", 1800.0)),
    ):  # fmt: skip

        def make(folder: Path, extra: list[str] = extra) -> list[str]:
            copied(folder, "good.yaml")
            return [*run, *extra]

        yield Kind(
            f,
            name,
            make,
            ("--days", "--set", "normal_strength", "time_step", "density", "days"),
            False,
            truth,
            seconds=SOON,
        )


def switches() -> Iterator[Kind]:
    """Give switches that are accepted, documented and read by nobody: a switch that is on changes something, or is refused."""
    f = "switches that do nothing"
    head = EXPERIMENT[: EXPERIMENT.index("forcing:")]
    tide = "forcing:\n  kind: formula\n  eddy: [{centre: [-39.1, -55.6], radius: 20 km, speed: 0.5}]\n  slope: [{point: [-39.0, -55.5], towards: 45, gradient: 0.01, depth: 172}]\n"

    def changes(plain: str) -> Truth:
        def wrong(folder: Path, text: str) -> str:
            from fuzz.judging import call

            (folder / "plain.yaml").write_text(plain)
            call(["run", "plain.yaml", "-o", "plain", "-q", "--no-map"])
            with (
                xr.open_dataset(folder / "out" / "run.nc") as one,
                xr.open_dataset(folder / "plain" / "run.nc") as other,
            ):
                same = all(np.array_equal(one[n].values, other[n].values) for n in ("lon", "lat", "u", "depth"))
            return "the switch changes nothing" if same else ""

        return Truth(wrong, ("compatib|switch|effect|mirrored|parity|stream",))

    schemes = {
        "": "",
        " with mts": "  stepping: {scheme: mts}\n",
        " with verlet": "  stepping: {scheme: verlet}\n  bonds: {law: spring}\n",
    }
    for switch in ("mirrored_bilinear", "depth_even_parity", "stream_of_draws"):
        for label, scheme in schemes.items():
            plain = f"{head}{tide}parameters:\n{scheme}" if scheme else f"{head}{tide}"
            with_it = (plain if scheme else f"{plain}parameters:\n") + f"  compatibility: {{{switch}: true}}\n"
            yield _text(
                f,
                switch + label,
                with_it,
                changes(plain),
                words=("bad.yaml", switch, "stepping", "compatib", "scheme", "bonds"),
            )
    files = f"{head}{tide}parameters:\n  footloose: {{enabled: true}}\n  melt: {{enabled: true, temperature: 2 degC, salinity: 34}}\n"
    yield _text(
        f,
        "stream_of_draws with footloose",
        f"{files}  compatibility: {{stream_of_draws: true}}\n",
        changes(files),
        words=("bad.yaml", "stream_of_draws", "compatib", "footloose"),
    )


def quiet() -> Iterator[Kind]:
    """Ask commands to be quiet: they print some lines at most."""
    f = "quiet commands"
    from fuzz.kid_kinds import KID, write_case

    def few(folder: Path, text: str) -> str:
        lines = [line for line in text.splitlines() if line.strip()]
        return (
            ""
            if len(lines) <= 20 and max(map(len, lines), default=0) < 2000
            else f"{len(lines)} lines, of {max(map(len, lines))} letters at most"
        )

    def of(name: str, arguments: list[str], **case: Any) -> Kind:
        def make(folder: Path) -> list[str]:
            copied(folder, "good.yaml", "run.nc", *(("case",) if not case else ()))
            if case:
                write_case(folder / "case", **{k: v for k, v in case.items() if v})
            if arguments[0] == "kid":
                (folder / "out").mkdir()
            return arguments

        return Kind(f, name, make, (), False, Truth(few), NEVER, seconds=SOON)

    yield of("kid", KID)
    yield of("kid with hourly fields", KID, driver={"ibhrs": 3})
    yield of("kid with other entries", KID, ice={"save_short_traj": True, "verbose": True})
    yield of("kid with debugging", KID, ice={"debug": True, "really_debug": True})
    yield of("kid of six hours", KID, driver={"ibhrs": 6, "transient_a68_data_start_ind": 1})
    yield of("run", ["run", "good.yaml", "-o", "out", "-q", "--no-map"])
    yield of("run with forces", ["run", "good.yaml", "-o", "out", "-q", "--no-map", "--forces"])
    yield of("run with cells", ["run", "good.yaml", "-o", "out", "-q", "--no-map", "--cells", "0.5"])
    yield of("both numerics", ["run", "good.yaml", "-o", "out", "-q", "--no-map", "--set", "stepping.scheme=mts"])
    yield of("why", ["why", "run.nc", "-o", "out", "-q", "--no-figure"])


def observed() -> Iterator[Kind]:
    """Give observed outlines in other orders, units and systems: the areas are those of the ring, or they are refused."""
    f = "observed outlines for the score"
    right = 25.2 * 22.24

    def areas(folder: Path, text: str) -> str:
        days = json.loads((folder / "scored" / "score.json").read_text())["days"]
        got = [m["area_observed_km2"] for day in days for m in day["matches"] if m.get("area_observed_km2") is not None]
        if not got:
            return "no area was seen"
        return (
            ""
            if all(abs(area / right - 1.0) < 0.05 for area in got)
            else f"areas {np.round(got, 1)} for {right:.1f} km2"
        )

    def of(name: str, content: str | bytes, file: str = "seen.geojson", extra: list[str] | None = None) -> Kind:
        def make(folder: Path) -> list[str]:
            copied(folder, "run.nc")
            (folder / file).write_bytes(content if isinstance(content, bytes) else content.encode())
            return ["score", "run.nc", file, "--no-figure", "-o", "scored", *(extra or [])]

        return Kind(f, name, make, (file,), False, Truth(areas, ("outline|area|date|ring|piece",)), seconds=SOON)

    near = [[x + 0.2, y + 0.55] for x, y in RING]
    head = "date,vertex,lat,lon\n"
    yield of("latitude first, beyond the pole", _ring([[y, x + 360.0] for x, y in near]))
    yield of("0 to 360", _ring([[x + 360.0, y] for x, y in near]))
    yield of("clockwise", _ring(near[::-1]))
    yield of("not closed", _ring(near[:-1]))
    yield of("heights", _ring([[x, y, 3.0] for x, y in near]))
    yield of("dates of another kind", _ring(near).replace('"2020-12-10"', '"10/12/2020"'))
    yield of(
        "the same outline twice",
        json.dumps({"type": "FeatureCollection", "features": json.loads(_ring(near))["features"] * 2}),
    )
    yield of(
        "columns exchanged",
        head.replace("lat,lon", "lon,lat") + "".join(f"2020-12-10,{k},{x},{y}\n" for k, (x, y) in enumerate(near)),
        "seen.csv",
    )
    yield of(
        "corners out of order",
        head + "".join(f"2020-12-10,{k},{near[k][1]},{near[k][0]}\n" for k in (2, 0, 3, 1)),
        "seen.csv",
    )
    yield of(
        "decimal commas",
        "date;vertex;lat;lon\n"
        + "".join(f"2020-12-10;{k};{y:.4f};{x:.4f}\n".replace(".", ",") for k, (x, y) in enumerate(near)),
        "seen.csv",
    )


def words_for_numbers() -> Iterator[Kind]:
    """Give texts where numbers belong, in tables, drawings and maps."""
    f = "texts where numbers belong"
    degree = [f"{x},{y}" for x, y in RING]

    def geo(points: Any) -> str:
        return _ring(points)

    for name, file, content in (
        ("coordinates in quotes", "ring.geojson", geo([[str(x), str(y)] for x, y in RING])), ("coordinates of words", "ring.geojson", geo([["west", "south"], *RING[1:]])), ("null among them", "ring.geojson", geo([[None, None], *RING[1:]])), ("true among them", "ring.geojson", geo([[True, False], *RING[1:]])), ("lists too deep", "ring.geojson", geo([[[x, y]] for x, y in RING])), ("numbers of four digits alone", "ring.geojson", geo([x for p in RING for x in p])),
        ("n/a in a column", "ring.csv", "lon,lat\n" + "\n".join([*degree[:2], "n/a,n/a", *degree[2:]])), ("a unit in the cells", "ring.csv", "lon,lat\n" + "\n".join(f"{x} deg,{y} deg" for x, y in RING)), ("a second heading", "ring.csv", "lon,lat\n" + "\n".join([*degree[:2], "lon,lat", *degree[2:]])), ("a row too short", "ring.csv", "lon,lat\n" + "\n".join([*degree[:2], "-39.0", *degree[2:]])),
    ):  # fmt: skip
        went = Truth(lambda folder, text: "" if (folder / "out" / "run.nc").exists() else "no run.nc")
        text = replaced((SHAPE, f"outline: {{file: {file}}}"), ("  placement: [-39.0, -55.5]\n", ""))
        yield _text(
            f,
            name,
            text,
            went if name in ("coordinates in quotes", "a unit in the cells") else None,
            files={file: content},
            words=(file,),
            impossible=True,
        )


FAMILIES: tuple[Callable[[], Iterator[Kind]], ...] = (
    magnitudes, starts, sections, collected, patterns, steps, lattices, outlines, tracks, large_tables, typed, switches, quiet, observed, words_for_numbers,
)  # fmt: skip
"""All families of this module."""

assert PLAIN
