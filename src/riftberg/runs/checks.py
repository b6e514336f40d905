"""Whether a run file is what it says: checked here, once, when it is opened.

All commands and `riftberg.runs.run_file.open_run` call `open_checked`; so what is drawn, compared or continued can
rely on shapes, types, finite positions and bonds that join elements of the run.
"""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from pydantic import ValidationError

from riftberg.config.values import finding_text
from riftberg.errors import InputError
from riftberg.parameters import Parameters
from riftberg.runs.layout import (
    CONTACT_VARIABLES,
    FRAGMENT_VARIABLES,
    IN_FILE,
    SHAPE,
    dimensions_of_variables,
    in_file,
)
from riftberg.state import BOND_VARIABLES, ELEMENT_VARIABLES
from riftberg.state.variables import ABOVE_0, LARGEST, LARGEST_WHOLE
from riftberg.system.input_files import check_file, reading, shown, value_shown
from riftberg.system.limits import MOST_VALUES, refuse_large
from riftberg.system.netcdf_lock import NETCDF, open_lazily

if TYPE_CHECKING:
    import xarray as xr

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
