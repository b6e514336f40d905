"""Restart files: the whole state, bit for bit, written so that a crash never leaves half a file.

What is stored follows the registries of `riftberg.state` (``restart=True``); parameters travel as JSON, the family tree
of the fragments as columns, and whatever else a model needs to go on exactly in ``extra``.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import netCDF4
import numpy as np

from riftberg.errors import InputError
from riftberg.parameters import Parameters
from riftberg.runs.checks import DAMAGED, check_restart, read_parameters, read_start
from riftberg.runs.layout import forcing_text
from riftberg.state import BOND_VARIABLES, ELEMENT_VARIABLES, Bonds, Elements, Variable, new_bonds, new_elements
from riftberg.state.population import Population
from riftberg.stepping.fragments.contact_log import ContactEvent, ContactLog
from riftberg.stepping.fragments.tree import Fragment
from riftberg.system.atomic_files import replacing
from riftberg.system.input_files import check_file, reading
from riftberg.system.netcdf_lock import NETCDF, open_netcdf
from riftberg.system.process import opening
from riftberg.version import __version__

if TYPE_CHECKING:
    from riftberg.model import BareModel

_LOG = logging.getLogger(__name__)

FORMAT = 5
"""Number of the layout, the oldest and newest that is read; what is added later takes its default in files without it."""

_Table = TypeVar("_Table", Elements, Bonds)
_REMEDY = "Name a restart file that Riftberg wrote (*.restart.nc)"


@dataclass
class RestartState:
    """What a restart file holds."""

    elements: Elements  # The state
    bonds: Bonds  # The state
    parameters: Parameters  # All parameters of the run
    start: datetime  # Date of time zero
    time: float  # Seconds since the start
    step_number: int  # Long steps taken
    fragments: list[Fragment] = field(default_factory=list)  # The family tree
    extra: dict[str, np.ndarray[Any, Any]] = field(default_factory=dict)  # Arrays that the model added by name
    forcing: str = ""  # Description of the forcing that the run used
    bergs: list[tuple[str, int]] = field(default_factory=list)  # Name and number of elements of each berg of the start
    contacts: ContactLog = field(default_factory=ContactLog)  # Collisions of bergs, and which contacts are none

    def population(self) -> Population:
        """Return the elements and bonds, with the identifiers that come next."""
        following = (int(self.extra.get(name, 0)) for name in ("next_element", "next_bond"))
        return Population(self.elements, self.bonds, *following)


def save(model: BareModel, path: str | Path, *, extra: Mapping[str, Any] | None = None) -> Path:
    """Write the state of ``model`` to ``path``; an earlier file is replaced only by a complete new one."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path, to_disk=True) as part, open_netcdf(part, "w") as file:
        file.setncatts(
            {
                "title": "Restart file of Riftberg",
                "riftberg_restart_format": FORMAT,
                "riftberg_version": __version__,
                "start": model.start.isoformat(),
                "forcing": forcing_text(model.forcing),
                "parameters_json": model.parameters.model_dump_json(),
            }
        )
        file.createVariable("time", "f8", ())[...] = model.time
        file["time"].units = "s"
        file["time"].long_name = "time since the start of the run"
        file.createVariable("step_number", "i8", ())[...] = model.step_number
        _write_table(file, "element", ELEMENT_VARIABLES, model.elements)
        _write_table(file, "bond", BOND_VARIABLES, model.bonds)
        # JSON keeps 64-bit floats exactly (shortest repr) and says "null" for a fragment without parent.
        file.setncattr("fragments_json", json.dumps([vars(row) for row in model.fragments.rows], default=_plain))
        file.setncattr("bergs_json", json.dumps([list(berg) for berg in model.fragments.bergs]))
        # Pairs that are in contact since they parted from each other: no collisions of their own.
        quiet = [[*pair, time] for pair, time in model.contacts.suppressed.items()]
        collisions = {"rows": [vars(row) for row in model.contacts.rows], "quiet": quiet}
        file.setncattr("contacts_json", json.dumps(collisions, default=_plain))
        _write_extra(file, extra or {})
    _LOG.info("state of %s saved in %s", f"{model.date:%Y-%m-%d %H:%M}", path)
    return path


