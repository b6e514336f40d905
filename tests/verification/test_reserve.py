"""Strength from flotation: bergs break at the reserve of their thickness, in a run and in all that is said of it afterwards."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from riftberg import A68A_2022, Forcing, Iceberg, Model, Options, Parameters, build, explain, open_run
from riftberg.diagnostics.summary import summarize
from riftberg.diagnostics.why import reason_lines
from riftberg.ensembles.vary import Draws, list_members, read_varied
from riftberg.errors import BergError, InputError
from riftberg.physics.crevasses import prestress, reserve, rift_factor
from riftberg.runs.run_file import RunWriter
from riftberg.runs.scene import Scene

TIP = 79e3
"""Tension at the tips of crevasses, Pa."""


def bar(thickness: Any, *, density: float = 850.0, **fracture: Any) -> Model:
    """A bar of 8 x 2 elements of 2 km on a plane, at rest in water that exerts nothing."""
    p = Parameters(
        fracture={"shear_strength": 1e9, **fracture}, ice={"density": density}, earth={"latlon": False},
        stepping={"only_interactions": True, "time_step": 60.0},
    )  # fmt: skip
    berg = Iceberg.rectangle(
        16e3, 4e3, thickness=200.0, radius=1000.0, placement=(8e3, 2e3), latlon=False, density=density
    )
    berg.elements.thickness[:] = thickness
    berg.elements.mass[:] *= berg.elements.thickness / 200.0
    return Model(berg, Forcing.uniform(), p)


def pull(model: Model, per_width: float) -> Model:
    """Pull both ends apart with a force per width (N m-1)."""
    x = model.elements.lon
    model.elements.load_x[:] = 2000.0 * per_width * ((x > x.max() - 1.0) * 1.0 - (x < x.min() + 1.0))
    return model


def borne(thickness: float, density: float) -> float:
    """Force per width (N m-1) that ice bears by its reserve."""
    return thickness * reserve(TIP, prestress(thickness, density))


@pytest.fixture(scope="module")
def peak() -> float:
    """Largest stress of the bar over the mean one: at the ends, where it is pulled."""
    model = pull(bar(200.0, normal_strength=1e12), 2e6)
    model.advance(steps=1)
    return float(model.bonds.normal_stress.max()) / 1e4


def test_the_same_load_per_width_breaks_thin_and_thick_ice_alike(peak: float) -> None:
    """120, 200 and 300 m: a stress would break the thin ice first. Denser ice floats deeper, and bears more."""
    limit = borne(200.0, 850.0) / peak
    for thickness in (120.0, 200.0, 300.0):
        for share, broken in ((0.98, False), (1.02, True)):
            model = pull(bar(thickness, crevasse_strength=TIP), share * limit)
            model.advance(steps=1)
            assert (model.bonds_broken > 0) is broken, (thickness, share)
    model = pull(bar(200.0, crevasse_strength=TIP, density=900.0), 1.02 * limit)
    model.advance(steps=1)
    assert model.bonds_broken == 0
    assert borne(200.0, 900.0) > 1.3 * borne(200.0, 850.0)


def test_strength_is_that_of_the_thickness_now(peak: float) -> None:
    """Ice that has thinned under a load that stays bears it as before: its stress rises, and its reserve as much."""
    model = pull(bar(200.0, crevasse_strength=TIP), 0.9 * borne(200.0, 850.0) / peak)
    model.advance(steps=1)
    model.elements.thickness[:] *= 0.6
    model.elements.mass[:] *= 0.6
    model.advance(steps=1)
    assert model.bonds_broken == 0
    assert float(model.bonds.normal_stress.max()) > reserve(TIP, prestress(200.0, 850.0))


@pytest.mark.parametrize("criterion", ["ice", "toughness"])
def test_factors_of_rifts_scatter_and_damage_multiply(peak: float, criterion: str) -> None:
    """Half the strength by a factor, and half of that by damage."""
    for strength, damage, left in ((0.5, 0.0, 0.5), (1.0, 0.5, 0.5), (0.5, 0.5, 0.25)):
        for share, broken in ((0.97, False), (1.03, True)):
            how: dict[str, Any] = {"criterion": criterion}
            model = bar(200.0, crevasse_strength=TIP, **(how | {"toughness": 1e5} if criterion != "ice" else how))
            model.bonds.strength[:], model.bonds.damage[:] = strength, damage
            pull(model, share * left * borne(200.0, 850.0) / peak).advance(steps=1)
            assert (model.bonds_broken > 0) is broken, (strength, damage, share)


def test_all_that_is_said_after_a_run_has_the_strength_of_the_place(tmp_path: Path) -> None:
    """Scene, tracks, reasons, summary, description of a bar of 300 m in the west, 180 m in the east, that parts in the west."""
    thick = np.where(np.arange(16) % 8 < 4, 300.0, 180.0)
    model = bar(thick, crevasse_strength=TIP)
    low, high = (reserve(TIP, prestress(h, 850.0)) for h in (300.0, 180.0))
    model.after_step.append(lambda run: pull(run, 0.15 * run.step_number * 300.0 * low))
    x, bonds = model.elements.lon, model.bonds
    bonds.strength[(x[bonds.first] < 6e3) != (x[bonds.second] < 6e3)] = 0.4
    model.advance(steps=10, recorders=[RunWriter(tmp_path / "run.nc", every_hours=0.05)])
    assert model.bonds_broken > 0
    with open_run(tmp_path / "run.nc") as run:
        scene = Scene(run)
        assert scene.bonds.strengths.shape == (len(scene.times), model.bonds.first.size)
        assert scene.bonds.strengths.min() == pytest.approx(low)
        assert scene.bonds.strengths.max() == pytest.approx(high)
        assert scene.bonds.strength == pytest.approx(low)
        ratio = float(run.riftberg.tracks["stress_over_strength"].max())
        assert 0.3 < ratio <= 1.0
        reasons = explain(run)
        for bond in (b for breakup in reasons.breakups for b in breakup.first_bonds):
            own = float(run["strength"].values[bond.bond])
            assert bond.strength == pytest.approx(own * scene.bonds.strengths[0, bond.bond])
            ends = [int(run[name].values[bond.bond]) for name in ("bond_first", "bond_second")]
            assert bond.prestress == pytest.approx(np.mean([prestress(thick[e], 850.0) for e in ends]))
        assert reasons.breakups
        text = " ".join(reason_lines(reasons))
        assert "Strengths at the tips of crevasses are good to a factor of 2" in text
        assert f"{TIP / 1e3:.0f} kPa at the tips of its crevasses" in text
        assert "beside a pre-stress of" in text
    entry = json.loads(json.dumps(summarize(model)))["bergs"][0]
    assert entry["crevasse_strength"] == TIP
    assert entry["largest_prestress"] == pytest.approx(prestress(300.0, 850.0))
    assert prestress(180.0, 850.0) <= entry["prestress"] < entry["largest_prestress"]
    assert entry["reserve"] == pytest.approx(reserve(TIP, entry["prestress"]))
    assert "Strengths at the tips of crevasses are good to a factor of 2" in model.describe()


@pytest.mark.parametrize(
    ("thickness", "strength", "tips"), [(200.0, "11 kPa", 79), (200.0, "14.3 kPa", 90), (120.0, "100 kPa", 185)]
)
def test_what_a_given_strength_means_is_said(thickness: float, strength: str, tips: int) -> None:
    """Of crevassed ice, and of thin strong ice that has no crevasses."""
    model = bar(thickness, normal_strength=strength)
    said = model.describe()
    assert f"pre-stress of the ice is {prestress(thickness, 850.0) / 1e3:.0f} kPa" in said
    assert f"{tips} kPa at the tips of its crevasses" in said
    assert "factor of 2" in said
    assert "15 to 35 %" in said
    model.advance(steps=1)
    assert summarize(model)["bergs"][0]["crevasse_strength"] == pytest.approx(1e3 * tips, abs=600.0)


@pytest.mark.parametrize("groups", [{"stepping": {"scheme": "mts"}}, {"fracture": {"enabled": False}}])
def test_strength_of_bonds_or_none_is_not_translated(groups: dict[str, Any]) -> None:
    """Explicit schemes test bonds, and where nothing breaks there is no strength: the pre-stress is said all the same."""
    model = Model(
        Iceberg.rectangle(12e3, 6e3, thickness=200.0, placement=(-38.0, -56.0)), Forcing.uniform(), Parameters(**groups)
    )
    model.advance(steps=1)
    said = model.describe()
    assert "pre-stress of the ice is 142 kPa." in said
    assert "at the tips of its crevasses" not in said
    assert summarize(model)["bergs"][0]["crevasse_strength"] is None


def test_several_bergs_are_said_each_by_its_name() -> None:
    """Each has a pre-stress of its own."""
    bergs = [
        Iceberg.rectangle(6e3, 6e3, thickness=h, placement=(-38.0 + k, -56.0)).named(name)
        for k, (h, name) in enumerate([(150.0, "A1"), (350.0, "B2")])
    ]
    said = Model(Iceberg.join(bergs), Forcing.uniform(), Parameters()).describe()
    assert "A1: The pre-stress of the ice is 107 kPa" in said
    assert "B2: The pre-stress of the ice is 249 kPa" in said


# Parameters


def test_one_strength_replaces_the_other() -> None:
    """On presets that have one, in both directions; and a copy with other changes keeps what is there."""
    by_tips = A68A_2022.changed(fracture={"crevasse_strength": "79 kPa"})
    assert (by_tips.fracture.normal_strength, by_tips.fracture.crevasse_strength) == (None, 79e3)
    assert by_tips.changed(stepping={"time_step": 900}).fracture == by_tips.fracture
    assert by_tips.changed(fracture={"shear_strength": 2e5}).fracture.crevasse_strength == 79e3
    back = by_tips.changed(fracture={"normal_strength": "20 kPa"}).fracture
    assert (back.normal_strength, back.crevasse_strength) == (20e3, None)
    assert A68A_2022.changed(fracture={"crevasse_strength": "none"}).fracture == A68A_2022.fracture
    explicit, left_out = by_tips.adapted(stepping={"scheme": "mts"})
    assert "fracture.crevasse_strength" in left_out
    assert explicit.fracture.normal_strength == Parameters().fracture.normal_strength


@pytest.mark.parametrize(
    ("groups", "match"),
    [
        ({"fracture": {"normal_strength": "11 kPa", "crevasse_strength": "79 kPa"}}, "give either normal_strength, or"),
        ({"fracture": {"normal_strength": "none"}}, "give either normal_strength, or"),
        ({"fracture": {"crevasse_strength": 0}}, r"fracture.crevasse_strength: 0 is not possible.*> 0"),
        ({"fracture": {"crevasse_strength": "-3 kPa"}}, r"fracture.crevasse_strength: -3000.0 is not possible"),
        ({"fracture": {"crevasse_strength": "79 kPa"}, "ice": {"density": 1030}}, "ice.density: 1030 is not possible"),
        ({"fracture": {"crevasse_strength": "79 kPa"}, "stepping": {"scheme": "mts"}},
         r"fracture.crevasse_strength: it is of quasi_static: write fracture.normal_strength"),
    ],
)  # fmt: skip
def test_impossible_strengths_are_refused_by_name(groups: dict[str, Any], match: str) -> None:
    """Both, none, not above 0, ice that does not float, an engine without it."""
    with pytest.raises(InputError, match=match):
        Parameters(**groups)


def test_files_and_sets_that_hold_all_parameters_read_back(tmp_path: Path) -> None:
    """A restart file, a run file, and the preset of A68a with the strength set."""
    model, _ = build("a68a", Options({"fracture": {"crevasse_strength": 79e3}}))
    assert model.parameters.fracture.crevasse_strength == 79e3
    assert model.constants.normal_strength == 0.0
    plain = bar(200.0, crevasse_strength=TIP)
    plain.advance(steps=1, recorders=[RunWriter(tmp_path / "run.nc", every_hours=1)])
    assert Model.resume(plain.save(tmp_path / "state.nc"), plain.forcing).parameters == plain.parameters
    with open_run(tmp_path / "run.nc") as run:
        assert Scene(run).parameters.fracture == plain.parameters.fracture
    with pytest.raises(InputError, match="give either normal_strength, or"):
        build("a68a", Options({"fracture": {"crevasse_strength": 79e3, "normal_strength": 11e3}}))


def test_it_is_varied_and_drawn() -> None:
    """In a list, and from 70 to 130 kPa as a forecast draws it."""
    (listed,) = read_varied(["fracture.crevasse_strength=70..130kPa:3"])
    assert listed.values == (70e3, 100e3, 130e3)
    (drawn,) = read_varied(["fracture.crevasse_strength~uniform(70 kPa, 130 kPa)"])
    values = [row["fracture.crevasse_strength"] for row in list_members([drawn], Draws(16))]
    assert 70e3 <= min(values) < 80e3
    assert 120e3 < max(values) <= 130e3
    with pytest.raises(InputError, match="impossible values"):
        read_varied(["fracture.crevasse_strength~normal(-90 kPa, 10 kPa)"])


# Rifts


LINE = [(8e3, -1e3), (8e3, 9e3)]


@pytest.fixture(scope="module")
def plate() -> Iceberg:
    """Ice of 170 m in the west and 250 m in the east of a plane."""
    berg = Iceberg.rectangle(16e3, 8e3, thickness=170.0, radius=1000.0, placement=(8e3, 4e3), latlon=False)
    east = berg.elements.lon > 8e3
    berg.elements.thickness[east] = 250.0
    return berg


@pytest.mark.parametrize("depth", [0.2, 0.4, 0.75, 0.97])
def test_a_rift_of_some_depth_leaves_what_the_ice_bears_there(plate: Iceberg, depth: float) -> None:
    """Of the thickness between both ends; with scatter on top."""
    cut = plate.with_strength("uniform", spread=0.3, seed=2)
    there = cut.with_rifts(LINE, depth=depth, crevasse_strength="202 kPa").bonds.strength / cut.bonds.strength
    expected = rift_factor(depth, 202e3, prestress(210.0, 850.0))
    assert np.unique(there.round(12)).tolist() == sorted({1.0, round(float(expected), 12)})
    assert (expected == 1.0) is (depth < 0.3)


@pytest.mark.parametrize(
    ("how", "match"),
    [
        ({"depth": 0.9}, r"depth: a rift of the depth 0.9 .* Give fracture.crevasse_strength"),
        ({"depth": 1.0, "crevasse_strength": 9e4}, "depth 1.*between 0 and 1"),
        ({"depth": 0, "crevasse_strength": 9e4}, "depth 0.*between 0 and 1"),
        ({"depth": 0.9, "crevasse_strength": 0}, "crevasse_strength 0 Pa.*above 0"),
        ({"depth": 0.9, "crevasse_strength": 9e4, "strength": 0.5}, "one of strength, broken and depth"),
        ({"depth": 0.9, "crevasse_strength": 9e4, "broken": True}, "one of strength, broken and depth"),
        ({"strength": 0.0, "broken": True}, "one of strength, broken and depth"),
    ],
)
def test_impossible_rifts_are_refused(plate: Iceberg, how: dict[str, Any], match: str) -> None:
    with pytest.raises(BergError, match=match):
        plate.with_rifts(LINE, **how)


FILE = """\
start: 2020-12-15
days: 0.1
berg:
  rectangle: {{length: 18 km, width: 9 km}}
  placement: [-38.0, -56.0]
  thickness: 200 m
  rifts: {rifts}
