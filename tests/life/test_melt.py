"""Melt in runs of Riftberg's own: what melts and what does not, bonds, deaths, restarts, the ledger, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contract import HEAT_CLOSES, MASS_CLOSES
from riftberg import A68A_2022, A68A_2022_MTS, Forcing, Iceberg, Model, Parameters, open_run
from riftberg.errors import ForcingError, InputError, RunError
from riftberg.life.melt import base_spans, life_values
from riftberg.runs.run_file import RunWriter
from twins import footloose as twin

REACH = 0.05

SIDE = 3000.0
PLANE = {"latlon": False, "f_plane": True, "reference_latitude": -55.0, "period": 0.0}
# Spring bonds and a short step: quick without compilation too; the melt of a step is made large by warm water.
QUICK = A68A_2022_MTS.changed(
    earth=PLANE, bonds={"law": "spring"}, fracture={"enabled": False}, melt={"enabled": True},
    stepping={"scheme": "verlet", "time_step": 20.0},
)  # fmt: skip
DEM = A68A_2022.changed(
    earth=PLANE, fracture={"enabled": False}, melt={"enabled": True}, stepping={"time_step": 1800.0}
)


def block(columns: int, rows: int, thickness: float = 200.0) -> Iceberg:
    i, j = (q.ravel() for q in np.meshgrid(np.arange(columns), np.arange(rows)))
    return Iceberg.from_points(SIDE * i, SIDE * j, thickness=thickness, latlon=False)


def sea(**changes: Any) -> Forcing:
    return Forcing.uniform(**{"current": (0.3, -0.1), "slope": (0.0, 0.0), "wind": (8.0, 4.0), "depth": 500.0,
                   "temperature": 3.0, "salinity": 34.0,
                     **changes})  # fmt: skip


def run(p: Parameters = QUICK, steps: int = 5, berg: Iceberg | None = None, **water: Any) -> Model:
    model = Model(block(3, 3) if berg is None else berg, sea(**water), p)
    model.advance(steps=steps)
    return model


def closes(model: Model) -> None:
    assert model.life is not None
    balance = model.life.balance(model)
    assert abs(balance.error) <= MASS_CLOSES
    assert abs(balance.heat_error) <= HEAT_CLOSES


def test_sides_melt_only_where_no_bond_covers_them_and_bases_everywhere() -> None:
    model = run()
    body = model.elements.body
    lost = SIDE - body.length
    covered = body.bond_count
    assert covered.tolist() == [2, 3, 2, 3, 4, 3, 2, 3, 2]
    assert lost[4] == 0.0
    # The outline at a corner shortens while it moves: the front is the mean until it is drawn anew.
    assert lost[0] == pytest.approx((2.0 - REACH) * lost[1], rel=1e-3) != 0.0
    assert (body.thickness < 200.0).all()
    np.testing.assert_array_equal(body.width, body.length)
    closes(model)


def test_mass_goes_with_volume() -> None:
    body = run().elements.body
    density = body.mass / (body.length * body.width * body.thickness)
    np.testing.assert_allclose(density, A68A_2022.ice.density, rtol=1e-12)


def test_the_rate_of_the_base_does_not_depend_on_the_lattice() -> None:
    """The turbulent law takes the length of the berg, not that of its elements."""
    p = QUICK.changed(melt={"base": "turbulent"})
    x, y = (1500.0 * q.ravel() for q in np.meshgrid(np.arange(4), np.arange(4)))
    fine = Iceberg.from_points(x, y, thickness=200.0, radius=750.0, latlon=False)
    rates = [200.0 - run(p, 1, berg).elements.thickness[0] for berg in (block(2, 2), fine)]
    assert rates[0] == pytest.approx(rates[1], rel=1e-2)  # the first step moves them a little apart


def test_modes() -> None:
    def lost(**melt: Any) -> tuple[float, float]:
        body = run(QUICK.changed(melt=melt), 2).elements.body
        return SIDE - float(body.length[4]), 200.0 - float(body.thickness[4])

    exposed, berg, shelf = lost(), lost(mode="berg"), lost(mode="shelf")
    assert exposed[0] == 0.0 < berg[0]
    assert shelf[0] == 0.0
    assert shelf[1] == pytest.approx(exposed[1], rel=1e-12)
    mixed = lost(mode="mixed")
    assert mixed[1] == pytest.approx(shelf[1], rel=1e-12)  # all sides are covered


def test_a_keel_near_the_floor_does_not_melt_where_a_gap_is_demanded() -> None:
    p = QUICK.changed(melt={"least_gap": 10.0})
    assert (run(p, 2, depth=175.0).elements.thickness == 200.0).all()
    assert (run(p, 2, depth=177.0).elements.thickness < 200.0).all()


def test_an_element_melts_away_and_takes_its_bonds_with_it() -> None:
    berg = block(3, 1)
    berg.elements.body.thickness[1] = 2e-4
    berg.elements.body.mass[1] *= 1e-6
    model = run(berg=berg, temperature=20.0)
    assert model.elements.id.tolist() == [1, 3]
    assert model.bonds.first.size == 0
    assert model.elements.bond_count.tolist() == [0, 0]
    assert model.fragment_count == 2
    closes(model)


def test_all_may_melt() -> None:
    model = run(berg=block(2, 1, thickness=1e-3), temperature=20.0, steps=40)
    assert model.elements.size == 0
    closes(model)
    balance = model.life.balance(model)  # type: ignore[union-attr]
    assert balance.now == 0.0
    assert sum(balance.water.values()) == pytest.approx(balance.start, rel=1e-12)


def test_melt_stretches_no_bond() -> None:
    """Rest lengths are state: a berg that melts at its rim for days feels nothing of it."""
    p = DEM.changed(bonds={"constant_size": False}, melt={"mode": "berg", "base": "turbulent"})
    model = Model(block(4, 1), sea(current=(0.0, 0.0), wind=(0.0, 0.0), temperature=25.0), p)
    model.advance(steps=8)
    assert (model.elements.length < SIDE - 0.1).all()
    assert np.abs(model.bonds.bond_length / SIDE - 1.0).max() < 1e-9


def test_draft_and_grounding_follow_the_thickness() -> None:
    """A berg that is aground by 0.1 m floats off as its base melts."""
    p = QUICK.changed(grounding={"coefficient": 1e4, "on_substeps": False})
    model = Model(block(2, 2), sea(depth=200.0 * 850.0 / 1025.0 - 1e-3, temperature=20.0), p)
    model.advance(steps=60)
    assert (model.elements.thickness < 200.0 - 2e-3).all()
    assert np.hypot(model.elements.u, model.elements.v).min() > 1e-4
    still = Model(block(2, 2), sea(depth=200.0 * 850.0 / 1025.0 - 1e-3), p.changed(melt={"enabled": False}))
    still.advance(steps=60)
    assert np.hypot(still.elements.u, still.elements.v).max() < 0.5 * np.hypot(model.elements.u, model.elements.v).min()


def lively() -> Parameters:
    """Everything at once, with births and deaths."""
    return QUICK.changed(
        melt={"bits_fraction": 0.4}, rolling={"enabled": True},
        footloose={"enabled": True, "youngs": 1e6, "strength": 3e-3, "berg_mass": 5e8, "seed": 3},
    )  # fmt: skip


def lively_model(modulus: str = "constant") -> Model:
    thin = block(3, 2)
    thin.elements.body.thickness[2] = 6e-4
    thin.elements.body.mass[2] *= 3e-6
    return Model(thin, sea(temperature=12.0), lively().changed(footloose={"modulus": modulus}))


def bits(model: Model) -> dict[str, bytes]:
    named = {name: array.tobytes() for name, array in model.elements.arrays().items()}
    named |= {f"bond {name}": array.tobytes() for name, array in model.bonds.arrays().items()}
    return {**named, "ledger": model.remembered["life_ledger"].tobytes(), "tree": repr(model.fragments.rows).encode()}


@pytest.mark.parametrize("modulus", ["constant", "relaxed"])
def test_a_run_that_melts_goes_on_bit_for_bit(modulus: str, tmp_path: Path) -> None:
    whole, files = lively_model(modulus), []
    whole.advance(steps=1)
    seen = set()
    for step in range(8):
        files.append(whole.save(tmp_path / f"{step}.nc"))
        whole.step()
        seen |= set(whole.elements.id.tolist())
    assert max(seen) > 6, "nothing was born"
    assert 3 not in set(whole.elements.id.tolist()), "nothing died"
    closes(whole)
    for file in files:
        resumed = Model.resume(file, sea(temperature=12.0))
        while resumed.step_number < whole.step_number:
            resumed.step()
        ours, theirs = bits(resumed), bits(whole)
        assert [name for name in theirs if ours[name] != theirs[name]] == [], file.name


def test_footloose_of_bonded_bergs_conserves() -> None:
    model = lively_model()
    model.advance(steps=9)
    life = model.elements.life
    assert (life.fl_k == -1.0).any() or (life.fl_k == -2.0).any()
    closes(model)
    balance = model.life.balance(model)  # type: ignore[union-attr]
    assert balance.water["footloose_bits"] > 0.0
    assert not any(balance.gained.values())


@pytest.mark.parametrize("columns", [1, 3])
def test_an_edge_that_relaxes_breaks_at_the_foot_of_its_twin(columns: int) -> None:
    """Of one element and of nine: the first piece comes when the foot has the area that breaks one of that growth."""
    p = DEM.changed(
        stepping={"time_step": 10800.0}, footloose={"enabled": True, "modulus": "relaxed", "viscosity": 4e14}
    )
    lone = Iceberg.from_points([0.0], [0.0], length=9e3, width=9e3, thickness=200.0, latlon=False)
    model = Model(block(columns, columns) if columns > 1 else lone, sea(wind=(9.0, 3.0), temperature=0.0), p)
    feet: list[float] = []
    while not model.elements.life.mass_of_fl_bits.any():
        feet.append(float(model.elements.life.fl_k.sum()))
        model.step()
        assert len(feet) < 200
    growth = float(model.remembered["foot_growth"][:, 1].max())
    edge = float(np.maximum(model.elements.life.front, 0.0).sum()) or 36e3
    assert growth * edge * 10800.0 == pytest.approx(np.diff(feet).mean(), rel=0.05)
    _, foot, wide = twin.relaxed(200.0, growth, 250e3, 850.0, 4e14, couple=False)
    assert feet[-2] < 1.02 * foot * 3.0 * wide
    assert feet[-1] > 0.98 * foot * 3.0 * wide


def test_pieces_as_bergs_conserve_too() -> None:
    model = Model(block(3, 2), sea(temperature=12.0), lively().changed(footloose={"style": "bergs"}))
    model.advance(steps=6)
    assert (model.elements.life.mass_scaling != 1.0).any()
    assert (model.elements.life.mass_of_fl_bits == 0.0).all()
    closes(model)


@pytest.mark.parametrize(("interactions", "foot"), [(True, -2.0), (False, -1.0)])
def test_children_are_let_go_to_collide_only_where_bergs_act_on_each_other(interactions: bool, foot: float) -> None:
    """A child that nothing touches may collide from now on; without interactions it stays what it is."""
    p = lively().changed(bonds={"law": "none"}, stepping={"interactions": interactions})
    model = Model(
        Iceberg.join([block(1, 1), Iceberg.from_points([20e3], [0.0], thickness=200.0, latlon=False)]), sea(), p
    )
    model.elements.life.fl_k[1] = -1.0
    model.step()
    assert model.elements.life.fl_k[1] == foot


def test_numerics_of_the_reference_refuse_bonded_bergs_that_calve_and_no_others() -> None:
    p = lively().changed(footloose={"footloose_sets_density": True})
    lone = Model(block(1, 1), sea(temperature=12.0), p)
    lone.step()
    assert lone.elements.size >= 1
    with pytest.raises(
        RunError, match="footloose calving of element 1, which has 1 bonds: the reference stops there too"
    ):
        Model(block(2, 1), sea(temperature=12.0), p).step()
    children = Model(block(2, 1), sea(temperature=12.0), p)
    children.elements.life.fl_k[:] = -2.0  # what calves no longer may have bonds
    children.step()


def test_what_others_add_and_take_is_in_the_ledger() -> None:
    model = run()
    model.remove([1])
    model.step()
    closes(model)
    assert model.life.balance(model).gained["other"] < 0.0  # type: ignore[union-attr]


def test_the_ledger_is_in_the_run_file(tmp_path: Path) -> None:
    model = lively_model()
    model.advance(steps=5, recorders=[RunWriter(tmp_path / "run.nc", every_hours=0.0, background=False)])
    with open_run(tmp_path / "run.nc") as file:
        water = file["melt_water"].transpose("time", "process").values
        assert (np.diff(water.sum(axis=1)) > 0.0).all()
        ice, gained = file["ice_mass"].values.ravel(), file["ice_gained"].values.ravel()
        np.testing.assert_allclose(ice[0] + gained - water.sum(axis=1), ice, rtol=1e-12)
        assert np.abs(file["ledger_error"].values).max() <= MASS_CLOSES
        assert np.abs(file["ledger_heat_error"].values).max() <= HEAT_CLOSES
        mass = file["mass"].transpose("time", "trajectory").values
        gone = int(np.flatnonzero(file["trajectory"].values == 3)[0])
        assert np.isfinite(mass[0, gone])
        assert np.isnan(mass[-1, gone])


def test_a_ledger_that_does_not_close_is_seen() -> None:
    model = run()
    model.life.balance(model)  # type: ignore[union-attr]
    model.remembered["life_ledger"][0, 1] *= 1.0 + 1e-3
    with pytest.raises(AssertionError):
        closes(model)


def test_a_run_without_melt_has_no_life_of_its_own() -> None:
    assert run(QUICK.changed(melt={"enabled": False})).life is None


def test_rolling_alone_melts_nothing() -> None:
    p = QUICK.changed(melt={"enabled": False}, rolling={"enabled": True}, bonds={"law": "none"})
    tall = Iceberg.from_points(np.array([0.0]), np.array([0.0]), thickness=200.0, latlon=False, radius=75.0)
    model = Model(tall, sea(), p)
    mass = float(model.elements.mass[0])
    model.advance(steps=1)
    body = model.elements.body
    assert sorted((body.thickness[0], body.width[0], body.length[0])) == pytest.approx([150.0, 150.0, 200.0])
    assert body.thickness[0] == pytest.approx(150.0)
    assert body.mass[0] == mass


# -------------------------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("water", "melt", "told"),
    [
        ({"temperature": None, "salinity": None}, {}, "no temperature and no salinity of the sea"),
        ({"temperature": None}, {}, "no temperature of the sea"),
        ({"salinity": None}, {}, "no salinity of the sea"),
        ({"temperature": None}, {"base": "turbulent"}, r"melt\.temperature"),
    ],
)
def test_melt_without_water_is_refused_by_name(water: dict[str, Any], melt: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told):
        Model(block(1, 1), sea(**water), QUICK.changed(melt=melt))


def test_numbers_stand_for_what_is_missing() -> None:
    p = QUICK.changed(melt={"temperature": 3.0, "salinity": 34.0})
    ours, theirs = run(p, 2, temperature=None, salinity=None), run(steps=2)
    np.testing.assert_array_equal(ours.elements.mass, theirs.elements.mass)
    Model(block(1, 1), sea(salinity=None), QUICK.changed(melt={"base": "turbulent"}))


def test_kelvin_is_refused() -> None:
    with pytest.raises(ForcingError, match=r"temperature = 274\.5 .*kelvin\? Then give 1\.35"):
        sea(temperature=274.5)
    with pytest.raises(InputError, match="<= 40, in degree_Celsius"):
        QUICK.changed(melt={"temperature": 274.5})


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"melt": {"salinity": -1.0}}, "a number >= 0 and <= 50"),
        ({"melt": {"bits_fraction": 1.5}}, "a number >= 0 and <= 1"),
        ({"melt": {"mode": "shelf", "base": "turbulent"}}, "needs melt.base"),
        ({"footloose": {"enabled": True}, "melt": {"enabled": False}}, "melt.enabled = true"),
        ({"footloose": {"enabled": True}, "melt": {"split": False}}, "melt.split = true"),
        ({"melt": {"law": "x"}}, "there is no such parameter"),
    ],
)
def test_parameters_that_cannot_be_are_refused(changes: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told):
        QUICK.changed(**changes)


def test_children_of_one_step_melt_each_by_its_own_length() -> None:
    """Ice that was born in a step has no number of its berg yet, and all of it was taken for one berg."""
    berg = Iceberg.join([
        Iceberg.rectangle(3e3, 3e3, thickness=200.0, placement=(-37.0 + k, -56.0)) for k in range(3)
    ])  # fmt: skip
    model = Model(berg, Forcing.uniform(temperature=2.0, salinity=34.0), Parameters(melt={"enabled": True}))
    model.step()
    body, values = model.elements.body, life_values(model.parameters)
    one_by_one = base_spans(model.elements, values)
    body.berg[:] = 0
    assert base_spans(model.elements, values).tolist() == one_by_one.tolist() == body.length.tolist()


def test_a_child_of_a_grounded_berg_is_afloat() -> None:
    """It took the load of the floor and what the bed holds of its parent, a hundred times its own."""
    p = Parameters(
        melt={"enabled": True}, grounding={"law": "seabed"},
        footloose={"enabled": True, "style": "bergs"},
    )  # fmt: skip
    sea = Forcing.uniform(current=(0.4, 0.0), depth=165.5, temperature=3.0, salinity=34.0, slope=(0.0, 0.0))
    model = Model(Iceberg.rectangle(3e3, 3e3, thickness=200.0, placement=(-37.0, -56.0)), sea, p)
    model.step()
    model.elements.fl_k[:] = 3e5
    model.step()
    keel = model.elements.keel
    assert keel.floor_load[0] > 0.0
    assert model.elements.size > 1
    assert not any(array[1:].any() for array in keel)


def test_what_another_forcing_said_of_the_water_ends_with_it(tmp_path) -> None:
    """Water at the keel and waves stayed from the forcing before, and melted a resumed berg three times as fast."""
    sea = Forcing.uniform(temperature=-1.0, salinity=34.0)
    model = Model(
        Iceberg.rectangle(3e3, 3e3, thickness=200.0, placement=(-37.0, -56.0)), sea, Parameters(melt={"enabled": True})
    )
    model.step()
    model.elements.keel_temperature[:], model.elements.wave_height[:] = 5.0, 8.0
    model.save(tmp_path / "restart.nc")
    resumed = Model.resume(tmp_path / "restart.nc", sea)
    assert np.isnan(resumed.elements.keel_temperature).all()
    assert (resumed.elements.wave_height < 0.0).all()
