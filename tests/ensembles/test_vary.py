"""What is varied is read and checked before the first run, in one sentence."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from riftberg import Forcing, Iceberg, Model, sweep
from riftberg.cli.main import app
from riftberg.ensembles.vary import Draws, list_members, read_varied
from riftberg.errors import InputError

from .made import small_berg


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("fracture.normal_strength=14..24kPa:11", tuple(1e3 * k for k in range(14, 25))),
        ("fracture.normal_strength=14 kPa..24 kPa:3", (14e3, 19e3, 24e3)),
        ("fracture.normal_strength=14000..24000:2", (14e3, 24e3)),
        ("fracture.normal_strength=14,18,24kPa", (14e3, 18e3, 24e3)),
        ("fracture.normal_strength=14 Pa, 0.1 MPa", (14.0, 1e5)),
        ("damage.enabled=true,false", (True, False)),
        ("grounding.law=linear,quadratic", ("linear", "quadratic")),
        ("stepping.substeps=30..90:3", (30, 60, 90)),
        ("stepping.time_step=15..30min:2", (900.0, 1800.0)),
        ("bonds.poisson=-0.1..0.3:3", (-0.1, 0.1, 0.3)),
    ],
)
def test_values(text: str, values: tuple[Any, ...]) -> None:
    (varied,) = read_varied([text])
    assert varied.values == pytest.approx(values) if isinstance(values[0], float) else varied.values == values


def test_lists_arrays_and_texts_in_python() -> None:
    strengths = np.linspace(14e3, 24e3, 3)
    vary = {
        "fracture.normal_strength": strengths,
        "damage.threshold": "0.1..0.3:2",
        "stepping.time_step": ["15 min", 1800],
    }
    members = list_members(read_varied(vary))
    assert len(members) == 12
    assert members[0] == {"fracture.normal_strength": 14e3, "damage.threshold": 0.1, "stepping.time_step": 900.0}
    assert members[1]["stepping.time_step"] == 1800.0  # the last one changes fastest
    assert members[-1] == {"fracture.normal_strength": 24e3, "damage.threshold": 0.3, "stepping.time_step": 1800.0}


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ([], "nothing is varied"),
        (["fracture.normal_strength"], "not of the form group.name=values"),
        (["strength=1,2"], "not of the form group.name"),
        (["fracture.normal_strenth=1,2"], "no parameter 'normal_strenth'. Did you mean 'normal_strength'"),
        (["fractur.normal_strength=1,2"], "no group of parameters is called 'fractur'"),
        (["fracture.normal_strength=14..24kPa"], "does not say how many values"),
        (["fracture.normal_strength=14..24kPa:1"], "'1' is no number of values"),
        (["fracture.normal_strength=14..24kPa:2.5"], "'2.5' is no number of values"),
        (["fracture.normal_strength=24..14kPa:3"], "is not below"),
        (["fracture.normal_strength=14kPa..24000:3"], "24000 has no unit, but 14kPa has"),
        (["stepping.time_step=10 min,900"], "900 has no unit, but 10 min has"),
        (["fracture.normal_strength=14..24m:3"], "is in m, but this is measured in Pa"),
        (["fracture.normal_strength=14..24parsec:3"], "is not a unit that Riftberg knows"),
        (["fracture.normal_strength=soft..hard:3"], "'soft' is not a number"),
        (["fracture.normal_strength=14,14"], "stands twice"),
        (["fracture.normal_strength=14,15", "fracture.normal_strength=16,17"], "is varied twice"),
        (["stepping.time_step=-5,900"], "-5.0 is not possible"),
        (["stepping.substeps=1..2:3"], "no whole numbers"),
        (["fracture.enabled=0..1:2"], "a range of what is no number"),
        (["grounding.law=linear,cubic"], "'cubic' is not possible"),
        (["stepping.fixed_velocity=1,2"], "Allowed: 2 numbers"),
        (["fracture.normal_strength=14..24kPa:100000"], "this asks for 100000 members"),
        (["fracture.normal_strength=1..2:200", "fracture.shear_strength=1..2:200"], "this asks for 40000 members"),
        ({"fracture.normal_strength": 5.0}, "is no list of values"),
        ({"fracture.normal_strength": []}, "no values"),
        ({"fracture.normal_strength": [True]}, "true is no number"),
        ([5], "5 is no text"),
    ],
)  # fmt: skip
def test_what_cannot_be_varied_is_refused(vary: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        list_members(read_varied(vary))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


def test_what_the_documentation_varies_can_be_varied() -> None:
    docs = Path(__file__).parents[2] / "docs"
    pages = "\n".join(page.read_text() for page in (*docs.rglob("*.md"), docs.parent / "README.md"))
    written = re.findall(r"--vary '?([a-z_]+\.[a-z_]+[~=][^'\n`]+?)(?:'| -|\n|`)", pages)
    assert len(written) >= 7
    for text in written:
        assert read_varied([text.strip()])


def drifting(speed: float) -> Model:
    berg = Iceberg.rectangle("3 km", "3 km", thickness=200.0, placement=(-37.0, -56.0))
    return Model(berg, Forcing.uniform(current=(speed, 0.0), slope=(0.0, 0.0)), start="2020-12-09")


def test_the_ends_of_what_is_drawn_and_all_listed_combinations_are_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To check every one of 10,000 draws took half a minute."""
    texts = ["fracture.normal_strength~uniform(10, 20 kPa)", "damage.enabled=true,false"]
    members = list_members(read_varied(texts), Draws(32))
    checked: list[float] = []

    def note(parameters: object, values: dict[str, dict[str, float]], *, where: str) -> None:
        checked.append(values["fracture"]["normal_strength"])

    monkeypatch.setattr("riftberg.ensembles.sweep.changed", note)
    sweep(drifting, {"speed": [0.1]}, days="1 h", workers=0, output=tmp_path)  # which is in the way of the first run
    with pytest.raises(InputError, match="holds a sweep"):
        sweep("a68a", texts, members=32, workers=0, output=tmp_path)
    drawn = [member["fracture.normal_strength"] for member in members]
    assert {min(drawn), max(drawn)} <= set(checked)
    assert 2 <= len(checked) <= 4


