"""KID's trajectory files: elements (short or long record) and bonds.

Names are KID's own, with their spelling. Source: files 6.5; sampling: dynamics, section 12.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from riftberg.bergs.bonding import Metric, separations
from riftberg.kid.ncfile import BlockWriter, Column
from riftberg.kid.parameters import Clock, Date, NamelistGroup, is_sampled
from riftberg.kid.restart import DEM_COLUMNS, LIFE, OPTIONAL, REQUIRED, directed, split_id
from riftberg.life.process import LifeModel
from riftberg.model import BareModel
from riftberg.ocean.gridded import GriddedForcing
from riftberg.parameters import Parameters
from riftberg.state import Floats, Ints
from riftberg.state.population import by_identifier
from riftberg.state.variables import GONE

KM2: Final = 1e6
"""Square metres in the unit of the area thresholds."""

_WHEN: Final = (
    Column("lon", "f8", "longitude", "degrees_E"),
    Column("lat", "f8", "latitude", "degrees_N"),
    Column("year", "i4", "year", "years"),
    Column("day", "f8", "year day", "days"),
)
_IDENTIFIER: Final = (
    Column("id_cnt", "i4", "counter component of iceberg id", "dimensionless"),
    Column("id_ij", "i4", "position component of iceberg id", "dimensionless"),
)
_MASS: Final = (
    Column("mass", "f8", "mass", "kg"),
    Column("start_mass", "f8", "start_mass", "kg"),
    Column("thickness", "f8", "thickness", "m"),
    Column("mass_of_bits", "f8", "mass_of_bits", "kg"),
    Column("uvel", "f8", "zonal spped", "m/s"),
    Column("vvel", "f8", "meridional spped", "m/s"),
)
_FOOTLOOSE: Final = (
    Column("mass_scaling", "f8", "mass_scaling", "dimensionless"),
    Column("mass_of_fl_bits", "f8", "mass_of_fl_bits", "kg"),
    Column("mass_of_fl_bergy_bits", "f8", "mass_of_fl_bergy_bits", "kg"),
    Column("fl_k", "f8", "footloose calving k", "none"),
)
_LONG: Final = (
    Column("uvel_prev", "f8", "zonal speed mts", "m/s"),
    Column("vvel_prev", "f8", "meridional speed mts", "m/s"),
    Column("uo", "f8", "ocean zonal spped", "m/s"),
    Column("vo", "f8", "ocean meridional spped", "m/s"),
    Column("ui", "f8", "ice zonal spped", "m/s"),
    Column("vi", "f8", "ice meridional spped", "m/s"),
    Column("ua", "f8", "atmos zonal spped", "m/s"),
    Column("va", "f8", "atmos meridional spped", "m/s"),
    Column("heat_density", "f8", "heat_density", "J/kg"),
    Column("width", "f8", "width", "m"),
    Column("length", "f8", "length", "m"),
    Column("ssh_x", "f8", "sea surface height gradient_x", "non-dim"),
    Column("ssh_y", "f8", "sea surface height gradient_y", "non-dim"),
    Column("sst", "f8", "sea surface temperature", "degrees_C"),
    Column("sss", "f8", "sea surface salinity", "psu"),
    Column("cn", "f8", "sea ice concentration", "none"),
    Column("hi", "f8", "sea ice thickness", "m"),
    Column("axn", "f8", "explicit zonal acceleration", "m"),
    Column("ayn", "f8", "explicit meridional acceleration", "m"),
    Column("bxn", "f8", "implicit zonal acceleration", "m"),
    Column("byn", "f8", "implicit meridional acceleration", "m"),
    Column("halo_berg", "f8", "halo status", "non-dim"),
    Column("od", "f8", "ocean_depth", "m"),
)
_FAST: Final = (
    Column("axn_fast", "f8", "explicit fast step zonal acceleration", "m"),
    Column("ayn_fast", "f8", "explicit fast step meridional acceleration", "m"),
    Column("bxn_fast", "f8", "implicit fast step zonal acceleration", "m"),
    Column("byn_fast", "f8", "implicit fast step meridional acceleration", "m"),
)
_COUNT: Final = (Column("n_bonds", "i4", "number of bonds", "dimensionless"),)
_SPIN: Final = (
    Column("ang_vel", "f8", "angular velocity", "rad/s"),
    Column("ang_accel", "f8", "angular acceleration", "rad/s^2"),
    Column("rot", "f8", "accumulated rotation", "rad"),
)

FIELDS: Final = {
    **REQUIRED,
    **OPTIONAL,
    **{name: name for name in LIFE},
    "uvel_prev": "u_sync",
    "vvel_prev": "v_sync",
    **{name: name for name in ("uo", "vo", "ui", "vi", "ua", "va", "sst", "sss")},
    "ssh_x": "slope_x",
    "ssh_y": "slope_y",
    "cn": "ice_fraction",
    "hi": "ice_thickness",
    "od": "depth",
}
"""Variables of the trajectory and the fields of `Elements` that they come from."""


def trajectory_columns(group: NamelistGroup, parameters: Parameters) -> list[Column]:
    """Return the variables of the trajectory file that KID writes for these settings, in its order."""
    columns = [*_WHEN, *_IDENTIFIER]
    columns += _MASS if group.flag("save_fl_traj") else ()
    columns += _FOOTLOOSE if group.flag("save_fl_traj") and group.flag("footloose") else ()
    if not group.flag("save_short_traj"):
        # KID describes the velocities of its long step only where it takes such steps (quirk T35).
        plain = not parameters.stepping.has_substeps
        columns += [c._replace(long_name="", units="") if plain and c.name.endswith("_prev") else c for c in _LONG]
        columns += () if plain else _FAST
        columns += _COUNT if parameters.bonds.law != "none" else ()
        columns += _SPIN if group.flag("dem") else ()
    return columns


def sampling_hours(group: NamelistGroup) -> float:
    """Return the interval of the records (h); -1 means every step."""
    name = "traj_write_hrs" if group.flag("debug_write") else "traj_sample_hrs"
    hours = group.number(name)
    if hours != -1.0 and hours <= 0.0:
        raise group.error(f"{name} = {hours} is no interval", "Give a positive number of hours, or -1 for every step")
    return hours


def listed_bonds(model: BareModel) -> Ints:
    """Return how many bonds KID lists at each element: intact ones, and broken ones that it has not dropped (quirk Q9)."""
    elements, bonds = model.elements, model.bonds
    if model.parameters.fracture.broken_as_contact:
        return elements.bond_count
    left = bonds.status == 1
    return elements.bond_count + np.bincount(np.append(bonds.first[left], bonds.second[left]), minlength=elements.size)


def recorded(model: BareModel, group: NamelistGroup, year: int) -> NDArray[np.bool_]:
    """Return which elements KID records: large enough, bonded, late enough, or of a chosen class of initial mass.

    Children of footloose calving have a threshold of their own too, but a lower threshold for all applies to them too.
    """
    elements = model.elements
    area = elements.mass / (model.parameters.ice.density * elements.thickness)
    chosen = (area >= group.number("traj_area_thres") * KM2) | (listed_bonds(model) > 0)
    if year > group.number("save_all_traj_year"):
        chosen[:] = True
    if group.flag("save_nonfl_traj_by_class"):
        south = group.number("save_traj_by_class_start_mass_thres_s")
        north = group.number("save_traj_by_class_start_mass_thres_n")
        heavy = (elements.start_mass >= np.where(elements.lat < 0, south, north)) & (elements.fl_k >= 0.0)
        chosen |= heavy & (area > group.number("traj_area_thres_sntbc") * KM2)
    chosen |= (elements.fl_k < 0.0) & (area > group.number("traj_area_thres_fl") * KM2)
    return chosen


class _Sampler:
    """Common part of both recorders: which steps are recorded, and their stamp.

    A record made at the end of a step carries the time of the step's start (quirks Q7, T28).
    """

    def __init__(self, path: Path, group: NamelistGroup, clock: Clock) -> None:
        self.path, self.group, self.clock = Path(path), group, clock
        self.hours = sampling_hours(group)
        self.block_hours = group.number("traj_write_hrs")
        self._writer: BlockWriter | None = None
        self._made = False

    def _columns(self, model: BareModel) -> list[Column]:
        raise NotImplementedError

    def _records(self, model: BareModel, date: Date) -> dict[str, NDArray[Any]]:
        raise NotImplementedError

    def start(self, model: BareModel) -> None:
        """Make the file."""
        self._writer = BlockWriter(self.path, self._columns(model))
        self._made = True

    def record(self, model: BareModel) -> None:
        """Take a record if the step that just ended started at a sampling time."""
        assert self._writer is not None
        date = self.clock.date((model.step_number - 1) * self.clock.dt)
        if is_sampled(date, self.hours):
            self._writer.append(self._records(model, date))
        if self.block_hours > 0 and is_sampled(date, self.block_hours):
            self._writer.flush()

    def finish(self, model: BareModel) -> None:
        """Write the waiting records and close the file."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def discard(self) -> None:
        """Remove the file of a run that came to nothing; one that this run did not make stays."""
        if self._made:
            self.path.unlink(missing_ok=True)


