"""Contents of a run file, which of its rows belongs to which element and bond, and checks that a file is valid.

All commands and `riftberg.runs.run_file.open_run` call `open_checked`, once, when a run file is opened; so pictures,
comparisons and continued runs can rely on shapes, types, finite positions and bonds that join elements of the run.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import netCDF4
import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from riftberg.config.values import explained
from riftberg.errors import InputError
from riftberg.parameters import Parameters, from_file
from riftberg.state import BOND_VARIABLES, ELEMENT_VARIABLES, Bonds, Elements, Floats, Ints, Variable
from riftberg.state.population import find_rows
from riftberg.state.rules import Rule, find_breach
from riftberg.state.variables import GONE, LARGEST, LARGEST_WHOLE
from riftberg.system.input_files import MOST_VALUES, check_file, reading, refuse_large, shown, value_shown
from riftberg.system.netcdf_lock import NETCDF, open_lazily
from riftberg.version import __version__

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.model import BareModel
    from riftberg.ocean.forcing import Forcing


LENGTH = 96
"""Bytes of a text; a longer one is cut."""


def define_texts(file: netCDF4.Dataset, name: str, dimension: str) -> netCDF4.Variable[Any]:
    """Create a variable of texts along a dimension; xarray and netCDF4 read it as texts."""
    if "text" not in file.dimensions:
        file.createDimension("text", LENGTH)
    variable = file.createVariable(name, "S1", (dimension, "text"), fletcher32=True)
    variable._Encoding = "utf-8"
    return variable


def texts(values: Iterable[str]) -> NDArray[Any]:
    """Return texts as such a variable takes them."""
    cut = [value.encode()[:LENGTH].decode(errors="ignore") for value in values]
    return np.array(cut, dtype=f"U{LENGTH}")


SHAPE: Final = ("length", "width", "mass", "sides")
"""Variables of the elements written once, and at every record of a run in which they change."""

BOND_HISTORY: Final = ("normal_stress", "shear_stress", "peak_stress")
"""Variables of the bonds written at every record, with ``damage`` where it is on; the other ones hold the latest state.

