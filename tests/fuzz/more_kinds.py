"""More kinds: whatever keys and parameters there are, fields of forcing, GeoTIFF, calls of the command line, more mutations.

The keys of experiment files and the parameters are taken from the code itself, so that a new one is tried at once.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args

import numpy as np
import yaml

from fuzz.base_files import EXPERIMENT, KML, RING, TRACK, changed_nc, copied, store, summary
from fuzz.judging import Kind, flipped
from keys import SECTIONS, TOP, keys
from keys import Path as KeyPath
from riftberg.parameters import fields_by_path

RUN = ["run", "bad.yaml", "-o", "out", "-q", "--no-map"]
WRONG: dict[str, Any] = {
    "NaN": float("nan"), "infinite": float("inf"), "-1": -1, "0": 0, "1e30": 1e30, "1e-300": 1e-300, "true": True, "nothing": None, "word": "nonsense",
    "empty": "", "list": [], "list of lists": [[1, [2]]], "mapping": {"a": {"b": [1]}}, "date": "2020-02-31", "control": "a\u0007b", "path up": "../../x",
    "device": "/dev/zero", "a long word": "w" * 3000, "many": [1] * 2000, "pair of words": ["a", "b"], "huge integer": 10**60, "percent": "5 %",
}  # fmt: skip


def from_bounds(west: float, south: float, east: float, north: float, width: int, height: int) -> Any:
    """Return the transform of a raster; that of rasterio warns of its own product of matrices."""
    from affine import Affine

    return Affine((east - west) / width, 0.0, west, 0.0, (south - north) / height, north)


def more(seeds: int) -> Iterator[Kind]:
    """Give all kinds of this module; ``seeds`` of each random sort."""
    for family in (schema_values, parameter_values, forcing_variables, forcing_attributes, rasters, calls):
        yield from family()
    yield from mutated(seeds)


# --- every key and every parameter ---------------------------------------------------------------------------------------


SHAPES: dict[str, dict[str, Any]] = {
    "rectangle": {"length": 9000, "width": 6000}, "lattice": {"rows": [[0, 0, 3], [1, 0, 3]]}, "outline": {"file": "good.kml"},
    "mask": {"file": "mask.nc"},
}  # fmt: skip
KINDS: dict[str, dict[str, Any]] = {
    "experiment": {},
    "files": {
        "files": ["ocean.nc"],
        "longitude": [-40, -38],
        "latitude": [-56.5, -54.5],
        "sea_level": "none",
        "wind": "none",
    },
}


def _placed(path: KeyPath, section: type | None, name: str, value: Any) -> dict[str, Any] | None:
    """Return an experiment with a value at a key of a section; None where the section has no place there."""
    made: dict[str, Any] = yaml.safe_load(EXPERIMENT)
    berg = made["berg"]
    if section is None:
        made[name] = value
    elif path == ("berg",):
        berg[name] = value
    elif path[:1] == ("berg",) and path[1] in SHAPES:
        del berg["rectangle"]
        berg[path[1]] = {**SHAPES[path[1]], name: value}
    elif path == ("berg", "rifts"):
        berg["rifts"] = [{"points": [[-39.1, -55.5], [-38.9, -55.5]], name: value}]
    elif path == ("berg", "strength"):
        berg["strength"] = {"weibull": 5, name: value}
    elif path == ("forcing",) and (kind := get_args(keys(section)["kind"].annotation)[0]) in KINDS:
        made["forcing"] = {"kind": kind, **KINDS[kind], name: value}
    else:
        return None
    return made


def schema_values() -> Iterator[Kind]:
    """Give a wrong value of every kind at every key that an experiment file knows."""
    sections: list[tuple[KeyPath, type | None]] = [((), None), *((path, section) for section, path in SECTIONS.items())]
    for path, section in sections:
        for name in TOP if section is None else keys(section):
            for what, value in WRONG.items():
                if path == ("berg",) and name in SHAPES:
                    continue
                made = _placed(path, section, name, value)
                if made is None:
                    continue

                def make(folder: Path, made: dict[str, Any] = made) -> list[str]:
                    copied(folder, "ocean.nc", "mask.nc")
                    (folder / "good.kml").write_text(KML)
                    (folder / "bad.yaml").write_text(yaml.safe_dump(made, allow_unicode=True))
                    return RUN

                yield Kind(
                    f"key of {section.__name__ if section else 'Experiment'}", f"{name}: {what}", make, (), False
                )


def parameter_values() -> Iterator[Kind]:
    """Give wrong values of every parameter on the command line."""
    wrongs = ("nan", "-1", "0", "1e30", "1e-300", "true", "nonsense", "", "[1, 2]", "5 furlong", "1e400")
    for path in fields_by_path():
        group, _, name = path.partition(".")
        for wrong in wrongs:

            def make(folder: Path, setting: str = f"{path}={wrong}") -> list[str]:
                copied(folder, "good.yaml")
                return ["run", "good.yaml", "-o", "out", "-q", "--no-map", "--set", setting]

            yield Kind(f"parameter of {group}", f"{name} = {wrong!r}", make, (), False)


# --- fields of forcing ---------------------------------------------------------------------------------------------------

FORCED = EXPERIMENT[: EXPERIMENT.index("  kind: formula")] + (
    "  kind: files\n  files: [bad.nc]\n  longitude: [-40, -38]\n  latitude: [-56.5, -54.5]\n  sea_level: none\n  wind: none\n"
)
SEEN_BY_ALL = ("bad.nc", "uo", "vo", "lat", "lon", "time", "cf")


def _forced(change: Callable[..., Any], *, doctor: bool = False) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        copied(folder, "ocean.nc")
        changed_nc(folder / "ocean.nc", change)
        (folder / "ocean.nc").rename(folder / "bad.nc")
        (folder / "bad.yaml").write_text(FORCED)
        return ["doctor", "bad.nc"] if doctor else RUN

    return make


def forcing_variables() -> Iterator[Kind]:
    """Give impossible values, types, shapes and sizes of the variables of a file of currents, to a run and to the doctor."""

    def change_of(name: str, what: str) -> Callable[..., Any]:
        def change(table: dict[str, Any], sizes: dict[str, int], attributes: dict[str, Any]) -> None:
            dtype, dims, values, own = table[name]
            numbers = {"NaN": np.nan, "1e36": 1e36, "inf": np.inf, "-1e36": -1e36, "1e5": 1e5}
            if what == "dropped":
                del table[name]
            elif what == "char":
                table[name] = ["S1", dims, np.full(values.shape, b"x"), {}]
            elif what == "scalar":
                table[name] = [dtype, (), values.ravel()[0], own]
            elif what == "swapped":
                table[name] = [dtype, dims[::-1], np.ascontiguousarray(values.T), own]
            elif what == "all equal":
                table[name][2] = np.full_like(values, values.ravel()[0])
            elif what == "one NaN":
                values.ravel()[values.size // 2] = np.nan
            else:
                table[name][2] = np.full(values.shape, numbers[what])

        return change

    for name in ("uo", "vo", "lat", "lon", "time"):
        for what in (
            "dropped",
            "NaN",
            "1e36",
            "inf",
            "-1e36",
            "1e5",
            "char",
            "scalar",
            "swapped",
            "all equal",
            "one NaN",
        ):
            # One missing value in the water is a gap that is bridged or refused by its place; axes of one dim swap into themselves.
            possible = (what == "one NaN" and name in ("uo", "vo")) or (what == "all equal" and name in ("uo", "vo"))
            possible |= what == "swapped"  # dimensions in another order, values with them: the same field
            for doctor in (False, True):
                yield Kind(
                    f"forcing variable for {'the doctor' if doctor else 'a run'}", f"{name} {what}",
                    _forced(change_of(name, what), doctor=doctor), SEEN_BY_ALL, not (possible or doctor),
                )  # fmt: skip


def forcing_attributes() -> Iterator[Kind]:
    """Give missing and impossible attributes of a file of currents."""
    tries: dict[str, dict[str, tuple[Any, ...]]] = {
        "uo": {
            "units": (None, "", "bananas", "m", 3.0, "s m-1", "K"), "standard_name": (None, "", "nonsense", "northward_sea_water_velocity", "sea_water_x_velocity", 3.0),
            "scale_factor": ("x", np.nan, 1e30, 0.0), "add_offset": ("x", np.nan, 1e30), "missing_value": ("x", 0.1), "grid_mapping": ("nothing", "uo", 3.0),
            "coordinates": ("nothing", "uo vo", "lat", 3.0), "cell_methods": ("time: point", "nonsense", 3.0), "valid_min": (1e9, "x"), "valid_range": ("x", [5.0, -5.0]),
        },
        "lat": {"units": (None, "degrees_east", "m", "K", 3.0), "standard_name": ("longitude", "nonsense", 3.0), "axis": ("Z", "T", "X", 3.0), "bounds": ("nothing", "uo")},
        "lon": {"units": (None, "degrees_north", "m", "hPa", 3.0), "standard_name": ("latitude", "time", 3.0), "axis": ("Z", "T", "Y", 3.0), "scale_factor": ("x", 0.0)},
        "time": {
            "units": (None, "", "hours", "days since", "days since yesterday", "hours since 2020-13-45", "months since 2020-12-01", "years since 2020-01-01", "hours since 9999-12-31",
                      "hours since -5000-01-01", "metres since 2020-12-09", "hours since 1950-01-01", 3.0, "nanoseconds since 2020-12-09", "HOURS SINCE 2020-12-09 00:00"),
            "calendar": ("nonsense", "360_day", "noleap", "julian", "none", 3.0), "bounds": ("nothing", "uo", 3.0), "scale_factor": ("x", 0.0, 1e30), "axis": ("X", "Z"),
        },
    }  # fmt: skip
    for variable, attributes in tries.items():
        for key, values in attributes.items():
            for value in values:

                def change(
                    table: Any, sizes: Any, own: Any, variable: str = variable, key: str = key, value: Any = value
                ) -> None:
                    table[variable][3].pop(key, None)
                    if value is not None:
                        table[variable][3][key] = value

                for doctor in (False, True):
                    yield Kind(
                        f"forcing attribute for {'the doctor' if doctor else 'a run'}", f"{variable}.{key} = {value!r}",
                        _forced(change, doctor=doctor), SEEN_BY_ALL, False,
                    )  # fmt: skip
    for dimension in ("time", "lat", "lon"):
        for count in (0, 1):

            def shorter(table: Any, sizes: Any, own: Any, dimension: str = dimension, count: int = count) -> None:
                sizes[dimension] = count
                for entry in table.values():
                    if dimension in entry[1]:
                        entry[2] = entry[2][
                            tuple(slice(0, count) if dim == dimension else slice(None) for dim in entry[1])
                        ]

            for doctor in (False, True):
                yield Kind(
                    f"forcing size for {'the doctor' if doctor else 'a run'}", f"{dimension} of {count}", _forced(shorter, doctor=doctor),
                    SEEN_BY_ALL, count == 0 and not doctor,
                )  # fmt: skip


# --- GeoTIFF -------------------------------------------------------------------------------------------------------------


def tiff(**changes: Any) -> bytes:
    """Return a GeoTIFF of a mask."""
    from rasterio.io import MemoryFile

    options = {
        "driver": "GTiff", "width": 21, "height": 21, "count": 1, "dtype": "float32", "crs": "EPSG:4326",
        "transform": from_bounds(-40.0, -56.5, -38.0, -54.5, 21, 21), **changes,
    }  # fmt: skip
    values = np.zeros((options["height"], options["width"]), options["dtype"])
    values[8:13, 6:15] = 1
    with MemoryFile() as memory:
        with memory.open(**options) as file:
            file.write(values, 1)
        return bytes(memory.read())


def _with_raster(data: bytes, key: str) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        (folder / "bad.tif").write_bytes(data)
        if key == "score":
            copied(folder, "run.nc")
            return ["score", "run.nc", "bad.tif", "--no-figure", "-o", "scored", "--date", "2020-12-10"]
        rectangle = "rectangle: {length: 9 km, width: 6 km}"
        new = {"mask": "mask: {file: bad.tif}", "strength": f"strength: {{file: bad.tif}}\n  {rectangle}"}.get(
            key, rectangle
        )
        text = EXPERIMENT.replace(rectangle, new)
        (folder / "bad.yaml").write_text(
            text.replace("thickness: 200", "thickness: bad.tif") if key == "thickness" else text
        )
        return RUN

    return make


def rasters() -> Iterator[Kind]:
    """Give impossible GeoTIFF as a mask, a map of thickness or strength, and as an observation."""
    good = tiff()
    made: dict[str, tuple[bytes, bool]] = {
        "empty": (b"", True), "garbage": (b"II*\0" + bytes(range(256)) * 4, True), "text": (b"hello" * 50, True), "cut short": (good[: len(good) // 2], True), "header only": (good[:16], True),
        "no coordinate system": (tiff(crs=None), False), "far away": (tiff(transform=from_bounds(10.0, 50.0, 12.0, 52.0, 21, 21)), False),
        "positions beyond the pole": (tiff(transform=from_bounds(-40.0, -156.5, -38.0, -154.5, 21, 21)), False), "one point": (tiff(width=1, height=1), False),
        "all missing": (tiff(nodata=0.0), False), "integers": (tiff(dtype="uint8"), False), "in metres without a system": (tiff(crs=None, transform=from_bounds(0, 0, 1e5, 1e5, 21, 21)), False),
    }  # fmt: skip
    for what, (data, impossible) in made.items():
        for key in ("mask", "thickness", "strength", "score"):
            yield Kind(f"GeoTIFF for {key}", what, _with_raster(data, key), ("bad.tif", "berg", "strength"), impossible)


# --- calls ---------------------------------------------------------------------------------------------------------------


def calls() -> Iterator[Kind]:
    """Give calls that lack something, have too much, or contradict themselves."""
    for arguments in (
        ["run"], ["run", "good.yaml", "good.yaml"], ["run", "a68a", "--resume", "good.restart.nc", "--set", "ice.density=900"], ["run", "good.yaml", "--numerics", "both", "--resume", "good.restart.nc", "-o", "out"],
        ["run", "good.yaml", "--days"], ["run", "good.yaml", "--set", "ice.density=900", "--set", "ice.density=bad", "-o", "out"], ["run", "good.yaml", "--days", "1", "--days", "-1", "-o", "out"],
        ["run", "good.yaml", "-o", ""], ["run", "--", "--days"], ["run", "GOOD.YAML"], ["run", "good"], ["run", "good.yaml", "--resume", "run.nc", "-o", "out"], ["run", "run.nc"], ["run", "https://example.org/x.yaml"],
        ["plot"], ["plot", "run.nc", "run.nc"], ["plot", "run.nc", "--date", "2020-12-10", "--kind", "timeline", "--kind", "x"], ["plot", "whole", "--observed"], ["plot", "seen.csv"], ["animate"], ["animate", "run.nc", "-o", "film.xyz"], ["animate", "run.nc", "-o", "film"],
        ["animate", "seen.csv"], ["replay"], ["replay", "seen.csv"], ["replay", "run.nc", "-o", "r.nc"], ["replay", "run.nc", "-o", "."], ["score", "run.nc"], ["score"], ["score", "seen.csv", "run.nc"], ["score", "run.nc", "seen.csv", "--between", "2020-12-10"],
        ["compare", "whole"], ["compare"], ["compare", "whole", "nowhere"], ["compare", "run.nc", "seen.csv"], ["compare", "whole", "whole", "whole", "nowhere"], ["why"], ["why", "seen.csv"], ["why", "nowhere"], ["doctor"], ["doctor", "*.none"], ["doctor", "--for", "good.yaml"],
        ["doctor", "ocean.nc", "--for", "good.yaml", "--for", "none"], ["kid"], ["kid", "good.yaml"], ["kid", "nowhere"], ["kid", "case", "case"], ["fetch"], ["fetch", "nothing"], ["fetch", "glorys"], ["nothing"], ["--nothing"], [""],
        ["experiments", "x"], ["-o", "x"],
    ):  # fmt: skip

        def make(folder: Path, arguments: list[str] = arguments) -> list[str]:
            copied(folder, "good.yaml", "good.restart.nc", "run.nc", "ocean.nc", "case")
            (folder / "whole").mkdir()
            copied(folder / "whole", "run.nc", "summary.json")
            (folder / "seen.csv").write_text(TRACK)
            return arguments

        fine = arguments in (["bench"], ["compare", "whole"]) or (
            arguments[:1] == ["doctor"] and arguments[-1] == "good.yaml"
        )
        yield Kind("call", " ".join(arguments) or "empty word", make, (), not fine)


# --- mutations -----------------------------------------------------------------------------------------------------------


def _zipped(seed: int) -> bytes:
    import io

    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED if seed % 3 else zipfile.ZIP_STORED) as archive:
        archive.writestr("doc.kml", KML)
    return buffer.getvalue()


def _shapes() -> dict[str, bytes]:
    """Return the files of a shapefile of the ring."""
    import io

    import shapefile

    parts = {suffix: io.BytesIO() for suffix in ("shp", "shx", "dbf")}
    with shapefile.Writer(**parts, shapeType=shapefile.POLYGON) as writer:
        writer.field("date", "C", 10)
        writer.poly([RING[::-1]])
        writer.record("2020-12-10")
    return {suffix: part.getvalue() for suffix, part in parts.items()}


def mutated(seeds: int) -> Iterator[Kind]:
    """Give files with some bytes changed, of the formats that the first module leaves out."""
    for seed in range(seeds):
        yield Kind("mutated forcing of a run", f"seed {seed}", _mutated_forcing(seed), (), False)
        yield Kind("mutated mask", f"seed {seed}", _mutated_mask(seed), (), False)
        yield Kind("mutated summary", f"seed {seed}", _mutated_summary(seed), (), False)
        yield Kind("mutated track", f"seed {seed}", _seen("bad.csv", flipped(TRACK.encode(), seed)), (), False)
        yield Kind("mutated archive", f"seed {seed}", _outline("bad.kmz", flipped(_zipped(seed), seed)), (), False)
        yield Kind("mutated shapefile", f"seed {seed}", _mutated_shape(seed), (), False)
        yield Kind(
            "mutated GeoTIFF",
            f"seed {seed}",
            _with_raster(
                flipped(tiff(), seed, where=(0, 400) if seed % 2 else None), ("mask", "thickness", "score")[seed % 3]
            ),
            (),
            False,
        )


def _mutated_forcing(seed: int) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        data = (store() / "ocean.nc").read_bytes()
        (folder / "bad.nc").write_bytes(flipped(data, seed, where=(0, 8192) if seed % 2 else None))
        (folder / "bad.yaml").write_text(FORCED)
        return RUN

    return make


def _mutated_mask(seed: int) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        data = (store() / "mask.nc").read_bytes()
        (folder / "bad.nc").write_bytes(flipped(data, seed, where=(0, 8192) if seed % 2 else None))
        (folder / "bad.yaml").write_text(
            EXPERIMENT.replace("rectangle: {length: 9 km, width: 6 km}", "mask: {file: bad.nc}")
        )
        return RUN

    return make


def _mutated_summary(seed: int) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        (folder / "bad").mkdir()
        copied(folder / "bad", "run.nc")
        (folder / "bad" / "summary.json").write_bytes(flipped(json.dumps(summary()).encode(), seed))
        return ["compare", "bad", "bad"]

    return make


def _seen(name: str, data: bytes) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        copied(folder, "run.nc")
        (folder / name).write_bytes(data)
        return ["score", "run.nc", name, "--no-figure", "-o", "scored"]

    return make


def _outline(name: str, data: bytes) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        (folder / name).write_bytes(data)
        (folder / "bad.yaml").write_text(
            EXPERIMENT.replace("rectangle: {length: 9 km, width: 6 km}", f"outline: {{file: {name}}}")
        )
        return RUN

    return make


def _mutated_shape(seed: int) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        parts = _shapes()
        struck = ("shp", "dbf", "shx", "shp")[seed % 4]
        for suffix, data in parts.items():
            (folder / f"bad.{suffix}").write_bytes(flipped(data, seed) if suffix == struck else data)
        return _outline("bad.shp", (folder / "bad.shp").read_bytes())(folder)

    return make
