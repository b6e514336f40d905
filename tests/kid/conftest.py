"""A small KID run folder, made by hand: two elements on a Cartesian grid."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest

DRIVER = {"ni": 20, "nj": 20, "ibdt": 600.0, "ibhrs": 2, "ibuo": 0.1, "gridres": 1000.0}
ICEBERGS: dict[str, Any] = {
    "Runge_not_Verlet": False,
    "mts": True,
    "mts_sub_steps": 10,
    "dem": True,
    "dem_spring_coef": 1e6,
    "grid_is_latlon": False,
    "Lx": -1.0,
    "iceberg_bonds_on": True,
    "interactive_icebergs_on": True,
    "manually_initialize_bonds": True,
    "manually_initialize_bonds_from_radii": True,
    "max_bonds": 4,
    "force_convergence": True,
    "set_melt_rates_to_zero": True,
    "old_bug_bilin": False,
    "ignore_ij_restart": True,
    "spring_coef": 1e-5,
    "traj_sample_hrs": 1.0,
    "save_short_traj": False,
    "h_to_init_grounding": 0.0,
    "allow_bergs_to_roll": False,
    "save_bond_traj": True,
}


def fortran(value: Any) -> str:
    """Return a value as a namelist has it."""
    if isinstance(value, bool):
        return ".true." if value else ".false."
    return f"'{value}'" if isinstance(value, str) else repr(value)


def namelist_text(driver: dict[str, Any] | None = None, icebergs: dict[str, Any] | None = None) -> str:
    """Return the text of a namelist: the standard one with some entries changed."""
    groups = {"icebergs_driver_nml": {**DRIVER, **(driver or {})}, "icebergs_nml": {**ICEBERGS, **(icebergs or {})}}
    lines = []
    for name, entries in groups.items():
        lines += [f"&{name}", *(f"  {key} = {fortran(value)}" for key, value in entries.items()), "/", ""]
    return "\n".join(lines)


def restart_variables(size: int = 2) -> dict[str, Any]:
    """Return variables of a restart: a row of bonded squares of 400 m, touching each other."""
    one = np.ones(size)
    values: dict[str, Any] = {
        "lon": 5100.0 + 400.0 * np.arange(size), "lat": 5500.0 * one, "uvel": 0.0 * one, "vvel": 0.0 * one,
        "mass": 850.0 * 200.0 * 400.0**2 * one, "thickness": 200.0 * one, "width": 400.0 * one, "length": 400.0 * one,
        "start_lon": 0.0 * one, "start_lat": 0.0 * one, "start_day": 0.0 * one, "start_mass": 0.0 * one,
        "mass_scaling": one, "start_year": np.zeros(size, dtype="i4"), "ine": np.zeros(size, dtype="i4"),
        "jne": np.zeros(size, dtype="i4"), "iceberg_num": np.arange(1, size + 1, dtype="i4"),
    }  # fmt: skip
    return values


def write_nc(path: Path, variables: dict[str, Any], drop: tuple[str, ...] = ()) -> Path:
    """Write one-dimensional variables to a classic NetCDF file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with netCDF4.Dataset(str(path), "w", format="NETCDF3_CLASSIC") as dataset:
        dataset.createDimension("i", len(variables["lon" if "lon" in variables else "first_id_cnt"]))
        for name, values in variables.items():
            if name not in drop:
                array = np.asarray(values)
                dataset.createVariable(name, "i4" if array.dtype.kind == "i" else "f8", ("i",))[:] = array
    return path


def write_case(folder: Path, driver: dict[str, Any] | None = None, icebergs: dict[str, Any] | None = None) -> Path:
    """Make a run folder with ``input.nml`` and ``INPUT/icebergs.res.nc``."""
    folder.mkdir()
    (folder / "input.nml").write_text(namelist_text(driver, icebergs))
    write_nc(folder / "INPUT" / "icebergs.res.nc", restart_variables())
    return folder


@pytest.fixture
def case(tmp_path: Path) -> Path:
    """Return a run folder with ``input.nml`` and ``INPUT/icebergs.res.nc``."""
    return write_case(tmp_path / "case")