A record is a moment, and ice rings within a long step: ``peak_stress`` is the largest ``normal_stress`` of any sub-step
since the record before.
"""

BOND_LATEST: Final = (
    "first",
    "second",
    "status",
    "strength",
    "break_time",
    "break_grounded",
    "break_strength",
    "released_energy",
    "cracked_area",
    "crack",
    "crack_order",
    "crack_part",
)

FRAGMENT_VARIABLES: Final = (
    Variable("number", "1", "number of the fragment, the value of berg", dtype="i8", limits=(1, LARGEST_WHOLE)),
    Variable("parent", "1", "number of the fragment it broke off, 0 for a berg of the start", dtype="i8"),
    Variable("birth_time", "s", "time of its birth"),
    Variable("lon", "degrees_east", "longitude of its centre at birth"),
    Variable("lat", "degrees_north", "latitude of its centre at birth"),
    Variable("elements", "1", "number of its elements at birth", dtype="i8", limits=(0, LARGEST_WHOLE)),
    Variable("area", "m2", "plan area at birth", limits=(0.0, LARGEST)),
    Variable("mass", "kg", "mass at birth"),
    Variable("bonds_broken", "1", "bonds that broke to set it free", dtype="i8", limits=(0, LARGEST_WHOLE)),
    Variable("grounded", "1", "1 where it broke off aground", dtype="i8"),
    Variable("name", "", "name: of a berg, or of a berg with the number of its fragment", dtype="str"),
    Variable(
        "calved_from", "1", "number of the berg from whose edge it calved (footloose), 0 for all others", dtype="i8"
    ),
)
"""Family tree of the fragments, each written as ``fragment_<name>``."""

CONTACT_VARIABLES: Final = (
    Variable("first", "1", "number of the one berg or fragment", dtype="i8", limits=(1, LARGEST_WHOLE)),
    Variable("second", "1", "number of the other", dtype="i8", limits=(1, LARGEST_WHOLE)),
    Variable("time", "s", "start of the long step in which they first touched"),
    Variable("end", "s", "end of the long step in which they last touched"),
    Variable("lon", "degrees_east", "longitude where they first touched"),
    Variable("lat", "degrees_north", "latitude where they first touched"),
    Variable("speed", "m s-1", "relative speed before they touched", limits=(0.0, LARGEST)),
)
"""Collisions of bergs, each written as ``contact_<name>``."""

GROUNDING_VARIABLES: Final = (
    Variable("number", "1", "number of the berg or fragment", dtype="i8", limits=(1, LARGEST_WHOLE)),
    Variable("time", "s", "start of the long step in which it touched the sea floor first"),
    Variable("end", "s", "end of the last long step at whose end the sea floor carried it"),
    Variable("lon", "degrees_east", "longitude where the sea floor carried it first"),
    Variable("lat", "degrees_north", "latitude where the sea floor carried it first"),
    Variable(
        "towards",
        "degrees",
        "direction of that from its centre, clockwise from north; -1 for its middle",
        limits=(-1.0, 360.0),
    ),
    Variable("elements", "1", "elements that touched first", dtype="i8", limits=(0, LARGEST_WHOLE)),
    Variable("times", "1", "how often it touched", dtype="i8", limits=(1, LARGEST_WHOLE)),
    Variable("seconds", "s", "time on the sea floor", limits=(0.0, LARGEST)),
    Variable("carried", "1", "elements that the sea floor carried last", dtype="i8", limits=(0, LARGEST_WHOLE)),
    Variable("load", "N", "weight that the sea floor carried last", limits=(0.0, LARGEST)),
    Variable("capacity", "N", "friction that could hold it last; 0 for the laws of drag", limits=(0.0, LARGEST)),
    Variable("pressing", "N", "force of all else on it in the last of these steps", limits=(0.0, LARGEST)),
    Variable("lift", "m", "largest rise of its keel", limits=(0.0, LARGEST)),
    Variable("stress", "Pa", "largest bending stress of the ice that the sea floor lifts", limits=(0.0, LARGEST)),
    Variable("gouge", "m", "how deep it has pressed a bed that yields, at most", limits=(0.0, LARGEST)),
    Variable(
        "way",
        "m",
        "way of its centre on the sea floor, with that before the touch in the first step",
        limits=(0.0, LARGEST),
    ),
    Variable("stopped", "m", "the same when it first came to rest; -1 where it never did", limits=(-1.0, LARGEST)),
    Variable(
        "held",
        "s",
        "since when it has stood still, from the start of the run; -1 while it slides",
        limits=(-1.0, LARGEST),
    ),
    Variable("level", "m", "sea level above the zero of the depth, where and when it touched first"),
)
"""Stays of bergs and fragments on the sea floor, each written as ``grounding_<name>``."""

RIFT_TIP_VARIABLES: Final = (
    Variable("crack", "1", "number of the rift, 0 where the tip stands no more", dtype="i8", limits=(0, LARGEST_WHOLE)),
    Variable("lon", "degrees_east", "longitude of the tip"),
    Variable("lat", "degrees_north", "latitude of the tip"),
    Variable("length", "m", "length of the rift", limits=(0.0, LARGEST)),
    Variable("spacing", "m", "distance of the elements beside the tip", limits=(0.0, LARGEST)),
    Variable(
        "opening", "Pa m1/2", "stress intensity K_I; NaN where the rift is too short, or too near to others, to say"
    ),
    Variable("shearing", "Pa m1/2", "stress intensity K_II"),
    Variable("largest", "Pa m1/2", "largest stress intensity by hoop stress since the tip came to stand there"),
)
"""Standing tips of the rifts that were there from the start, as the last step left them, each written as ``rift_tip_<name>``."""

TABLES: Final = (
    ("fragment", FRAGMENT_VARIABLES), ("contact", CONTACT_VARIABLES), ("grounding", GROUNDING_VARIABLES),
    ("rift_tip", RIFT_TIP_VARIABLES),
)  # fmt: skip
"""Tables of a run file, with a dimension each."""


IN_FILE: Final = {"u_sync": "u", "v_sync": "v", "sides": "corners", "first": "bond_first", "second": "bond_second"}
"""Names in a run file of variables that the state of the model, which has a ``u`` of each stage of a step, calls otherwise."""


def in_file(name: str) -> str:
    """Return how a variable of the state is called in the run file; positions apart."""
    return IN_FILE.get(name, name)


def position_names(latlon: bool) -> dict[str, str]:
    """Return how the positions are called in the file: ``lon`` and ``lat``, or ``x`` and ``y`` in metres."""
    return {} if latlon else {"lon": "x", "lat": "y"}


@cache
def element_history() -> tuple[Variable, ...]:
    """Return the variables of the elements that every record holds, from the registry, by their names in the file."""
    return tuple(
        replace(v, name=in_file(v.name)) for v in ELEMENT_VARIABLES if v.output and v.name not in ("id", *SHAPE)
    )


def variable_dimensions() -> dict[str, tuple[str, ...]]:
    """Return the dimensions of every variable of a run file that stands in a registry; positions may be called x and y."""
    dims: dict[str, tuple[str, ...]] = {v.name: ("trajectory", "time") for v in element_history()}
    dims |= {"x": ("trajectory", "time"), "y": ("trajectory", "time")}
    dims |= dict.fromkeys(map(in_file, SHAPE), ("trajectory",)) | dict.fromkeys(map(in_file, BOND_LATEST), ("bond",))
    dims |= dict.fromkeys((*BOND_HISTORY, "damage"), ("bond", "time"))
    for table, variables in TABLES:
        dims |= {f"{table}_{v.name}": (table,) for v in variables}
    return {"time": ("time",), **dims, "fragment_melt_water": ("fragment", "process")}


class Layout:
    """Rows of a run file: all elements and bonds that the run has had, in order of birth."""

    def __init__(self) -> None:
        self.ids: Ints = np.zeros(0, np.int64)
        self.bond_ids: Ints = np.zeros(0, np.int64)
        self.gaps = self.outgrown = False
        self.moving: list[str] = []
        self.shape: dict[str, Floats] = {}
        self.latest: dict[str, NDArray[Any]] = {}
        self._begun = False

    def written(self) -> None:
        """Take note that a file has been laid out like this."""
        self.outgrown = False

    def taken_up(
        self, shape: dict[str, Floats], latest: dict[str, NDArray[Any]], *, gaps: bool, moving: list[str]
    ) -> None:
        """Take up the rows (``ids``, ``bond_ids``) of a file that goes on, with its data of them."""
        self.shape, self.latest, self.gaps, self.moving, self._begun = shape, latest, gaps, moving, True

    def follow(self, elements: Elements, bonds: Bonds, shape: Sequence[str], latest: Sequence[str]) -> None:
        """Take in the elements and bonds of a record, and see whether their shape has changed."""
        same = np.array_equal(elements.id, self.ids) and np.array_equal(bonds.id, self.bond_ids)
        if not same:
            self.gaps = self.gaps or self._begun
            self._add(elements, bonds, shape)
        row = slice(None) if same else _locate_rows(elements.id, self.ids)
        for name in shape:
            if name not in self.moving and not np.array_equal(self.shape[name][row], getattr(elements, name)):
                self.moving.append(name)
                self.outgrown = True
        if not same:
            self.refresh(elements, bonds, latest)
        self._begun = True

    def _add(self, elements: Elements, bonds: Bonds, shape: Sequence[str]) -> None:
        born, formed = ~np.isin(elements.id, self.ids), ~np.isin(bonds.id, self.bond_ids)
        self.ids = np.concatenate([self.ids, elements.id[born]])
        self.bond_ids = np.concatenate([self.bond_ids, bonds.id[formed]])
        for name in shape:
            self.shape[name] = np.concatenate([self.shape.get(name, np.zeros(0)), getattr(elements, name)[born]])
        self.outgrown = True

    def refresh(self, elements: Elements, bonds: Bonds, names: Sequence[str]) -> None:
        """Take the present state of the bonds; of those that are no more, the last known one is kept."""
        row, end = _locate_rows(bonds.id, self.bond_ids), _locate_rows(elements.id, self.ids)
        is_stored = row < self.bond_ids.size
        for name in names:
            values = getattr(bonds, name)
            table = np.zeros(self.bond_ids.size, values.dtype)
            previous = self.latest.get(name, table[:0])
            table[: previous.size] = previous
            if name == "status":
                table[: previous.size] = GONE
            table[row[is_stored]] = (end[values] if name in ("first", "second") else values)[is_stored]
            self.latest[name] = table


def _locate_rows(ids: Ints, rows: Ints) -> Ints:
    """Return the rows in which identifiers stand; one behind the last where they do not."""
    if np.array_equal(ids, rows):
        return np.arange(rows.size)
    row, present = find_rows(rows, ids)
    return np.where(present, row, rows.size).astype(np.int64)


def reorder(ids: Ints, values: NDArray[Any], rows: Ints, missing: float) -> NDArray[Any]:
    """Return values by the rows of other identifiers; ``missing`` where there is no value."""
    if ids is rows or np.array_equal(ids, rows):
        return values
    row = _locate_rows(ids, rows)
    column = np.full(rows.size, missing, values.dtype)
    column[row[row < rows.size]] = values[row < rows.size]
    return column


def label_fragment(number: int, parent: int, name: str = "") -> str:
    """Return a berg or fragment in words: its name, or its number."""
    return name or f"{'fragment' if parent > 0 else 'berg'} {number}"


def time_units(start: Any) -> dict[str, str]:
    """Return units and calendar of times that count from a date."""
    moment = np.datetime_as_string(np.datetime64(start, "s")).replace("T", " ")
    return {"units": f"seconds since {moment}", "calendar": "proleptic_gregorian"}


HUTH_2022 = (
    "Huth, A., Adcroft, A., Sergienko, O. and Khan, N. (2022): Ocean currents break up a tabular iceberg. "
    "Science Advances 8, eabq6974. https://doi.org/10.1126/sciadv.abq6974"
)
"""The model that Riftberg implements."""

LIBRARIES = ("numpy", "numba", "xarray", "netCDF4", "pydantic")


def forcing_title(forcing: Forcing) -> str:
    """Return the short name of the forcing for titles: its ``title``, else the first line of its description."""
    return str(forcing.title).strip() or next(
        (line.strip() for line in forcing.describe().splitlines() if line.strip()), ""
    )


def run_heading(run: xr.Dataset, otherwise: str = "Iceberg") -> str:
    """Return a run in titles: the heading of its experiment, else the name."""
    return str(run.attrs.get("heading") or run.attrs.get("experiment") or otherwise)


def citations(model: BareModel) -> list[str]:
    """Return the works to cite for this run: the model, and the data products that the forcing names."""
    return [HUTH_2022, *(str(text) for text in model.forcing.citations)]


COMMAND, FILE, PLACE = "command", "experiment_file", "data_folder"
"""Attributes of a run from the command line: this, the text of the experiment file, and where data files are, from the run."""


def run_attributes(model: BareModel, *, experiment: str = "", seed: int | None = None) -> dict[str, Any]:
    """Return global attributes that let another person understand and repeat the run."""
    timestamp = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    # The versions of Riftberg, Python and the libraries that decide on numbers.
    versions = {"riftberg": __version__, "python": platform.python_version()}
    for name in LIBRARIES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "unknown"
    return {
        "title": f"Drift and break-up of bonded icebergs: {experiment or 'run'}",
        "experiment": experiment,
        "source": f"Riftberg {__version__}",
        "history": f"{timestamp} written by Riftberg {__version__}",
        "date_created": timestamp,
        "references": "\n".join(citations(model)),
        "start": model.start.isoformat(),
        "forcing": model.forcing.describe(),
        "forcing_title": "" if model.parameters.stepping.only_interactions else forcing_title(model.forcing),
        **({"sea_level": level} if (level := model.sea_level_notice) else {}),
        **({"laws": laws} if (laws := model.laws.named()) else {}),
        "parameters": model.parameters.describe(),
        "parameters_json": model.parameters.model_dump_json(),
        "versions_json": json.dumps(versions),
        "seed": "none" if seed is None else str(seed),
    }


# ---- checks of a file ----------------------------------------------------------------------------------------------------

RUN_REMEDY: Final = "Name a run.nc, or the folder that 'riftberg run' made"

NEEDED: Final = (
    "time", "trajectory", *SHAPE[:3], "thickness", "rotation", "u", "v", "spin", "depth", "berg",
    "bond_first", "bond_second", "status", "strength", "break_time", "break_grounded", "normal_stress", "shear_stress",
    *(f"fragment_{name}" for name in ("number", "parent", "birth_time", "elements", "area", "bonds_broken", "grounded")),
)  # fmt: skip
"""Variables of a run file that every reader may use; positions besides. Variables added later may be missing."""

_DATES: Final = ("time", "break_time", "fragment_birth_time")
_DATES_OF_EVENTS: Final = ("contact_time", "contact_end", "grounding_time", "grounding_end")
_TEXTS: Final = ("fragment_name",)
_SHAPE_IN_FILE: Final = ("char_dim_name", "original_shape")
"""Notes of xarray on a text in a file, of which it warns where a part of the run is written to another file."""
_CHECKED: Final = (
    "rotation", "u", "v", "spin", "length", "width", "mass", "thickness", "corners", "status",
)  # fmt: skip
"""Variables of elements and bonds whose values are read when a run file is opened, with all of fragments and collisions."""

_ENTRIES: Final = {"trajectory": "element", "time": "record", "contact": "collision"}
"""Names of the entries along the dimensions of a run file, where they differ."""


def open_checked(file: Path, *, trusted: bool = False) -> xr.Dataset:
    """Open a run file and check it; whatever is wrong is said in one sentence.

    ``trusted``: this process has written it, and its values, which the model has checked, are not read for that again.
    """
    check_file(file, remedy=RUN_REMEDY)
    with reading(file, "not a NetCDF file, or a damaged one", RUN_REMEDY):
        dataset = open_lazily(file, engine="netcdf4", lock=NETCDF, decode_times=False)  # never xarray's own lock
    try:
        with reading(file, "a damaged run file", "Make the run again, or name another run.nc"):
            _check_layout(dataset, file)
            run_parameters(dataset, file)
            read_start(dataset.attrs.get("start"), file)
            decoded = _decode_dates(dataset, file)
            if not trusted:
                _check_values(decoded, file)
            return decoded
    except BaseException:
        dataset.close()
        raise


def _error(
    problem: str, file: Path, location: str = "", remedy: str = "Make the run again, or name another run.nc"
) -> InputError:
    return InputError(problem, where=f"{shown(file)}, {location}" if location else shown(file), remedy=remedy)


def _check_layout(run: xr.Dataset, file: Path) -> None:
    """Check kind, dimensions, variables and their types."""
    if "trajectory" not in run.dims or run.attrs.get("featureType") != "trajectory":
        raise _error("not the trajectory file of a run of Riftberg", file, remedy=RUN_REMEDY)
    if "parameters_json" not in run.attrs or "bond" not in run.dims:
        raise _error(
            "a trajectory file, but not of Riftberg: it has no elements, bonds and parameters", file, remedy=RUN_REMEDY
        )
    coordinates = ("lon", "lat") if "lon" in run.variables else ("x", "y")
    for name in (*coordinates, *NEEDED):
        if name not in run.variables:
            raise _error(f"variable {name} is missing", file)
    for name, dims in variable_dimensions().items():
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


def run_parameters(run: xr.Dataset, file: Path | None = None) -> Parameters:
    """Return the parameters of a run file, or say that its attribute is none."""
    return read_parameters(run.attrs.get("parameters_json"), file or Path(str(run.encoding.get("source", "run"))))


def read_parameters(text: Any, file: Path, *, goes_on: bool = False) -> Parameters:
    """Return parameters from the attribute ``parameters_json`` of a file.

    ``goes_on``: a run goes on with them; else they describe it, and keys of earlier versions are left out.
    """
    location = "attribute parameters_json"
    if not isinstance(text, str):
        raise _error("missing, or no text", file, location)
    try:
        values = json.loads(text)
        return from_file(values, goes_on=goes_on)
    except json.JSONDecodeError as error:
        raise _error("no JSON of parameters", file, location) from error
    except (InputError, ValidationError) as error:
        fault = error if isinstance(error, InputError) else explained(error, Parameters)
        problem = f"{fault.where}: {fault.what[:400]}" if fault.where else fault.what[:400]
        raise _error(
            f"no parameters of Riftberg ({problem})", file, location,
            f"{fault.remedy + '. ' if goes_on and fault.remedy else ''}"
            "The file is damaged, or was written by another version of Riftberg",
        ) from error  # fmt: skip


def read_start(text: Any, file: Path) -> datetime:
    """Return a date from the attribute ``start`` of a file."""
    try:
        start = datetime.fromisoformat(text)
    except (TypeError, ValueError) as error:
        raise _error(f"{value_shown(text)} is no date", file, "attribute start") from error
    if start.tzinfo is not None:
        raise _error(f"{text} has a time zone", file, "attribute start", "Dates of run files are UTC, without a zone")
    return start


def _decode_dates(run: xr.Dataset, file: Path) -> xr.Dataset:
    """Return the run with decoded dates."""
    dates = (*_DATES, *(name for name in _DATES_OF_EVENTS if name in run.variables))
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
    latlon = run_parameters(run, file).earth.latlon
    if latlon != ("lon" in run.variables):
        raise _error("positions and the parameter earth.latlon do not agree", file)
    for name, rule in _rules_in_file(latlon).items():
        if name in run.variables:
            _check_rule(run, rule, file)
    ends = run["bond_first"].values, run["bond_second"].values
    check_bond_ends(*ends, run.sizes["trajectory"], file, "variable bond_first, bond_second")
    if "corners" in run and not np.isin(np.nan_to_num(run["corners"].values), (0, 4, 6)).all():  # 0: not known
        raise _error("an element has 4 or 6 corners", file, "variable corners")
    dated = ("fragment_birth_time", "a fragment"), ("contact_time", "a collision"), ("grounding_time", "a grounding")
    for name, subject in dated:
        if name in run.variables and np.isnat(run[name].values).any():
            raise _error(f"{subject} without a time", file, f"variable {name}")
    number, parent = run["fragment_number"].values, run["fragment_parent"].values
    location = "variable fragment_number, fragment_parent"
    if len(np.unique(number)) < len(number):
        raise _error("two fragments have the same number", file, location)
    has_parent = np.isin(parent, (0, *number)) & (parent != number)
    if not has_parent.all():
        k = int(np.argmin(has_parent))
        raise _error(f"fragment {number[k]} broke off {parent[k]}, which is not in the file", file, location)


def _rules_in_file(latlon: bool) -> dict[str, Rule]:
    """Return the rules for the variables that are checked in a run file, by name, from the registries."""
    position_limits = {"lon": 1e4, "lat": 90.0} if latlon else dict.fromkeys(("x", "y"), 1e12)
    rules = [Rule.between(name, -most, most) for name, most in position_limits.items()]
    states = [v for v in (*ELEMENT_VARIABLES, *BOND_VARIABLES) if in_file(v.name) in _CHECKED]
    for table, variables in (("", states), *TABLES):
        for v in variables:
            if not table or v.limits != (-LARGEST, LARGEST):
                name = f"{table}_{v.name}" if table else in_file(v.name)
                rules.append(Rule.between(name, v.limits[0], float(v.limits[1]), whole=v.dtype == "i8"))
    rules.append(Rule.between("berg", 1, LARGEST_WHOLE, whole=True))
    return {rule.variable: rule for rule in rules}


def _check_rule(run: xr.Dataset, rule: Rule, file: Path) -> None:
    """Refuse NaN, infinite and impossible values; names element and record."""
    name = rule.variable
    # Elements that are not there yet, or no more, have no values, but none of theirs is impossible.
    absent = _absent(run, name, run[name].values.shape)
    present = rule._replace(test=lambda values: rule.test(values) | (np.isnan(values) & absent))
    if breach := find_breach([present], lambda name: run[name].values):
        entry = ", ".join(
            f"{_ENTRIES.get(str(dim), dim)} {k + 1}" for dim, k in zip(run[name].dims, breach.index, strict=False)
        )
        raise _error(f"{name} is {breach.value:g}, not {rule.allowed}", file, f"variable {name}, {entry}")


def _absent(run: xr.Dataset, name: str, shape: tuple[int, ...]) -> Any:
    """Return where elements are not there, in runs in which they come and go: such records hold no fragment either."""
    berg = run["berg"]
    if berg.dtype.kind != "f" or set(run[name].dims) != set(berg.dims):
        return np.zeros(shape, dtype=bool)
    return np.isnan(berg.transpose(*run[name].dims).values)


def check_bond_ends(first: Any, second: Any, elements: int, file: Path, location: str) -> None:
    """Refuse bonds that join no two elements of the run."""
    bad = (first < 0) | (second < 0) | (first >= elements) | (second >= elements) | (first == second)
    if bad.any():
        k = int(np.argmax(bad))
        raise _error(
            f"bond {k + 1} joins rows {first[k]:g} and {second[k]:g}, but the elements have rows 0 to {elements - 1}",
            file, location,
        )  # fmt: skip
    if first.dtype.kind == "f" and not ((first == np.floor(first)).all() and (second == np.floor(second)).all()):
        raise _error("rows of elements are whole numbers", file, location)
    low, high = np.minimum(first, second).astype(np.int64), np.maximum(first, second).astype(np.int64)
    pairs, counts = np.unique(low * elements + high, return_counts=True)
    if (counts > 1).any():
        pair = int(pairs[np.argmax(counts > 1)])
        raise _error(f"two bonds join rows {pair // elements} and {pair % elements}", file, location)


def check_recorded(run: xr.Dataset, names: tuple[str, ...]) -> None:
    """Refuse a run whose recorded surroundings are missing or no numbers, for those who compute forces from them."""
    file = Path(str(run.encoding.get("source", "run")))
    for name in names:
        if name not in run.variables:
            raise _error(f"variable {name} is missing", file)
        _check_rule(run, Rule.between(name, -LARGEST, LARGEST), file)