def test_members_are_plain_values_however_they_are_kept() -> None:
    varied = read_varied({"start.strength": [1.0, 2.0], "stepping.substeps": [3], "damage.enabled": [True, False]})
    members = list_members(varied)
    assert len(members) == 4
    assert members[-1] == members[3] == {"start.strength": 2.0, "stepping.substeps": 3, "damage.enabled": False}
    assert {name: type(value) for name, value in members[0].items()} == {
        "start.strength": float, "stepping.substeps": int, "damage.enabled": bool,
    }  # fmt: skip
    assert members[1:3] == list(members)[1:3]
    with pytest.raises(IndexError):
        members[4]


def test_members_that_follow_an_order_are_said_to(tmp_path: Path) -> None:
    turn, strength = ["--vary", "start.turn~normal(0, 5)"], ["--vary", "fracture.normal_strength~uniform(10, 20 kPa)"]
    for vary, told in ((turn, False), (turn + strength, True)):
        words = [
            "sweep",
            str(small_berg(tmp_path)),
            *vary,
            "--members",
            "2",
            "--days",
            "0.02",
            "--workers",
            "0",
            "--no-map",
        ]
        said = CliRunner().invoke(app, [*words, "--every", "0.48", "-o", str(tmp_path / f"{told}")])
        assert said.exit_code == 0, said.output
        line = "(start.turn, fracture.normal_strength): another order gives other members"
        assert (line in " ".join(said.output.split())) == told
    one, other = (list_members(read_varied(vary), Draws(4)) for vary in (
        ["start.turn~normal(0, 5)", "start.size~normal(1, 0.1)"], ["start.size~normal(1, 0.1)", "start.turn~normal(0, 5)"]
    ))  # fmt: skip
    assert [member["start.turn"] for member in one] != [member["start.turn"] for member in other]
