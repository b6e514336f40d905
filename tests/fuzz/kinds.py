"""Kinds of bad input by class, each made by a seed or from a list: YAML, namelists, NetCDF, outlines, tables, options."""

from __future__ import annotations

import json
import os
import random
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from fuzz.base_files import (
    CSV,
    EXPERIMENT,
    GEOJSON,
    KML,
    RING,
    TRACK,
    changed_nc,
    copied,
    identified,
    store,
    summary,
)
from fuzz.judging import Kind, flipped
from kid.conftest import DRIVER, ICEBERGS, restart_variables
from riftberg.runs.restart import seal

RUN = ["run", "bad.yaml", "-o", "out", "-q", "--no-map"]


def kinds(seeds: int) -> Iterator[Kind]:
    """Give all kinds; ``seeds`` of each random sort."""
    for family in (
        yaml_values, yaml_texts, namelist_values, kid_variables, run_variables, run_attributes, restart_variables_of_own,
        summaries, drawings, tables, archives, grids, options, files, outputs,
    ):  # fmt: skip
        yield from family()
    yield from mutations(seeds)


def text_kind(family: str, name: str, text: str | bytes, words: tuple[str, ...], impossible: bool = True) -> Kind:
    """Return a kind that is the text of an experiment file."""

    def make(folder: Path) -> list[str]:
        (folder / "bad.yaml").write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
        return RUN

    return Kind(family, name, make, words, impossible)


# --- YAML --------------------------------------------------------------------------------------------------------------

NUMBERS = (
    ".nan",
    ".inf",
    "-.inf",
    "true",
    "[1]",
    "{a: 1}",
    "2020-12-09",
    "~",
    "text",
    "1e400",
    "'5 kg K'",
    "0x1p3",
    "1:30",
    "007",
)
KEYS: dict[str, tuple[str, tuple[str, ...]]] = {
    "days": ("days: 0.0625", ("0", "-1", "1e9", "'1e9 days'", *NUMBERS)),
    "output_every_hours": ("output_every_hours: 0.5", ("-1", "1e-6", *NUMBERS)),
    "start": (
        "start: 2020-12-09 13:00",
        ("2020", "20201209", "12.5", "true", "2020-02-31", "2020-13-01", "0000-01-01", "10000-01-01", "[2020]", "~", "soon",
         "9999-12-31", "0001-01-01", "'2020-12-09 25:00'", "{a: 1}", "-2020-01-01", "1e9", "2020-12-09 13:00:00+99:00"),
    ),
    "length": ("length: 9 km", ("0", "-1", "1e30", "1 mm", "1e9", "9 km km", *NUMBERS)),
    "width": ("width: 6 km", ("0", "-1", "1e30", "1 mm", *NUMBERS)),
    "thickness": ("thickness: 200", ("0", "-200", "1e36", "1e-300", "20000", *(n for n in NUMBERS if n != "text"), "none.nc", "/dev/zero")),
    "radius": ("radius: 1500", ("0", "-1500", "1e-3", "1e-300", "1e30", "1e5", "1 mm", *NUMBERS)),
    "rotation": ("rotation: 10", NUMBERS),
    "velocity": ("velocity: [0.1, 0.0]", ("1", "[1]", "[1, 2, 3]", "[true, 0]", "[.nan, 0]", "[a, b]", "{x: 1}", "[1e30, 0]", "[[1], 2]")),
    "spin": ("spin: 0", (*NUMBERS, "1e30")),
    "placement": (
        "placement: [-39.0, -55.5]",
        ("[1000, -55]", "[-55.5, -139]", "[-65, -89.5]", "[70, 89]", "[-39, 90]", "[-39]", "[-39, -55, 0]", "[.nan, 0]", "[true, 1]",
         "['a', 'b']", "-39", "~", "[-39, -1e30]", "{lon: 1}", "[2020-12-09, 1]", "[5 kg, 5]"),
    ),
    "current": ("current: [0.2, 0.0]", ("[.nan, 0]", "[1e30, 0]", "[0.2]", "0.2", "[a, b]", "[true, 0]", "[0.2 kg, 0]")),
    "wind": ("wind: [5, 1]", ("[.inf, 0]", "[1e10, 0]", "[5]", "strong", "[[1, 2], 3]")),
    "slope": ("slope: [0, 0]", ("[.nan, 0]", "[1e10, 0]", "[1]", "flat")),
    "sea_ice": ("sea_ice: [0, 0, 0]", ("[0, 0]", "[0, 0, -1]", "[0, 0, .nan]", "thick", "[1e20, 0, 1]")),
    "depth": ("depth: 1000", ("0", "-1", "1e30", *NUMBERS)),
    "kind": ("kind: formula", ("[formula]", "~", "true", "formla", "{a: b}", "3", "''")),
    "berg": ("berg:", ("berg: 3\nx:", "berg: [1]\nx:", "berg: ~\nx:", "bergs: 3\nx:")),
    "name": ("days: 0.0625", tuple(f"days: 1\nname: {n}" for n in ("[a]", "3", "true", "../x", "'a/b'", "''", "~", "{a: b}", "2020-12-09"))),
    "parameters": (
        "fracture: {normal_strength: 20 kPa}",
        tuple(
            ["fracture: 3", "fracture: ~", "fractur: {}", "preset: [a]", "preset: 3", "preset: ~x", "3: {}", "fracture: {normal_strength: [1]}"]
            + [f"stepping: {{time_step: {v}}}" for v in ("0", "-1", "1e-9", "true", ".nan", "1e30", "[1]", "soon")]
            + [f"stepping: {{substeps: {v}}}" for v in ("0", "-1", "1000000000", "1.5", "true", "many", "[3]")]
            + [f"grounding: {{law: {v}}}" for v in ("linear", "0", "true", "[seabed]")]
            + [f"contact: {{max_iterations: {v}}}" for v in ("0", "1e30", "1000000000000", ".nan")]
            + [f"stepping: {{scheme: mts, safety: {v}}}" for v in ("0", "2", "1e-12", ".nan", "true")]
            + [f"stepping: {{scheme: {v}}}" for v in ("euler", "[mts]", "3", "true")]
            + [f"bonds: {{youngs_modulus: {v}}}" for v in ("-1", "1e300", ".inf", "true", "'1 kg'")]
            + [f"bonds: {{poisson: {v}}}" for v in ("-1", "0.5", "7", "true")]
            + [f"ice: {{density: {v}}}" for v in ("0", "2000", "true", "-1", "[900]")]
            + [f"earth: {{radius: {v}}}" for v in ("0", "-1", "true", "1e-3")]
            + ["earth: {latlon: 3}", "earth: {latlon: [true]}", "earth: {period: .nan}", "earth: {reference_latitude: 100}"]
            + [f"fracture: {{normal_strength: {v}}}" for v in ("0", "-1", "20 m", ".nan", "true")]
        ),
    ),
}  # fmt: skip

HARMLESS_VALUES = {("rotation", "1e400"), ("thickness", "~"), ("preset", "~")}
POSSIBLE = (
    ("output_every_hours", "~"), ("length", "1e9"), ("spin", "1e30"), ("name", "'a b'"), ("parameters", "preset: ~x"),
    ("depth", "1e30"),
)  # fmt: skip


def yaml_values() -> Iterator[Kind]:
    """Give impossible values of every key of an experiment file."""
    for key, (right, wrongs) in KEYS.items():
        assert right in EXPERIMENT, right
        whole = key in ("berg", "name", "parameters")
        for wrong in wrongs:
            new = wrong if whole else f"{right.split(':')[0]}: {wrong}"
            yield text_kind(
                "yaml value",
                f"{key}: {wrong}",
                EXPERIMENT.replace(right, new),
                ("bad.yaml", "element", "stepping", "--every", "fracture", "berg", "none.nc", "/dev/zero"),
            )


