"""All that is wrong with a file is told at once, in words of our own; every form that the docs offer is taken."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from keys import SECTIONS, keys, nested
from riftberg import Parameters, build
from riftberg.cli.main import app
from riftberg.config.values import given, moment, parse_date
from riftberg.errors import InputError
from riftberg.experiments.changes import parse_settings
from riftberg.experiments.yaml_file import build_berg, read_file
from riftberg.parameters import ExplicitParameters, QuasiStaticParameters

SLAB = """\
start: 2020-12-09 13:00
days: 0.0625
berg:
  rectangle: {length: 12 km, width: 6 km}
  placement: [-39.0, -55.5]
forcing:
  kind: formula
  uniform: {current: [0.2, 0.0]}
"""

FIVE = """\
start: 2020-12-09 13:00
days: -2
colour: red
berg:
  rectangle: {lenght: 12 km, width: 6 kg}
  placement: [-39.0, -55.5]
forcing:
  kind: formula
  eddy: {centre: [-39, -55], radius: -3, speed: 0.5}
parameters:
  fracture: {normal_strength: 18 m}
  stepping: {time_step: -30}
"""

FOREIGN = re.compile(
    r"Input should|should be|should match|should have|String|pydantic|[Uu]nable to|valid (number|string|integer|dictionary|list)"
    r"|Value error|Field required|type=|ensure this|unexpected keyword"
)
"""Words of pydantic."""


def written(folder: Path, text: str) -> Path:
    path = folder / "own.yaml"
    path.write_text(text)
    return path


def answer(call: Callable[[], object]) -> str:
    """Return what a refusal says; nothing where none came."""
    try:
        call()
    except InputError as error:
        return str(error)
    return ""


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_file(path)
    assert not FOREIGN.search(str(caught.value)), str(caught.value)
    return str(caught.value)


def test_five_faults_are_told_at_once_each_with_its_line(tmp_path: Path) -> None:
    told = refusal(written(tmp_path, FIVE)).splitlines()
    assert told[0].startswith("7 things are wrong:")
    places = [
        "line 2, days: -2 is not possible. Allowed: a number > 0",
        "line 3, colour: there is no such key",
        "line 5, berg.rectangle.lenght: there is no such key. Did you mean 'length'?",
        "line 5, berg.rectangle.width: '6 kg' is in kg",
        "line 9, forcing.eddy.0.radius: -3 is not possible",
        "line 11, parameters.fracture.normal_strength: '18 m' is in m",
        "line 12, parameters.stepping.time_step: -30 is not possible. Allowed: a number > 0, in s or none (time step)",
    ]
    assert len(told) == 1 + len(places)  # `length` is misspelt, not missing: that is told once
    for line, words in zip(told[1:], places, strict=True):
        assert words in line


KEYS_ONCE = {
    "bergs that are none": (f"bergs: [{', '.join(['1'] * 12)}]", "It has the keys radius, packing"),
    "points of a rift that are none": (
        f"berg: {{rectangle: {{length: 1e4, width: 1e4}}, placement: [-39, -55], rifts: {{points: [{', '.join(['1'] * 12)}]}}}}",
        "Allowed: a list",
    ),
    "keys that are not known": (
        "berg: {aaa: 1, bbb: 2, ccc: 3, placement: [-39, -55]}",
        "Allowed here: radius, packing",
    ),
}


@pytest.mark.parametrize("case", KEYS_ONCE)
def test_what_would_be_right_for_many_faults_is_said_once_at_the_end(case: str, tmp_path: Path) -> None:
    """Ten bergs that were numbers had the nineteen keys of a berg ten times."""
    bergs, keys = KEYS_ONCE[case]
    told = refusal(written(tmp_path, f"{bergs}\ndays: 1\nstart: 2020-12-09\nforcing: {{uniform: {{}}}}\n"))
    assert told.count(keys) == 1
    assert len(told) < 1500
    faults = [line for line in told.splitlines() if line.startswith("  own.yaml") or "own.yaml, line" in line]
    assert keys in [line for line in faults if keys in line or "berg" in line][-1]


def test_a_hint_to_one_name_stays_with_its_fault(tmp_path: Path) -> None:
    text = "berg: {thicknes: 1, radus: 2, ccc: 3, placement: [-39, -55]}\ndays: 1\nstart: 2020-12-09\nforcing: {uniform: {}}\n"
    told = refusal(written(tmp_path, text)).splitlines()
    for name in ("thickness", "radius"):
        assert sum(f"Did you mean '{name}'?" in line for line in told) == 1
    assert sum("Allowed here:" in line for line in told) == 1


def test_faults_of_settings_and_of_parameters_in_python_are_told_at_once() -> None:
    with pytest.raises(InputError) as caught:
        parse_settings(["stepping.time_stp=900", "ice.density=18 m", "fracture.normal_strength=20 kPa"])
    assert "time_stp" in str(caught.value)
    assert "ice.density=18 m" in str(caught.value)
    with pytest.raises(InputError) as caught:
        Parameters(fracture={"normal_strength": "18 m", "shear_strength": "x"}, ice={"density": -1})
    for name in ("fracture.normal_strength", "fracture.shear_strength", "ice.density"):
        assert name in str(caught.value)


def test_places_and_spans_are_told_with_the_rest(tmp_path: Path) -> None:
    text = (
        SLAB.replace("-55.5", "-95.5")
        .replace("2020-12-09 13:00", "1500-01-01")
        .replace("placement", "rotaton: 3\n  placement")
    )
    told = refusal(written(tmp_path, text.replace("  rotaton: 3\n", "")))
    assert "latitude -95.5 has no sea" in told
    assert "Runs lie in the years" in told


@pytest.mark.parametrize("step", ["-30", "-30 min", "0", "-1e-300"])
def test_a_negative_step_is_answered_in_plain_words(step: str, tmp_path: Path) -> None:
    """In brackets stood half of a sentence about schemes."""
    told = refusal(written(tmp_path, SLAB + f"parameters: {{stepping: {{time_step: {step}}}}}\n"))
    assert told.endswith("is not possible. Allowed: a number > 0, in s or none (time step)")


WRONG: list[Any] = [
    float("nan"), float("inf"), -1e400, -1, 1e300, 2.5, "", "abc", "1 kg", "9" * 400, True, None, [], {}, [1, 2, 3], ["a", None],
    [[1, 2], [3]], {"a": 1}, datetime(2020, 1, 1), object(), b"bytes", [float("nan")] * 2, 10**30,
]  # fmt: skip
ENGINES = (QuasiStaticParameters, ExplicitParameters)
GROUPS_OF_PARAMETERS = [
    group for engine in ENGINES for field in keys(engine).values() for group in nested(field.annotation)
]
FIELDS = [(section, name) for section in dict.fromkeys((*SECTIONS, *GROUPS_OF_PARAMETERS)) for name in keys(section)]


@pytest.mark.quick(100)
@pytest.mark.parametrize(("section", "name"), FIELDS, ids=lambda part: part if isinstance(part, str) else part.__name__)
def test_no_word_of_pydantic_answers_a_wrong_value(section: type, name: str) -> None:
    answers = [answer(partial(given, value, section, name)) for value in WRONG]
    assert sum(map(bool, answers)) >= 3
    for told in answers:
        assert not FOREIGN.search(told), told
        assert len(told) < 700


TEXTS = [
    ".nan",
    ".inf",
    "-1",
    "abc",
    "[]",
    "{}",
    "[1, 2, 3]",
    "true",
    "2020-01-01",
    "1 kg",
    "''",
    "[[1, 2], [3]]",
    "{a: 1}",
]
PLACES = [
    "days: {}", "name: {}", "start: {}", "output_cells: {}", "bergs: {}", "parameters: {}", "berg: {}", "forcing: {}",
    "berg: {{rectangle: {}}}", "berg: {{rifts: {}}}", "berg: {{strength: {}}}", "berg: {{outline: {}}}", "berg: {{lattice: {}}}",
    "forcing: {{kind: formula, eddy: {}}}", "forcing: {{kind: formula, uniform: {}}}", "forcing: {{kind: files, files: {}}}",
    "parameters: {{ice: {}}}", "parameters: {{calving: {{south: {}}}}}", "parameters: {{stepping: {{fixed_velocity: {}}}}}",
    "parameters: {{preset: {}}}",
]  # fmt: skip


@pytest.mark.quick(8)
@pytest.mark.parametrize("place", PLACES)
def test_a_wrong_value_anywhere_in_a_file_is_refused_in_our_words(place: str, tmp_path: Path) -> None:
    key = place.partition(":")[0]
    kept = [block for block in re.split(r"(?m)^(?=\w)", SLAB) if not block.startswith(f"{key}:")]
    refused = 0
    for text in TEXTS:
        path = written(tmp_path, "".join(kept) + place.format(text) + "\n")
        told = answer(partial(read_file, path))
        assert not FOREIGN.search(told), told
        assert not told or str(path) in told
        refused += bool(told)
    assert refused >= 6


@pytest.mark.parametrize("word", ["abc", "1e999", "1,5", "٣٫٥"])
@pytest.mark.parametrize("option", [("run", "--days"), ("animate", "--fps"), ("score", "--hour")])
def test_options_that_are_numbers_are_refused_in_our_words(word: str, option: tuple[str, str]) -> None:
    """Typer takes its words from pydantic too."""
    command, name = option
    result = CliRunner().invoke(app, [command, "a", *(["b"] if command == "score" else []), name, word])
    assert result.exit_code == 2
    assert not FOREIGN.search(" ".join(result.output.replace("│", " ").split())), result.output


BEYOND = ["0001-01-01T00:00:00+02:00", "9999-12-31T23:00:00-02:00", "0001-01-01T05:00:00+14:00"]


@pytest.mark.parametrize("text", BEYOND)
def test_dates_outside_all_years_once_their_zone_is_taken_off_are_refused(text: str, tmp_path: Path) -> None:
    """They ended in an OverflowError, from a file, in Python, and in a table of observations."""
    for quoted in (text, f'"{text}"'):
        assert "lies outside the years 1 to 9999" in refusal(
            written(tmp_path, SLAB.replace("2020-12-09 13:00", quoted))
        )
    with pytest.raises(InputError, match="lies outside the years 1 to 9999"):
        moment(text, where="start")
    with pytest.raises(InputError, match="lies outside the years 1 to 9999"):
        parse_date(text, where="table")


def test_a_day_of_the_year_beyond_all_years_is_no_date() -> None:
    with pytest.raises(InputError, match="is not a date"):
        parse_date("9999999")


FORMULAS = {
    "eddy": "{centre: [-39, -55], radius: 30 km, speed: 0.5}",
    "tide": "{major: 0.3}",
    "uniform": "{current: [0.2, 0.1]}",
    "seamount": "{centre: [-39, -55], height: 300, width: 5 km, depth: 1000}",
}


@pytest.mark.parametrize("name", FORMULAS)
def test_a_formula_is_a_section_or_a_list_of_sections(name: str, tmp_path: Path) -> None:
    """As the docs say; a section was refused for every formula but one, which refused a list."""
    head = SLAB[: SLAB.index("  kind")]
    alone = build(str(written(tmp_path, f"{head}  kind: formula\n  {name}: {FORMULAS[name]}\n")))[0].forcing.describe()
    listed = build(str(written(tmp_path, f"{head}  kind: formula\n  {name}: [{FORMULAS[name]}]\n")))[
        0
    ].forcing.describe()
    twice = build(str(written(tmp_path, f"{head}  kind: formula\n  {name}: [{FORMULAS[name]}, {FORMULAS[name]}]\n")))
    assert alone == listed
    assert len(twice[0].forcing.parts) == 2  # type: ignore[attr-defined]
    empty = refusal(written(tmp_path, f"{head}  kind: formula\n  {name}: []\n"))
    assert "no formula is given" in empty


def test_a_file_stands_for_a_section_with_a_file(tmp_path: Path) -> None:
    (tmp_path / "berg.csv").write_text("lon,lat\n-39,-55\n-38.5,-55\n-38.5,-54.8\n-39,-54.8\n")
    (tmp_path / "rift.csv").write_text("lon,lat\n-38.8,-55.2\n-38.8,-54.5\n")
    text = SLAB.replace("  rectangle: {length: 12 km, width: 6 km}\n  placement: [-39.0, -55.5]\n", "{}")

    def berg(keys: str) -> Any:
        experiment, parameters, _ = read_file(written(tmp_path, text.replace("{}", keys)))
        return build_berg(experiment, parameters, tmp_path)

    full = berg("  outline: {file: berg.csv}\n  rifts: [{file: rift.csv}]\n")
    short = berg("  outline: berg.csv\n  rifts: rift.csv\n")
    assert (short.elements.lon == full.elements.lon).all()
    assert (short.bonds.strength == full.bonds.strength).all()
    assert (full.bonds.strength < 1.0).any()
    for other in ("mask: berg.csv", "shelf: berg.csv"):
        assert "has 2 shapes" in refusal(written(tmp_path, text.replace("{}", f"  outline: berg.csv\n  {other}\n")))
    mapped = read_file(written(tmp_path, text.replace("{}", "  outline: berg.csv\n  strength: map.nc\n")))[0]
    assert mapped.berg is not None
    assert mapped.berg.strength is not None
    assert mapped.berg.strength.file == "map.nc"


def test_one_file_of_forcing_needs_no_brackets(tmp_path: Path) -> None:
    head = SLAB[: SLAB.index("  kind")]
    box = "  longitude: [-41, -37]\n  latitude: [-57, -54]\n"
    for files in ("a.nc", "{file: a.nc}"):
        forcing = read_file(written(tmp_path, f"{head}  kind: files\n  files: {files}\n{box}"))[0].forcing
        assert [entry.file for entry in forcing.entries]  # type: ignore[union-attr] == ["a.nc"]


def test_what_the_lattice_loses_is_told_on_the_command_line(tmp_path: Path) -> None:
    """Up to 5.5 % of area and mass went without a word. A square of 5 km takes one, two or four elements of 3 km, never three."""
    out = ["--no-map", "-o", str(tmp_path / "out")]
    path = written(tmp_path, SLAB.replace("length: 12 km, width: 6 km", "length: 5 km, width: 5 km"))
    told = CliRunner().invoke(app, ["run", str(path), *out])
    assert told.exit_code == 0, told.output
    assert "Asked for 25 km2 and 4.25 Gt; the lattice has " in told.stderr
    assert "%). A smaller berg.radius comes closer" in told.stderr
    two = (
        SLAB.replace("berg:\n", "bergs:\n")
        .replace("  rectangle", "  - rectangle")
        .replace("  placement", "    placement")
    )
    two = two.replace("forcing:", "  - {rectangle: {length: 5 km, width: 5 km}, placement: [-36, -55]}\nforcing:")
    assert build(str(written(tmp_path, two)))[1].made.startswith("Asked for 97 km2")


def test_a_lattice_with_the_area_of_its_shape_says_nothing(tmp_path: Path) -> None:
    """13 km x 6.4 km were 90 km2 of ice; now the elements are stretched to the 83.2 km2 that were asked for."""
    path = written(tmp_path, SLAB.replace("length: 12 km, width: 6 km", "length: 13 km, width: 6.4 km"))
    model, info = build(str(path))
    area = (model.elements.length * model.elements.width).sum()
    assert area == pytest.approx(83.2e6, rel=1e-9)
    assert (info.made, info.loses) == ("", False)


def test_pieces_that_the_lattice_loses_are_told(tmp_path: Path) -> None:
    ring = [[-39.0, -55.0], [-38.5, -55.0], [-38.5, -54.8], [-39.0, -54.8], [-39.0, -55.0]]
    small = [[-37.0, -55.0], [-36.99, -55.0], [-36.99, -54.995], [-37.0, -54.995], [-37.0, -55.0]]
    (tmp_path / "two.geojson").write_text(f'{{"type": "MultiPolygon", "coordinates": [[{ring}], [{small}]]}}')
    text = SLAB.replace(
        "  rectangle: {length: 12 km, width: 6 km}\n  placement: [-39.0, -55.5]\n", "  outline: two.geojson\n"
    )
    assert ", in 1 of 2 pieces" in build(str(written(tmp_path, text)))[1].made


@pytest.mark.parametrize(("old", "new"), [("length: 12 km", "length: 1e300"), ("  placement", "  radius: 1e300\n  placement"),
                                          ("  placement", "  thickness: 1e300\n  placement")])  # fmt: skip
def test_sizes_whose_squares_are_no_numbers_are_refused(old: str, new: str, tmp_path: Path) -> None:
    """A radius of 1e300 m ended in an OverflowError."""
    told = CliRunner().invoke(app, ["run", str(written(tmp_path, SLAB.replace(old, new))), "-q"])
    assert told.exit_code == 2, told.output


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        ("[1, 2]", "2 things are wrong:"),
        ("[a.nc, {file: 3}]", "forcing.files.1.file: 3 is not possible"),
        ("[{fil: a.nc}]", "forcing.files.0.fil: there is no such key. Did you mean 'file'?"),
        ("[[a.nc]]", "forcing.files.0: ['a.nc'] is not a section. It has the keys file, product"),
        ("[" + "1, " * 2000 + "1]", "and 1991 more"),
    ],
)
def test_an_entry_that_may_be_a_text_or_a_section_has_one_fault_in_our_words(
    tmp_path: Path, entries: str, said: str
) -> None:
    """Each was told twice, with the names that pydantic has for the alternatives; of 2000 there were 4 kB."""
    text = (
        SLAB[: SLAB.index("  kind")]
        + f"  kind: files\n  files: {entries}\n  longitude: [-40, -38]\n  latitude: [-56, -55]\n"
    )
    with pytest.raises(InputError) as told:
        read_file(written(tmp_path, text))
    assert said in str(told.value)
    assert not re.search(r"\.str\b|function-after|NamedFiles", str(told.value))
    assert len(str(told.value)) < 200 * (1 + min(10, entries.count("1")))
