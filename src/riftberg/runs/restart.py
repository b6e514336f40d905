"""Restart files: the whole state, bit for bit, written so that a crash never leaves half a file.

The stored variables follow the registries of `riftberg.state` (``restart=True``); parameters travel as JSON, the family tree
of the fragments as columns, and all other arrays that a model needs to go on exactly in ``extra``.
"""

from __future__ import annotations

import json
import logging
import math
import re
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar

import netCDF4
import numpy as np
from numpy.typing import NDArray

from riftberg.engines.common.fragments.contact_log import ContactEvent, ContactLog
from riftberg.engines.common.fragments.grounding_log import GroundingEvent, GroundingLog
from riftberg.engines.common.fragments.tree import Fragment
from riftberg.errors import InputError
from riftberg.life.ledger import PROCESSES, SOURCES
from riftberg.parameters import Parameters
from riftberg.runs.layout import check_bond_ends, read_parameters, read_start
from riftberg.state import BOND_VARIABLES, ELEMENT_VARIABLES, Bonds, Elements, Variable, new_bonds, new_elements
from riftberg.state.population import Population
from riftberg.state.rules import Rule, find_breach
from riftberg.state.variables import LARGEST, LARGEST_WHOLE
from riftberg.system.atomic_files import replacing
from riftberg.system.input_files import MOST_SUBSTEPS, MOST_VALUES, check_file, reading, shown, value_shown
from riftberg.system.netcdf_lock import open_netcdf
from riftberg.version import __version__

if TYPE_CHECKING:
    from riftberg.model import BareModel

_LOG = logging.getLogger(__name__)

FORMAT = 7
"""Number of the layout, the oldest and newest that is read; what is added later takes its default in files without it."""

_Table = TypeVar("_Table", Elements, Bonds)
DAMAGED: Final = "The file is damaged: resume from another restart"
"""Remedy where a run cannot go on from a restart file."""

DIGEST: Final = "digest"
"""Attribute with the checksum over all else in the file."""

_REMEDY = "Name a restart file that Riftberg wrote (*.restart.nc)"


@dataclass
class RestartState:
    """Contents of a restart file."""

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
    groundings: GroundingLog = field(default_factory=GroundingLog)  # Stays of bergs on the sea floor

    def population(self) -> Population:
        """Return the elements and bonds, with the identifiers that come next."""
        following = (int(self.extra.get(name, 0)) for name in ("next_element", "next_bond"))
        return Population(self.elements, self.bonds, *following)