def yaml_texts() -> Iterator[Kind]:
    """Give texts that are no plain experiment files."""
    bomb = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
        f"{c}: &{c} [" + ",".join([f"*{b}"] * 9) + "]\n" for b, c in zip("abcdefgh", "bcdefghi", strict=True)
    )
    texts: dict[str, str | bytes] = {
        "recursive alias": EXPERIMENT + "x: &x [*x]\n", "recursive mapping": EXPERIMENT + "x: &x {a: *x}\n",
        "exploding aliases": EXPERIMENT + bomb, "unknown alias": EXPERIMENT + "x: *nothing\n",
        "deep list": EXPERIMENT + "x: " + "[" * 5000 + "]" * 5000, "deep open list": "x: " + "[" * 100_000,
        "deep mapping": "".join(" " * k + "a:\n" for k in range(3000)), "deep flow mapping": "x: " + "{a: " * 3000,
        "complex key": EXPERIMENT + "? [a, b]\n: 1\n", "mapping key": EXPERIMENT + "? {a: b}\n: 1\n", "null key": EXPERIMENT + "? \n: 1\n",
        "empty key": EXPERIMENT + ": 1\n", "number key": EXPERIMENT + "1: 2\n", "date key": EXPERIMENT + "2020-12-09: 2\n",
        "repeated key": EXPERIMENT + "days: 3\n", "two documents": EXPERIMENT + "---\n" + EXPERIMENT, "nothing": "", "only a comment": "# nothing\n",
        "a list": "- 1\n- 2\n", "a word": "hello", "a number": "3", "null": "~", "tabs": EXPERIMENT.replace("  ", "\t"),
        "open quote": EXPERIMENT + 'title: "abc\n', "open bracket": EXPERIMENT + "x: [1, 2\n", "bad indent": EXPERIMENT.replace("  radius", "   radius"),
        "colon": EXPERIMENT + "title: a: b\n", "merge of a number": EXPERIMENT + "<<: 3\n", "merge of a list": EXPERIMENT + "<<: [1]\n",
        "long number": EXPERIMENT.replace("0.0625", "9" * 5000), "long float": EXPERIMENT.replace("0.0625", "1" + "0" * 400 + ".0"),
        "long key": EXPERIMENT + "k" * 20_000 + ": 1\n", "long word": EXPERIMENT + "title: [" + "w" * 20_000 + "]\n",
        "large file": EXPERIMENT + "#" * 1_000_000, "directive": "%YAML 9.9\n---\n" + EXPERIMENT, "bad directive": "%TAG ! \n---\n" + EXPERIMENT,
        "not UTF-8": EXPERIMENT.encode() + b"title: \xff\xfe\xfa\n", "UTF-16": EXPERIMENT.encode("utf-16"), "binary": bytes(range(256)) * 20,
        "NetCDF": b"CDF\x01" + bytes(2000), "zip": b"PK\x03\x04" + bytes(1000), "surrogate": EXPERIMENT + "title: '\ud800'\n",
        "anchor twice": EXPERIMENT + "x: &a 1\ny: &a 2\n", "billion rows": EXPERIMENT.replace("rectangle: {length: 9 km, width: 6 km}", "lattice: {rows: [[0, 0, 1000000000]]}"),
        "rows of text": EXPERIMENT.replace("rectangle: {length: 9 km, width: 6 km}", "lattice: {rows: [[a, b, c]]}"),
        "no rows": EXPERIMENT.replace("rectangle: {length: 9 km, width: 6 km}", "lattice: {rows: []}"),
        "rows twice": EXPERIMENT.replace("rectangle: {length: 9 km, width: 6 km}", "lattice: {rows: [[0, 0, 3], [0, 2, 5]]}"),
        "row far off": EXPERIMENT.replace("rectangle: {length: 9 km, width: 6 km}", "lattice: {rows: [[0, 0, 3], [1000000000, 2, 5]]}"),
        "two shapes": EXPERIMENT.replace("  radius", "  lattice: {rows: [[0, 0, 3]]}\n  radius"), "no shape": EXPERIMENT.replace("  rectangle: {length: 9 km, width: 6 km}\n", ""),
    }  # fmt: skip
    for name, text in texts.items():
        yield text_kind("yaml text", name, text, ("bad.yaml", "table of rows"))
    for code in (*range(9), 11, 12, *range(14, 32), 127, 128, 0x9F, 0xFFFE):
        yield text_kind("yaml control", f"character {code}", EXPERIMENT + f"title: a{chr(code)}b\n", ("bad.yaml",))
    for tag in ("!x", "!!python/object/apply:os.system ['true']", "!!python/name:os.system", "!!binary aGVsbG8=", "!!set {a}", "!!omap [a: 1]",
                "!!pairs [a: 1]", "!!python/tuple [1, 2]", "!<tag:x> 1", "!!int abc", "!!float abc", "!!bool abc", "!!timestamp abc", "!!null abc", "!!map 3", "!!seq 3"):  # fmt: skip
        yield text_kind("yaml tag", tag, EXPERIMENT + f"title: {tag}\n", ("bad.yaml",))
        yield text_kind("yaml tag", f"days {tag}", EXPERIMENT.replace("days: 0.0625", f"days: {tag}"), ("bad.yaml",))
    for line in EXPERIMENT.splitlines():
        key = line.split(":")[0].strip()
        if key not in (
            "output_every_hours",
            "thickness",
            "radius",
            "rotation",
            "velocity",
            "spin",
            "wind",
            "slope",
            "sea_ice",
            "depth",
            "current",
            "fracture",
            "parameters",
        ):
            yield text_kind("yaml key", f"without {key}", EXPERIMENT.replace(line + "\n", "", 1), ("bad.yaml",))
        yield text_kind("yaml key", f"{key} misspelt", EXPERIMENT.replace(f"{key}:", f"{key}q:", 1), ("bad.yaml",))
        yield text_kind(
            "yaml key", f"{key} twice", EXPERIMENT.replace(line + "\n", line + "\n" + line + "\n", 1), ("bad.yaml",)
        )
    for extra in (
        "rifts: 3", "rifts: [3]", "rifts: [{}]", "rifts: [{points: [[0, 0]]}]", "rifts: [{points: [[0, 0], [.nan, 1]]}]", "rifts: [{file: none.geojson}]",
        "rifts: [{points: [[0, 0], [1, 1]]}]", "rifts: [{file: a, points: [[0, 0], [1, 1]]}]", "rifts: [{points: [[0, 0], [1, 1]], strength: 2}]",
        "rifts: [{points: 3}]", "rifts: [{points: [[true, 0], [1, 1]]}]", "rifts: {points: []}", "strength: 3", "strength: {}", "strength: {weibull: 0}",
        "strength: {weibull: -1}", "strength: {normal: 1}", "strength: {uniform: 2}", "strength: {weibull: 5, normal: 0.1}", "strength: {weibull: true}",
        "strength: {weibull: 5, seed: -1}", "strength: {weibull: 5, seed: 1.5}", "strength: {file: none.nc}", "strength: {weibull: 1e-300}",
        "packing: [square]", "packing: triangle", "packing: 3", "packing: true", "shift: [1000, 0]", "shift: [0, 170]", "shift: 3", "shift: [.nan, 0]",
    ):  # fmt: skip
        yield text_kind(
            "yaml berg",
            extra,
            EXPERIMENT.replace("  radius", f"  {extra}\n  radius"),
            ("bad.yaml", "rift", "strength", "none"),
        )
    forcing = EXPERIMENT[: EXPERIMENT.index("  kind: formula")]
    good = {
        "files": "[ocean.nc]",
        "longitude": "[-40, -38]",
        "latitude": "[-56.5, -54.5]",
        "sea_level": "none",
        "wind": "none",
    }
    for key, values in {
        "files": ("[]", "3", "~", "[3]", "[none.nc]", "[/dev/zero]", "['*']", "[{file: ocean.nc, product: none}]", "[{product: glorys}]", "['']", "[[a]]", "[.]", "{a: b}"),
        "longitude": ("[-38, -40]", "[1000, 1001]", "[-40]", "west", "[.nan, 0]", "[true, 1]", "~"),
        "latitude": ("[-54.5, -56.5]", "[-100, 100]", "[-40]", "south", "[.nan, 0]", "~", "[50, 60]"),
        "spacing": ("0", "-1", "100", "1e-9", ".nan", "true", "fine"), "every_hours": ("0", "-1", "1e-9", ".nan", "true", "often"),
        "max_gap": ("0", "-1", ".nan", "true"), "hold": ("-1", ".nan", "true", "long"), "currents": ("keel", "3", "[draft]", "true"),
        "sea_level": ("maybe", "3", "[none]"), "wind": ("maybe", "3", "true"), "coastal_drift": ("-1", ".nan", "true"), "unknown": ("3",),
    }.items():  # fmt: skip
        for value in values:
            lines = "".join(f"  {k}: {v}\n" for k, v in {**good, key: value}.items())
            if key == "every_hours":
                lines += "  spacing: 0.25\n"

            def make(folder: Path, text: str = f"{forcing}  kind: files\n{lines}") -> list[str]:
                copied(folder, "ocean.nc")
                (folder / "bad.yaml").write_text(text)
                return RUN

            yield Kind(
                "yaml forcing",
                f"{key}: {value}",
                make,
                ("bad.yaml", "ocean.nc", "none.nc", "files", "/dev/zero", "longitude", "latitude", "ocean"),
            )


