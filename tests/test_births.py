"""Elements that come and go in a run: identity, restarts, files, fragments, sub-steps, and bergs that do not meet."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from riftberg import A68A_2022, A68A_2022_KID, A68A_2022_MTS, Forcing, Iceberg, Model, Parameters, open_run
from riftberg.errors import InputError, RunError
from riftberg.runs.run_file import RunWriter
from riftberg.runs.scene import Scene
from riftberg.state import BOND_VARIABLES, ELEMENT_VARIABLES, new_bonds, new_elements
from riftberg.state.population import Population

PLANE = {"latlon": False, "f_plane": True, "reference_latitude": -55.0, "period": 0.0}
BASE = A68A_2022_MTS.changed(earth=PLANE, fracture={"normal_strength": 10e3, "shear_strength": 10e3})
SPRING = {"bonds": {"law": "spring", "spring": 1e-4}, "fracture": {"enabled": False}}
SCHEMES: dict[str, Parameters] = {
    "mts": BASE.changed(stepping={"substeps": None}),
    "verlet": BASE.changed(**SPRING, stepping={"scheme": "verlet", "time_step": 20.0}),
    "runge_kutta": BASE.changed(**SPRING, stepping={"scheme": "runge_kutta", "time_step": 20.0}),
}
each_scheme = pytest.mark.parametrize("scheme", SCHEMES)
SIDE = 3000.0


def block(columns: int, rows: int, x: float = 0.0, y: float = 0.0, **body: float) -> Iceberg:
    """Return a berg of squares in plane coordinates."""
    i, j = (q.ravel() for q in np.meshgrid(np.arange(columns), np.arange(rows)))
    body = {"thickness": 200.0, **body}
    return Iceberg.from_points(x + SIDE * i, y + SIDE * j, latlon=False, **body)  # type: ignore[arg-type]


def ocean() -> Forcing:
    return Forcing.uniform(current=(0.3, -0.1), wind=(8.0, 4.0), slope=(1e-6, 2e-6), depth=500.0)


def come_and_go(model: Model) -> None:
    """Remove and add elements at random, and let all melt; whatever is drawn depends on the step alone."""
    rng = np.random.default_rng(model.step_number)
    body = model.elements.body
    for values in (body.mass, body.thickness):
        values *= 1.0 - 1e-4 * rng.random()
    if rng.random() < 0.6:
        model.remove(rng.choice(body.id, int(rng.integers(1, 3)), replace=False))
    if rng.random() < 0.8:
        new = new_elements(2)
        new.place.lon[:] = 6e4 * model.step_number + SIDE * np.arange(2)
        new.place.lat[:], new.motion.u[:] = -5e4, 0.1
        new.body.mass[:], new.body.thickness[:] = 1.5e12, 200.0
        new.body.length[:] = new.body.width[:] = SIDE
        model.append(new, new_bonds(np.array([0]), np.array([1])))


def lively(scheme: str) -> Model:
    model = Model(block(5, 3), ocean(), SCHEMES[scheme])
    model.after_step.append(come_and_go)  # type: ignore[arg-type]
    return model


def bits(model: Model) -> dict[str, object]:
    """All that a model is."""
    named = {v.name: getattr(model.elements, v.name).tobytes() for v in ELEMENT_VARIABLES}
    named |= {f"bond {v.name}": getattr(model.bonds, v.name).tobytes() for v in BOND_VARIABLES}
    following = model.population.next_element, model.population.next_bond
    return {**named, "following": following, "tree": repr(model.fragments.rows), "time": model.time}


def differing(one: Model, other: Model) -> list[str]:
    a, b = bits(one), bits(other)
    return [name for name in a if a[name] != b[name]]


@pytest.mark.quick(1)
@each_scheme
def test_a_run_with_births_and_deaths_goes_on_bit_for_bit(tmp_path: Path, scheme: str) -> None:
    whole, files, seen = lively(scheme), [], set()
    for step in range(9):
        files.append(whole.save(tmp_path / f"{step}.nc"))
        whole.step()
        seen |= set(whole.elements.id.tolist())
        assert len(set(whole.elements.id.tolist())) == whole.elements.size
    assert (
        max(seen) == whole.population.next_element - 1 > 15 > len(set(whole.elements.id.tolist()) & set(range(1, 16)))
    )
    for file in files:
        resumed = Model.resume(file, ocean())
        resumed.after_step.append(come_and_go)  # type: ignore[arg-type]
        while resumed.step_number < whole.step_number:
            resumed.step()
        assert differing(resumed, whole) == [], file.name


@each_scheme
def test_a_process_that_fails_takes_the_step_back(scheme: str) -> None:
    model, same = lively(scheme), lively(scheme)
    model.advance(steps=3)
    same.advance(steps=3)

    def fail(_: object) -> None:
        raise RunError("no more")

    model.after_step.append(fail)
    with pytest.raises(RunError, match="no more"):
        model.step()
    assert differing(model, same) == []
    model.after_step.pop()
    model.step()
    same.step()
    assert differing(model, same) == []


@each_scheme
def test_the_newly_born_have_their_environment_and_a_number(scheme: str) -> None:
    model = Model(block(3, 2), ocean(), SCHEMES[scheme])
    model.advance(steps=1)
    new = block(2, 1, x=1e5)
    ids = model.append(new.elements, new.bonds)
    model.step()
    rows = model.population.rows(ids)
    assert (model.elements.uo[rows] == 0.3).all()
    assert (model.elements.depth[rows] == 500.0).all()
    assert model.elements.berg[rows].tolist() == [2, 2]
    assert model.fragments.rows[-1].parent == 0
    assert model.elements.bond_count[rows].tolist() == [1, 1]
    assert model.fragments.rows[-1].birth_time == model.parameters.time_step


def test_a_berg_that_loses_its_middle_becomes_two_fragments() -> None:
    model = Model(block(5, 1), ocean(), SCHEMES["mts"])
    model.advance(steps=1)
    model.remove([3])
    model.step()
    assert model.fragment_count == 2
    assert [row.parent for row in model.fragments.rows] == [0, 1]


def test_all_elements_may_go_and_others_come() -> None:
    model = Model(block(2, 1), ocean(), SCHEMES["mts"])
    model.advance(steps=1)
    model.remove([1, 2])
    model.advance(steps=2)
    assert (model.elements.size, model.step_number) == (0, 3)
    new = block(2, 1)
    assert model.append(new.elements, new.bonds).tolist() == [3, 4]
    model.advance(steps=1)
    assert np.isfinite(model.elements.lon).all()


def test_a_bad_newborn_is_refused_and_the_run_stays_as_it_was() -> None:
    model = Model(block(2, 1), ocean(), SCHEMES["mts"])
    model.advance(steps=1)

    def bear(m: Model) -> None:
        m.append(new_elements(1))

    model.after_step.append(bear)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="mass is 0"):
        model.step()
    assert (model.elements.size, model.step_number) == (2, 1)


def test_substeps_are_chosen_anew_when_mass_changes() -> None:
    model = Model(block(3, 2), ocean(), SCHEMES["mts"])
    model.advance(steps=1)
    before = model.substeps
    model.elements.mass[:] *= 0.25
    model.elements.thickness[:] *= 0.25
    model.elements.body.mass[:] *= 0.25
    model.elements.body.bond_area[:] *= 0.25
    model.step()
    assert model.substeps > before


def test_a_given_number_of_substeps_that_became_too_small_is_refused() -> None:
    p = BASE.changed(bonds={"constant_size": False}, stepping={"substeps": 90})
    model = Model(block(3, 2), ocean(), p)
    model.advance(steps=1)
    model.elements.mass[:] *= 1e-3
    with pytest.raises(InputError, match=r"stepping\.substeps"):
        model.step()


@pytest.mark.parametrize("substeps", [10**11, 10**30])
def test_more_substeps_than_an_array_can_hold_are_refused_in_words(substeps: int) -> None:
    with pytest.raises(InputError, match=r"stepping\.substeps.*(sub-steps in a long step|Allowed)"):
        Model(block(3, 2), ocean(), BASE.changed(stepping={"substeps": substeps}))


def test_melting_sides_do_not_strain_the_bonds() -> None:
    """The rest length is that with which the bond formed; with the reference's rule the berg would pull itself together."""
    strains = {}
    for rule in (False, True):
        p = BASE.changed(
            bonds={"constant_size": False}, fracture={"enabled": False}, stepping={"substeps": None},
            compatibility={"rest_length_from_sizes": rule},
        )  # fmt: skip
        model = Model(block(4, 1), Forcing.uniform(), p)
        model.advance(steps=1)
        body = model.elements.body
        body.length[:] *= 0.98
        body.width[:] *= 0.98
        body.mass[:] *= 0.98**2
        model.advance(steps=2)
        strains[rule] = float(np.abs(model.bonds.bond_length / SIDE - 1.0).max())
    assert strains[False] < 1e-9 < 0.015 < strains[True]


