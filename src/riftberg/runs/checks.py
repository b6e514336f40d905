"""Whether a file is what it says: run files, restart files and summaries are checked here, once, when they are opened.

All commands and `riftberg.runs.run_file.open_run` call `open_checked`; so what is drawn, compared or continued can
rely on shapes, types, finite positions and bonds that join elements of the run.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, NamedTuple, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from riftberg.config.values import finding_text
from riftberg.errors import InputError
from riftberg.life.ledger import PROCESSES, SOURCES
from riftberg.parameters import Parameters
from riftberg.runs.layout import (
    CONTACT_VARIABLES,
    FRAGMENT_VARIABLES,
    IN_FILE,
    SHAPE,
    dimensions_of_variables,
    forcing_text,
    in_file,
)
from riftberg.state import BOND_VARIABLES, ELEMENT_VARIABLES, Bonds, Elements
from riftberg.state.variables import ABOVE_0, LARGEST, LARGEST_WHOLE
from riftberg.system.input_files import check_file, reading, shown, value_shown
from riftberg.system.limits import MOST_SUBSTEPS, MOST_TEXT, MOST_VALUES, refuse_large
from riftberg.system.netcdf_lock import NETCDF, open_lazily

if TYPE_CHECKING:
    import xarray as xr

DAMAGED: Final = "The file is damaged: resume from another restart"
"""What helps where a restart file cannot be gone on from."""

RUN_REMEDY: Final = "Name a run.nc, or the folder that 'riftberg run' made"

NEEDED: Final = (
    "time", "trajectory", *SHAPE[:3], "thickness", "rotation", "u", "v", "spin", "depth", "berg",
    "bond_first", "bond_second", "status", "strength", "break_time", "break_grounded", "normal_stress", "shear_stress",
    *(f"fragment_{name}" for name in ("number", "parent", "birth_time", "elements", "area", "bonds_broken", "grounded")),
)  # fmt: skip
"""Variables of a run file that every reader may use; positions besides. What is added later may be missing."""

_DATES: Final = ("time", "break_time", "fragment_birth_time")
_DATES_OF_COLLISIONS: Final = ("contact_time", "contact_end")
_TEXTS: Final = ("fragment_name",)
_SHAPE_IN_FILE: Final = ("char_dim_name", "original_shape")
"""What xarray notes of a text in a file, and warns of where a part of the run is written to another file."""
_CHECKED: Final = (
    "rotation", "u", "v", "spin", "length", "width", "mass", "thickness", "corners", "status",
)  # fmt: skip
"""Variables of elements and bonds whose values are read when a run file is opened; those of fragments and collisions all are."""

_ENTRIES: Final = {"trajectory": "element", "time": "record", "contact": "collision"}
"""What stands along the dimensions of a run file, where it has another name."""


def open_checked(file: Path, *, own: bool = False) -> xr.Dataset:
    """Open a run file and check it; whatever is wrong is said in one sentence.

    ``own``: this process has written it, and its values, which the model has checked, are not read for that again.
    """
    check_file(file, remedy=RUN_REMEDY)
    with reading(file, "not a NetCDF file, or a damaged one", RUN_REMEDY):
        opened = open_lazily(file, engine="netcdf4", lock=NETCDF, decode_times=False)  # never xarray's own lock
        # Names in files of versions before 0.2.0.
        dataset = opened.rename({old: new for old, new in IN_FILE.items() if old in opened.variables})
        dataset.set_close(opened.close)
    try:
        with reading(file, "a damaged run file", "Make the run again, or name another run.nc"):
            _check_layout(dataset, file)
            parameters_of(dataset, file)
            read_start(dataset.attrs.get("start"), file)
            decoded = _with_dates(dataset, file)
            if not own:
                _check_values(decoded, file)
            return decoded
    except BaseException:
        dataset.close()
        raise


def _error(
    what: str, file: Path, place: str = "", remedy: str = "Make the run again, or name another run.nc"
) -> InputError:
    return InputError(what, where=f"{shown(file)}, {place}" if place else shown(file), remedy=remedy)


def _check_layout(run: xr.Dataset, file: Path) -> None:
    """Check kind, dimensions, variables and their types."""
    if "trajectory" not in run.dims or run.attrs.get("featureType") != "trajectory":
        raise _error("not the trajectory file of a run of Riftberg", file, remedy=RUN_REMEDY)
    if "parameters_json" not in run.attrs or "bond" not in run.dims:
        raise _error(
            "a trajectory file, but not of Riftberg: it has no elements, bonds and parameters", file, remedy=RUN_REMEDY
        )
    places = ("lon", "lat") if "lon" in run.variables else ("x", "y")
    for name in (*places, *NEEDED):
        if name not in run.variables:
            raise _error(f"variable {name} is missing", file)
    for name, dims in dimensions_of_variables().items():
        if name not in run.variables:
            continue
        variable = run[name]
        # Sizes have a time only in runs in which they change.
        moving = name in map(in_file, SHAPE) and set(variable.dims) == {"trajectory", "time"}
        if not moving and (set(variable.dims) != set(dims) or len(variable.dims) != len(dims)):
            raise _error(f"dimensions {variable.dims} instead of {dims}", file, f"variable {name}")
        if name in _TEXTS and variable.dtype.kind not in "UOT":
            raise _error(f"texts are needed, not values of type {variable.dtype}", file, f"variable {name}")
        if name not in _TEXTS and variable.dtype.kind not in "iuf":
            raise _error(f"numbers are needed, not values of type {variable.dtype}", file, f"variable {name}")
        refuse_large(
            variable.size, MOST_VALUES, f"values of {name}", size=variable.dtype.itemsize, where=shown(file),
            remedy="Write fewer records (--every)", kind=InputError,
        )  # fmt: skip
    ids = run["trajectory"]
    if ids.dtype.kind not in "iu" or len(np.unique(ids.values)) < ids.size:
        raise _error("identifiers are whole numbers, and each stands once", file, "variable trajectory")
    for dimension, word in (("trajectory", "elements"), ("time", "records")):
        if run.sizes[dimension] == 0:
            raise _error(f"no {word}", file, remedy="The run stopped before its first record: make it again")


def parameters_of(run: xr.Dataset, file: Path | None = None) -> Parameters:
    """Return the parameters of a run file, or say that its attribute is none."""
    return read_parameters(run.attrs.get("parameters_json"), file or Path(str(run.encoding.get("source", "run"))))


def read_parameters(text: Any, file: Path) -> Parameters:
    """Return parameters from the attribute ``parameters_json`` of a file."""
    place = "attribute parameters_json"
    if not isinstance(text, str):
        raise _error("missing, or no text", file, place)
    try:
        return Parameters.model_validate_json(text)
    except InputError as error:
        raise _error(
            f"no parameters of Riftberg ({error.where}: {error.what[:100]})", file, place,
            "The file is damaged, or was written by another version of Riftberg",
        ) from error  # fmt: skip
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise _error(
            f"no parameters of Riftberg ({key}: {finding_text(first)})" if key else "no JSON of parameters",
            file,
            place,
            "The file is damaged, or was written by another version of Riftberg",
        ) from error


def read_start(text: Any, file: Path) -> datetime:
    """Return a date from the attribute ``start`` of a file."""
    try:
        start = datetime.fromisoformat(text)
    except (TypeError, ValueError) as error:
        raise _error(f"{value_shown(text)} is no date", file, "attribute start") from error
    if start.tzinfo is not None:
        raise _error(f"{text} has a time zone", file, "attribute start", "Dates of run files are UTC, without a zone")
    return start


def _with_dates(run: xr.Dataset, file: Path) -> xr.Dataset:
    """Return the run with decoded dates."""
    dates = (*_DATES, *(name for name in _DATES_OF_COLLISIONS if name in run.variables))
    for name in dates:
        units = run[name].attrs.get("units")
        if not isinstance(units, str) or not units.startswith("seconds since "):
            raise _error(f"units {value_shown(units)} are no 'seconds since' a date", file, f"variable {name}")
        values = run[name].values
        if not (np.isfinite(values) | (name != "time")).all() or (np.abs(values[np.isfinite(values)]) > 1e11).any():
            raise _error("times that are no numbers, or thousands of years away", file, f"variable {name}")
    with reading(f"{shown(file)}, variable time", "dates that cannot be read", "Make the run again"):
        import xarray as xr

        decoded = xr.decode_cf(run)
    for variable in decoded.variables.values():
        for name in _SHAPE_IN_FILE:  # texts are as long elsewhere as they are there
            variable.encoding.pop(name, None)
    decoded.set_close(run.close)
    for name in dates:
        if decoded[name].dtype.kind != "M":
            raise _error("dates outside the years 1678 to 2261", file, f"variable {name}")
    # As whole numbers: a difference of dates that are none would be no number and pass.
    steps = np.diff(decoded["time"].values.astype("datetime64[ns]").astype(np.int64))
    if (steps <= 0).any():
        raise _error(f"times do not rise after record {int(np.argmax(steps <= 0)) + 1}", file, "variable time")
    return decoded


def _check_values(run: xr.Dataset, file: Path) -> None:
    latlon = parameters_of(run, file).earth.latlon
    if latlon != ("lon" in run.variables):
        raise _error("positions and the parameter earth.latlon do not agree", file)
    for name, limits in _limits_in_file(latlon).items():
        if name in run.variables:
            _check_allowed(run, name, file, limits)
    ends = run["bond_first"].values, run["bond_second"].values
    check_bond_ends(*ends, run.sizes["trajectory"], file, "variable bond_first, bond_second")
    if "corners" in run and not np.isin(np.nan_to_num(run["corners"].values), (0, 4, 6)).all():  # 0: not known
        raise _error("an element has 4 or 6 corners", file, "variable corners")
    for name, what in (("fragment_birth_time", "a fragment"), ("contact_time", "a collision")):
        if name in run.variables and np.isnat(run[name].values).any():
            raise _error(f"{what} without a time", file, f"variable {name}")
    number, parent = run["fragment_number"].values, run["fragment_parent"].values
    place = "variable fragment_number, fragment_parent"
    if len(np.unique(number)) < len(number):
        raise _error("two fragments have the same number", file, place)
    known = np.isin(parent, (0, *number)) & (parent != number)
    if not known.all():
        k = int(np.argmin(known))
        raise _error(f"fragment {number[k]} broke off {parent[k]}, which is not in the file", file, place)


class Allowed(NamedTuple):
    """Between which numbers values lie, and whether they are whole ones."""

    least: float
    most: float
    whole: bool = False

    def beyond(self, values: Any) -> Any:
        """Return which values lie outside, or are no whole numbers."""
        with np.errstate(invalid="ignore"):
            bad = ~((values >= self.least) & (values <= self.most))
            return bad | (values != np.floor(values)) if self.whole and values.dtype.kind == "f" else bad

    def demand(self) -> str:
        """Return in words what is asked of a value."""
        if self.whole:
            return f"a whole number from {self.least:.0f} to {self.most:.0f}"
        if self.least == ABOVE_0:
            return f"a number above 0 and up to {self.most:g}"
        return (
            "a finite number"
            if self.least == -self.most == -LARGEST
            else f"a number from {self.least:g} to {self.most:g}"
        )


def _limits_in_file(latlon: bool) -> dict[str, Allowed]:
    """Return the limits of what is checked in a run file, by name and as the registries have them."""
    places = {"lon": 1e4, "lat": 90.0} if latlon else dict.fromkeys(("x", "y"), 1e12)
    limits = {name: Allowed(-most, most) for name, most in places.items()}
    states = [v for v in (*ELEMENT_VARIABLES, *BOND_VARIABLES) if in_file(v.name) in _CHECKED]
    for table, variables in (("", states), ("fragment_", FRAGMENT_VARIABLES), ("contact_", CONTACT_VARIABLES)):
        for v in variables:
            if not table or v.limits != (-LARGEST, LARGEST):
                limits[f"{table}{v.name}" if table else in_file(v.name)] = Allowed(
                    v.limits[0], float(v.limits[1]), v.dtype == "i8"
                )
    return {**limits, "berg": Allowed(1, LARGEST_WHOLE, whole=True)}


def _check_allowed(run: xr.Dataset, name: str, file: Path, limits: Allowed) -> None:
    """Refuse NaN, infinite and impossible values; names element and record."""
    values = run[name].values
    # Elements that are not there yet, or no more, have no values, but none of theirs is impossible.
    bad = limits.beyond(values) & ~(np.isnan(values) & _absent(run, name, values.shape))
    if bad.any():
        index = tuple(int(k) for k in np.argwhere(bad)[0])
        place = ", ".join(
            f"{_ENTRIES.get(str(dim), dim)} {k + 1}" for dim, k in zip(run[name].dims, index, strict=True)
        )
        raise _error(f"{name} is {values[index]:g}, not {limits.demand()}", file, f"variable {name}, {place}")


def _absent(run: xr.Dataset, name: str, shape: tuple[int, ...]) -> Any:
    """Return where elements are not there, in runs in which they come and go: such records hold no fragment either."""
    berg = run["berg"]
    if berg.dtype.kind != "f" or set(run[name].dims) != set(berg.dims):
        return np.zeros(shape, dtype=bool)
    return np.isnan(berg.transpose(*run[name].dims).values)


def check_bond_ends(first: Any, second: Any, elements: int, file: Path, place: str) -> None:
    """Refuse bonds that join no two elements of the run."""
    bad = (first < 0) | (second < 0) | (first >= elements) | (second >= elements) | (first == second)
    if bad.any():
        k = int(np.argmax(bad))
        raise _error(
            f"bond {k + 1} joins rows {first[k]:g} and {second[k]:g}, but the elements have rows 0 to {elements - 1}",
            file, place,
        )  # fmt: skip
    if first.dtype.kind == "f" and not ((first == np.floor(first)).all() and (second == np.floor(second)).all()):
        raise _error("rows of elements are whole numbers", file, place)
    low, high = np.minimum(first, second).astype(np.int64), np.maximum(first, second).astype(np.int64)
    pairs, counts = np.unique(low * elements + high, return_counts=True)
    if (counts > 1).any():
        pair = int(pairs[np.argmax(counts > 1)])
        raise _error(f"two bonds join rows {pair // elements} and {pair % elements}", file, place)


def check_recorded(run: xr.Dataset, names: tuple[str, ...]) -> None:
    """Refuse a run whose recorded surroundings are missing or no numbers, for those who compute forces from them."""
    file = Path(str(run.encoding.get("source", "run")))
    for name in names:
        if name not in run.variables:
            raise _error(f"variable {name} is missing", file)
        _check_allowed(run, name, file, Allowed(-LARGEST, LARGEST))


# --- restarts ----------------------------------------------------------------------------------------------------------


class State(Protocol):
    """What a restart holds (`riftberg.runs.restart.RestartState`)."""

    elements: Elements
    bonds: Bonds
    parameters: Parameters
    start: datetime
    time: float
    step_number: int
    extra: dict[str, Any]
    forcing: str
    fragments: list[Any]
    bergs: list[tuple[str, int]]
    contacts: Any


def _damaged(what: str, path: Path, place: str = "") -> InputError:
    return _error(what, path, place, DAMAGED)


def check_restart(state: State, path: Path) -> None:
    """Refuse a restart that is no state of a run: times, steps, statuses, references and numbers that cannot be."""
    dt = state.parameters.stepping.time_step
    if not math.isfinite(state.time) or not 0.0 <= state.time <= 1e11:
        raise _damaged(f"time is {state.time:g} s", path, "variable time")
    if state.step_number < 0 or (state.step_number == 0) != (state.time == 0.0):
        raise _damaged(f"{state.step_number} steps do not lead to {state.time:g} s", path, "variable step_number")
    if abs(state.step_number * dt - state.time) > 0.5 * dt:
        raise _damaged(
            f"{state.step_number} steps of {dt:g} s do not lead to {state.time:g} s",
            path,
            "variable step_number",
        )
    # A run whose elements have all gone knows the next identifier.
    if state.elements.mass.size == 0 and "next_element" not in state.extra:
        raise _damaged("no elements", path)
    check_fragment_rows(state.fragments, path, "attribute fragments_json")
    check_fragment_rows(state.contacts.rows, path, "attribute contacts_json")
    if any(count < 0 for _, count in state.bergs):
        raise _damaged("a berg with less than no elements", path, "attribute bergs_json")
    bonds, count = state.bonds, state.elements.mass.size
    check_bond_ends(bonds.first, bonds.second, count, path, "variable bond_first, bond_second")
    _check_tables(state, path)
    ids = state.elements.id
    if len(np.unique(ids)) < len(ids):
        raise _damaged("two elements have the same identifier", path, "variable element_id")
    broken_at = bonds.break_time[~np.isnan(bonds.break_time)]  # NaN: the bond holds
    if ((broken_at < 0.0) | (broken_at > state.time + dt)).any():
        raise _damaged("a bond that broke before the start, or later than now", path, "variable bond_break_time")
    if state.parameters.stepping.scheme == "mts":
        _refuse(state.elements.substeps, Allowed(1, MOST_SUBSTEPS, whole=True), path, "variable element_substeps")
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
    "own_laws": Bound((3,), 0, 1),
    # The rigid bodies of the quasi-static scheme, as the last step left them; elements may have come or gone since.
    "rigid_body": Bound(("left",), 0, "bodies - 1"),
    "rigid_(shape|bend)": Bound(("left", 3)),
    "rigid_pose": Bound(("bodies", 3, 3)),
    "rigid_rate": Bound(("bodies", 3)),
    "rigid_left_id": Bound(("left",), 0, "next_element - 1", once=True),
    "rigid_left_.+": Bound(("left",)),
    "life_ledger": Bound((5, 1 + len(PROCESSES) + len(SOURCES))),
    "motion_ledger": Bound((None, 3)),  # the ledger itself knows how many rows it has
    "melt_by_fragment": Bound((None, 1 + len(PROCESSES))),
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
    "footprint_element": Bound(("footprints",), 0, "next_element - 1", once=True),
    "footprint_size": Bound(("footprints",)),
    "footprint_centre": Bound(("footprints", 2)),
    "footprint_owner": Bound(("polygons",), 0, "footprints - 1"),
    "footprint_corner": Bound(("corners", 2)),
    "footprint_start": Bound((None,), 0, "corners"),
    # Faces of two elements that press each other.
    "meeting_pair": Bound(("face pairs", 2), 0, "next_element - 1"),
    "meeting_state": Bound(("face pairs", 13)),
    "meeting_dissipated": Bound((1,)),
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
    # Rows and columns are those of the grid of the exchange, which refuses others.
    "exchange_counter": Bound((None, None), 0, LARGEST_WHOLE),
    "exchange_(settling|heat|mean_flux|mean_heat)": Bound((None, None)),
    "exchange_ice": Bound((None, None, None)),
    "gridded_.+_s_times": Bound((3,)),
    "gridded_.+_cells": Bound((None,), 0, MOST_VALUES),
    "gridded_.+_rows": Bound((None, None)),
}
"""What a restart file may hold in its group ``extra``, by a pattern of the name. Arrays of a user's own processes, with
other names, may have any shape; they must be numbers."""


def check_extra(state: State, path: Path) -> None:
    """Refuse arrays of the group ``extra`` of the wrong shape, kind or size: compiled code indexes memory by some of them."""
    for name, array in state.extra.items():
        values = np.asarray(array)
        place = f"variable extra/{name}"
        if values.dtype.kind not in "iuf":
            raise _damaged(f"numbers are needed, not values of type {values.dtype}", path, place)
    # Sizes by which others are bounded; those that arrays say themselves are added as they are met.
    sizes = {"elements": state.elements.size, "bonds": len(state.bonds.first)}
    sizes["fragments"] = max((row.number for row in state.fragments), default=LARGEST_WHOLE)
    following = {name: np.asarray(state.extra.get(name)) for name in ("next_element", "next_bond")}
    sizes |= {name: int(value) for name, value in following.items() if value.dtype.kind in "iu" and value.ndim == 0}
    ends = {f"beyond {table}_id": int(ids.max()) + 1 if ids.size else 0
            for table, ids in (("element", state.elements.id), ("bond", state.bonds.id))}  # fmt: skip
    for name, bound in _bounds_of(state.extra):
        values, place = np.asarray(state.extra[name]), f"variable extra/{name}"
        fits = values.ndim == len(bound.shape) and all(
            wanted is None or size == (sizes.setdefault(wanted, size) if isinstance(wanted, str) else wanted)
            for wanted, size in zip(bound.shape, values.shape, strict=True)
        )
        if not fits:
            wanted = tuple(
                sizes.get(size, size) if isinstance(size, str) else "any" if size is None else size
                for size in bound.shape
            )
            raise _damaged(f"shape {values.shape} instead of {wanted}", path, place)
        if bound.least is None:
            _refuse(values, Allowed(-LARGEST, LARGEST), path, place)
        else:
            least, most = (_resolved(limit, {**sizes, **ends}) for limit in (bound.least, bound.most))
            _refuse(values, Allowed(least, most, whole=True), path, place)
        if bound.once and np.unique(values).size < values.size:
            raise _damaged("two entries are the same", path, place)


def _bounds_of(extra: Mapping[str, Any]) -> list[tuple[str, Bound]]:
    """Return names and bounds of the arrays that are known, those first that say how long the others are."""
    found: dict[str, Bound] = {}
    for pattern, bound in EXTRAS.items():
        for name in extra:
            if re.fullmatch(pattern, name):
                found.setdefault(name, bound)  # the first pattern that fits holds
    return sorted(found.items(), key=lambda item: item[1].least is not None)


def _resolved(limit: float | str | None, sizes: Mapping[str, int]) -> int:
    """Return a limit as a number: itself, a size or some times of it, or such a size less one."""
    if not isinstance(limit, str):
        return int(limit or 0)
    size, _, less = limit.partition(" - ")
    times, _, name = size.rpartition(" * ")
    # Where the array that says the size is missing nothing is taken up.
    return int(times or 1) * sizes.get(name, LARGEST_WHOLE) - int(less or 0)


def _refuse(values: Any, limits: Allowed, path: Path, place: str) -> None:
    """Refuse values outside of their limits, and what is no whole number where these belong."""
    bad = limits.beyond(values)
    if bad.any():
        index = tuple(int(k) for k in np.argwhere(np.atleast_1d(bad))[0])
        entry = f"entry {', '.join(str(k + 1) for k in index)} is {np.atleast_1d(values)[index]:g}"
        raise _damaged(f"{entry}, not {limits.demand()}", path, place)


def check_fragment_rows(rows: Sequence[Any], path: Path, place: str) -> None:
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
                raise _damaged(f"{name} of row {k + 1} is {value_shown(value)}", path, place)


def _check_tables(state: State, path: Path) -> None:
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
        for variable in variables:
            name, (least, most) = variable.name, variable.limits
            values, place = getattr(arrays, name), f"variable {table}_{name}"
            if variable.dtype == "i8":
                _refuse(values, Allowed(least, _resolved(most, sizes), whole=True), path, place)
            elif name != "break_time":  # NaN while the bond holds
                bad = Allowed(least, float(most)).beyond(values)
                # A missing value at the keel means that the one at the surface holds there too.
                bad &= ~(np.isnan(values) & (name in ("keel_temperature", "keel_salinity")))
                if bad.any():
                    k = int(np.argmax(bad))
                    raise _damaged(f"{table} {k + 1} has {name} = {values[k]:g}", path, place)
    lat = state.elements.lat
    if state.parameters.earth.latlon and (np.abs(lat) > 90.0).any():
        raise _damaged(f"latitude {lat[np.argmax(np.abs(lat))]:g}", path, "variable element_lat")


def check_same_run(state: State, fresh: Any, path: Path, *, named: str) -> None:
    """Refuse to go on from the restart of another experiment, ocean or start."""
    remedy = "Name the experiment that it comes from, with the options of that run"
    where = f"--resume {shown(path)}"
    if state.parameters.earth.latlon != fresh.parameters.earth.latlon:
        raise InputError(f"a restart in other coordinates than {named}", where=where, remedy=remedy)
    if state.start != fresh.start:
        raise InputError(
            f"a run that started at {state.start:%Y-%m-%d %H:%M}, but {named} starts at {fresh.start:%Y-%m-%d %H:%M}",
            where=where, remedy=remedy,
        )  # fmt: skip
    ours, theirs = state.elements, fresh.elements
    # The run may have changed the density of the ice (--set), which the named experiment does not know.
    denser = state.parameters.ice.density / fresh.parameters.ice.density
    born = [(row.elements, row.area, row.mass) for row in state.fragments if row.parent <= 0 >= row.birth_time]
    if born:  # bergs that melt, calve or are added to are recognised by what they were at the start
        start = theirs.mass.size, (theirs.length * theirs.width).sum(), denser * theirs.mass.sum()
        same = np.allclose(np.sum(born, axis=0), start, rtol=1e-6)
    else:
        same = ours.mass.size == theirs.mass.size and all(
            np.allclose(getattr(ours, name), factor * getattr(theirs, name), rtol=1e-6)
            for name, factor in (("mass", denser), ("length", 1.0), ("width", 1.0))
        )
    if not same:
        raise InputError(
            f"a berg of {ours.mass.size} elements and {ours.mass.sum() / 1e12:.4g} Gt, but that of {named} has "
            f"{theirs.mass.size} and {theirs.mass.sum() / 1e12:.4g} Gt",
            where=where, remedy=remedy,
        )  # fmt: skip
    before, now = (
        next((line.strip() for line in text.splitlines() if line.strip()), "")
        for text in (state.forcing, forcing_text(fresh.forcing))
    )
    if before != now:
        raise InputError(
            f"a run in another ocean ({value_shown(before)}) than that of {named} ({value_shown(now)})",
            where=where, remedy=remedy,
        )  # fmt: skip


# --- summaries ---------------------------------------------------------------------------------------------------------

_Number = Annotated[float, Field(gt=-LARGEST, lt=LARGEST)]
_Count = Annotated[int, Field(ge=0)]


class _Entries(BaseModel):
    """What readers of ``summary.json`` use; there is more in it."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _BreakupEntry(_Entries):
    time: str
    lon: _Number
    lat: _Number
    area_km2: Annotated[float, Field(gt=0, lt=LARGEST)]
    bonds: _Count
    grounded: bool