# --- namelists and KID -------------------------------------------------------------------------------------------------

KID = ["kid", "case", "-o", "out", "-q"]


NO_LIMIT = (("Lx", "-1e30"), ("h_to_init_grounding", "-1e30"))


def namelist_values() -> Iterator[Kind]:
    """Give impossible values of entries of a namelist."""
    wrongs = ("'text'", "1.5.2", "", "nan", "1e999", "1,2,3", "(1,2)", ".maybe.", "1000000*1", "-1e30", "\x01")
    for group, entries in (("icebergs_driver_nml", DRIVER), ("icebergs_nml", ICEBERGS)):
        for entry in entries:
            for wrong in wrongs:
                # No value means the default; a logical takes any text that begins like one. Lx <= 0 is no
                # period, and no clearance below 0 is one of 0.
                yield Kind(
                    "namelist",
                    f"{entry} = {wrong!r}",
                    _namelist(group, entry, wrong),
                    ("input.nml",),
                    wrong not in ("", "'text'") and (entry, wrong) not in NO_LIMIT,
                )
    for entry, values in {
        "nmax": ("0", "-1"), "ibhrs": ("0", "-5", "2000000000"), "ibdt": ("0", "-1", "1e-30", "1e30"), "ni": ("0", "1", "-3", "1000000000"),
        "nj": ("0", "1", "1000000000"), "gridres": ("0", "-1", "1e-300", "1e300"),
    }.items():  # fmt: skip
        for value in values:
            yield Kind(
                "namelist",
                f"{entry} = {value}",
                _namelist("icebergs_driver_nml", entry, value),
                ("input.nml", "icebergs.res.nc", "element"),
            )
    for entry, values in {
        "mts_sub_steps": ("0", "-5", "1000000000"), "rho_bergs": ("0", "-1", "2000"), "max_bonds": ("-1", "100"), "dem_spring_coef": ("-1",),
        "traj_sample_hrs": ("0", "-2"), "spring_coef": ("-1",), "poisson": ("7", "-3"), "restart_input_dir": ("'nowhere'", "'/dev/zero'", "''"),
        "unknown_entry": ("3",), "traj_name": ("'bergs_bonds.nc', bond_traj_name='bergs_bonds.nc'",),
    }.items():  # fmt: skip
        for value in values:
            yield Kind(
                "namelist",
                f"{entry} = {value}",
                _namelist("icebergs_nml", entry, value),
                ("input.nml", "stepping.substeps", "nowhere", "/dev/zero", "icebergs.res.nc"),
            )
    for name, text in {
        "empty": "", "no end": "&icebergs_nml\n a = 1", "one group": "&icebergs_nml\n/\n", "binary": bytes(range(256)).decode("latin-1"),
        "other": "hello\n", "html": "<html></html>", "nested": "&icebergs_nml\n&icebergs_driver_nml\n/\n/\n", "huge": "&icebergs_nml\n" + "! x\n" * 200_000 + "/\n",
    }.items():  # fmt: skip

        def make(folder: Path, text: str = text) -> list[str]:
            copied(folder, "case")
            (folder / "case" / "input.nml").write_text(text, encoding="latin-1")
            return KID

        yield Kind("namelist", name, make, ("input.nml",))


def _namelist(group: str, entry: str, value: str) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        copied(folder, "case")
        path = folder / "case" / "input.nml"
        lines = [line for line in path.read_text().splitlines() if line.split("=")[0].strip() != entry]
        lines.insert(lines.index(f"&{group}") + 1, f"  {entry} = {value}")
        path.write_text("\n".join(lines) + "\n")
        (folder / "out").mkdir()
        return KID

    return make


def kid_variables() -> Iterator[Kind]:
    """Give impossible values, types and shapes of the variables of a KID restart and of its bonds."""
    anything = {"ine", "jne", "start_lon", "start_lat", "start_year", "start_day"}
    wrongs: dict[str, Any] = {
        "NaN": np.nan,
        "1e36": 1e36,
        "-1e36": -1e36,
        "fill": 9.969e36,
        "inf": np.inf,
        "char": "char",
        "shape": "shape",
        "dropped": "drop",
    }
    positive = {"mass", "thickness", "width", "length", "mass_scaling"}
    files = {"icebergs.res.nc": set(identified(restart_variables(3))) - {"iceberg_num"} , "bonds_iceberg.res.nc": set(netCDF4.Dataset(store() / "case/INPUT/bonds_iceberg.res.nc").variables)}  # fmt: skip
    for file, names in files.items():
        for name in sorted(names - {"ine", "jne"}):
            own = {
                **wrongs,
                **({"0": 0.0, "-1": -1.0, "1e-300": 1e-300} if name in positive - {"mass_scaling"} else {}),
            }
            if name == "mass_scaling":
                own |= {"0": 0.0, "-1": -1.0}
            for what, value in own.items():
                optional = what == "dropped" and name in (
                    "broken",
                    "tangd1",
                    "tangd2",
                    "nstress",
                    "sstress",
                    "rel_rotation",
                )
                possible = optional or (
                    name in anything and what not in ("NaN", "1e36", "inf", "char", "shape", "dropped", "fill", "-1e36")
                )
                yield Kind("KID variable", f"{file} {name} {what}", _kid(file, name, value), (file, name), not possible)
    for what, change in {
        "element twice": lambda t: t["lon"][2].__setitem__(1, t["lon"][2][0]), "identifier twice": lambda t: t["id_cnt"][2].__setitem__(1, 1),
        "far away": lambda t: t["lon"][2].__setitem__(0, 1e7), "fast": lambda t: t["uvel"][2].__setitem__(0, 1e6), "thick": lambda t: t["thickness"][2].__setitem__(0, 1e5),
    }.items():  # fmt: skip
        yield Kind(
            "KID element", what, _kid_change("icebergs.res.nc", change), ("element", "icebergs.res.nc", "id_cnt")
        )
    for what, change in {
        "bond lacks its mirror": lambda t: t["first_id_cnt"][2].__setitem__(0, 3), "bond twice": lambda t: [t[n][2].__setitem__(1, t[n][2][0]) for n in ("first_id_cnt", "other_id_cnt")],
        "bond to itself": lambda t: t["other_id_cnt"][2].__setitem__(0, int(t["first_id_cnt"][2][0])), "unknown element": lambda t: t["other_id_cnt"][2].__setitem__(0, 77),
        "broken 9": lambda t: t["broken"][2].__setitem__(0, 9), "broken in one direction": lambda t: t["broken"][2].__setitem__(0, 1),
    }.items():  # fmt: skip
        yield Kind("KID bond", what, _kid_change("bonds_iceberg.res.nc", change), ("bond",))


def _kid(file: str, name: str, value: Any) -> Callable[[Path], list[str]]:
    def change(table: dict[str, Any]) -> None:
        if value == "drop":
            del table[name]
        elif value == "char":
            table[name][0], table[name][2] = "S1", np.full(len(table[name][2]), b"x")
        elif value == "shape":
            table[name][1], table[name][2] = (), table[name][2][0]
        else:
            table[name][0], table[name][2] = "f8", table[name][2].astype("f8")
            table[name][2][1] = value

    return _kid_change(file, change)


