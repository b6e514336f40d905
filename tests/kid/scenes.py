"""Small KID cases in which namelist entries matter, their runs in this process, and what comes out of them."""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import netCDF4
import numpy as np

from experiments.paper_files import GRID_FILE, VARIABLES
from riftberg.kid.run import KidReport, run_kid

from .conftest import fortran, write_nc

Values = dict[str, Any]
Files = dict[str, dict[str, np.ndarray]]

SCHEMES: Final[dict[str, Values]] = {
    "verlet": {"Runge_not_Verlet": False},
    "runge": {"Runge_not_Verlet": True},
    "springs": {"mts": True, "mts_sub_steps": 20, "explicit_inner_mts": True, "force_convergence": True},
    "dem": {"mts": True, "mts_sub_steps": 20, "dem": True, "dem_spring_coef": 2e3, "force_convergence": True},
}
"""The four ways of stepping: single-step Verlet and Runge-Kutta, multiple steps with springs and with DEM bonds."""

COMMON: Final[Values] = {
    "grid_is_latlon": False, "Lx": -1.0, "old_bug_bilin": False, "interactive_icebergs_on": True,
    "iceberg_bonds_on": True, "manually_initialize_bonds": True, "length_for_manually_initialize_bonds": 430.0,
    "max_bonds": 4, "spring_coef": 1e-5, "contact_spring_coef": 2e-6, "lat_ref": -60.0, "tau_is_velocity": True,
    "scale_damping_by_pmag": False, "traj_sample_hrs": -1.0, "save_short_traj": False, "save_bond_traj": True,
    "use_updated_rolling_scheme": True, "convergence_tolerance": 1e-6, "bergy_bit_erosion_fraction": 0.3,
}  # fmt: skip
"""What most entries need to matter: bonds, contact, melt, and records of everything in every step."""

BERG: Final[Values] = {
    "ni": 20, "nj": 20, "gridres": 1000.0, "ibdt": 600.0, "nmax": 4, "ibhrs": 100, "ibuo": 0.3, "ibvo": -0.1,
    "ibua": 8.0, "ibuy": -3.0, "sst": 2.0,
}  # fmt: skip
"""The stand-alone driver: bergs in open water, a bonded one of four elements and a larger one that touches it."""

SEAMOUNT: Final[Values] = {
    **BERG,
    "ni": 45,
    "nj": 45,
    "gridres": 5000.0,
    "big_grounding_test": True,
    "bump_depth": 50.0,
}

A68: Final[Values] = {
    "a68_test": True, "data_dir": "data/", "transient_a68_data_start_ind": 1, "ibdt": 1800.0, "nmax": 4, "ibhrs": 100,
}  # fmt: skip

OCEAN: Final[Values] = {
    "ni": 12, "nj": 10, "gridres": 5000.0, "dt": 3600.0, "nsteps": 4, "uo0": 0.3, "vo0": -0.1, "ui0": 0.1, "vi0": 0.05,
    "ua0": 8.0, "va0": -3.0, "sst0": 2.0, "sss0": 34.0, "cn0": 0.5, "hi0": 2.0, "calv0": 2e-3, "calvh0": 10.0,
}  # fmt: skip
"""The driver with an ocean: flux of land ice, sea ice, a sloping sea; bergs have no bonds there."""

DRIVERS: Final = {"berg": BERG, "seamount": SEAMOUNT, "a68": A68, "ocean": OCEAN}

SCENES: Final[dict[str, Values]] = {
    "berg": {},
    "seamount": {"length_for_manually_initialize_bonds": 3300.0, "cdrag_grounding": 1e3, "spring_coef": 1e-7,
                 "contact_spring_coef": 2e-8},
    "a68": {"grid_is_latlon": True, "Lx": 360.0, "length_for_manually_initialize_bonds": 3300.0, "A68_test": True,
            "A68_xdisp": -30.0, "A68_ydisp": -50.0, "spring_coef": 1e-7, "contact_spring_coef": 2e-8},
    "ocean": {"iceberg_bonds_on": False, "manually_initialize_bonds": False, "save_bond_traj": False,
              "make_calving_reproduce": True, "spring_coef": 1e-7, "contact_spring_coef": 2e-8},
}  # fmt: skip


def bergs(scene: str) -> Values:
    """Return the restart of a scene: a bonded berg of four unequal elements, and a larger one that overlaps it a little."""
    size = {"berg": 400.0, "seamount": 3000.0, "a68": 3000.0, "ocean": 3000.0}[scene]
    x0, y0 = {"berg": (8600.0, 8600.0), "seamount": (61e3, 58e3), "a68": (0.0, 0.0), "ocean": (18e3, 24e3)}[scene]
    x = size * np.array([0.0, 1.01, 0.0, 1.01, 2.42])
    y = size * np.array([0.0, 0.0, 1.02, 1.02, 0.12])
    length = size * np.array([1.0, 1.0, 1.0, 1.0, 2.0])
    width = size * np.array([1.0, 1.0, 1.0, 0.95, 1.9])
    thickness = np.array([200.0, 200.0, 200.0, 200.0, 150.0])
    if scene == "a68":
        lat = -60.0 + 0.4 + y / 111e3
        x0, x, y = 320.4, x / (111e3 * np.cos(np.radians(lat))), lat
    one = np.ones(5)
    return {
        "lon": x0 + x, "lat": y0 + y, "uvel": np.array([0.1, 0.12, 0.08, 0.1, 0.02]),
        "vvel": np.array([0.02, 0.0, 0.03, 0.01, -0.05]), "mass": 850.0 * thickness * length * width,
        "thickness": thickness, "width": width, "length": length, "start_lon": 0.0 * one, "start_lat": 0.0 * one,
        "start_day": 0.1 * np.arange(5), "start_mass": 850.0 * thickness * length * width, "mass_scaling": one,
        "start_year": np.zeros(5, dtype="i4"), "ine": np.zeros(5, dtype="i4"), "jne": np.zeros(5, dtype="i4"),
        "iceberg_num": np.arange(1, 6, dtype="i4"), "mass_of_bits": 1e6 * one,
    }  # fmt: skip


