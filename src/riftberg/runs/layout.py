"""What a run file holds, and which of its rows belongs to which element and bond, also when elements come and go."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any, Final

import netCDF4
import numpy as np
from numpy.typing import NDArray

from riftberg.state import ELEMENT_VARIABLES, Bonds, Elements, Floats, Ints, Variable
from riftberg.state.population import rows_of
from riftberg.state.variables import GONE, LARGEST, LARGEST_WHOLE
from riftberg.version import __version__

if TYPE_CHECKING:
    from riftberg.model import BareModel


LENGTH = 96
"""Bytes of a text; a longer one is cut."""


def define_texts(file: netCDF4.Dataset, name: str, dimension: str) -> netCDF4.Variable[Any]:
    """Create a variable of texts along a dimension; xarray and netCDF4 read it as texts."""
    if "text" not in file.dimensions:
        file.createDimension("text", LENGTH)
    variable = file.createVariable(name, "S1", (dimension, "text"))
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


IN_FILE: Final = {"u_sync": "u", "v_sync": "v", "sides": "corners", "first": "bond_first", "second": "bond_second"}
"""Names in a run file of what the state of the model, which has a ``u`` of each stage of a step, calls otherwise."""


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


def dimensions_of_variables() -> dict[str, tuple[str, ...]]:
    """Return the dimensions of every variable of a run file that stands in a registry; positions may be called x and y."""
    dims: dict[str, tuple[str, ...]] = {v.name: ("trajectory", "time") for v in element_history()}
    dims |= {"x": ("trajectory", "time"), "y": ("trajectory", "time")}
    dims |= dict.fromkeys(map(in_file, SHAPE), ("trajectory",)) | dict.fromkeys(map(in_file, BOND_LATEST), ("bond",))
    dims |= dict.fromkeys((*BOND_HISTORY, "damage"), ("bond", "time"))
    for table, variables in (("fragment", FRAGMENT_VARIABLES), ("contact", CONTACT_VARIABLES)):
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
        """Take up the rows (``ids``, ``bond_ids``) of a file that goes on, with what it knows of them."""
        self.shape, self.latest, self.gaps, self.moving, self._begun = shape, latest, gaps, moving, True

    def follow(self, elements: Elements, bonds: Bonds, shape: Sequence[str], latest: Sequence[str]) -> None:
        """Take in the elements and bonds of a record, and see whether their shape has changed."""
        same = np.array_equal(elements.id, self.ids) and np.array_equal(bonds.id, self.bond_ids)
        if not same:
            self.gaps = self.gaps or self._begun
            self._add(elements, bonds, shape)
        row = slice(None) if same else _rows_of(elements.id, self.ids)
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
        row, end = _rows_of(bonds.id, self.bond_ids), _rows_of(elements.id, self.ids)
        known = row < self.bond_ids.size
        for name in names:
            values = getattr(bonds, name)
            table = np.zeros(self.bond_ids.size, values.dtype)
            before = self.latest.get(name, table[:0])
            table[: before.size] = before
            if name == "status":
                table[: before.size] = GONE
            table[row[known]] = (end[values] if name in ("first", "second") else values)[known]
            self.latest[name] = table


def _rows_of(ids: Ints, rows: Ints) -> Ints:
    """Return the rows in which identifiers stand; one behind the last where they do not."""
    if np.array_equal(ids, rows):
        return np.arange(rows.size)
    row, there = rows_of(rows, ids)
    return np.where(there, row, rows.size).astype(np.int64)


def placed(ids: Ints, values: NDArray[Any], rows: Ints, missing: float) -> NDArray[Any]:
    """Return values by the rows of other identifiers; ``missing`` where there is no value."""
    if ids is rows or np.array_equal(ids, rows):
        return values
    row = _rows_of(ids, rows)
    column = np.full(rows.size, missing, values.dtype)
    column[row[row < rows.size]] = values[row < rows.size]
    return column


def called(number: int, parent: int, name: str = "") -> str:
    """Return what a berg or fragment is called: by its name, or by its number."""
    return name or f"{'fragment' if parent > 0 else 'berg'} {number}"


HUTH_2022 = (
    "Huth, A., Adcroft, A., Sergienko, O. and Khan, N. (2022): Ocean currents break up a tabular iceberg. "
    "Science Advances 8, eabq6974. https://doi.org/10.1126/sciadv.abq6974"
)
"""The model that Riftberg implements."""

LIBRARIES = ("numpy", "numba", "xarray", "netCDF4", "pydantic")


def library_versions() -> dict[str, str]:
    """Return the versions of Riftberg, Python and the libraries that decide on numbers."""
    versions = {"riftberg": __version__, "python": platform.python_version()}
    for name in LIBRARIES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "unknown"
    return versions


def forcing_text(forcing: Any) -> str:
    """Return what the forcing says of itself, or nothing where it is silent."""
    describe = getattr(forcing, "describe", None)
    return str(describe()) if callable(describe) else ""


def forcing_title(forcing: Any) -> str:
    """Return the short name of the forcing for titles: its ``title``, else the first line of its description."""
    title = getattr(forcing, "title", "")
    text = str(title() if callable(title) else title).strip()
    return text or next((line.strip() for line in forcing_text(forcing).splitlines() if line.strip()), "")


def citations(model: BareModel) -> list[str]:
    """Return the works to cite for this run: the model, and the data products that the forcing names."""
    return [HUTH_2022, *(str(text) for text in getattr(model.forcing, "citations", ()))]


COMMAND, FILE, PLACE = "command", "experiment_file", "data_folder"
"""Attributes of a run from the command line: this, the text of the experiment file, and where data files are, from the run."""


def run_attributes(model: BareModel, *, experiment: str = "", seed: int | None = None) -> dict[str, Any]:
    """Return global attributes that let another person understand and repeat the run."""
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return {
        "title": f"Drift and break-up of bonded icebergs: {experiment or 'run'}",
        "experiment": experiment,
        "source": f"Riftberg {__version__}",
        "history": f"{now} written by Riftberg {__version__}",
        "date_created": now,
        "references": "\n".join(citations(model)),
        "start": model.start.isoformat(),
        "forcing": forcing_text(model.forcing),
        "forcing_title": forcing_title(model.forcing),
        **({"laws": laws} if (laws := model.laws.named()) else {}),
        "parameters": model.parameters.describe(),
        "parameters_json": model.parameters.model_dump_json(),
        "versions_json": json.dumps(library_versions()),
        "seed": "none" if seed is None else str(seed),
    }
