"""KID restart files of elements: reading of all variants, writing in KID's layout, errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest

from riftberg import A68A_2022_KID, Grid, Parameters
from riftberg.errors import BergError, InputError
from riftberg.kid.ncfile import checksum, opened_dataset
from riftberg.kid.restart import join_id, new_identifiers, read_restart, split_id, write_restart

from .conftest import restart_variables, write_nc

CONTACT_FLAG = 0.1

ONES = np.ones(3, dtype="i4")
DEM = A68A_2022_KID
VERLET = Parameters(bonds={"law": "spring"}, stepping={"scheme": "verlet"}, fracture={"enabled": False})

FOOTLOOSE = VERLET.changed(melt={"enabled": True, "mode": "berg", "base": "turbulent"}, footloose={"enabled": True})


@pytest.fixture
def grid() -> Grid:
    return Grid.cartesian(20, 20, 1000.0)


def made(tmp_path: Path, size: int = 3, drop: tuple[str, ...] = (), **changes: Any) -> Path:
    return write_nc(tmp_path / "icebergs.res.nc", {**restart_variables(size), **changes}, drop)


def test_minimal_file(tmp_path: Path, grid: Grid) -> None:
    elements = read_restart(made(tmp_path, uvel=np.array([0.1, 0.2, 0.3])), grid)
    assert elements.u.tolist() == elements.u_pair.tolist() == elements.u_sync.tolist() == [0.1, 0.2, 0.3]
    assert elements.lon_pair.tolist() == elements.lon.tolist()
    assert not elements.ax_fast.any()
    assert not elements.static.any()
    assert elements.life.mass_of_bits.tolist() == [0.0, 0.0, 0.0]


def test_identifiers_count_within_the_cell_of_creation(tmp_path: Path, grid: Grid) -> None:
    """Section 0.4: counter and i + ni (j - 1), in the order of the file."""
    lon = np.array([5100.0, 7100.0, 5900.0])
    elements = read_restart(made(tmp_path, lon=lon), grid)
    counter, cell = split_id(elements.id)
    assert counter.tolist() == [1, 1, 2]
    assert cell.tolist() == [6 + 20 * 5, 8 + 20 * 5, 6 + 20 * 5]


def test_given_identifiers_are_kept(tmp_path: Path, grid: Grid) -> None:
    ids = {"id_cnt": np.array([7, 8, 9], dtype="i4"), "id_ij": np.array([1, 1, -5], dtype="i4")}
    elements = read_restart(made(tmp_path, drop=("iceberg_num",), **ids), grid)
    counter, cell = split_id(elements.id)
    assert counter.tolist() == [7, 8, 9]
    assert cell.tolist() == [1, 1, -5]


@pytest.mark.parametrize("counter", [1, 2**31 - 1])
@pytest.mark.parametrize("cell", [1, 2**31 - 1, -1])
def test_identifier_halves(counter: int, cell: int) -> None:
    joined = join_id(np.array([counter]), np.array([cell]))
    assert joined.dtype == np.int64
    assert [int(part[0]) for part in split_id(joined)] == [counter, cell]


def test_static_and_contact_marks(tmp_path: Path, grid: Grid) -> None:
    elements = read_restart(made(tmp_path, static_berg=np.array([1.0, CONTACT_FLAG, 0.0])), grid)
    assert elements.static.tolist() == [1.0, 0.0, 0.0]
    assert elements.in_contact.tolist() == [0.0, 1.0, 0.0]


@pytest.mark.parametrize("parameters", [DEM, VERLET, FOOTLOOSE], ids=["mts dem", "verlet", "footloose"])
def test_round_trip(tmp_path: Path, grid: Grid, parameters: Parameters) -> None:
    """What is written is read back bit for bit."""
    rng = np.random.default_rng(3)
    elements = read_restart(made(tmp_path, static_berg=np.array([1.0, CONTACT_FLAG, 0.0])), grid)
    for name in ("u", "v", "ax", "ay", "bx", "by"):
        getattr(elements, name)[:] = rng.normal(size=3)
    if parameters is DEM:
        for name in ("ax_fast", "ay_fast", "bx_fast", "by_fast", "spin", "spin_rate", "rotation"):
            getattr(elements, name)[:] = rng.normal(size=3)
    life = elements.life
    life.start_mass[:], life.start_year[:], life.mass_of_bits[:] = rng.uniform(size=3), [1, 2, 3], rng.uniform(size=3)
    if parameters.footloose.enabled:
        life.fl_k[:], life.mass_of_fl_bits[:] = [7.5, -1.0, -2.0], rng.uniform(size=3)
        life.mass_of_fl_bergy_bits[:] = rng.uniform(size=3)
    path = tmp_path / "out.nc"
    write_restart(path, elements, grid, parameters)
    again = read_restart(path, grid)
    for name in elements.arrays():
        if not name.startswith(("u_", "v_")):
            np.testing.assert_array_equal(getattr(again, name), getattr(elements, name), err_msg=name)


def test_layout_is_that_of_the_reference(tmp_path: Path, shared: Path) -> None:
    """Order, types and attributes of variables, and checksums of equal data."""
    case = shared / "reference" / "collision_iKID"
    grid = Grid.cartesian(20, 20, 1000.0, period=20e3)
    elements = read_restart(case / "expected" / "final_restart.nc", grid)
    write_restart(tmp_path / "out.nc", elements, grid, DEM)
    with (
        netCDF4.Dataset(tmp_path / "out.nc") as ours,
        netCDF4.Dataset(case / "expected" / "final_restart.nc") as theirs,
    ):
        assert ours.data_model == "NETCDF3_64BIT_OFFSET"
        assert ours.dimensions["i"].isunlimited()
        assert int(ours["i"][...]) == 16
        assert [name for name in ours.variables if name != "i"] == [name for name in theirs.variables if name != "i"]
        for name, variable in theirs.variables.items():
            if name == "i":
                continue
            assert ours[name].dtype == variable.dtype
            assert ours[name].ncattrs() == variable.ncattrs()
            for attribute in variable.ncattrs():
                pair = [str(v.getncattr(attribute)).rstrip() for v in (ours[name], variable)]
                assert pair[0] == pair[1], name


def test_checksum_wraps() -> None:
    assert checksum(np.array([1, -2])) == f"{'F' * 16}".ljust(32)
    assert checksum(np.array([1.0, 1.0])) == "7FE0000000000000".ljust(32)
    assert checksum(np.zeros(0)) == f"{'0':>16}".ljust(32)


def test_new_identifiers_are_unique(grid: Grid, tmp_path: Path) -> None:
    lon = np.full(50, 5100.0) + np.arange(50)
    path = write_nc(tmp_path / "r.nc", {**restart_variables(50), "lon": lon})
    elements = read_restart(path, grid)
    assert len(np.unique(new_identifiers(elements, grid))) == 50


@pytest.mark.parametrize(
    ("changes", "drop", "words"),
    [
        ({"lat": np.array([5500.0, np.nan, 5500.0])}, (), ["variable lat", "nan of record 2", "finite"]),
        ({"mass": np.array([1e9, 1e9, 0.0])}, (), ["variable mass", "mass = 0 of record 3", "positive"]),
        ({"thickness": np.array([-1.0, 1.0, 1.0])}, (), ["variable thickness", "-1 of record 1"]),
        ({"fl_k": np.array([0.0, -1.5, 0.0])}, (), ["variable fl_k", "footloose"]),
        ({"mass_of_fl_bits": np.array([0.0, -1.0, 0.0])}, (), ["variable mass_of_fl_bits", "0 or more"]),
        ({"lon": np.array([5100.0, 5500.0, 99_000.0])}, (), ["outside the grid"]),
        ({}, ("thickness",), ["no variable 'thickness'", "found: "]),
        ({}, ("iceberg_num",), ["no variable 'id_cnt'"]),
        ({"id_cnt": ONES, "id_ij": ONES}, ("iceberg_num",), ["id_cnt = 1, id_ij = 1"]),
    ],
)
def test_bad_files_are_refused(
    tmp_path: Path, grid: Grid, changes: dict[str, Any], drop: tuple[str, ...], words: list[str]
) -> None:
    with pytest.raises(InputError) as error:
        read_restart(made(tmp_path, drop=drop, **changes), grid)
    for word in words:
        assert word in str(error.value)


def test_a_position_periods_away_is_refused(tmp_path: Path) -> None:
    """Bug: in a periodic domain 1e9 m were wrapped without a word."""
    cyclic = Grid.cartesian(20, 20, 1000.0, period=20e3)
    assert read_restart(made(tmp_path, lon=np.array([5100.0, -300.0, 25e3])), cyclic).size == 3
    with pytest.raises(BergError, match=r"lon = 1e\+09 of record 2 is not within two periods"):
        read_restart(made(tmp_path, lon=np.array([5100.0, 1e9, 5500.0])), cyclic)


def test_wrong_size_and_no_elements(tmp_path: Path, grid: Grid) -> None:
    path = made(tmp_path)
    with netCDF4.Dataset(path, "a") as dataset:
        dataset.createDimension("k", 2)
        dataset.createVariable("rot", "f8", ("k",))[:] = 0.0
    with pytest.raises(InputError, match=r"variable rot.*shape \(2,\), expected \(3,\)"):
        read_restart(path, grid)
    with netCDF4.Dataset(path, "w", format="NETCDF3_CLASSIC") as dataset:
        dataset.createDimension("i", None)
    with pytest.raises(BergError, match="no element"):
        read_restart(path, grid)


@pytest.mark.parametrize("kept", [50, -100, -8])
def test_a_file_cut_short_is_refused(tmp_path: Path, grid: Grid, kept: int) -> None:
    """The NetCDF library reads zeros beyond the end of a classic file."""
    path = made(tmp_path)
    read_restart(path, grid)
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(InputError, match="cut short") as error:
        read_restart(path, grid)
    assert str(path) in str(error.value)


def test_record_files_cut_short_are_found(tmp_path: Path, grid: Grid) -> None:
    elements = read_restart(made(tmp_path), grid)
    path = tmp_path / "out.nc"
    write_restart(path, elements, grid, DEM)
    whole = path.read_bytes()
    read_restart(path, grid)
    path.write_bytes(whole[:-9])
    with pytest.raises(InputError, match=r"at least \d+ bytes short"):
        read_restart(path, grid)


def test_no_file_and_no_netcdf(tmp_path: Path, grid: Grid) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_restart(tmp_path / "none.nc", grid)
    (tmp_path / "text.nc").write_text("not a NetCDF file")
    with pytest.raises(InputError, match="cannot be read"):
        read_restart(tmp_path / "text.nc", grid)


def test_all_reference_inputs_are_complete(shared: Path) -> None:
    files = sorted((shared / "reference").glob("*/INPUT/*.nc"))
    assert len(files) >= 12
    for path in files:
        with opened_dataset(path):
            pass
