"""A run that is stopped after any long step and resumed is bit for bit the run that never stopped."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from riftberg import (
    A68A_2022,
    A68A_2022_KID,
    A68A_2022_MTS,
    FieldRules,
    Forcing,
    Grid,
    GriddedForcing,
    Iceberg,
    Model,
    Parameters,
)
from riftberg.state import BOND_VARIABLES, ELEMENT_VARIABLES

STEPS = 7
SPRING = {"bonds": {"law": "spring", "spring": 1e-4}, "fracture": {"enabled": False}}
WEAK = {"normal_strength": 10e3, "shear_strength": 10e3}
WEAKER = {"normal_strength": 2e3, "shear_strength": 2e3}
# Faces that crush each other break more than springs, and pieces that grind on each other take short sub-steps.
STRONGER = {"normal_strength": 20e3, "shear_strength": 20e3}
STRONGEST = {"normal_strength": 30e3, "shear_strength": 30e3}
WEAR = {"enabled": True, "threshold": 0.1, "time_scale": 3600.0}

EXPLICIT = A68A_2022_MTS
PHYSICS: dict[str, Parameters] = {
    "dem": EXPLICIT.changed(fracture=WEAK, stepping={"substeps": None}),
    "dem, fracture after the step": EXPLICIT.changed(fracture={**WEAKER, "on_substeps": False}),
    "dem, broken bonds dropped": EXPLICIT.changed(fracture={**WEAK, "broken_as_contact": False}),
    # The reference's explicit drag of the floor flings a lone element that touches down: 30 m/s, and 0.4 m/s by the implicit one.
    "dem as the reference": A68A_2022_KID.changed(fracture=WEAK, stepping={"speed_limit": 100.0}),
    "quasi-static": A68A_2022.changed(fracture=STRONGER, stepping={"scheme": "quasi_static", "time_step": 1800.0}),
    "quasi-static, damage": A68A_2022.changed(
        fracture=STRONGEST, damage=WEAR, stepping={"scheme": "quasi_static", "time_step": 1800.0}
    ),
    "spring": A68A_2022_MTS.changed(**SPRING, stepping={"substeps": None}),
    "spring, implicit sub-steps": A68A_2022_MTS.changed(
        **SPRING, stepping={"explicit_substeps": False, "time_step": 600.0, "substeps": 60}
    ),
    "verlet": A68A_2022_MTS.changed(**SPRING, stepping={"scheme": "verlet", "time_step": 20.0}),
    "verlet as the reference": A68A_2022_KID.changed(**SPRING, stepping={"scheme": "verlet", "time_step": 20.0}),
    "runge_kutta": A68A_2022_MTS.changed(**SPRING, stepping={"scheme": "runge_kutta", "time_step": 20.0}),
}


def bergs() -> Iceberg:
    """Two bergs of 5 x 3 elements that spin towards each other; the second lies over a shoal in the gridded ocean."""
    i, j = (q.ravel() for q in np.meshgrid(np.arange(5), np.arange(3)))
    x, y = 3000.0 * np.concatenate([i, i + 5.4]), 3000.0 * np.concatenate([j, j + 0.4])
    metre = 180.0 / np.pi / A68A_2022.earth.radius
    first = np.arange(30) < 15
    return Iceberg.from_points(
        -39.0 + x * metre / np.cos(np.radians(55.0)), -55.0 + y * metre, thickness=200.0,
        velocity=(np.where(first, 0.3, -0.2), np.where(first, 0.1, 0.0)), spin=2e-5,
    )  # fmt: skip


def steady() -> Forcing:
    """Return a uniform environment."""
    return Forcing.uniform(current=(0.3, -0.1), wind=(8.0, 4.0), slope=(1e-6, 2e-6), depth=500.0)


def gridded(summit: float = 100.0) -> Forcing:
    """Return an ocean of hourly records with a shear, and a shoal under the second berg up to ``summit`` m below the surface."""
    lon, lat = np.meshgrid(-40.0 + 0.125 * np.arange(1, 25), -56.0 + 0.125 * np.arange(1, 17))
    grid = Grid.from_corners(lon, lat, radius_for_metrics=A68A_2022.earth.radius)
    depth = 400.0 - (400.0 - summit) * np.exp(-(((lon + 38.55) / 0.2) ** 2) - ((lat + 54.95) / 0.2) ** 2)
    records = [
        grid.fields(
            uo=0.1 * (1 + k) * np.sin(40.0 * lat), vo=0.1 * (1 + k) * np.sin(20.0 * lon), ua=8.0 - k, va=3.0,
            ssh=0.1 * np.sin(10.0 * lon + k), depth=depth,
        )
        for k in range(6)
    ]  # fmt: skip
    return GriddedForcing(grid, records, 3600.0 * np.arange(6), FieldRules(stepwise=("ssh",)))


def knoll() -> Forcing:
    """Return the same ocean with a shoal on which a keel of 166 m lies: on the higher one a bed of sediment shatters a berg."""
    return gridded(160.0)


def state_of(model: Model) -> dict[str, Any]:
    """Return all that a model is, in bits."""
    bits = {v.name: getattr(model.elements, v.name).tobytes() for v in ELEMENT_VARIABLES}
    bits |= {f"bond {v.name}": getattr(model.bonds, v.name).tobytes() for v in BOND_VARIABLES}
    return {
        **bits, "time": model.time, "step": model.step_number, "start": model.start, "substeps": model.substeps,
        "fragments": repr(model.fragments.rows), "parameters": model.parameters,
    }  # fmt: skip


def differing(one: Model, other: Model) -> list[str]:
    """Names of what two models differ in."""
    a, b = state_of(one), state_of(other)
    return [name for name in a if a[name] != b[name]]


# What the steady ocean adds has little to do with the physics: two schemes are enough for the quick tests.
RUNS = [(name, knoll if PHYSICS[name].stepping.scheme == "quasi_static" else gridded) for name in PHYSICS]
IN_THE_STEADY = [pytest.param(n, steady, marks=() if n in ("dem", "verlet") else pytest.mark.slow) for n in PHYSICS]


@pytest.mark.quick(4)
@pytest.mark.parametrize(("name", "ocean"), [*RUNS, *IN_THE_STEADY])
def test_stopping_after_any_long_step_changes_nothing(tmp_path: Path, name: str, ocean: Callable[[], Forcing]) -> None:
    """A run that is stopped and gone on with after each long step is at each the run that never stopped."""
    whole = stopped = Model(bergs(), ocean(), PHYSICS[name])
    for step in range(STEPS):
        stopped = Model.resume(stopped.save(tmp_path / f"{step}.nc"), ocean())
        stopped.step()
        whole.step()
        assert differing(stopped, whole) == [], f"{step}.nc"


@pytest.mark.parametrize("name", [name for name in PHYSICS if name.startswith("dem")])
def test_bonds_break_before_and_after_the_stops(name: str) -> None:
    """The test above is about runs in which bonds break in several steps, and fragments are born."""
    model = Model(bergs(), gridded(), PHYSICS[name])
    broken = []
    for _ in range(STEPS):
        model.step()
        broken.append(model.bonds_broken)
    assert len(set(broken)) >= 3
    assert 0 < broken[-1] < model.bonds.first.size
    assert model.fragment_count > 2
    assert (model.elements.depth < 150.0).any()  # a keel of 166 m is aground


@pytest.mark.quick(2)
@pytest.mark.parametrize("name", [name for name in PHYSICS if PHYSICS[name].stepping.scheme == "mts"])
def test_bergs_touch_in_these_runs(name: str) -> None:
    """The test above is about runs in which bergs collide: without contact between bergs they end elsewhere."""
    ends = []
    for contact in (1e-7, 0.0):
        model = Model(bergs(), gridded(), PHYSICS[name].changed(contact={"spring": contact}))
        for _ in range(STEPS):
            model.step()
        ends.append(model.elements.lon)
    assert (ends[0] != ends[1]).any()


def test_runs_through_the_recorders_are_the_same_too(tmp_path: Path) -> None:
    whole = Model(bergs(), gridded(), PHYSICS["dem"])
    whole.advance(steps=6)
    first = Model(bergs(), gridded(), PHYSICS["dem"])
    first.advance(steps=2)
    resumed = Model.resume(first.save(tmp_path / "two.nc"), gridded())
    resumed.advance(steps=4)
    assert differing(resumed, whole) == []


def test_bonds_that_break_after_the_step_do_not_shift_the_bonds_of_contact_pairs(tmp_path: Path) -> None:
    """Candidates of the search once named rows of unbroken bonds, which break_after renumbers before they are used."""
    whole = Model(bergs(), gridded(), PHYSICS["dem, fracture after the step"])
    while whole.bonds_broken == 0:
        file = whole.save(tmp_path / "before.nc")
        whole.step()
    resumed = Model.resume(file, gridded())
    resumed.step()
    assert differing(resumed, whole) == []
    joined = {*zip(whole.bonds.first, whole.bonds.second, strict=True)}
    pairs = whole._stepper._batches[0].work.pairs  # type: ignore[attr-defined]
    for k in range(pairs.used[0]):
        bond = pairs.bond[k]
        ends = pairs.first[k], pairs.second[k]
        assert ends == (whole.bonds.first[bond], whole.bonds.second[bond]) if bond >= 0 else ends not in joined


def test_a_resumed_run_keeps_its_number_of_substeps(tmp_path: Path) -> None:
    """Found anew it would depend on the bonds broken since, and the run would not be the same."""
    model = Model(bergs(), gridded(), PHYSICS["dem"])
    for _ in range(STEPS):
        model.step()
    model.bonds.status[:] = 2
    resumed = Model.resume(model.save(tmp_path / "a.nc"), gridded())
    assert resumed.substeps == model.substeps > 1


def test_the_first_run_is_left_alone_by_saving(tmp_path: Path) -> None:
    saved, plain = (Model(bergs(), gridded(), PHYSICS["dem"]) for _ in range(2))
    for step in range(STEPS):
        saved.save(tmp_path / f"{step}.nc")
        saved.step()
        plain.step()
    assert differing(saved, plain) == []
