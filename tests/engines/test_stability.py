"""The automatic sub-step against what real lattices bear when they are run."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from riftberg import A68A_2022_KID, A68A_2022_MTS, Forcing, Iceberg, Model, Parameters
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.explicit.stability import (
    SubstepMatrix,
    choose_substeps,
    critical_time_step,
    largest_eigenvalue,
    size_bins,
)
from riftberg.errors import InputError, RunError

RADIUS = 1500.0


def _parameters(**groups):
    base = {
        "earth": {"latlon": False, "period": 0.0},
        "fracture": {"enabled": False},
        "stepping": {"scheme": "mts", "only_interactions": True, "substeps": None},
        # Published bonds may start without the force that a proper start gives them, so that a step may be too long.
        "bonds": {"constant_size": False},
    }
    for group, values in groups.items():
        base[group] = {**base.get(group, {}), **values}
    return A68A_2022_MTS.changed(**base)


def _berg(packing="square", thickness=200.0, side=4, **kwargs):
    length = 2 * RADIUS * side
    return Iceberg.rectangle(
        length, length, thickness=thickness, radius=RADIUS, packing=packing, latlon=False, **kwargs
    )


def _limit(berg, p):
    return critical_time_step(p, berg.elements, berg.bonds, interaction_sizes(berg.elements, p.kernel_values()))


def _growth(berg, p, substep):
    """Factor by which small random motions of the lattice grow over 500 sub-steps."""
    model = Model(berg, Forcing.uniform(), p.changed(stepping={"time_step": 500 * substep, "substeps": 500},
                                            compatibility={"zero_start": True}))  # fmt: skip
    r = np.random.default_rng(3)
    for name in ("u", "v"):
        getattr(model.elements, name)[:] = 1e-9 * r.standard_normal(model.elements.u.size)
    model.elements.spin[:] = 1e-9 / RADIUS * r.standard_normal(model.elements.u.size)
    before = _speed(model)
    try:
        model.step()
    except RunError:
        return math.inf
    return _speed(model) / before


def _speed(model):
    el = model.elements
    return float(np.sqrt(np.sum(el.u**2 + el.v**2 + (RADIUS * el.spin) ** 2)))


def _scattered_thickness(packing):
    count = _berg(packing).elements.mass.size
    return 200.0 * np.random.default_rng(5).uniform(0.5, 1.5, count)


@pytest.mark.quick(4)
@pytest.mark.compiled
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("objective", [True, False])
@pytest.mark.parametrize(
    "change",
    [{}, {"damping": 0.0}, {"youngs_modulus": 1e9}, {"no_shear": True}],
    ids=["as published", "undamped", "stiff", "without shear"],
)
def test_lattice_is_stable_below_the_limit_and_not_above(packing, objective, change) -> None:
    p = _parameters(bonds={"packing": packing, "objective_damping": objective, **change})
    berg = _berg(packing)
    limit = _limit(berg, p)
    assert _growth(berg, p, 0.99 * limit) < 3.0
    assert _growth(berg, p, 1.03 * limit) > 30.0


@pytest.mark.compiled
@pytest.mark.parametrize("objective", [True, False])
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_limit_holds_where_thickness_varies(packing, objective) -> None:
    p = _parameters(bonds={"packing": packing, "objective_damping": objective})
    berg = _berg(packing, _scattered_thickness(packing))
    limit = _limit(berg, p)
    assert limit < _limit(_berg(packing), p)
    assert _growth(berg, p, 0.99 * limit) < 3.0
    assert _growth(berg, p, 1.03 * limit) > 30.0


def test_limit_of_spring_bonds() -> None:
    p = _parameters(bonds={"law": "spring", "packing": "hexagonal"}, contact={"tangential_critical_damping": True})
    berg = _berg("hexagonal")
    limit = _limit(berg, p)
    assert _growth(berg, p, 0.99 * limit) < 3.0
    assert _growth(berg, p, 1.03 * limit) > 30.0


def test_elements_that_never_move_have_no_inertia_to_lend() -> None:
    p = _parameters()
    x, y = RADIUS * np.array([1.0, 3.0]), np.zeros(2)
    clamped = Iceberg.from_points(x, y, thickness=200.0, radius=RADIUS, static=[True, False], latlon=False)
    limit = _limit(clamped, p)
    assert _growth(clamped, p, 0.99 * limit) < 3.0
    assert _growth(clamped, p, 1.03 * limit) > 30.0
    assert math.isinf(_limit(Iceberg.from_points(x, y, thickness=200.0, radius=RADIUS, static=True, latlon=False), p))


def test_limit_of_one_undamped_bond_is_that_of_its_fastest_oscillation() -> None:
    p = _parameters(bonds={"damping": 0.0})
    pair = Iceberg.from_points([0.0, 2 * RADIUS], [0.0, 0.0], thickness=200.0, radius=RADIUS, latlon=False)
    stiffness, mass = 5e6 * 200.0, 850.0 * 200.0 * 4 * RADIUS**2
    inertia = 0.5 * mass * RADIUS**2
    shear = stiffness / 2.6 * (2 / mass + 2 * RADIUS**2 / inertia)
    assert _limit(pair, p) == pytest.approx(2.0 / math.sqrt(shear), rel=0.011)


def test_limit_is_that_of_the_whole_matrix() -> None:
    p = _parameters(bonds={"packing": "hexagonal"})
    berg = _berg("hexagonal", _scattered_thickness("hexagonal"))
    sparse = SubstepMatrix(p, berg.elements, berg.bonds, interaction_sizes(berg.elements, p.kernel_values()))
    matrix = np.array([sparse @ one for one in np.eye(sparse.size)])
    assert np.abs(matrix - matrix.T).max() < 1e-12 * np.abs(matrix).max()
    exact = np.linalg.eigvalsh(matrix)[-1]
    assert exact <= largest_eigenvalue(sparse) <= 1.01 * exact


def test_published_run_is_within_the_limit() -> None:
    """The sub-step of the paper (20 s) is stable with either damper; an earlier bound of single bonds refused it."""
    for preset, limit in ((A68A_2022_MTS, 27.4), (A68A_2022_KID, 30.2)):
        p = preset.changed(earth={"latlon": False, "period": 0.0},
                           bonds={"constant_length": 2 * RADIUS, "constant_width": 2 * RADIUS})  # fmt: skip
        found = _limit(_berg(side=20), p)
        assert found == pytest.approx(limit, rel=0.01)
        assert found > 1800.0 / 90
        sizes = interaction_sizes(_berg(side=20).elements, p.kernel_values())
        berg = _berg(side=20)
        assert choose_substeps(p, berg.elements, berg.bonds, sizes) == 90


def test_number_of_substeps_keeps_the_safety_factor() -> None:
    p = _parameters(stepping={"safety": 0.7})
    model = Model(_berg(), Forcing.uniform(), p)
    limit = _limit(_berg(), p)
    assert 1800.0 / model.substeps <= 0.7 * limit < 1800.0 / (model.substeps - 1)


def test_substep_beyond_the_limit_is_refused() -> None:
    with pytest.raises(InputError, match=r"longer than the stable .*Set it to 8\d or more"):
        Model(_berg(), Forcing.uniform(), _parameters(stepping={"substeps": 50}))


def test_no_bonds_no_limit() -> None:
    p = _parameters()
    berg = _berg()
    berg.bonds.status[:] = 2
    assert math.isinf(_limit(berg, p))
    assert Model(berg, Forcing.uniform(), p).substeps == 1


def test_resumed_run_keeps_its_number_of_substeps(tmp_path) -> None:
    """A number found anew after bonds have broken would differ, and the run would not go on bit for bit."""
    p = _parameters(stepping={"only_interactions": False})
    model = Model(_berg(), Forcing.uniform(current=(0.3, 0.1), slope=(0.0, 0.0)), p)
    model.step()
    model.bonds.status[:-1] = 2
    resumed = Model.resume(
        model.save(tmp_path / "half.restart.nc"), Forcing.uniform(current=(0.3, 0.1), slope=(0.0, 0.0))
    )
    assert Model(_berg(), Forcing.uniform(), p).substeps == resumed.substeps == model.substeps
    for run in (model, resumed):
        run.step()
    assert np.array_equal(model.elements.lon, resumed.elements.lon)


@pytest.mark.compiled
def test_choice_takes_little_time() -> None:
    p = _parameters()
    berg = _berg(side=22)
    sizes = interaction_sizes(berg.elements, p.kernel_values())
    took = []
    for _ in range(5):
        began = time.process_time()  # the clock also counts what else the machine does
        critical_time_step(p, berg.elements, berg.bonds, sizes)
        took.append(time.process_time() - began)
    assert min(took) < 0.05


def test_defaults_need_no_number_of_substeps() -> None:
    assert Parameters(stepping={"scheme": "mts"}).stepping.substeps is None


def _loose(scheme, packing, step, spring=None, **groups):
    """A berg of spring bonds, whose elements move a little, in a scheme without sub-steps."""
    p = Parameters(
        earth={"latlon": False, "period": 0.0}, fracture={"enabled": False},
        bonds={"law": "spring", "spring": spring, "packing": packing},
        stepping={"scheme": scheme, "time_step": step, "only_interactions": True}, **groups,
    )  # fmt: skip
    model = Model(_berg(packing), Forcing.uniform(), p)
    model.elements.u[:] = 1e-3 * np.random.default_rng(3).standard_normal(model.elements.size)
    return model


@pytest.mark.quick(3)
@pytest.mark.parametrize("spring", [None, 1e-6])
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("scheme", ["verlet", "runge_kutta"])
def test_a_long_step_that_spring_bonds_cannot_bear_is_refused(scheme, packing, spring) -> None:
    """Bug: a bonded berg in a scheme without sub-steps went at 400 m/s to 19 km/s, with the default step, and nobody said so."""
    with pytest.raises(InputError, match="springs of these bonds bear") as refused:
        _loose(scheme, packing, 5000.0, spring)
    longest = float(str(refused.value).split("longer than the ")[1].split(" s ")[0])
    model = _loose(scheme, packing, 0.995 * longest, spring)
    for _ in range(4):
        model.advance(steps=50)
        assert np.hypot(model.elements.u, model.elements.v).max() < 4e-3
    with pytest.raises(InputError, match="springs of these bonds bear"):
        _loose(scheme, packing, 1.01 * longest, spring)
    _loose(scheme, packing, 5000.0, spring, compatibility={"zero_start": True})  # as the reference has it


@pytest.mark.parametrize("scheme", ["mts", "verlet", "runge_kutta"])
def test_contact_that_the_long_step_cannot_bear_is_refused(scheme) -> None:
    """Two bergs that touch would leave each other at a thousand times their speed."""
    bergs = Iceberg.join([
        Iceberg.rectangle(3e3, 3e3, thickness=200.0, radius=RADIUS, placement=(x, 0.0), latlon=False, velocity=(u, 0.0))
        for x, u in ((0.0, 0.1), (3010.0, -0.1))
    ])  # fmt: skip

    def bergs_with(spring, dt=1800.0, substeps=False):
        return Model(bergs, Forcing.uniform(), Parameters(
            earth={"latlon": False, "period": 0.0}, bonds={"law": "none"},
            stepping={"scheme": scheme, "time_step": dt, "only_interactions": True},
            contact={"spring": spring, "on_substeps": substeps},
        ))  # fmt: skip

    with pytest.raises(InputError, match=r"contact of 1e-05 s-2 swings in 1.4e\+03 s") as refused:
        bergs_with(1e-5)
    longest = float(str(refused.value).split("longer than the ")[1].split(" s ")[0])
    for allowed in (bergs_with(1e-5, 0.99 * longest), bergs_with(None), bergs_with(1e-7)):
        allowed.advance(steps=30)
        assert np.abs(allowed.elements.u).max() <= 0.21
    if scheme == "mts":
        bergs_with(1e-5, substeps=True).advance(steps=3)


def test_the_bins_of_sizes_see_what_changes_the_critical_step() -> None:
    """A fifth of mass, thickness or area; not a thousandth, unless an edge of a bin lies there."""
    elements = _berg(side=2).elements
    before = size_bins(elements)
    for name, changed in (("mass", 0), ("thickness", 1), ("length", 3)):
        values = getattr(elements, name)
        kept = values.copy()
        values *= 0.5
        assert (size_bins(elements)[changed] < before[changed]).all()
        values[:] = kept
    for now, then in zip(size_bins(elements), before, strict=True):
        np.testing.assert_array_equal(now, then)


def test_a_fixed_number_of_sub_steps_is_checked_wherever_they_are_explicit() -> None:
    berg = _berg()
    few = _parameters(bonds={"law": "spring"}, stepping={"time_step": 1800.0, "substeps": 1, "explicit_substeps": True})
    sizes = interaction_sizes(berg.elements, few.kernel_values())
    with pytest.raises(InputError, match="longer than the stable"):
        choose_substeps(few.changed(compatibility={"zero_start": False}), berg.elements, berg.bonds, sizes)
    implicit = few.changed(stepping={"explicit_substeps": False}, compatibility={"zero_start": False})
    assert choose_substeps(implicit, berg.elements, berg.bonds, sizes) == 1
