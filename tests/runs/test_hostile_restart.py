"""Restart files that are whole, but hold numbers that no run can have: refused by name before anything is indexed by them."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import netCDF4
import numpy as np
import pytest

from riftberg import Exchange, Iceberg, Model, OceanForcing, Parameters, ocean_grid
from riftberg.errors import InputError, RiftbergError
from riftberg.runs.restart import load_state, seal
from riftberg.state import BOND_VARIABLES, ELEMENT_VARIABLES
from riftberg.state.variables import LARGEST

WHOLE = (-5, 2**31, 2**63 - 1)
REAL = (np.nan, np.inf, -1e300)
HARMLESS = {
    # Identifiers may have gaps of any size below 2**62.
    ("element_id", 2**31), ("bond_id", 2**31), ("extra/next_element", 2**31), ("extra/next_bond", 2**31),
    ("element_entered", 2**31), ("bond_crack", 2**31), ("bond_crack_order", -5),
    ("extra/exchange_counter", 2**31),
    # A value at the keel that is missing, and a bond that holds.
    ("element_start_year", -5),
    # A byte in the middle of the coordinates of an outline: another coordinate.
    *(("extra/front_shapes", value) for value in WHOLE),
    *(((f"element_keel_{name}"), "nan") for name in ("temperature", "salinity")), ("bond_break_time", "nan"),
}  # fmt: skip


def ocean() -> OceanForcing:
    lon, lat = np.meshgrid(np.linspace(-38.0, -36.0, 21), np.linspace(-56.6, -55.4, 13))
    grid = ocean_grid(lon, lat)
    return OceanForcing(grid, grid.fields())


def begun(scheme: str = "quasi_static") -> tuple[Model, OceanForcing]:
    """Return two bonded bergs in an ocean model after three steps, with melt, an exchange and a record of forces."""
    forcing = ocean()
    bonded = scheme in ("mts", "quasi_static")
    melting = Parameters(melt={"enabled": True}, stepping={"scheme": scheme}, fracture={"enabled": bonded})
    size = ("12 km", "6 km") if bonded else ("3 km", "3 km")
    berg = Iceberg.rectangle(*size, thickness="200 m", placement=(-37.0, -56.0))
    model = Model(berg, forcing, melting, start="2020-12-09")
    exchange = Exchange(model)
    for _ in range(3):
        exchange.step({"sea_surface_temperature": (275.0, "K"), "sea_surface_salinity": 34.0})
    model.run(steps=2, forces=True)
    return model, forcing


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    model, _ = begun()
    return model.save(tmp_path_factory.mktemp("sound") / "sound.restart.nc")


@pytest.fixture
def file(sound: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(sound, tmp_path / "hostile.restart.nc"))


def variables(path: Path) -> Iterator[tuple[str, np.dtype]]:
    with netCDF4.Dataset(path) as ds:
        for name, variable in (*ds.variables.items(), *((f"extra/{n}", v) for n, v in ds["extra"].variables.items())):
            if variable.size:
                yield name, variable.dtype


def spoil(path: Path, name: str, value: float) -> None:
    with netCDF4.Dataset(path, "a") as ds:
        variable = ds[name]
        variable.set_auto_mask(False)
        values = np.array(variable[...])
        values.flat[values.size // 2] = np.asarray(value).astype(values.dtype)  # what the type can hold of it
        variable[...] = values
        seal(ds)


def test_every_whole_number_of_the_state_has_its_bounds() -> None:
    whole = [v for v in (*ELEMENT_VARIABLES, *BOND_VARIABLES) if v.dtype == "i8"]
    assert len(whole) == 17
    assert [v.name for v in whole if v.limits[0] < -(10**6) or v.limits[1] == LARGEST] == []


def test_the_sound_file_goes_on(sound: Path) -> None:
    """What follows is refused for the number that was changed, not for something else in this file."""
    model = Model.resume(sound, ocean())
    model.advance(steps=1)
    assert model.step_number == 6


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["in turn", "all"])
def test_every_number_of_a_restart_is_refused_where_it_cannot_be(every: bool, sound: Path, tmp_path: Path) -> None:
    """2**63 - 1 in `extra/rigid_body` wrote over the heap; 2**31 there asked for 16 GiB; NaN in sea and ledgers passed.

    The quick test takes every fourth variable, and gives it one of three values in turn.
    """
    passed, forcing = [], ocean()
    for turn, (name, kind) in enumerate(islice(variables(sound), 0, None, 1 if every else 4)):
        values = WHOLE if kind.kind in "iu" else REAL
        for value in values if every else values[turn % 3 :][:1]:
            if (name, value if kind.kind in "iu" else f"{value:g}") in HARMLESS:
                continue
            path = Path(shutil.copy(sound, tmp_path / "hostile.restart.nc"))
            spoil(path, name, value)
            try:
                Model.resume(path, forcing)  # cells are held against the grid
                passed.append((name, value, "taken"))
            except RiftbergError as error:
                if not any(word in str(error) for word in (name.split("_", 1)[-1], "cell (", "identifier")):
                    passed.append((name, value, str(error)))
    assert passed == []


@pytest.mark.quick(3)
@pytest.mark.parametrize(
    ("name", "value"),
    [("element_mass", 1e20), ("element_mass", 0.0), ("element_thickness", 5001.0), ("element_length", 2e6),
     ("element_start_mass", 1e19), ("bond_rest_length", 1e9), ("element_mass_of_bits", -1.0)],
)  # fmt: skip
def test_a_size_that_no_ice_has_is_refused(file: Path, name: str, value: float) -> None:
    spoil(file, name, value)
    with pytest.raises(InputError, match=rf"variable {name}: (element|bond) \d+ has \w+ = {re.escape(f'{value:g}')}"):
        Model.resume(file, ocean())


@pytest.mark.quick(1)
@pytest.mark.parametrize("value", [2**63 - 1, 2**31, -1])
def test_bodies_of_the_rigid_scheme_index_no_foreign_memory(file: Path, value: int) -> None:
    spoil(file, "extra/rigid_body", value)
    with pytest.raises(InputError, match=r"extra/rigid_body.*entry \d+ is .* not a whole number from 0 to 0"):
        Model.resume(file, ocean())


def test_cells_of_another_grid_are_refused_before_they_are_read(file: Path) -> None:
    """The sampling of fields goes by cells of the restart; a grid that is smaller had it read beyond its arrays."""
    lon, lat = np.meshgrid(np.linspace(-37.3, -36.7, 5), np.linspace(-56.2, -55.8, 5))
    small = ocean_grid(lon, lat)
    with pytest.raises(RiftbergError, match=r"cell \(\d+, \d+\) of a grid of \d+ by \d+"):
        Model.resume(file, OceanForcing(small, small.fields()))


@pytest.mark.quick(4)
@pytest.mark.parametrize(
    ("name", "shape", "word"),
    [
        ("rigid_pose", (1, 3), r"shape \(1, 3\) instead of"),
        ("rigid_bend", (7, 3), r"shape"),
        ("motion_ledger", (2, 2), r"shape"),
        ("life_ledger", (4,), r"shape"),
        ("next_element", (3,), r"shape \(3,\) instead of \(\)"),
        ("exchange_ice", (4,), r"shape"),
        ("melt_by_fragment", (2, 3), r"shape"),
    ],
)
def test_arrays_of_another_shape_are_refused(file: Path, name: str, shape: tuple[int, ...], word: str) -> None:
    with netCDF4.Dataset(file, "a") as ds:
        group = ds["extra"]
        kind = group[name].dtype
        group.renameVariable(name, f"old_{name}")
        dims = []
        for k, size in enumerate(shape):
            group.createDimension(f"other_{k}", size)
            dims.append(f"other_{k}")
        group.createVariable(name, kind, dims)[...] = np.ones(shape)
        seal(ds)
    with pytest.raises(InputError, match=f"extra/{name}.*{word}|{word}.*extra/{name}"):
        Model.resume(file, ocean())


@pytest.mark.quick(2)
@pytest.mark.parametrize("name", ["next_element", "rigid_body", "motion_ledger", "a_users_own"])
def test_texts_in_the_place_of_numbers_are_refused(file: Path, name: str) -> None:
    with netCDF4.Dataset(file, "a") as ds:
        group = ds["extra"]
        if name in group.variables:
            group.renameVariable(name, f"old_{name}")
        group.createVariable(name, str, ())[...] = "many"
        seal(ds)
    with pytest.raises(InputError, match=f"numbers are needed.*|.*extra/{name}"):
        load_state(file)


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("attribute", "before", "after"),
    [
        ("fragments_json", '"number": 1', '"number": "one"'),
        ("fragments_json", '"number": 1', '"number": 1e30'),
        ("fragments_json", '"area": ', '"area": -1e400, "x": '),
        ("bergs_json", "]]", ", -3]]"),
    ],
)
def test_rows_of_fragments_that_cannot_be(file: Path, attribute: str, before: str, after: str) -> None:
    with netCDF4.Dataset(file, "a") as ds:
        text = ds.getncattr(attribute)
        if attribute == "bergs_json":
            ds.bergs_json = '[["A", -3]]'
        else:
            assert before in text
            ds.setncattr(attribute, text.replace(before, after))
        seal(ds)
    with pytest.raises(InputError, match=rf"{attribute}|damaged restart file"):
        load_state(file)


def test_stores_of_an_exchange_on_another_grid_are_refused(sound: Path) -> None:
    lon, lat = np.meshgrid(np.linspace(-38.0, -36.0, 31), np.linspace(-56.6, -55.4, 23))
    grid = ocean_grid(lon, lat)
    model = Model.resume(sound, OceanForcing(grid, grid.fields()))
    with pytest.raises(InputError, match=r"exchange_settling lies on a grid of"):
        Exchange(model)


@pytest.mark.quick(2)
@pytest.mark.parametrize("scheme", ["mts", "verlet", "runge_kutta", "quasi_static"])
def test_restarts_of_every_scheme_are_taken(scheme: str, tmp_path: Path) -> None:
    model, _ = begun(scheme)
    path = model.save(tmp_path / "a.restart.nc")
    model.advance(steps=1)
    other = Model.resume(path, ocean())
    other.advance(steps=1)
    np.testing.assert_array_equal(other.elements.lon, model.elements.lon)


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    "name", ["rigid_pose", "rigid_left_lon", "motion_ledger", "next_element", "record_times", "life_ledger"]
)
def test_an_array_that_the_run_needs_and_that_is_gone_is_missed(file: Path, name: str) -> None:
    """Without the pose of the bodies the run went on, from bodies made anew, and not bit for bit."""
    with netCDF4.Dataset(file, "a") as ds:
        found = next(n for n in ds["extra"].variables if n.startswith(name))
        ds["extra"].renameVariable(found, "a_users_own")
        seal(ds)
    with pytest.raises(InputError, match=f"variable extra/{found} is missing"):
        load_state(file)


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["rigid_left_id", "record_rows_of_elements", "record_rows_of_bonds"])
def test_identifiers_stand_once_and_are_some_that_were_given(file: Path, name: str) -> None:
    with netCDF4.Dataset(file, "a") as ds:
        name = next(n for n in ds["extra"].variables if n.startswith(name))
        values = np.array(ds["extra"][name][...])
        ds["extra"][name][1] = values[0]
        seal(ds)
    with pytest.raises(InputError, match=f"extra/{name}.*two entries are the same"):
        load_state(file)
    with netCDF4.Dataset(file, "a") as ds:
        ds["extra"][name][1] = 10**9
        seal(ds)
    with pytest.raises(InputError, match=rf"extra/{name}.*entry 2 is 1e\+09, not a whole number from 0 to"):
        load_state(file)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("name", "value"), [("cell_i", 10**9), ("cell_j", 10**8), ("cell_j", -2)])
def test_cells_that_no_grid_has_are_refused_without_a_grid_too(file: Path, name: str, value: int) -> None:
    spoil(file, f"element_{name}", value)
    with pytest.raises(InputError, match=f"element_{name}.*not a whole number from -1 to 1000000"):
        load_state(file)


def test_a_restart_of_two_bergs_with_outlines_is_taken(tmp_path: Path) -> None:
    """Outlines belong to any fragment, up to the one with the largest number."""
    bergs = [Iceberg.rectangle("9 km", "6 km", thickness="200 m", placement=(lon, -56.0)) for lon in (-37.2, -36.8)]
    model = Model(Iceberg.join(bergs), ocean(), Parameters(melt={"enabled": True}), start="2020-12-09")
    model.advance(steps=1)
    state = load_state(model.save(tmp_path / "two.restart.nc"))
    assert sorted(np.unique(state.extra["front_bergs"]).tolist()) == [1, 2]