class TrajectoryRecorder(_Sampler):
    """Writes KID's trajectory file during a run; a recorder of `riftberg.Model`."""

    def _columns(self, model: BareModel) -> list[Column]:
        return trajectory_columns(self.group, model.parameters)

    def _records(self, model: BareModel, date: Date) -> dict[str, NDArray[Any]]:
        # The multiple-time-step scheme of KID writes what its step has seen; the others sample again after the move.
        if not model.parameters.stepping.has_substeps:
            resample_environment(model, (model.step_number - 1) * self.clock.dt, self.group)
        e = model.elements
        rows = np.flatnonzero(recorded(model, self.group, date.year))
        columns: dict[str, NDArray[Any]] = {name: getattr(e, field)[rows] for name, field in FIELDS.items()}
        columns.update(_file_stamp(date, len(rows)))
        columns["id_cnt"], columns["id_ij"] = split_id(e.id[rows])
        columns["halo_berg"], columns["n_bonds"] = np.zeros(len(rows)), listed_bonds(model)[rows]
        return columns


def resample_environment(model: LifeModel, time: float, group: NamelistGroup) -> None:
    """Sample the environment at the new positions with the fields of the step that ended (files, section 1.1).

    KID does so in its thermodynamics, without the random tide, and leaves the depth as the step found it. With ``dem`` or
    ``footloose`` it does so after the move, with the tide and the depth. The next step samples again.
    """
    after_move = group.flag("dem") or group.flag("footloose")
    depth = model.elements.depth.copy()
    if isinstance(model.forcing, GriddedForcing):  # no other has a tide
        model.forcing.sample(model.elements, time, tide=after_move)
    else:
        model.forcing.sample(model.elements, time)
    if not after_move:
        model.elements.depth[:] = depth