def test_rest_lengths_travel_in_restarts(tmp_path: Path) -> None:
    model = Model(block(4, 1), ocean(), SCHEMES["mts"])
    model.advance(steps=1)
    model.bonds.rest_length[:] *= 1.0 + 1e-5 * np.arange(3)
    same = Model.resume(model.save(tmp_path / "a.nc"), ocean())
    model.step()
    same.step()
    assert differing(same, model) == []


@pytest.mark.quick(3)
@pytest.mark.parametrize("scheme", ["mts", "mts, spring, implicit", "verlet", "runge_kutta"])
@pytest.mark.parametrize("far", ["stiff", "large", "colliding"])
def test_a_berg_far_away_changes_nothing(scheme: str, far: str) -> None:
    """Alone or with others in the run: bit for bit the same, also in contact."""
    p = SCHEMES.get(scheme) or BASE.changed(
        **SPRING, stepping={"explicit_substeps": False, "time_step": 600.0, "substeps": 60}
    )
    near = [block(3, 2, velocity=(0.4, 0.0)), block(3, 2, x=3.05 * SIDE, velocity=(-0.4, 0.05))]
    others = {
        "stiff": [block(6, 4, x=9e5, thickness=90.0)],
        "large": [Iceberg.from_points(9e5 + 9e3 * np.arange(3), np.zeros(3), thickness=200.0, latlon=False)],
        "colliding": [block(3, 2, x=9e5, velocity=(1.0, 0.0)), block(3, 2, x=9e5 + 3.05 * SIDE, velocity=(-1.0, 0.0))],
    }[far]
    alone, together = (Model(joined(bergs), ocean(), p) for bergs in (near, [*near, *others]))
    for _ in range(6):
        alone.step()
        together.step()
        n, b = alone.elements.size, alone.bonds.first.size
        for name, array in alone.elements.arrays().items():
            if name != "berg":  # fragments are numbered through the whole run
                np.testing.assert_array_equal(getattr(together.elements, name)[:n], array, err_msg=name)
        for name, array in alone.bonds.arrays().items():
            np.testing.assert_array_equal(getattr(together.bonds, name)[:b], array, err_msg=name)
    if scheme == "mts" and far == "stiff":
        assert len(set(together.elements.substeps.tolist())) > 1