class _Earth(_Entries):
    latlon: bool
    radius: _Number


class _Numerics(_Entries):
    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, dict[str, Any]]

    earth: _Earth


class _Summary(_Entries):
    experiment: str
    start: str
    end: str
    days: _Number
    elements: _Count
    bonds_total: _Count
    bonds_broken: _Count
    fragments: _Count
    breakups: list[_BreakupEntry]
    largest_km2: _Number
    numerics: _Numerics
    seconds_per_day: _Number | None = None


def read_summary(path: Path) -> dict[str, Any]:
    """Read ``summary.json`` and check what it holds."""
    remedy = "Make the run again: 'riftberg run' writes summary.json beside run.nc"
    check_file(path, remedy="Name folders that 'riftberg run' made", most=MOST_TEXT, missing="no summary.json")
    with reading(path, "not JSON, or a damaged file", remedy):
        summary: Any = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(summary, dict):
        raise InputError("no summary of a run", where=shown(path), remedy=remedy)
    try:
        _Summary.model_validate(summary)
    except ValidationError as error:
        first = error.errors()[0]
        place = f"{shown(path)}, key {'.'.join(map(str, first['loc']))}"
        raise InputError(finding_text(first), where=place, remedy=remedy) from error
    for event in summary["breakups"]:
        read_start(event["time"], path)
    return {"seconds_per_day": None, **summary}