def _file_stamp(date: Date, size: int) -> dict[str, NDArray[Any]]:
    return {"year": np.full(size, date.year), "day": np.full(size, date.year_day())}


_BOND: Final = (
    Column("length", "f8", "length", "m"),
    Column("n1", "f8", "unit vector 1", "non-dim"),
    Column("n2", "f8", "unit vector 2", "non-dim"),
    Column("id_cnt1", "i4", "counter component of first connected iceberg id", "dimensionless"),
    Column("id_ij1", "i4", "position component of first connected iceberg id", "dimensionless"),
    Column("id_cnt2", "i4", "counter component of second connected iceberg id", "dimensionless"),
    Column("id_ij2", "i4", "position component of second connected iceberg id", "dimensionless"),
)


class BondRecorder(_Sampler):
    """Writes KID's bond trajectory file during a run: every listed bond in both directions.

    ``n1``, ``n2`` are the separations divided by the length of the element, as in KID, so no unit vector in general
    (quirk T36). ``length`` is the present length with DEM bonds; else the initial one, in units of the coordinates.
    """

    def start(self, model: BareModel) -> None:
        """Make the file, and keep the initial lengths."""
        e, b = model.elements, model.bonds
        self._first_length: Floats = np.hypot(e.lon[b.first] - e.lon[b.second], e.lat[b.first] - e.lat[b.second])
        self._first_bonds = b.id.copy()
        super().start(model)

    def _columns(self, model: BareModel) -> list[Column]:
        return [*_WHEN, *_BOND, *(DEM_COLUMNS if self.group.flag("dem") else ())]

    def _records(self, model: BareModel, date: Date) -> dict[str, NDArray[Any]]:
        e, p = model.elements, model.parameters
        columns = directed(model.bonds, self.group.flag("dem"))
        length = model.bonds.bond_length
        # Bonds that have broken since are gone from the state, so initial lengths are found by identifier.
        if p.bonds.law != "dem":
            length = by_identifier(self._first_bonds, self._first_length, model.bonds.id)
        columns["length"] = np.tile(length[model.bonds.status != GONE], 2)
        keep = recorded(model, self.group, date.year)[columns["first"]]
        columns = {name: values[keep] for name, values in columns.items()}
        a, b = columns["first"], columns["other"]
        metric = Metric(p.earth.latlon, p.earth.radius, p.earth.period)
        dx, dy = separations(metric, e.lon[a], e.lat[a], e.lon[b], e.lat[b])
        columns["n1"], columns["n2"] = dx / e.length[a], dy / e.length[a]
        columns["lon"], columns["lat"] = 0.5 * (e.lon[a] + e.lon[b]), 0.5 * (e.lat[a] + e.lat[b])
        for k, rows in ((1, a), (2, b)):
            columns[f"id_cnt{k}"], columns[f"id_ij{k}"] = split_id(e.id[rows])
        return {**columns, **_file_stamp(date, len(a))}