def _kid_change(file: str, change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        copied(folder, "case")
        changed_nc(folder / "case" / "INPUT" / file, lambda table, sizes, attributes: change(table))
        (folder / "out").mkdir()
        return KID

    return make


# --- run files, restarts, summaries ------------------------------------------------------------------------------------

READERS: tuple[list[str], ...] = (
    ["why", "bad", "--no-figure"], ["replay", "bad", "-o", "r.html"], ["plot", "bad", "--kind", "timeline", "-o", "pic"],
    ["compare", "bad", "bad"], ["score", "bad", "seen.csv", "--no-figure"], ["animate", "bad", "-o", "f.gif", "--hours", "24", "-q"],
    ["doctor", "ocean.nc", "--along", "bad"],
)  # fmt: skip
CHECKED = (
    "time", "trajectory", "lon", "lat", "length", "width", "mass", "thickness", "rotation", "u", "v", "spin", "berg", "bond_first", "bond_second", "status",
    "strength", "break_time", "normal_stress", "fragment_number", "fragment_parent", "fragment_birth_time", "fragment_area",
)  # fmt: skip


def _reader(number: int, change: Callable[..., Any]) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        (folder / "bad").mkdir()
        copied(folder / "bad", "run.nc", "summary.json")
        copied(folder, "ocean.nc")
        (folder / "seen.csv").write_text(TRACK)
        changed_nc(folder / "bad" / "run.nc", change)
        return READERS[number % len(READERS)]

    return make


def run_variables() -> Iterator[Kind]:
    """Give impossible values, types, shapes and sizes of the variables of a run file."""
    with netCDF4.Dataset(store() / "run.nc") as file:
        names = [(n, np.dtype(v.dtype).kind) for n, v in file.variables.items()]
    number = 0
    for name, _ in names:
        for what in ("dropped", "NaN", "1e36", "-5", "char", "scalar", "swapped"):
            number += 1
            # NaN and -5 have a meaning for some.
            free = what in ("NaN", "-5", "swapped", "1e36") and not (
                name in ("lon", "lat", "length", "width", "mass", "thickness", "time")
                and what != "swapped"
                and not (what == "-5" and name in ("lon", "lat", "time"))
            )
            possible = name not in CHECKED or free
            yield Kind(
                "run variable",
                f"{name} {what} ({READERS[number % len(READERS)][0]})",
                _reader(number, _run_change(name, what)),
                ("run.nc",),
                not possible,
            )
    for number, what in enumerate(("bond", "time", "trajectory", "fragment") * 3):
        yield Kind(
            "run size",
            f"no {what} {number}",
            _reader(number, _without(what)),
            ("run.nc",),
            what in ("time", "trajectory"),
        )


def _run_change(name: str, what: str) -> Callable[..., Any]:
    def change(table: dict[str, Any], sizes: dict[str, int], attributes: dict[str, Any]) -> None:
        dtype, dims, values, own = table[name]
        if what == "dropped":
            del table[name]
        elif what == "char":
            table[name] = ["S1", dims, np.full(values.shape, b"x"), {}]
        elif what == "scalar":
            table[name] = [
                dtype,
                (),
                values.ravel()[0] if values.size else 0,
                {k: v for k, v in own.items() if k != "coordinates"},
            ]
        elif what == "swapped":
            table[name] = [dtype, dims[::-1], np.moveaxis(values, 0, -1), own]
        elif values.dtype.kind in "SU":
            letter = {"NaN": b"\xff", "1e36": b"\x00", "-5": b"\x1b"}[what]
            table[name] = ["S1", dims, np.full(values.shape, letter, "S1"), own]
        else:
            changed = values.astype("f8")
            if changed.size:
                changed.ravel()[-1] = {"NaN": np.nan, "1e36": 1e36, "-5": -5.0}[what]
            table[name] = ["f8", dims, changed, own]

    return change


def _without(dimension: str) -> Callable[..., Any]:
    def change(table: dict[str, Any], sizes: dict[str, int], attributes: dict[str, Any]) -> None:
        sizes[dimension] = 0
        for entry in table.values():
            if dimension in entry[1]:
                index = tuple(slice(0, 0) if dim == dimension else slice(None) for dim in entry[1])
                entry[2] = entry[2][index]

    return change


def run_attributes() -> Iterator[Kind]:
    """Give missing and impossible attributes of a run file."""
    number = 0
    values: tuple[Any, ...] = (
        None,
        "",
        "garbage",
        3,
        "{}",
        "[1]",
        np.nan,
        '{"ice": 3}',
        "9" * 5000,
        "2020-13-45",
        "2020-01-01T00:00:00+05:00",
    )
    for name in ("parameters_json", "start", "featureType"):
        for value in values:
            if name == "parameters_json" and value == "{}":
                continue  # no changes of the defaults
            number += 1

            def change(
                table: Any, sizes: Any, attributes: dict[str, Any], name: str = name, value: Any = value
            ) -> None:
                attributes.pop(name)
                if value is not None:
                    attributes[name] = value

            yield Kind("run attribute", f"{name} = {str(value)[:20]!r}", _reader(number, change), ("run.nc",))
    for name in ("time", "break_time", "fragment_birth_time"):
        for value in (
            None,
            "",
            "seconds",
            "seconds since when",
            "metres",
            3,
            "seconds since 0000-00-00",
            "days since 2020-01-01",
            "seconds since 99999-01-01",
        ):
            number += 1

            def change_units(table: Any, sizes: Any, attributes: Any, name: str = name, value: Any = value) -> None:
                table[name][3].pop("units")
                if value is not None:
                    table[name][3]["units"] = value

            yield Kind("run attribute", f"{name}: units = {value!r}", _reader(number, change_units), ("run.nc",))
    for command in READERS:

        def foreign(folder: Path, command: list[str] = command) -> list[str]:
            (folder / "bad").mkdir()
            (folder / "seen.csv").write_text(TRACK)
            copied(folder, "ocean.nc")
            with netCDF4.Dataset(folder / "bad" / "run.nc", "w") as file:
                file.setncatts({"Conventions": "CF-1.8", "featureType": "trajectory"})
                file.createDimension("trajectory", 3)
                file.createDimension("time", 2)
                file.createVariable("lon", "f8", ("trajectory", "time"))[:] = 1.0
            return command

        yield Kind("run foreign", f"CF trajectories ({command[0]})", foreign, ("run.nc",))
        for other in ("ocean.nc", "good.restart.nc", "mask.nc", "good.yaml"):

            def another(folder: Path, command: list[str] = command, other: str = other) -> list[str]:
                (folder / "bad").mkdir()
                (folder / "seen.csv").write_text(TRACK)
                copied(folder, "ocean.nc")
                (folder / "bad" / "run.nc").write_bytes((store() / other).read_bytes())
                return command

            yield Kind("run foreign", f"{other} ({command[0]})", another, ("run.nc",))


RESUME = ["run", "good.yaml", "-o", "out", "-q", "--no-map", "--resume", "bad.restart.nc"]


def restart_variables_of_own() -> Iterator[Kind]:
    """Give impossible variables and attributes of a restart of Riftberg, and restarts of other runs."""
    with netCDF4.Dataset(store() / "good.restart.nc") as file:
        names = list(file.variables)
    around = (
        "uo",
        "vo",
        "ui",
        "vi",
        "ua",
        "va",
        "slope",
        "depth",
        "sst",
        "sss",
        "ice_",
        "vorticity",
        "keel_",
        "_ax",
        "_ay",
        "_bx",
        "_by",
    )
    for name in names:
        for what in ("dropped", "NaN", "1e36", "char", "scalar"):
            if what in ("NaN", "1e36") and name == "step_number":
                continue
            looked_up = what == "NaN" and any(part in name for part in around)
            possible = (
                looked_up
                or (name in ("bond_break_time", "bond_rest_length") and what == "NaN")
                or (name in ("time", "step_number") and what == "scalar")
            )
            yield Kind(
                "restart variable",
                f"{name} {what}",
                _restart(_run_change(name, what)),
                ("bad.restart.nc", "--resume"),
                not possible,
            )
    for name, value in (
        ("time", -5.0), ("time", 1e30), ("time", 7.0), ("step_number", -1), ("step_number", 10**9), ("step_number", 0), ("element_substeps", -3),
        ("element_substeps", 10**12), ("bond_status", 9), ("bond_status", -1), ("bond_first", -1), ("bond_second", 10**6),
        ("bond_strength", -1.0), ("bond_damage", 2.0), ("element_mass", -1.0), ("element_mass", 1e20), ("element_lat", -200.0), ("element_thickness", 0.0), ("element_length", -1.0),
        ("element_berg", -3), ("element_id", 2), ("bond_break_time", 1e12), ("bond_break_time", -7.0), ("bond_bond_length", 0.0),
    ):  # fmt: skip

        def change(table: Any, sizes: Any, attributes: Any, name: str = name, value: Any = value) -> None:
            values = np.array(table[name][2])
            values.ravel()[-1:] = value
            values.ravel()[:1] = value
            table[name][2] = values

        yield Kind(
            "restart value", f"{name} = {value}", _restart(change), ("bad.restart.nc", "--resume", "bond", "element")
        )
    for name, values in {
        "riftberg_restart_format": (None, 99, "x", -1, np.nan), "start": (None, "garbage", 3, "1999-01-01T00:00:00"), "parameters_json": (None, "x", "{}x", 3),
        "fragments_json": (None, "x", "3", "[3]", '[{"a": 1}]', "{}"), "forcing": (None, "another ocean"),
    }.items():  # fmt: skip
        for value in values:

            def change_attribute(table: Any, sizes: Any, attributes: Any, name: str = name, value: Any = value) -> None:
                attributes.pop(name)
                if value is not None:
                    attributes[name] = value

            yield Kind(
                "restart attribute", f"{name} = {value!r}", _restart(change_attribute), ("bad.restart.nc", "--resume")
            )
    for old, new in (
        ("2020-12-09", "2020-12-10"),
        ("9 km", "12 km"),
        ("[0.2, 0.0]", "[0.3, 0.0]"),
        ("thickness: 200", "thickness: 250"),
        ("depth: 1000", "depth: 500"),
    ):

        def other(folder: Path, old: str = old, new: str = new) -> list[str]:
            copied(folder, "good.restart.nc", "good.yaml")
            (folder / "good.restart.nc").rename(folder / "bad.restart.nc")
            (folder / "good.yaml").write_text(EXPERIMENT.replace(old, new))
            return RESUME

        yield Kind("restart of another run", new, other, ("bad.restart.nc",))
    for command in (["run", "a68a"], ["run", "a68a-melt"]):

        def built_in(folder: Path, command: list[str] = command) -> list[str]:
            copied(folder, "good.restart.nc")
            return [*command, "-o", "out", "-q", "--no-map", "--resume", "good.restart.nc"]

        yield Kind("restart of another run", command[1], built_in, ("good.restart.nc",))


def resealed(path: Path) -> None:
    """Give a restart the checksum of what it holds now."""
    with suppress(TypeError), netCDF4.Dataset(path, "a") as file:
        seal(file)


def _restart(change: Callable[..., Any]) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        copied(folder, "good.restart.nc", "good.yaml")
        changed_nc(folder / "good.restart.nc", change)
        resealed(folder / "good.restart.nc")
        (folder / "good.restart.nc").rename(folder / "bad.restart.nc")
        return RESUME

    return make


def summaries() -> Iterator[Kind]:
    """Give impossible summaries beside a run file."""
    keys = (
        "experiment",
        "start",
        "end",
        "days",
        "elements",
        "bonds_total",
        "bonds_broken",
        "fragments",
        "breakups",
        "largest_km2",
        "numerics",
    )
    for key in keys:
        for value in ("drop", None, [], {}, "text", -1, True, float("inf"), 1.5, [[]]):
            # An empty list of break-ups, a text for a text and a number for a number may be right.
            right = (key == "breakups" and value == []) or (key in ("experiment", "start", "end") and value == "text")
            right |= key in ("days", "largest_km2") and value in (-1, 1.5) and not isinstance(value, bool)
            yield Kind("summary", f"{key} = {value!r}", _summary(key, value), ("summary.json",), not right)
    for key in ("time", "lon", "lat", "area_km2", "bonds", "grounded"):
        for value in ("drop", None, "text", [], float("nan")):
            yield Kind("summary", f"breakups.0.{key} = {value!r}", _summary(key, value, inner=True), ("summary.json",))
    for name, text in (
        ("empty", ""),
        ("word", "hello"),
        ("list", "[]"),
        ("open", "{"),
        ("deep", "[" * 100_000),
        ("binary", "\x00\x01"),
    ):

        def make(folder: Path, text: str = text) -> list[str]:
            (folder / "bad").mkdir()
            copied(folder / "bad", "run.nc")
            (folder / "bad" / "summary.json").write_text(text)
            return ["compare", "bad", "bad"]

        yield Kind("summary", name, make, ("summary.json",))


def _summary(key: str, value: Any, inner: bool = False) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        (folder / "bad").mkdir()
        copied(folder / "bad", "run.nc")
        made = summary()
        part = made["breakups"][0] if inner else made
        if value == "drop":
            del part[key]
        else:
            part[key] = value
        (folder / "bad" / "summary.json").write_text(json.dumps(made))
        return ["compare", "bad", "bad"]

    return make


# --- drawings, tables, grids -------------------------------------------------------------------------------------------


def _outlined(name: str, content: str | bytes, *, score: bool) -> Callable[[Path], list[str]]:
    """Return a maker of an outline for an experiment, or for a score."""

    def make(folder: Path) -> list[str]:
        data = content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass")
        (folder / name).write_bytes(data)
        if score:
            copied(folder, "run.nc")
            return ["score", "run.nc", name, "--no-figure", "-o", "scored"]
        text = EXPERIMENT.replace("rectangle: {length: 9 km, width: 6 km}", f"outline: {{file: {name}}}")
        (folder / "bad.yaml").write_text(text)
        return RUN

    return make


def _both(family: str, what: str, name: str, content: str | bytes, impossible: bool = True) -> Iterator[Kind]:
    for score in (False, True):
        yield Kind(
            f"{family} for {'score' if score else 'a berg'}",
            what,
            _outlined(name, content, score=score),
            (name,),
            impossible,
        )


def _geometry(geometry: Any, **extra: Any) -> str:
    feature = {"type": "Feature", "properties": {"date": "2020-12-10"}, "geometry": geometry}
    return json.dumps({"type": "FeatureCollection", "features": [feature], **extra})


def drawings() -> Iterator[Kind]:
    """Give impossible GeoJSON and KML."""
    rings: dict[str, Any] = {
        "no coordinates": [], "empty ring": [[]], "one point": [[RING[0]]], "two points": [[RING[0], RING[1]]], "NaN": [[*RING[:2], [float("nan"), 1.0], RING[0]]],
        "infinite": [[*RING[:2], [float("inf"), 1.0], RING[0]]], "text": [[["a", "b"], *RING[1:]]], "null vertex": [[None, *RING[1:]]], "one number": [[[1.0], *RING[1:]]],
        "flat": [1.0, 2.0], "nested": [[[RING]]], "mixed hemispheres": [[[-39, -55], [-38, -55], [-38, 55], [-39, 55], [-39, -55]]], "latitude 100": [[[-39, -155], [-38, -155], [-38, -154], [-39, -155]]],
        "longitude 1000": [[[1000, -55], [1001, -55], [1001, -54], [1000, -55]]], "metres": [[[x * 1e5, y * 1e5] for x, y in RING]], "crossing itself": [[RING[0], RING[2], RING[1], RING[3], RING[0]]],
        "a line": [[RING[0], RING[0], RING[0], RING[0]]], "huge number": [[[1e308, 1e308], *RING[1:]]], "tiny": [[[x * 1e-9 - 39, y * 1e-9 - 55] for x, y in RING]], "a word": "ring", "a number": 3,
    }  # fmt: skip
    for what, ring in rings.items():
        # A score takes outlines that cross themselves or are small as they were seen.
        mild = what in ("crossing itself", "a line", "tiny", "nested")
        for kind in _both("GeoJSON", what, "bad.geojson", _geometry({"type": "Polygon", "coordinates": ring})):
            yield Kind(kind.family, kind.name, kind.make, kind.words, not (mild and "score" in kind.family))
    for what, geometry in {
        "no geometry": None, "point": {"type": "Point", "coordinates": [1, 2]}, "line": {"type": "LineString", "coordinates": RING}, "unknown type": {"type": "Blob", "coordinates": [1]}, "no type": {"coordinates": [RING]},
        "empty collection": {"type": "GeometryCollection", "geometries": []}, "collection of points": {"type": "GeometryCollection", "geometries": [{"type": "Point", "coordinates": [1, 2]}]},
        "collection of words": {"type": "GeometryCollection", "geometries": ["a"]}, "collection of null": {"type": "GeometryCollection", "geometries": None}, "list": [1, 2], "word": "polygon", "number": 3,
        "multipolygon of nothing": {"type": "MultiPolygon", "coordinates": []}, "multipolygon of points": {"type": "MultiPolygon", "coordinates": [RING]}, "deep": {"type": "Polygon", "coordinates": [[[[[[RING]]]]]]},
    }.items():  # fmt: skip
        yield from _both("GeoJSON", what, "bad.geojson", _geometry(geometry))
    for what, text in {
        "empty": "", "a word": "hello", "a list": "[1]", "a number": "3", "null": "null", "open": "{", "no features": '{"type": "FeatureCollection", "features": []}', "features no list": '{"type": "FeatureCollection", "features": {}}',
        "features null": '{"type": "FeatureCollection", "features": null}', "features of numbers": '{"type": "FeatureCollection", "features": [1, 2]}', "deep list": "[" * 100_000, "deep object": '{"a":' * 100_000, "binary": "\x00\x01\x02",
        "properties a list": json.dumps({**GEOJSON, "features": [{**GEOJSON["features"][0], "properties": [1]}]}), "crs a number": _geometry({"type": "Polygon", "coordinates": [RING]}, crs=3),
        "crs unknown": _geometry({"type": "Polygon", "coordinates": [RING]}, crs={"type": "name", "properties": {"name": "EPSG:999999"}}), "surrogate": '{"type": "\ud800"}', "UTF-16": json.dumps(GEOJSON).encode("utf-16"),
    }.items():  # fmt: skip
        for kind in _both("GeoJSON", what, "bad.geojson", text):
            yield Kind(
                kind.family,
                kind.name,
                kind.make,
                kind.words,
                not (("crs" in what or "UTF-16" in what) and "score" in kind.family)
                and not (what == "properties a list" and "berg" in kind.family),
            )
    coordinates = " ".join(f"{x},{y},0" for x, y in RING)
    for what, text in {
        "empty": "", "a word": "hello", "open": "<kml>", "no placemark": "<kml></kml>", "no coordinates": KML.replace(coordinates, ""), "two points": KML.replace(coordinates, "-39,-55 -38,-55"),
        "words": KML.replace(coordinates, "a,b c,d e,f"), "NaN": KML.replace(coordinates, "nan,nan -38,-55 -38,-54"), "one number": KML.replace(coordinates, "1 2 3"), "no boundary": KML.replace("outerBoundaryIs", "x"),
        "entities": '<!DOCTYPE k [<!ENTITY a "x"><!ENTITY b "&a;&a;&a;">]>' + KML.replace('<?xml version="1.0"?>', ""), "file entity": '<!DOCTYPE k [<!ENTITY a SYSTEM "file:///etc/passwd">]><kml>&a;</kml>',
        "encoding": KML.replace('version="1.0"', 'version="1.0" encoding="nonsense"'), "latitude 100": KML.replace(coordinates, "-39,-155 -38,-155 -38,-154"), "mixed hemispheres": KML.replace(coordinates, "-39,-55 -38,-55 -38,55 -39,55"),
        "deep": "<kml>" + "<Folder>" * 20_000 + "</Folder>" * 20_000 + "</kml>", "infinite": KML.replace(coordinates, "1e999,0 -38,-55 -38,-54"), "binary": "\x00\x01",
    }.items():  # fmt: skip
        yield from _both("KML", what, "bad.kml", text)


def tables() -> Iterator[Kind]:
    """Give impossible tables of outlines and of positions."""
    rows = CSV.splitlines()
    for what, text in {
        "empty": "", "header only": rows[0] + "\n", "no header": "\n".join(rows[1:]), "no columns": "a,b\n1,2\n", "one row": "\n".join(rows[:2]), "two rows": "\n".join(rows[:3]), "words": CSV.replace("-39.2", "west"),
        "NaN": CSV.replace("-39.2", "nan"), "infinite": CSV.replace("-39.2", "inf"), "empty cells": CSV.replace("-39.2", ""), "latitude 100": CSV.replace("-55.6", "-155.6"), "longitude 1000": CSV.replace("-39.2", "1000").replace("-38.8", "1001"),
        "no latitude": CSV.replace("lat", "height"), "columns twice": CSV.replace("vertex", "lat"), "no date": CSV.replace("2020-12-10", "soon"), "impossible date": CSV.replace("2020-12-10", "2020-02-31"), "short rows": CSV.replace(",-39.2", ""),
        "NUL": CSV.replace("-39.2", "\x00"), "binary": bytes(range(256)) * 10, "a long cell": CSV.replace("-39.2", "9" * 200_000), "one line": CSV.replace("\n", " "), "mixed hemispheres": CSV.replace("-55.4", "55.4"), "quote": CSV.replace("-39.2", '"-39.2', 1),
        "huge number": CSV.replace("-39.2", "1e308"), "number too long": CSV.replace("-39.2", "1e999"),
    }.items():  # fmt: skip
        for kind in _both("CSV", what, "bad.csv", text):
            mild = what in ("quote", "columns twice") or ("date" in what and "berg" in kind.family)
            yield Kind(kind.family, kind.name, kind.make, kind.words, not mild)
    for what, text in {
        "no date": TRACK.replace("2020-12-10", "soon"), "31 February": TRACK.replace("2020-12-10", "2020-02-31"), "no lat": TRACK.replace("lat", "x"), "words": TRACK.replace("-55.0", "south"), "latitude 100": TRACK.replace("-55.0", "-155"),
        "longitude 1000": TRACK.replace("-39.0", "1000"), "header only": "date,lat,lon\n", "all NaN": TRACK.replace("-55.0", "nan").replace("-55.1", "nan"), "negative area": TRACK.replace("lon", "lon,area_km2").replace("-39.0", "-39.0,-5"), "year 0": TRACK.replace("2020-12-10", "0000-12-10"),
        "year 10000": TRACK.replace("2020-12-10", "10000-12-10"), "no rows": "\n\n", "another year": TRACK.replace("2020", "1999"),
    }.items():  # fmt: skip
        yield Kind("track for score", what, _outlined("bad.csv", text, score=True), ("bad.csv", "observ"))


def archives() -> Iterator[Kind]:
    """Give archives and shapefiles that hold no outline, too much, or paths outside of themselves."""

    def zipped(*members: tuple[str, bytes]) -> bytes:
        import io

        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in members:
                archive.writestr(name, data)
        return buffer.getvalue()

    bomb = zipped(("berg.shp", bytes(200 * 2**20)))
    kml_bomb = zipped(("doc.kml", bytes(200 * 2**20)))
    good = zipped(("doc.kml", KML.encode()))
    for what, name, data in (
        ("empty archive", "bad.zip", zipped()), ("empty archive", "bad.kmz", zipped()), ("no shapefile", "bad.zip", zipped(("a.txt", b"x"))), ("no KML", "bad.kmz", zipped(("a.txt", b"x"))), ("bomb", "bad.zip", bomb),
        ("bomb", "bad.kmz", kml_bomb), ("path outside", "bad.zip", zipped(("../../berg.shp", b"x"))), ("path outside", "bad.kmz", zipped(("../x.kml", KML.encode()))), ("absolute path", "bad.zip", zipped(("/etc/berg.shp", b"x"))),
        ("empty shapefile", "bad.zip", zipped(("a.shp", b""), ("a.dbf", b""), ("a.shx", b""))), ("garbage shapefile", "bad.zip", zipped(("a.shp", b"x" * 200), ("a.dbf", b"y" * 200), ("a.shx", b"z" * 200))), ("no archive", "bad.zip", b"hello" * 20),
        ("no archive", "bad.kmz", b"hello" * 20), ("cut short", "bad.kmz", good[: len(good) // 2]), ("garbage KML", "bad.kmz", zipped(("doc.kml", b"\x00\x01"))), ("many files", "bad.zip", zipped(*((f"{k}.txt", b"") for k in range(3000)))),
        ("garbage", "bad.shp", b"x" * 500), ("zeros", "bad.shp", bytes(500)), ("magic only", "bad.shp", (9994).to_bytes(4, "big") + bytes(96)),
    ):  # fmt: skip
        yield from _both("archive", what, name, data)


def grids() -> Iterator[Kind]:
    """Give impossible masks and maps of thickness in NetCDF."""

    def masked(change: Callable[..., Any], key: str) -> Callable[[Path], list[str]]:
        def make(folder: Path) -> list[str]:
            copied(folder, "mask.nc")
            changed_nc(folder / "mask.nc", change)
            (folder / "mask.nc").rename(folder / "bad.nc")
            copied(folder, "mask.nc")
            if key == "score":
                copied(folder, "run.nc")
                return ["score", "run.nc", "bad.nc", "--no-figure", "-o", "scored"]
            new = {
                "mask": "mask: {file: bad.nc}",
                "thickness": "mask: {file: mask.nc}",
                "strength": "strength: {file: bad.nc}\n  rectangle: {length: 9 km, width: 6 km}",
            }[key]
            text = EXPERIMENT.replace("rectangle: {length: 9 km, width: 6 km}", new)
            (folder / "bad.yaml").write_text(
                text.replace("thickness: 200", "thickness: bad.nc") if key == "thickness" else text
            )
            return RUN

        return make

    def values(value: float) -> Callable[..., Any]:
        return lambda table, sizes, attributes: table["mask"].__setitem__(2, np.full_like(table["mask"][2], value))

    def axis(name: str, what: str) -> Callable[..., Any]:
        def change(table: Any, sizes: Any, attributes: Any) -> None:
            old = table[name][2]
            table[name][2] = {
                "NaN": old * np.nan,
                "equal": old * 0.0,
                "1e36": old + 1e36,
                "repeated": np.r_[old[:1], old[:-1]],
            }[what]

        return change

    def char(table: Any, sizes: Any, attributes: Any) -> None:
        table["mask"] = ["S1", table["mask"][1], np.full(table["mask"][2].shape, b"x"), {}]

    def no_axes(table: Any, sizes: Any, attributes: Any) -> None:
        del table["lon"]

    def no_mask(table: Any, sizes: Any, attributes: Any) -> None:
        del table["mask"]

    changes: dict[str, Callable[..., Any]] = {
        "all NaN": values(np.nan), "all 1e36": values(1e36), "infinite": values(np.inf), "all 0": values(0.0), "all -1": values(-1.0), "characters": char, "no longitude": no_axes, "no mask": no_mask,
        **{f"{n} {w}": axis(n, w) for n in ("lon", "lat") for w in ("NaN", "equal", "1e36", "repeated")},
    }  # fmt: skip
    for what, change in changes.items():
        for key in ("mask", "thickness", "strength", "score"):
            yield Kind(f"grid for {key}", what, masked(change, key), ("bad.nc",))


# --- options, files, outputs -------------------------------------------------------------------------------------------

BAD_NUMBERS = ("nan", "inf", "-inf", "0", "-1", "text", "", "1e400", "--", "1e-320")
OPTIONS: dict[str, tuple[list[str], dict[str, tuple[str, ...]]]] = {
    "run": (
        ["run", "good.yaml", "-q", "--no-map", "-o", "out"],
        {
            "--days": (*BAD_NUMBERS, "1e7", "1e300", "1e-9"), "--every": (*BAD_NUMBERS, "1e-6", "1e300"), "--grid": (*BAD_NUMBERS, "100"), "--numerics": ("", "none", "Own", "both,own"), "--resume": ("none.nc", ".", "/dev/zero", ""),
            "--data": ("none", "good.yaml", "/dev/null"), "--without": ("shoal", "", "x"), "--set": ("", "=", "a=b", "a.b=c", "stepping=3", "stepping.time_step", "stepping.time_step=", "stepping.time_step=nan", "stepping.time_step=1e400", "stepping.time_step=-3",
            "stepping.substeps=1e12", "stepping.substeps=1.5", "stepping.time_step=5 km^1000000", "stepping.time_step=1e-12", "bonds.packing=round", "fracture.enabled=maybe", "ice.density=1 kg", "stepping.fixed_velocity=1", "stepping.fixed_velocity=a,b", "bonds.youngs_modulus=1e300", "bonds.youngs_modulus=inf"),
            "--unknown": ("1",),
        },
    ),
    "plot": (["plot", "run.nc", "-o", "out"], {"--dpi": ("0", "-1", "1e9", "nan", "text", "99999"), "--kind": ("", "none", "Dates"), "--date": ("", "soon", "2020-02-31", "0000-01-01", "10000-01-01", "1" * 5000), "--observed": ("none.csv", ".", "/dev/zero", "run.nc", "good.yaml")}),
    "animate": (["animate", "run.nc", "-o", "f.gif", "-q"], {"--hours": (*BAD_NUMBERS, "1e-6", "1e300"), "--fps": ("0", "-1", "1000", "nan", "text"), "--dpi": ("0", "1e9", "text"), "--observed": ("none.csv", ".", "/dev/zero")}),
    "replay": (["replay", "run.nc", "-o", "r.html"], {"--largest": ("0", "-1", "nan", "-inf", "text", "inf"), "--observed": ("none.csv", ".", "run.nc")}),
    "score": (["score", "run.nc", "seen.csv", "--no-figure", "-o", "out"], {"--hour": ("nan", "-1", "25", "inf", "text"), "--between": ("", "a,b", "2020-12-10", "2020-12-12,2020-12-10", ",", "2020-02-31,2020-03-01", "1,2,3"), "--together": ("a", "1.5", "1,,x", "nan", "99", "-1", "1" * 5000), "--date": ("soon",), "--variable": ("none",)}),
    "why": (["why", "run.nc", "--no-figure", "-o", "out"], {"--experiment": ("none", "none.yaml"), "--data": ("none",)}),
    "compare": (["compare", "whole", "whole"], {"--observed": ("none.csv", ".", "/dev/zero", "good.yaml")}),
    "doctor": (["doctor", "ocean.nc"], {"--lon": ("", "1", "a,b", "nan,1", "-38,-40", "1000,1001", "1,2,3", "inf,inf"), "--lat": ("", "1", "-100,100", "nan,nan", "-54,-56"), "--time": ("", "soon", "2020-12-10,2020-12-09", "2020-13-01,2020-14-01", "a,b,c"), "--for": ("none", "none.yaml", ".", "good.yaml"), "--along": ("none.nc", "ocean.nc", "/dev/zero"), "--product": ("none", ""), "--need": ("", "nothing")}),
    "fetch": (["fetch", "glorys", "-o", "out"], {"--lon": ("", "a", "1", "nan,nan", "5,1"), "--lat": ("", "a", "100,200", "5,1"), "--time": ("", "soon", "a,b"), "--depth": ("nan", "-1", "inf", "text"), "--fields": ("none", "")}),
    "kid": (["kid", "case", "-q"], {"-o": ("/proc/none/out.nc", "case/input.nml", "case/INPUT/icebergs.res.nc", "run.nc/out.nc")}),
}  # fmt: skip
OPTIONAL = {
    ("replay", "--largest", "inf"), ("why", "--experiment", "none"), ("why", "--experiment", "none.yaml"), ("why", "--data", "none"),
    ("plot", "--date", "0000-01-01"), ("score", "--together", "99"), ("score", "--together", "-1"), ("score", "--date", "soon"), ("score", "--variable", "none"),
    ("score", "--between", ""), ("doctor", "--product", ""), ("doctor", "--need", ""), ("doctor", "--need", "nothing"), ("doctor", "--lon", ""),
}  # fmt: skip


def _optional(command: str, option: str, value: str) -> bool:
    """Whether an option may pass: it is not used by this call, or only asks for more than there is."""
    return (command, option, value) in OPTIONAL


def options() -> Iterator[Kind]:
    """Give impossible values of the options of every command."""
    for command, (arguments, given) in OPTIONS.items():
        for option, values in given.items():
            for value in values:

                def make(
                    folder: Path, arguments: list[str] = arguments, option: str = option, value: str = value
                ) -> list[str]:
                    copied(folder, "good.yaml", "run.nc", "ocean.nc", "case")
                    (folder / "whole").mkdir()
                    copied(folder / "whole", "run.nc", "summary.json")
                    (folder / "seen.csv").write_text(TRACK)
                    return [*arguments, f"{option}={value}"] if option.startswith("--") else [*arguments, option, value]

                words = (option, option.lstrip("-"), value[:20]) if value else (option, option.lstrip("-"))
                yield Kind(
                    f"option of {command}",
                    f"{option} {value[:30]!r}",
                    make,
                    (*words, "good.yaml", "wind", "substeps", "time_step", "parameters", "restart", "fetch"),
                    not _optional(command, option, value),
                )


SLOTS: dict[str, tuple[str, list[str]]] = {
    "experiment": ("bad.yaml", RUN), "restart": ("bad.nc", [*RESUME[:-1], "bad.nc"]), "run file of plot": ("bad.nc", ["plot", "bad.nc", "-o", "out"]), "run file of why": ("bad.nc", ["why", "bad.nc", "-o", "out"]),
    "run file of replay": ("bad.nc", ["replay", "bad.nc", "-o", "r.html"]), "run file of animate": ("bad.nc", ["animate", "bad.nc", "-o", "f.gif"]), "run file of score": ("bad.nc", ["score", "bad.nc", "seen.csv", "-o", "out"]),
    "run file of compare": ("bad.nc", ["compare", "bad.nc"]), "observations": ("bad.csv", ["score", "run.nc", "bad.csv", "-o", "out"]), "observed GeoJSON": ("bad.geojson", ["score", "run.nc", "bad.geojson", "-o", "out"]),
    "observed mask": ("bad.nc", ["score", "run.nc", "bad.nc", "-o", "out"]), "observed KML": ("bad.kml", ["score", "run.nc", "bad.kml", "-o", "out"]), "observed shapefile": ("bad.shp", ["score", "run.nc", "bad.shp", "-o", "out"]),
    "observed in a plot": ("bad.csv", ["plot", "run.nc", "--observed", "bad.csv", "-o", "out"]), "forcing": ("bad.nc", ["doctor", "bad.nc"]), "namelist": ("case/input.nml", KID), "KID restart": ("case/INPUT/icebergs.res.nc", KID), "KID bonds": ("case/INPUT/bonds_iceberg.res.nc", KID),
}  # fmt: skip


def files() -> Iterator[Kind]:
    """Give what is no plain file where a file is read."""
    for slot, (name, arguments) in SLOTS.items():
        for what in (
            "missing",
            "folder",
            "zeros device",
            "null device",
            "pipe",
            "empty",
            "binary",
            "text",
            "zeros",
            "broken link",
            "circle of links",
        ):

            def make(folder: Path, name: str = name, arguments: list[str] = arguments, what: str = what) -> list[str]:
                copied(folder, "good.yaml", "run.nc", "case")
                (folder / "seen.csv").write_text(TRACK)
                path = folder / name
                path.unlink(missing_ok=True)
                if what == "folder":
                    path.mkdir()
                elif what.endswith("device"):
                    path.symlink_to("/dev/zero" if what == "zeros device" else "/dev/null")
                elif what == "pipe":
                    os.mkfifo(path)
                elif what == "broken link":
                    path.symlink_to("nowhere")
                elif what == "circle of links":
                    path.symlink_to(path.name)
                elif what != "missing":
                    path.write_bytes(
                        {
                            "empty": b"",
                            "binary": random.Random(3).randbytes(5000),
                            "text": b"hello, this is a text\n" * 20,
                            "zeros": bytes(5000),
                        }[what]
                    )
                if arguments[0] == "kid":
                    (folder / "out").mkdir()
                return arguments

            yield Kind(
                "input file",
                f"{slot}: {what}",
                make,
                (Path(name).name, str(Path(arguments[1]).name)),
                slot != "forcing" or what != "folder",
            )
    for what, value in (
        ("long name", "x" * 300 + ".yaml"),
        ("zero byte", "a\0b.yaml"),
        ("under a file", "good.yaml/x.yaml"),
        ("empty name", ""),
        ("control characters", "a\x1b[31m.yaml"),
    ):

        def named(folder: Path, value: str = value) -> list[str]:
            copied(folder, "good.yaml")
            return ["run", value, "-o", "out"]

        yield Kind("input file", f"experiment: {what}", named, ("x.yaml", "yaml", "experiment"))


def outputs() -> Iterator[Kind]:
    """Give places that cannot be written."""
    commands: dict[str, tuple[list[str], str]] = {
        "run": (["run", "good.yaml", "-q", "--no-map"], "run.nc"), "plot": (["plot", "run.nc", "--kind", "timeline"], "timeline.png"), "why": (["why", "run.nc", "--no-figure"], "why.json"), "score": (["score", "run.nc", "seen.csv", "--no-figure"], "score.json"),
        "compare": (["compare", "whole", "whole"], "comparison.json"), "replay": (["replay", "run.nc"], ""), "animate": (["animate", "run.nc", "-q", "--hours", "24"], ""), "kid": (["kid", "case", "-q"], ""), "fetch": (["fetch", "glorys", "--lon", "1,2", "--lat", "1,2", "--time", "2020-01-01,2020-01-02"], ""),
    }  # fmt: skip
    for command, (arguments, file) in commands.items():
        for what in (
            "under a file",
            "read-only place",
            "device",
            "file where a folder goes",
            "folder where a file goes",
            "input",
            "long name",
            "missing in /proc",
        ):

            def make(folder: Path, arguments: list[str] = arguments, file: str = file, what: str = what) -> list[str]:
                copied(folder, "good.yaml", "run.nc", "case")
                (folder / "whole").mkdir()
                copied(folder / "whole", "run.nc", "summary.json")
                (folder / "seen.csv").write_text(TRACK)
                (folder / "taken").mkdir()
                (folder / "taken" / (file or "folder.html")).mkdir()
                place = {
                    "under a file": "good.yaml/out", "read-only place": "/sys/riftberg", "device": "/dev/null/out", "file where a folder goes": "good.yaml" if file else "good.yaml/a.gif", "folder where a file goes": "taken" if file else "taken/folder.html",
                    "input": "run.nc" if arguments[0] != "kid" else "case/input.nml", "long name": "x" * 300, "missing in /proc": "/proc/riftberg/out",
                }[what]  # fmt: skip
                return [*arguments, "-o", place]

            same = what == "input" and command in ("fetch",)
            folder_is_fine = what == "folder where a file goes" and command in ("kid", "fetch")
            yield Kind(
                f"output of {command}",
                what,
                make,
                ("-o", "--output", "good.yaml", "run.nc", "taken", "x", "/", "copernicusmarine"),
                not (same or folder_is_fine),
            )


# --- mutations ---------------------------------------------------------------------------------------------------------


def mutations(seeds: int) -> Iterator[Kind]:
    """Give files with some bytes changed; some of them stay good."""
    for seed in range(seeds):
        yield text_kind("mutated YAML", f"seed {seed}", flipped(EXPERIMENT.encode(), seed), (), False)
        yield Kind("mutated run file", f"seed {seed}", _mutated_run(seed), (), False)
        yield Kind(
            "mutated restart", f"seed {seed}", _mutated("good.restart.nc", "bad.restart.nc", RESUME, seed), (), False
        )
        yield Kind("mutated KID restart", f"seed {seed}", _mutated_kid("icebergs.res.nc", seed), (), False)
        yield Kind("mutated KID bonds", f"seed {seed}", _mutated_kid("bonds_iceberg.res.nc", seed), (), False)
        yield Kind("mutated namelist", f"seed {seed}", _mutated_kid("input.nml", seed), (), False)
        yield Kind(
            "mutated forcing", f"seed {seed}", _mutated("ocean.nc", "bad.nc", ["doctor", "bad.nc"], seed), (), False
        )
        for name, text in (("bad.geojson", json.dumps(GEOJSON)), ("bad.kml", KML), ("bad.csv", CSV)):
            score = bool(seed % 2)
            yield Kind(
                f"mutated {name[4:]}",
                f"seed {seed}",
                _outlined(name, flipped(text.encode(), seed), score=score),
                (),
                False,
            )


def _mutated(source: str, target: str, arguments: list[str], seed: int) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        copied(folder, "good.yaml")
        data = (store() / source).read_bytes()
        # Half of the seeds strike the header, where they do most.
        (folder / target).write_bytes(flipped(data, seed, where=(0, min(len(data), 4096)) if seed % 2 else None))
        return arguments

    return make


def _mutated_run(seed: int) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        (folder / "bad").mkdir()
        (folder / "seen.csv").write_text(TRACK)
        copied(folder, "ocean.nc")
        copied(folder / "bad", "summary.json")
        data = (store() / "run.nc").read_bytes()
        (folder / "bad" / "run.nc").write_bytes(flipped(data, seed, where=(0, 8192) if seed % 2 else None))
        return READERS[(0, 1, 3, 4)[seed // 2 % 4]]

    return make


def _mutated_kid(file: str, seed: int) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        copied(folder, "case")
        path = folder / "case" / file if file.endswith(".nml") else folder / "case" / "INPUT" / file
        data = path.read_bytes()
        path.write_bytes(flipped(data, seed, where=(0, len(data) // 2) if seed % 2 else None, count=1 + seed % 3))
        (folder / "out").mkdir()
        return KID

    return make