def save(model: BareModel, path: str | Path, *, extra: Mapping[str, Any] | None = None) -> Path:
    """Write the state of ``model`` to ``path``; an earlier file is replaced only by a complete new one."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path, to_disk=True) as temporary, open_netcdf(temporary, "w") as file:
        file.setncatts(
            {
                "title": "Restart file of Riftberg",
                "riftberg_restart_format": FORMAT,
                "riftberg_version": __version__,
                "start": model.start.isoformat(),
                "forcing": model.forcing.describe(),
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
        log = model.groundings
        stays = {
            "rows": [vars(row) for row in log.rows],
            "clearance": log.clearance if log.clearance < LARGEST else None,
        }
        file.setncattr("groundings_json", json.dumps(stays, default=_plain))
        _write_extra(file, extra or {})
        seal(file)
    _LOG.info("state of %s saved in %s", f"{model.date:%Y-%m-%d %H:%M}", path)
    return path


def seal(file: netCDF4.Dataset) -> None:
    """Store the checksum over all that a restart file holds, which is open."""
    file.set_auto_mask(False)
    file.setncattr(DIGEST, np.uint32(_digest(_content(file))))


def load_state(path: str | Path, *, check: bool = True) -> RestartState:
    """Read a file written by `save`."""
    path = Path(path)
    check_file(path, remedy=_REMEDY)
    with reading(path, "not readable as NetCDF-4, or a damaged restart file", _REMEDY), open_netcdf(path) as file:
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
                remedy=f"Use the Riftberg that wrote it ({getattr(file, 'riftberg_version', '?')}{later}), or make the run again",
            )
        # Only the number of bonds counts here: their ends are read with the rest of the table.
        ends = np.zeros(file.dimensions["bond"].size, np.int64)
        elements, bonds = new_elements(file.dimensions["element"].size), new_bonds(ends, ends)
        content = _content(
            file,
            {f"element_{name}": array for name, array in elements.arrays().items()}
            | {f"bond_{name}": array for name, array in bonds.arrays().items()},
        )
        if content.get(f":{DIGEST}") != _digest(content):
            raise InputError("its values are not those that were written", where=str(path), remedy=DAMAGED)
        collisions = dict(json.loads(file.contacts_json))
        suppressed = {(int(a), int(b)): float(time) for a, b, time in collisions.get("quiet", [])}
        state = RestartState(
            elements=_fill_table(content, "element", ELEMENT_VARIABLES, elements, path),
            bonds=_fill_table(content, "bond", BOND_VARIABLES, bonds, path),
            parameters=read_parameters(getattr(file, "parameters_json", None), path, goes_on=True),
            start=read_start(getattr(file, "start", None), path),
            time=float(content["time"]),
            step_number=int(content["step_number"]),
            fragments=[Fragment(**row) for row in json.loads(file.fragments_json)],
            extra={name: content[f"extra/{name}"] for name in file["extra"].variables},
            forcing=str(file.getncattr("forcing")),
            bergs=[(str(name), int(count)) for name, count in json.loads(file.bergs_json)],
            contacts=ContactLog([ContactEvent(**row) for row in collisions.get("rows", [])], suppressed),
            groundings=_groundings(file.groundings_json),
        )
        if lost := set(str(getattr(file, "extra_variables", "")).split()) - set(state.extra):
            raise InputError(f"variable extra/{min(lost)} is missing", where=str(path), remedy=DAMAGED)
        if check:
            check_restart(state, path)
        return state


def _groundings(text: str) -> GroundingLog:
    """Read the stays on the sea floor."""
    log = dict(json.loads(text))
    clearance = log.get("clearance")
    return GroundingLog(
        [GroundingEvent(**row) for row in log.get("rows", [])], math.inf if clearance is None else float(clearance)
    )


def _write_table(file: netCDF4.Dataset, dim: str, variables: Iterable[Variable], arrays: Elements | Bonds) -> None:
    file.createDimension(dim, len(next(iter(arrays.arrays().values()))))
    stored_variables = [v for v in variables if v.restart]
    # By this list a reader distinguishes a variable that was lost from one that was added to the registry later.
    file.setncattr(f"{dim}_variables", " ".join(v.name for v in stored_variables))
    for v in stored_variables:
        # No compression and no fill value: the bytes of the arrays unchanged.
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


def _content(
    group: netCDF4.Dataset, tables: Mapping[str, NDArray[Any]] | None = None, prefix: str = ""
) -> dict[str, Any]:
    """Return the arrays of a file by their names, and its attributes by ``variable:attribute``; fill the arrays of tables."""
    content = {f"{prefix}:{name}": group.getncattr(name) for name in group.ncattrs()}
    for name, variable in group.variables.items():
        values, table = variable[...], (tables or {}).get(f"{prefix}{name}")
        if table is not None and (table.dtype, table.shape) == (values.dtype, values.shape):
            table[...] = values  # and the copy goes: large new arrays cost more than what is read into them
            values = table
        content[f"{prefix}{name}"] = values
        content |= {f"{prefix}{name}:{key}": variable.getncattr(key) for key in variable.ncattrs()}
    for name, inner in group.groups.items():
        content |= _content(inner, prefix=f"{prefix}{name}/")
    return content


def _digest(content: Mapping[str, Any]) -> int:
    """Return a checksum over all that a file holds, by which a bit that has flipped is noticed."""
    total = 0
    for name in sorted(content):
        if name != f":{DIGEST}":
            value = content[name]
            data: Any = value.encode() if isinstance(value, str) else np.ascontiguousarray(value)
            total = zlib.crc32(data, zlib.crc32(name.encode(), total))
    return total


def _fill_table(
    content: Mapping[str, Any], table: str, variables: Iterable[Variable], arrays: _Table, path: Path
) -> _Table:
    """Return a filled table, unless something is missing; variables added to the registry since keep their default."""
    written = str(content.get(f":{table}_variables", "")).split()
    for v in variables:
        if not v.restart or v.name not in written:
            continue
        name = f"{table}_{v.name}"
        if name not in content:
            raise InputError(f"variable {name} ({v.long_name}) is missing", where=str(path), remedy=DAMAGED)
        target, stored = getattr(arrays, v.name), content[name]
        if stored.dtype != target.dtype or stored.shape != target.shape:
            raise InputError(
                f"type {stored.dtype} and shape {stored.shape}, not {target.dtype} and {target.shape}",
                where=f"{path}, variable {name}", remedy=DAMAGED,
            )  # fmt: skip
    if not written:
        raise InputError(f"attribute {table}_variables is missing", where=str(path), remedy=DAMAGED)
    return arrays


# ---- refusal of impossible states -----------------------------------------------------------------------------------------


def _damage_error(problem: str, path: Path, location: str = "") -> InputError:
    return InputError(problem, where=f"{shown(path)}, {location}" if location else shown(path), remedy=DAMAGED)


def check_restart(state: RestartState, path: Path) -> None:
    """Refuse a restart that is no state of a run: times, steps, statuses, references and numbers that cannot be."""
    dt = state.parameters.time_step
    if not math.isfinite(state.time) or not 0.0 <= state.time <= 1e11:
        raise _damage_error(f"time is {state.time:g} s", path, "variable time")
    if state.step_number < 0 or (state.step_number == 0) != (state.time == 0.0):
        raise _damage_error(f"{state.step_number} steps do not lead to {state.time:g} s", path, "variable step_number")
    if abs(state.step_number * dt - state.time) > 0.5 * dt:
        raise _damage_error(
            f"{state.step_number} steps of {dt:g} s do not lead to {state.time:g} s",
            path,
            "variable step_number",
        )
    # A run whose elements have all gone knows the next identifier.
    if state.elements.mass.size == 0 and "next_element" not in state.extra:
        raise _damage_error("no elements", path)
    check_fragment_rows(state.fragments, path, "attribute fragments_json")
    check_fragment_rows(state.contacts.rows, path, "attribute contacts_json")
    check_fragment_rows(state.groundings.rows, path, "attribute groundings_json")
    if any(count < 0 for _, count in state.bergs):
        raise _damage_error("a berg with less than no elements", path, "attribute bergs_json")
    bonds, count = state.bonds, state.elements.mass.size
    check_bond_ends(bonds.first, bonds.second, count, path, "variable bond_first, bond_second")
    _check_tables(state, path)
    ids = state.elements.id
    if len(np.unique(ids)) < len(ids):
        raise _damage_error("two elements have the same identifier", path, "variable element_id")
    broken_at = bonds.break_time[~np.isnan(bonds.break_time)]  # NaN: the bond holds
    if ((broken_at < 0.0) | (broken_at > state.time + dt)).any():
        raise _damage_error("a bond that broke before the start, or later than now", path, "variable bond_break_time")
    if state.parameters.stepping.has_substeps:
        _check_values(state.elements.substeps, Rule.between("element_substeps", 1, MOST_SUBSTEPS, whole=True), path)
    check_extra(state, path)


class Bound(NamedTuple):
    """Shape and values of one array of a restart file."""

    # Length of each dimension: a number, a name (equal names are equal lengths, see `check_extra`), or None for any
    shape: tuple[int | str | None, ...]
    least: int | str | None = None  # Whole numbers between these; None for real numbers, which must be finite
    most: int | str | None = None  # Whole numbers between these; None for real numbers, which must be finite
    once: bool = False  # None of the numbers stands twice


EXTRAS: Final[Mapping[str, Bound]] = {
    "next_element": Bound((), "beyond element_id", LARGEST_WHOLE),
    "next_bond": Bound((), "beyond bond_id", LARGEST_WHOLE),
    "own_laws": Bound((4,), 0, 1),
    "turns": Bound((None, 2)),
    # The rigid bodies of the quasi-static scheme, as the last step left them; elements may have come or gone since.
    "rigid_body": Bound(("left",), 0, "bodies - 1"),
    "rigid_(shape|bend)": Bound(("left", 3)),
    "rigid_pose": Bound(("bodies", 3, 3)),
    "rigid_rate": Bound(("bodies", 3)),
    "rigid_left_id": Bound(("left",), 0, "next_element - 1", once=True),
    "rigid_left_.+": Bound(("left",)),
    "life_ledger": Bound((5, 1 + len(PROCESSES) + len(SOURCES))),
    "motion_ledger": Bound((None, 3)),  # the ledger itself knows how many rows it has
    "motion_on_bed": Bound((None,)),
    "melt_by_fragment": Bound((None, 1 + len(PROCESSES))),
    "foot_growth": Bound((None, 2)),
    "front_shapes": Bound((None,), 0, 255),
    "front_bergs": Bound(("outlines",), 0, "fragments"),
    "front_elements": Bound(("fronts", 2), 0, "next_element - 1"),
    "front_sizes": Bound(("fronts", 2)),
    # The mesh of elastic cells; bonds of neighbours that were never bonded have the identifier -1.
    "cells_element": Bound(("cells",), 0, "next_element - 1", once=True),
    "cells_bond": Bound(("cell_bonds",), -1, "next_bond - 1"),
    "cells_xy": Bound(("nodes", 2)),
    "cells_owner": Bound(("nodes",), 0, "cells - 1"),
    "cells_triangle": Bound(("triangles", 3), 0, "nodes - 1"),
    "cells_(weight|area)": Bound(("triangles",)),
    "cells_edge_bond": Bound(("triangles", 3), -1, "cell_bonds - 1"),
    "cells_edge_tie": Bound(("triangles", 3), -1, "3 * triangles - 1"),
    "cells_path_tie": Bound(("paths",), 0, "3 * triangles - 1"),
    "cells_path_bonds": Bound(("paths", None), -1, "cell_bonds - 1"),
    # Tips of cracks, each beside two elements.
    "crack_tip_beside": Bound(("tips", 2), 0, "next_element - 1"),
    "crack_tip_(place|direction)": Bound(("tips", 2)),
    "crack_tip_crack": Bound(("tips",), 0, LARGEST_WHOLE),
    "crack_tip_order": Bound(("tips",), -LARGEST_WHOLE, LARGEST_WHOLE),
    "crack_tip_length": Bound(("tips",)),
    "crack_tip_intensity": Bound(("tips", 3)),
    "footprint_element": Bound(("footprints",), 0, "next_element - 1", once=True),
    "footprint_size": Bound(("footprints",)),
    "footprint_east": Bound(("footprints",)),
    "footprint_centre": Bound(("footprints", 2)),
    "footprint_owner": Bound(("polygons",), 0, "footprints - 1"),
    "footprint_corner": Bound(("corners", 2)),
    "footprint_start": Bound((None,), 0, "corners"),
    "footprint_cracked": Bound((None,), 0, "next_bond - 1"),
    # Faces of two elements that press each other.
    "meeting_pair": Bound(("face pairs", 2), 0, "next_element - 1"),
    "meeting_polygon": Bound(("face pairs", 2), 0, LARGEST_WHOLE),
    "meeting_state": Bound(("face pairs", 16)),
    "meeting_dissipated": Bound((1,)),
    "bed_(plastic|clearance)": Bound((None,)),
    "record_peak_stress_.+": Bound((None,)),
    "record_sums_.+": Bound((None, None)),
    "record_seconds_.+": Bound(()),
    "record_times_.+": Bound((2,)),
    # Identifiers in the order of the rows of the run file; whether it has gaps, and which sizes change.
    "record_rows_of_elements_.+": Bound((None,), 0, "next_element - 1", once=True),
    "record_rows_of_bonds_.+": Bound((None,), 0, "next_bond - 1", once=True),
    "record_rows_change_.+": Bound((None,), 0, 1),
    "sweep_track": Bound((None, 10)),  # the columns of `riftberg.ensembles.member.Outcome.track`
    "exchange_totals": Bound((4,)),
    "exchange_left": Bound((2,)),
    "exchange_(start|held)": Bound((2,)),
    "exchange_corners": Bound((4,)),
    "exchange_handed": Bound((12,), 0, 1),  # the fields of `riftberg.ocean.cells.Fields`
    # Rows and columns are those of the grid of the exchange, which refuses others.
    "yac_given": Bound((10, None, None)),
    "exchange_counter": Bound((None, None), 0, LARGEST_WHOLE),
    "exchange_(settling|heat|mean_flux|mean_heat)": Bound((None, None)),
    "exchange_ice": Bound((None, None, None)),
    "gridded_.+_s_times": Bound((3,)),
    "gridded_.+_cells": Bound((None,), 0, MOST_VALUES),
    "gridded_.+_rows": Bound((None, None)),
}
"""Arrays that a restart file may hold in its group ``extra``, by a pattern of the name. Arrays of a user's own processes, with
other names, may have any shape; they must be numbers."""


def check_extra(state: RestartState, path: Path) -> None:
    """Refuse arrays of the group ``extra`` of the wrong shape, kind or size: compiled code indexes memory by some of them."""
    for name, array in state.extra.items():
        values = np.asarray(array)
        location = f"variable extra/{name}"
        if values.dtype.kind not in "iuf":
            raise _damage_error(f"numbers are needed, not values of type {values.dtype}", path, location)
    # Sizes by which others are bounded; those that arrays say themselves are added as they are met.
    sizes = {"elements": state.elements.size, "bonds": len(state.bonds.first)}
    sizes["fragments"] = max((row.number for row in state.fragments), default=LARGEST_WHOLE)
    following = {name: np.asarray(state.extra.get(name)) for name in ("next_element", "next_bond")}
    sizes |= {name: int(value) for name, value in following.items() if value.dtype.kind in "iu" and value.ndim == 0}
    ends = {f"beyond {table}_id": int(ids.max()) + 1 if ids.size else 0
            for table, ids in (("element", state.elements.id), ("bond", state.bonds.id))}  # fmt: skip
    # Names and bounds of the arrays that are known, those first that say how long the others are.
    bounds: dict[str, Bound] = {}
    for pattern, bound in EXTRAS.items():
        for name in state.extra:
            if re.fullmatch(pattern, name):
                bounds.setdefault(name, bound)  # the first pattern that fits holds
    for name, bound in sorted(bounds.items(), key=lambda item: item[1].least is not None):
        values, location = np.asarray(state.extra[name]), f"variable extra/{name}"
        fits = values.ndim == len(bound.shape) and all(
            expected is None or size == (sizes.setdefault(expected, size) if isinstance(expected, str) else expected)
            for expected, size in zip(bound.shape, values.shape, strict=True)
        )
        if not fits:
            expected = tuple(
                sizes.get(size, size) if isinstance(size, str) else "any" if size is None else size
                for size in bound.shape
            )
            raise _damage_error(f"shape {values.shape} instead of {expected}", path, location)
        if bound.least is None:
            _check_values(values, Rule.between(f"extra/{name}", -LARGEST, LARGEST), path)
        else:
            least, most = (_resolve_limit(limit, {**sizes, **ends}) for limit in (bound.least, bound.most))
            _check_values(values, Rule.between(f"extra/{name}", least, most, whole=True), path)
        if bound.once and np.unique(values).size < values.size:
            raise _damage_error("two entries are the same", path, location)


def _resolve_limit(limit: float | str | None, sizes: Mapping[str, int]) -> int:
    """Return a limit as a number: itself, a size or some times of it, or such a size less one."""
    if not isinstance(limit, str):
        return int(limit or 0)
    size, _, less = limit.partition(" - ")
    times, _, name = size.rpartition(" * ")
    # Where the array that says the size is missing nothing is taken up.
    return int(times or 1) * sizes.get(name, LARGEST_WHOLE) - int(less or 0)


def _check_values(values: Any, rule: Rule, path: Path) -> None:
    """Refuse values of a variable that break a rule."""
    if breach := find_breach([rule], lambda _: values):
        entry = f"entry {', '.join(str(k + 1) for k in breach.index)} is {breach.value:g}"
        raise _damage_error(f"{entry}, not {rule.allowed}", path, f"variable {rule.variable}")


def check_fragment_rows(rows: Sequence[Any], path: Path, location: str) -> None:
    """Refuse rows of fragments or collisions with texts where numbers belong, numbers that are none, or unknown fragments."""
    for k, row in enumerate(rows):
        for name, value in vars(row).items():
            kind = type(row).__dataclass_fields__[name].type
            good = (
                isinstance(value, str) if kind == "str"
                else isinstance(value, bool) if kind == "bool"
                else isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**31 if kind == "int"
                else isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST
            )  # fmt: skip
            if not good:
                raise _damage_error(f"{name} of row {k + 1} is {value_shown(value)}", path, location)


def _check_tables(state: RestartState, path: Path) -> None:
    """Refuse numbers outside their limits in the registry.

    Cells are held against the grid of the forcing when the run goes on (`riftberg.ocean.grid.Grid.check_cells`).
    """
    sizes = {
        "elements": state.elements.size, "bonds": 2 * len(state.bonds.first),
        # Numbers of fragments rise by one from 1; runs of the reference's numerics keep no tree.
        "fragments": max((row.number for row in state.fragments), default=LARGEST_WHOLE),
    }  # fmt: skip
    tables = (("element", ELEMENT_VARIABLES, state.elements), ("bond", BOND_VARIABLES, state.bonds))
    for table, variables, arrays in tables:
        rules = []
        for variable in variables:
            name, (least, most), whole = variable.name, variable.limits, variable.dtype == "i8"
            most = _resolve_limit(most, sizes) if whole else float(most)
            # A bond that holds has no date of breaking; without a value at the keel the one at the surface holds there too.
            missing = name in ("break_time", "keel_temperature", "keel_salinity")
            rules.append(Rule.between(name, least, most, whole=whole, missing=missing))
        if breach := find_breach(rules, partial(getattr, arrays)):
            name = breach.rule.variable
            problem = f"{table} {breach.row + 1} has {name} = {breach.value:g}, not {breach.rule.allowed}"
            raise _damage_error(problem, path, f"variable {table}_{name}")
    lat = state.elements.lat
    if state.parameters.earth.latlon and (np.abs(lat) > 90.0).any():
        raise _damage_error(f"latitude {lat[np.argmax(np.abs(lat))]:g}", path, "variable element_lat")


def check_same_run(state: RestartState, fresh: Any, path: Path, *, experiment: str) -> None:
    """Refuse to go on from the restart of another experiment, ocean or start."""
    remedy = "Name the experiment that it comes from, with the options of that run"
    where = f"--resume {shown(path)}"
    if state.parameters.earth.latlon != fresh.parameters.earth.latlon:
        raise InputError(f"a restart in other coordinates than {experiment}", where=where, remedy=remedy)
    if state.start != fresh.start:
        raise InputError(
            f"a run that started at {state.start:%Y-%m-%d %H:%M}, but {experiment} starts at {fresh.start:%Y-%m-%d %H:%M}",
            where=where, remedy=remedy,
        )  # fmt: skip
    saved_elements, fresh_elements = state.elements, fresh.elements
    # The run may have changed the density of the ice (--set), which the named experiment does not know.
    denser = state.parameters.ice.density / fresh.parameters.ice.density
    born = [(row.elements, row.area, row.mass) for row in state.fragments if row.parent <= 0 >= row.birth_time]
    if born:  # bergs that melt, calve or are added to are recognised by their state at the start
        start = (
            fresh_elements.mass.size,
            (fresh_elements.length * fresh_elements.width).sum(),
            denser * fresh_elements.mass.sum(),
        )
        same = np.allclose(np.sum(born, axis=0), start, rtol=1e-6)
    else:
        same = saved_elements.mass.size == fresh_elements.mass.size and all(
            np.allclose(getattr(saved_elements, name), factor * getattr(fresh_elements, name), rtol=1e-6)
            for name, factor in (("mass", denser), ("length", 1.0), ("width", 1.0))
        )
    if not same:
        raise InputError(
            f"a berg of {saved_elements.mass.size} elements and {saved_elements.mass.sum() / 1e12:.4g} Gt, "
            f"but that of {experiment} has "
            f"{fresh_elements.mass.size} and {fresh_elements.mass.sum() / 1e12:.4g} Gt",
            where=where, remedy=remedy,
        )  # fmt: skip
    saved_ocean, fresh_ocean = (
        next((line.strip() for line in text.splitlines() if line.strip()), "")
        for text in (state.forcing, fresh.forcing.describe())
    )
    if saved_ocean != fresh_ocean:
        raise InputError(
            f"a run in another ocean ({value_shown(saved_ocean)}) than that of {experiment} ({value_shown(fresh_ocean)})",
            where=where, remedy=remedy,
        )  # fmt: skip
