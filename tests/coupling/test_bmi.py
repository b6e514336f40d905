"""The Basic Model Interface: names, values, time, grid; the same numbers as the exchange; bad configurations refused."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from riftberg.coupling.fields import GIVEN, TAKEN
from riftberg.errors import ForcingError, InputError

bmi = pytest.importorskip("riftberg.coupling.bmi", reason="the extra bmi is not installed")

CONFIGURATION = """
grid: {west: -40, east: -36, south: -58, north: -55, columns: 16, rows: 12, depth: 3000}
berg: {length: 6000, width: 6000, thickness: 200, lon: -38, lat: -56.5}
parameters: {melt: {enabled: true, mode: berg, base: turbulent}}
ocean: {sea_surface_temperature: 1.5}
days: 1
"""


@pytest.fixture
def model(tmp_path: Path):
    path = tmp_path / "riftberg.yaml"
    path.write_text(CONFIGURATION)
    component = bmi.BmiRiftberg()
    component.initialize(str(path))
    return component


def test_a_step_gives_melt_water_where_the_berg_is(model) -> None:
    name = "water_flux_into_sea_water_from_icebergs"
    model.update()
    flux = model.get_value(name, np.zeros(12 * 16))
    assert flux.max() > 0.0
    assert model.get_current_time() == model.get_time_step() == 1800.0
    assert model.get_value_ptr(name) is not flux
    np.testing.assert_array_equal(model.get_value_ptr(name), flux)
    where = np.array([int(flux.argmax())])
    assert model.get_value_at_indices(name, np.zeros(1), where)[0] == flux.max()
    assert abs(model.exchange.balance().error) < 1e-12


def test_input_is_set_as_a_whole_and_in_part(model) -> None:
    name = "sea_surface_temperature"
    model.set_value(name, np.full(12 * 16, 3.0))
    model.set_value_at_indices(name, np.array([0, 5]), np.array([4.0, 5.0]))
    assert model.get_value_ptr(name)[[0, 1, 5]].tolist() == [4.0, 3.0, 5.0]
    model.update_until(3600.0)
    assert model.get_current_time() == 3600.0
    with pytest.raises(InputError, match="whole steps"):
        model.update_until(4000.0)


def test_bergs_that_melt_need_a_temperature_that_is_given(tmp_path: Path) -> None:
    """It was 0 where none was given."""
    path = tmp_path / "riftberg.yaml"
    path.write_text(CONFIGURATION.replace("ocean: {sea_surface_temperature: 1.5}", "ocean: {}"))
    component = bmi.BmiRiftberg()
    component.initialize(str(path))
    assert np.isnan(component.get_value_ptr("sea_surface_temperature")).all()
    with pytest.raises(ForcingError, match="no sea_surface_temperature, but bergs melt"):
        component.update()
    component.set_value_at_indices("sea_surface_temperature", np.array([0]), np.array([1.0]))
    with pytest.raises(InputError, match=r"exchange, sea_surface_temperature: nan"):
        component.update()
    component.get_value_ptr("sea_surface_temperature")[:] = 1.5
    component.update()
    component.get_value_ptr("sea_surface_temperature")[:] = np.nan
    with pytest.raises(InputError, match=r"exchange, sea_surface_temperature: nan"):
        component.update()
    assert component.get_current_time() == 1800.0


def test_names_are_those_of_csdms_and_those_of_cf_are_known(model) -> None:
    """The tester of CSDMS looked at long names of CF for longer than anybody waits."""
    names = (*model.get_input_var_names(), *model.get_output_var_names())
    assert set(names) == set(bmi.NAMES)
    assert set(bmi.NAMES.values()) == {*TAKEN, *GIVEN} - {
        "surface_downward_eastward_stress",
        "surface_downward_northward_stress",
    }
    for name, known in bmi.NAMES.items():
        assert re.fullmatch(r"[a-z]+([-_][a-z]+)*__[a-z]+([-_][a-z]+)*", name)
        assert model.get_value_ptr(name).base is model.get_value_ptr(known).base
        assert model.get_var_units(name) == model.get_var_units(known) == {**TAKEN, **GIVEN}[known].units
    model.update()
    assert model.get_value("iceberg__melt_mass_flux", np.zeros(12 * 16)).max() > 0.0
    for ask in (model.get_var_units, model.get_var_grid, model.get_value_ptr):
        with pytest.raises(InputError, match="no variable 'iceberg__melt'"):
            ask("iceberg__melt")


def test_names_units_and_grid(model) -> None:
    names = (*model.get_input_var_names(), *model.get_output_var_names())
    assert len(names) == model.get_input_item_count() + model.get_output_item_count()
    for name in names:
        assert model.get_var_units(name)
        assert model.get_var_nbytes(name) == model.get_var_itemsize(name) * model.get_grid_size(
            model.get_var_grid(name)
        )
    assert model.get_grid_shape(0, np.zeros(2, int)).tolist() == [12, 16]
    assert model.get_grid_y(0, np.zeros(12))[[0, -1]].tolist() == pytest.approx([-57.875, -55.125])
    assert model.get_grid_x(0, np.zeros(16))[[0, -1]].tolist() == pytest.approx([-39.875, -36.125])
    model.finalize()
    with pytest.raises(InputError, match="not initialized"):
        model.update()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("days: 3", "no section 'grid'"),
        ("grid: {west: 1}", "grid.east: this key is missing"),
        (CONFIGURATION + "gird: 3", "unknown section 'gird'"),
        (CONFIGURATION.replace("sea_surface_temperature", "temperature"), "unknown field 'temperature'"),
        (CONFIGURATION.replace("1.5", "274.5"), "looks like kelvin"),
        (CONFIGURATION.replace("1.5", "warm"), "ocean, sea_surface_temperature: 'warm' is not a number"),
        (CONFIGURATION.replace("ocean: {sea_surface_temperature: 1.5}", "ocean: 3"), "'ocean' is no list"),
        (CONFIGURATION.replace("columns: 16", "columns: 2.5"), "grid.columns: 2.5 is not possible"),
        (CONFIGURATION.replace("west: -40", "west: -30"), "west below east"),
        (CONFIGURATION.replace("depth: 3000", "depth: .nan"), "grid.depth: nan is no finite number"),
        (CONFIGURATION.replace("lon: -38", "lon: 38"), "outside"),
        (CONFIGURATION.replace("lon: -38", "long: -38"), "unknown 'long' of the berg"),
        (CONFIGURATION.replace("days: 1", "days: -1"), "days = -1"),
        (CONFIGURATION.replace("melt:", "mellt:"), "Did you mean 'melt'"),
    ],
)
def test_configurations_that_cannot_be_are_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        bmi.BmiRiftberg().initialize(str(path))


@pytest.mark.slow
def test_the_tester_of_csdms_passes(model, tmp_path: Path) -> None:
    """The command of the how-to page."""
    pytest.importorskip("bmi_tester", reason="bmi-tester is not installed (extra tests)")
    config = tmp_path / "riftberg.yaml"
    words = ["riftberg.coupling.bmi:BmiRiftberg", "--root-dir", str(tmp_path), "--config-file", str(config)]
    settings = {**os.environ, "PYTEST_ADDOPTS": "-W default -p no:cacheprovider", "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "bmi_tester", *words], env=settings, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:]
    assert "All tests passed" in done.stderr
    assert "failed" not in done.stdout
    assert "not a valid standard name" not in done.stdout