def load_state(path: str | Path, *, check: bool = True) -> RestartState:
    """Read a file written by `save`."""
    path = Path(path)
    with _open_restart(path) as file, reading(path, "a damaged restart file", _REMEDY):
        file.set_auto_mask(False)
        layout = getattr(file, "riftberg_restart_format", None)
        if layout is None:
            raise InputError(
                "not a restart file of Riftberg (attribute riftberg_restart_format is missing)",
                where=str(path),
                remedy="Run files (run.nc) cannot be resumed; files of KID go through 'riftberg kid'",
            )
        if not isinstance(layout, int | np.integer) or layout < 1:
            raise InputError(f"restart layout {layout!r} is none", where=str(path), remedy=_REMEDY)
        if layout != FORMAT:
            age, later = ("newer", " or later") if layout > FORMAT else ("older", "")
            raise InputError(
                f"restart layout {layout} is {age} than this Riftberg ({__version__}) reads ({FORMAT})",
                where=str(path),
                remedy=f"Use Riftberg {getattr(file, 'riftberg_version', '?')}{later}, or make the run again",
            )
        # Only the number of bonds counts here: their ends are read with the rest of the table.
        ends = np.zeros(file.dimensions["bond"].size, np.int64)
        collisions = dict(json.loads(file.contacts_json))
        suppressed = {(int(a), int(b)): float(time) for a, b, time in collisions.get("quiet", [])}
        state = RestartState(
            elements=_filled(file, "element", ELEMENT_VARIABLES, new_elements(file.dimensions["element"].size), path),
            bonds=_filled(file, "bond", BOND_VARIABLES, new_bonds(ends, ends), path),
            parameters=read_parameters(getattr(file, "parameters_json", None), path),
            start=read_start(getattr(file, "start", None), path),
            time=float(file["time"][...]),
            step_number=int(file["step_number"][...]),
            fragments=[Fragment(**row) for row in json.loads(file.fragments_json)],
            extra={name: variable[...] for name, variable in file["extra"].variables.items()},
            forcing=str(file.getncattr("forcing")),
            bergs=[(str(name), int(count)) for name, count in json.loads(file.bergs_json)],
            contacts=ContactLog([ContactEvent(**row) for row in collisions.get("rows", [])], suppressed),
        )
        if lost := set(str(getattr(file, "extra_variables", "")).split()) - set(state.extra):
            raise InputError(f"variable extra/{min(lost)} is missing", where=str(path), remedy=DAMAGED)
        if check:
            check_restart(state, path)
        return state


def _write_table(file: netCDF4.Dataset, dim: str, variables: Iterable[Variable], arrays: Elements | Bonds) -> None:
    file.createDimension(dim, len(next(iter(arrays.arrays().values()))))
    kept = [v for v in variables if v.restart]
    # By this list a reader distinguishes a variable that was lost from one that was added to the registry later.
    file.setncattr(f"{dim}_variables", " ".join(v.name for v in kept))
    for v in kept:
        # No compression and no fill value: the bytes of the arrays, as they are.
        stored = file.createVariable(f"{dim}_{v.name}", v.dtype, (dim,), fill_value=False)
        stored.setncatts({"units": v.units, "long_name": v.long_name})
        stored[:] = getattr(arrays, v.name)


def _plain(value: Any) -> Any:
    """Turn NumPy scalars into numbers that JSON knows."""
    return value.item() if isinstance(value, np.generic) else str(value)


def _write_extra(file: netCDF4.Dataset, extra: Mapping[str, Any]) -> None:
    group = file.createGroup("extra")
    file.setncattr("extra_variables", " ".join(extra))  # by these a reader finds what was lost
    for name, value in extra.items():
        array = np.asarray(value)
        # NetCDF has no booleans.
        if array.dtype == bool:
            array = array.astype("i1")
        dims = tuple(f"{name}_{axis}" for axis in range(array.ndim))
        for dim, size in zip(dims, array.shape, strict=True):
            group.createDimension(dim, size)
        group.createVariable(name, array.dtype, dims, fill_value=False)[...] = array


@contextmanager
def _open_restart(path: Path) -> Iterator[netCDF4.Dataset]:
    check_file(path, remedy=_REMEDY)
    with NETCDF:
        with reading(path, "not readable as NetCDF-4", _REMEDY), opening(path):
            file = netCDF4.Dataset(path)
        with file:
            yield file


def _filled(file: netCDF4.Dataset, table: str, variables: Iterable[Variable], arrays: _Table, path: Path) -> _Table:
    """Fill the arrays of a table; what was added to the registry since the file was written keeps its default."""
    written = str(getattr(file, f"{table}_variables", "")).split()
    for v in variables:
        if not v.restart or v.name not in written:
            continue
        name = f"{table}_{v.name}"
        if name not in file.variables:
            raise InputError(f"variable {name} ({v.long_name}) is missing", where=str(path), remedy=DAMAGED)
        target, stored = getattr(arrays, v.name), file[name]
        if stored.dtype != target.dtype or stored.shape != target.shape:
            raise InputError(
                f"type {stored.dtype} and shape {stored.shape}, not {target.dtype} and {target.shape}",
                where=f"{path}, variable {name}", remedy=DAMAGED,
            )  # fmt: skip
        target[:] = stored[:]
    if not written:
        raise InputError(f"attribute {table}_variables is missing", where=str(path), remedy=DAMAGED)
    return arrays
