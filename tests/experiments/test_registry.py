"""Built-in experiments by name, and changes of their parameters."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from cases import CASES
from riftberg import A68A_2022, A68A_2022_KID, Options, build
from riftberg.cli.main import app
from riftberg.diagnostics.summary import fragment_areas
from riftberg.errors import InputError
from riftberg.experiments.changes import changed, parse_settings, reference_numerics
from riftberg.parameters import PUBLISHED_SPRINGS

NAMES = [line.split()[0] for line in CliRunner().invoke(app, ["experiments"]).output.splitlines()]
WITHOUT_FILES = [name for name in NAMES if name not in ("a68a-paper", "a68a-oras5")]


def test_settings_are_converted_to_the_unit_of_the_parameter() -> None:
    settings = ["stepping.time_step=30 min", "fracture.normal_strength = 20 kPa", "stepping.substeps=none",
                "bonds.no_shear=yes", "stepping.fixed_velocity=0.1, 20 cm/s", "bonds.packing=hexagonal"]  # fmt: skip
    changes = parse_settings(settings)
    assert changes == {
        "stepping": {"time_step": 1800.0, "substeps": None, "fixed_velocity": (0.1, 0.2)},
        "fracture": {"normal_strength": 20_000.0},
        "bonds": {"no_shear": True, "packing": "hexagonal"},
    }
    assert changed(A68A_2022, changes).stepping.fixed_velocity == (0.1, 0.2)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("stepping.time_stp=3", "Did you mean 'time_step'"),
        ("steping.time_step=3", "Did you mean 'stepping'"),
        ("stepping.time_step=3 kPa", "measured in s"),
        ("stepping.time_step=soon", "not a number"),
        ("bonds.no_shear=maybe", "neither true nor false"),
        ("time_step=3", "group.name=value"),
    ],
)
def test_wrong_settings_are_explained(setting: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_settings([setting])


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("stepping.time_step=-3", r"--set stepping.time_step=-3: -3.0 is not possible. Allowed: a number > 0, in s"),
        ("bonds.packing=round", "Allowed: 'square', 'hexagonal'"),
        ("stepping.scheme=verlet", "set stepping.scheme = 'mts'"),
    ],
)
def test_impossible_values_are_explained(setting: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        changed(A68A_2022, parse_settings([setting]))


def test_reference_numerics_are_those_of_the_preset() -> None:
    published = A68A_2022.changed(fracture={"normal_strength": 18e3})
    made = reference_numerics(published, springs=PUBLISHED_SPRINGS)
    assert made.changed(stepping={"substeps": 90}) == A68A_2022_KID


def test_unknown_experiments_and_parts_are_explained() -> None:
    with pytest.raises(InputError, match="Did you mean 'a68a'"):
        build("a68")
    with pytest.raises(InputError, match="Did you mean 'shoal'"):
        build("a68a", Options(without=frozenset({"shoall"})))
    with pytest.raises(InputError, match="can go without nothing"):
        build("a68a-melt", Options(without=frozenset({"shoal"})))


def test_names_are_unique_and_told_with_a_name_that_there_is_not() -> None:
    assert len(set(NAMES)) == len(NAMES)
    with pytest.raises(InputError, match=f"Built in are {', '.join(NAMES)};"):
        build("nothing")


@pytest.mark.parametrize("name", CASES)
def test_a_former_experiment_is_refused_with_where_it_is_now(name: str) -> None:
    with pytest.raises(InputError, match=f"{name} is no built-in experiment any more.*gallery"):
        build(name)


def test_the_list_imports_nothing_heavy() -> None:
    code = "import sys, riftberg.experiments; print([m for m in ('numpy', 'numba', 'xarray') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.slow
@pytest.mark.parametrize("numerics", ["own", "reference"])
def test_grounding_fracture_ends_in_more_than_one_fragment(numerics: Any) -> None:
    """Bug: with Riftberg's numerics three bonds failed and the berg stayed whole, although the experiment says it breaks."""
    model = CASES["grounding-fracture"](numerics)
    model.advance(days=3)
    areas = fragment_areas(model)
    assert len(areas) >= 2
    assert areas[0] < 450.0
    # By Riftberg's numerics the rest runs into the piece that the ground holds, at 0.2 m/s, and shatters.
    assert areas[1] > (50.0 if numerics == "own" else 100.0)


@pytest.mark.parametrize("numerics", ["own", "reference"])
@pytest.mark.parametrize("name", WITHOUT_FILES)
def test_each_experiment_can_be_built_and_takes_a_step(name: str, numerics: Any) -> None:
    model, _ = build(name, Options(numerics=numerics))
    model.step()
    assert model.step_number == 1


@pytest.mark.parametrize("numerics", ["own", "reference"])
@pytest.mark.parametrize("name", CASES)
def test_each_case_of_the_paper_can_be_built_and_takes_a_step(name: str, numerics: Any) -> None:
    """A check of long steps, made for others, refused the collision: nobody built it by Riftberg's own numerics."""
    model = CASES[name](numerics)
    model.step()
    assert model.step_number == 1


@pytest.mark.parametrize("name", WITHOUT_FILES)
def test_a_bed_of_sediment_may_lie_under_every_built_in_ocean(name: str) -> None:
    """The ocean of A68a once had a sea level of one point alone, and a traceback for ``grounding.law: seabed``."""
    model, _ = build(name)
    lon, lat = model.elements.lon, model.elements.lat
    level = model.forcing.sea_level(lon, lat, 3600.0)
    assert level.shape == lon.shape
    assert (level == 0.0).all()  # no tide in any of them
    assert np.shape(model.forcing.depth(lon, lat)) == lon.shape