forcing: {{uniform: {{current: [0.1, 0.0], slope: [0, 0]}}}}
parameters: {{fracture: {{{fracture}}}}}
"""
ACROSS = "points: [[-38.0, -56.05], [-38.0, -55.95]]"


def test_a_file_gives_the_depth_and_is_told_where_it_changes_nothing(tmp_path: Path) -> None:
    """Of two rifts the shallow one lies in crevasses that reach deeper."""
    path = tmp_path / "rifted.yaml"
    rifts = f"[{{{ACROSS}, depth: 95 %}}, {{{ACROSS}, depth: 0.2}}]"
    path.write_text(FILE.format(rifts=rifts, fracture="crevasse_strength: 202 kPa"))
    model, info = build(str(path))
    assert model.bonds.strength.min() == pytest.approx(rift_factor(0.95, 202e3, prestress(200.0, 850.0)))
    (notice,) = info.notices
    assert "berg.rifts.1: its depth of 0.2 changes nothing" in notice
    assert "down to 0.29" in notice
    # Another strength, as a sweep sets it, means another factor.
    other, _ = build(str(path), Options({"fracture": {"crevasse_strength": 90e3}}))
    assert other.bonds.strength.min() == pytest.approx(rift_factor(0.95, 90e3, prestress(200.0, 850.0)))


@pytest.mark.parametrize("how", ["broken: true", "strength: 0.5", "depth: 0.95"])
def test_a_file_whose_rift_lies_beside_the_ice_in_part_is_told(tmp_path: Path, how: str) -> None:
    path = tmp_path / "rifted.yaml"
    rifts = f"[{{{ACROSS}, {how}}}, {{points: [[-38.05, -57.0], [-38.05, -56.0]], {how}}}]"
    path.write_text(FILE.format(rifts=rifts, fracture="crevasse_strength: 202 kPa"))
    (notice,) = build(str(path))[1].notices
    assert "berg.rifts.1: 9" in notice
    assert "% of it lies outside of the ice" in notice


@pytest.mark.parametrize(
    ("rift", "fracture", "match"),
    [
        ("depth: 0.95", "normal_strength: 11 kPa", r"berg.rifts.0, depth: .* Give fracture.crevasse_strength"),
        ("depth: 0.95, strength: 0.1", "crevasse_strength: 90 kPa", "one of strength, broken: true and depth"),
        ("depth: 0.95, broken: true", "crevasse_strength: 90 kPa", "one of strength, broken: true and depth"),
        ("depth: 1", "crevasse_strength: 90 kPa", "depth: 1 is not possible"),
        ("depth: 0.95", "crevasse_strength: 90 kPa, normal_strength: 11 kPa", "give either normal_strength, or"),
    ],
)
def test_impossible_rifts_in_a_file_are_refused(tmp_path: Path, rift: str, fracture: str, match: str) -> None:
    path = tmp_path / "rifted.yaml"
    path.write_text(FILE.format(rifts=f"[{{{ACROSS}, {rift}}}]", fracture=fracture))
    with pytest.raises(InputError, match=match):
        build(str(path))