def joined(bergs: list[Iceberg]) -> Iceberg:
    """Put bergs into one state."""
    population = Population(bergs[0].elements.copy(), bergs[0].bonds.copy())
    for other in bergs[1:]:
        population.append(other.elements, other.bonds)
    return replace(bergs[0], elements=population.elements, bonds=population.bonds)


def test_the_reference_couples_all_bergs() -> None:
    assert A68A_2022_KID.compatibility.bergs_coupled
    assert A68A_2022_KID.compatibility.rest_length_from_sizes
    assert not A68A_2022.quirks.bergs_coupled


@pytest.mark.parametrize("most", [2_000, pytest.param(50_000, marks=pytest.mark.slow)])
def test_growth_from_500_elements_within_a_run(most: int) -> None:
    p = BASE.changed(fracture={"enabled": False}, stepping={"time_step": 60.0, "substeps": 3})
    model = Model(block(25, 20), ocean(), p)

    def double(m: Model) -> None:
        count = min(m.elements.size, most - m.elements.size)
        if count > 0:
            new = m.elements.taken(slice(0, count))
            new.place.lat[:] += 20 * SIDE * (m.elements.size // 500)
            new.body.berg[:] = 0
            m.append(new)

    model.after_step.append(double)  # type: ignore[arg-type]
    model.advance(steps=9)
    assert model.elements.size == most
    assert len(set(model.elements.id.tolist())) == most
    assert np.isfinite(model.elements.lon).all()
    assert model.fragment_count == 1 + most - 500


# ------------------------------------------------------------------------------------------------------- the run file


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[float, dict[int, float]]]:
    """A lively run, its file, and the eastward positions by time and identifier."""
    path = tmp_path_factory.mktemp("births") / "run.nc"
    model, seen = lively("mts"), {}

    class Witness:
        def start(self, m: Model) -> None:
            self.record(m)

        def record(self, m: Model) -> None:
            seen[m.time] = dict(zip(m.elements.id.tolist(), m.elements.lon.tolist(), strict=True))

        def finish(self, m: Model) -> None:
            pass

    writer = RunWriter(path, every_hours=0.0, flush_seconds=0.0, background=False)
    model.advance(steps=8, recorders=[writer, Witness()])
    return path, seen


