"""Restart files are the state, bit for bit."""

from __future__ import annotations

from pathlib import Path

import netCDF4
import numpy as np
import pytest

from fakes import FakeModel
from riftberg import A68A_2022
from riftberg.errors import InputError
from riftberg.runs.restart import load_state, save, seal
from riftberg.state import BOND_VARIABLES, ELEMENT_VARIABLES

FORMAT = 7


def random_model() -> FakeModel:
    """Return a model whose every number is random, with awkward ones among them."""
    rng = np.random.default_rng(11)
    model = FakeModel(5, 4, parameters=A68A_2022.changed(fracture={"normal_strength": 18e3 / 3.0}))
    for variables, arrays in ((ELEMENT_VARIABLES, model.elements), (BOND_VARIABLES, model.bonds)):
        for v in variables:
            array = getattr(arrays, v.name)
            array[:] = rng.integers(0, 2**60, array.size) if v.dtype == "i8" else rng.normal(size=array.size)
    model.elements.u[:4] = [np.nan, np.inf, -0.0, 5e-324]
    model.bonds.break_time[:] = np.nan
    model.bonds.break_time[0] = 1.0 / 3.0
    model.time, model.step_number = 0.1 + 0.2, 17
    return model


def test_state_comes_back_bit_for_bit(tmp_path: Path) -> None:
    model = random_model()
    back = load_state(save(model, tmp_path / "a.restart.nc"), check=False)
    for variables, old, new in (
        (ELEMENT_VARIABLES, model.elements, back.elements),
        (BOND_VARIABLES, model.bonds, back.bonds),
    ):
        for v in variables:
            if v.restart:
                assert getattr(old, v.name).tobytes() == getattr(new, v.name).tobytes(), v.name
    assert (back.time, back.step_number, back.start) == (model.time, 17, model.start)
    assert back.parameters == model.parameters
    assert back.parameters.fracture.normal_strength == 6000.0


def test_family_tree_and_extras_come_back(tmp_path: Path) -> None:
    model = FakeModel()
    for _ in range(50):
        model.step()
    extra = {"flags": np.array([[True, False], [True, True]]), "sum": 1.0 / 3.0, "ids": np.arange(3)}
    back = load_state(save(model, tmp_path / "a.nc", extra=extra), check=False)
    assert back.fragments == model.fragments.rows
    np.testing.assert_array_equal(back.extra["flags"], extra["flags"])
    assert back.extra["sum"] == 1.0 / 3.0
    np.testing.assert_array_equal(back.extra["ids"], [0, 1, 2])


def test_failed_save_leaves_the_earlier_file(tmp_path: Path) -> None:
    model, path = FakeModel(), tmp_path / "a.nc"
    save(model, path)
    before = path.read_bytes()
    with pytest.raises(TypeError):
        save(model, path, extra={"bad": object()})
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_wrong_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_state(tmp_path / "none.nc")
    (tmp_path / "text.nc").write_text("hello")
    with pytest.raises(InputError, match="not readable as NetCDF-4"):
        load_state(tmp_path / "text.nc")
    netCDF4.Dataset(tmp_path / "empty.nc", "w").close()
    with pytest.raises(InputError, match="not a restart file of Riftberg"):
        load_state(tmp_path / "empty.nc")


def test_a_variable_that_was_added_later_takes_its_default(tmp_path: Path) -> None:
    """As of a file from before it was in the registry; one that the file lists, but has lost, is refused (below)."""
    path = save(FakeModel(), tmp_path / "a.nc")
    with netCDF4.Dataset(path, "a") as file:
        for table, name in (("element", "wave_height"), ("bond", "damage")):
            file.renameVariable(f"{table}_{name}", f"{table}_nothing")
            names = str(file.getncattr(f"{table}_variables")).split()
            file.setncattr(f"{table}_variables", " ".join(n for n in names if n != name))
        seal(file)
    state = load_state(path)
    assert set(state.elements.wave_height) == {-1.0}
    assert set(state.bonds.damage) == {0.0}


def test_other_layouts_and_missing_variables_are_refused(tmp_path: Path) -> None:
    path = save(FakeModel(), tmp_path / "a.nc")
    with netCDF4.Dataset(path, "a") as file:
        file.renameVariable("element_spin", "element_twist")
        seal(file)
    with pytest.raises(InputError, match="element_spin"):
        load_state(path)
    with netCDF4.Dataset(path, "a") as file:
        file.riftberg_restart_format = FORMAT + 1
    with pytest.raises(InputError, match="newer than this Riftberg"):
        load_state(path)
    with netCDF4.Dataset(path, "a") as file:
        file.riftberg_restart_format = FORMAT - 1
    with pytest.raises(
        InputError,
        match=r"layout 6 is older than this Riftberg .*Use the Riftberg that wrote it .*, or make the run again",
    ):
        load_state(path)