def write_a68_data(folder: Path) -> None:
    """Write a grid of an eighth of a degree and six hours of wind, currents and sea level that vary in space and time."""
    folder.mkdir()
    lon, lat = np.meshgrid(-40.0 + 0.125 * np.arange(10), -60.0 + 0.125 * np.arange(8))
    shapes = (("time", 6), ("lat", 8), ("lon", 10))
    with netCDF4.Dataset(folder / GRID_FILE, "w") as grid:
        for name, size in shapes[1:]:
            grid.createDimension(name, size)
        grid.createVariable("longitude", "f8", ("lat", "lon"))[:] = lon
        grid.createVariable("latitude", "f8", ("lat", "lon"))[:] = lat
    sizes = {"ua": 8.0, "va": -4.0, "uo": 0.3, "vo": -0.1, "SSH": 0.2}
    wave = np.sin(3.0 * lon + np.arange(6)[:, None, None]) + np.cos(2.0 * lat)
    for file, names in VARIABLES.items():
        with netCDF4.Dataset(folder / file, "w") as dataset:
            for name, size in shapes:
                dataset.createDimension(name, size)
            for name in names:
                dataset.createVariable(name, "f8", ("time", "lat", "lon"))[:] = sizes[name] * (1.0 + 0.3 * wave)


def text_of(scene: str, scheme: str, driver: Values, icebergs: Values) -> str:
    """Return the namelist of a scene."""
    name = "drv_nml" if scene == "ocean" else "icebergs_driver_nml"
    groups = {
        name: {**DRIVERS[scene], **driver},
        "icebergs_nml": {**COMMON, **SCHEMES[scheme], **SCENES[scene], **icebergs},
    }
    lines = []
    for group, entries in groups.items():
        lines.append(f"&{group}")
        for key, value in entries.items():
            items = value if isinstance(value, list | tuple) else [value]
            lines.append(f"  {key} = {', '.join(fortran(item) for item in items)}")
        lines += ["/", ""]
    return "\n".join(lines)


@dataclass
class Outcome:
    """What a run left behind: its files by name, its report, and how well the ledger of mass closes."""

    files: Files
    lines: tuple[str, ...]
    report: KidReport
    ledger: float | None
    heat: float | None
    state: dict[str, np.ndarray] = field(default_factory=dict)

    def said(self, entry: str) -> str:
        """Return what the report says of an entry: 'honoured', 'no effect here: why', and so on."""
        return next(line.split(": ", 1)[1] for line in self.lines if line.startswith(f"{entry} = "))


def run(scene: str, scheme: str, driver: Values | None = None, icebergs: Values | None = None, **more: Any) -> Outcome:
    """Run a scene with some entries changed, in a folder that is removed again.

    ``restart`` changes variables of the restart; ``prepare(folder)`` may change the run folder.
    """
    folder = Path(tempfile.mkdtemp(prefix="kid_"))
    try:
        (folder / "input.nml").write_text(text_of(scene, scheme, driver or {}, icebergs or {}))
        write_nc(folder / "INPUT" / "icebergs.res.nc", {**bergs(scene), **more.get("restart", {})})
        if scene == "a68":
            write_a68_data(folder / "data")
        if "prepare" in more:
            more["prepare"](folder)
        out = folder / "out"
        out.mkdir()
        report = run_kid(folder, out)
        files = {path.name: _read(path) for path in sorted(out.glob("*.nc"))}
    finally:
        shutil.rmtree(folder)
    model = report.case.model
    balance = model.life.balance(model) if model.life is not None else None
    restart = next(path.name for path in report.files if path.name.endswith("restart.nc") and "bonds" not in path.name)
    return Outcome(
        files, report.lines, report, None if balance is None else balance.error,
        None if balance is None else balance.heat_error, _by_age(files[restart]),
    )  # fmt: skip


def _by_age(state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Put the elements of a restart into the order of `bergs`, and those born since behind them."""
    order = np.lexsort((state["start_day"], state["start_lon"]))
    return {name: values[order] if values.shape == order.shape else values for name, values in state.items()}


def _read(path: Path) -> dict[str, np.ndarray]:
    with netCDF4.Dataset(path) as dataset:
        dataset.set_auto_mask(False)
        return {name: np.array(variable[...]) for name, variable in dataset.variables.items()}


def same(one: Files, other: Files) -> bool:
    """Whether two runs wrote the same files, bit for bit."""
    return one.keys() == other.keys() and all(same_values(one[name], other[name]) for name in one)


def same_values(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    """Whether two files hold the same values."""
    return one.keys() == other.keys() and all(
        one[name].shape == other[name].shape and np.array_equal(one[name], other[name], equal_nan=True) for name in one
    )