@pytest.mark.slow
def test_every_element_has_values_in_its_life_and_at_no_other_time(recorded: tuple) -> None:
    path, seen = recorded
    with open_run(path) as run:
        ids, x = run["trajectory"].values, run["x"].transpose("time", "trajectory").values
        assert len(set(ids.tolist())) == len(ids) > 15
        for record, positions in enumerate(seen.values()):
            there = np.isfinite(x[record])
            assert dict(zip(ids[there].tolist(), x[record][there].tolist(), strict=True)) == positions
            for name in ("u", "thickness", "berg", "mass"):
                assert (np.isfinite(run[name].transpose("time", "trajectory").values[record]) == there).all(), name


def test_mass_is_in_time_where_it_changes_and_sides_are_not(recorded: tuple) -> None:
    with open_run(recorded[0]) as run:
        assert set(run["mass"].dims) == {"trajectory", "time"}
        assert run["length"].dims == ("trajectory",)
        mass = run["mass"].sel(trajectory=run["trajectory"][0]).values
        assert (np.diff(mass[np.isfinite(mass)]) < 0.0).all()


def test_bonds_name_rows_of_the_file(recorded: tuple) -> None:
    with open_run(recorded[0]) as run:
        x = run["x"].transpose("time", "trajectory").values
        there = np.isfinite(x)
        first, second = run["bond_first"].values, run["bond_second"].values
        assert (there[:, first] & there[:, second]).any(axis=0).all()
        apart = np.where(there[:, first] & there[:, second], np.abs(x[:, first] - x[:, second]), 0.0).max(axis=0)
        assert (apart < 2.0 * SIDE).all()
        gone = ~(there[-1, first] & there[-1, second])
        assert gone.any()
        assert (run["status"].values[gone] == 2).all()


def test_a_scene_shows_only_those_that_are_there(recorded: tuple) -> None:
    with open_run(recorded[0]) as run:
        scene = Scene(run)
        for record in range(len(scene.times)):
            drawn = np.isfinite(scene.polygons(record)).all(axis=(1, 2))
            assert (drawn == scene.there[record]).all()
            assert (scene.berg[record][~scene.there[record]] == 0).all()
        assert np.isfinite(scene.x).all()
        assert 0 not in scene.numbers


def test_opens_in_trajan_and_clouddrift(recorded: tuple) -> None:
    pytest.importorskip("trajan")
    with open_run(recorded[0]) as run:
        assert run["x"].dims == ("trajectory", "time")
        ragged = run["x"].values[np.isfinite(run["x"].values)]
        assert ragged.size == sum(len(positions) for positions in recorded[1].values())


def test_a_run_without_births_has_the_layout_that_it_always_had(tmp_path: Path) -> None:
    import netCDF4

    model = Model(block(3, 2), ocean(), SCHEMES["mts"])
    model.advance(steps=2, recorders=[RunWriter(tmp_path / "run.nc", background=False)])
    with netCDF4.Dataset(tmp_path / "run.nc") as file:
        assert file["mass"].dimensions == ("trajectory",)
        assert not any("_FillValue" in variable.ncattrs() for variable in file.variables.values())
