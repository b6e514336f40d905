"""Dimensions and variables of a run file: which there are, how each is stored and described."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final

import netCDF4
import numpy as np

from riftberg.parameters import QuasiStaticParameters
from riftberg.runs.derived import define_ledgers
from riftberg.runs.layout import (
    BOND_HISTORY,
    BOND_LATEST,
    SHAPE,
    TABLES,
    Layout,
    define_texts,
    element_history,
    in_file,
    time_units,
)
from riftberg.runs.tracks import GOES_ON, ON_BED, is_channel
from riftberg.state import BOND_VARIABLES, ELEMENT_VARIABLES, Variable

if TYPE_CHECKING:
    from riftberg.model import BareModel

DOUBLE: Final = frozenset({"lon", "lat", "rotation"})
"""Variables kept in double precision at every record; the others are stored in single precision."""

MISSING: Final = -1
"""Value of whole numbers where an element is not there."""

REGISTRY: Final = {v.name: v for v in ELEMENT_VARIABLES}
"""Variables of the elements by name."""

VALUES_PER_CHUNK: Final = 2048

COLUMNS: Final[dict[str, Any]] = {"i8": "i4", "str": str}
"""How columns of tables are stored, by the kind of their variable."""


def histories(model: BareModel) -> list[Variable]:
    """Return the variables of the elements that every record of this run holds."""
    return [v for v in element_history() if v.name not in ON_BED or model.parameters.grounding.law == "seabed"]


def bond_history(model: BareModel) -> tuple[str, ...]:
    """Return the variables of the bonds that every record of this run holds."""
    p = model.parameters
    return (*BOND_HISTORY, "damage") if isinstance(p, QuasiStaticParameters) and p.damage.enabled else BOND_HISTORY


def define_run(file: netCDF4.Dataset, model: BareModel, names: dict[str, str], layout: Layout) -> None:
    """Create dimensions and variables, and write the constants."""
    file.setncatts({"Conventions": "CF-1.11", "featureType": "trajectory"})
    file.createDimension("trajectory", len(layout.ids))
    file.createDimension("time", None)
    file.createDimension("bond", len(layout.bond_ids))
    for kind, _ in TABLES:
        file.createDimension(kind, None)
    about = {"standard_name": "time", "long_name": "time", **time_units(model.start), "axis": "T"}
    create_variable(file, "time", "f8", ("time",), **about)
    # CF before 1.9 knows no 64-bit whole numbers; identifiers that need them are those of no run of ours.
    kind = "i4" if layout.ids.max(initial=0) <= np.iinfo(np.int32).max else "i8"
    number = create_variable(
        file, "trajectory", kind, ("trajectory",), cf_role="trajectory_id", long_name="identifier of the element"
    )
    number[:] = layout.ids
    for name in SHAPE:
        described = _variable_attributes(REGISTRY[name], names)
        if name in layout.moving:
            create_variable(
                file,
                in_file(name),
                "f8",
                ("trajectory", "time"),
                layout.gaps,
                **described,
                coordinates=_coordinates(names),
            )
        else:
            kind = "i4" if REGISTRY[name].dtype == "i8" else "f8"
            create_variable(file, in_file(name), kind, ("trajectory",), **described)[:] = layout.shape[name]
    define_histories(file, histories(model), names, layout)
    if is_channel(model.parameters):
        file[names.get("lon", "lon")].comment = GOES_ON
    registry = {v.name: v for v in BOND_VARIABLES}
    for name in BOND_LATEST:
        v = registry[name]
        attributes = _variable_attributes(v, {})
        if name == "break_time":
            attributes |= {**time_units(model.start), "long_name": "time of breaking, missing while unbroken"}
        if name == "status":
            attributes |= {"flag_meanings": "unbroken broken_in_contact gone"}
        stored = create_variable(file, in_file(name), "i4" if v.dtype == "i8" else "f8", ("bond",), **attributes)
        if name == "status":
            stored.flag_values = np.arange(3, dtype="i4")
    for name in bond_history(model):
        attributes = _variable_attributes(registry[name], {})
        if name == "peak_stress":
            attributes["long_name"] = "largest normal_stress of any sub-step since the record before"
        create_variable(file, name, "f4", ("bond", "time"), layout.gaps, **attributes)
    for kind, variables in TABLES:
        for v in variables:
            attributes = {**_variable_attributes(v, names), "long_name": v.long_name}
            attributes.pop("axis", None)
            if v.name in ("lon", "lat") and not names:
                attributes["standard_name"] = {"lon": "longitude", "lat": "latitude"}[v.name]
            if v.name in ("birth_time", "time", "end"):
                attributes |= time_units(model.start)
            name = f"{kind}_{names.get(v.name, v.name)}"
            if v.dtype == "str":
                define_texts(file, name, kind).setncatts(
                    {key: value for key, value in attributes.items() if value != ""}
                )
                continue
            create_variable(file, name, COLUMNS.get(v.dtype, "f8"), (kind,), **attributes)
    define_ledgers(file, model)


def create_variable(
    file: netCDF4.Dataset, name: str, kind: Any, dims: tuple[str, ...], gaps: bool = False, /, **attributes: Any
) -> netCDF4.Variable[Any]:
    """Create a variable in chunks of many records; ``gaps``: elements come or go in the run, so that values may be missing."""
    packed = "time" in dims and len(dims) == 2
    chunks = None
    if packed:
        rows = max(1, file.dimensions[dims[0]].size)
        chunks = (rows, int(np.clip(VALUES_PER_CHUNK // rows, 1, 512)))
    # Light compression only: a run must not wait for its file. Stresses of bonds, a third of the work, lose but a sixth by it.
    light = {"compression": "zlib", "complevel": 1, "shuffle": True}
    options: dict[str, Any] = light if packed and dims[0] != "bond" else {}
    missing = (MISSING if kind == "i4" else np.nan) if gaps and packed else False
    variable = file.createVariable(name, kind, dims, chunksizes=chunks, fill_value=missing, fletcher32=True, **options)
    variable.setncatts({key: value for key, value in attributes.items() if value != ""})
    return variable


def _variable_attributes(v: Variable, names: dict[str, str]) -> dict[str, str]:
    """Attributes of a variable; positions on a Cartesian grid are metres."""
    if v.name in names:
        axis = names[v.name]
        attributes = {"units": "m", "standard_name": f"projection_{axis}_coordinate", "long_name": f"{axis} position"}
        return {**attributes, "axis": axis.upper()}
    return {"units": v.units, "long_name": v.long_name, "standard_name": v.standard_name}


def stored_kind(v: Variable) -> str:
    """Return the type in which a variable of the elements is stored at every record."""
    if v.dtype == "i8":
        return "i4"
    return "f8" if v.name in DOUBLE else "f4"


def _coordinates(names: dict[str, str]) -> str:
    return f"time {names.get('lat', 'lat')} {names.get('lon', 'lon')}"


def define_histories(
    file: netCDF4.Dataset, variables: Iterable[Variable], names: dict[str, str], layout: Layout
) -> None:
    """Create variables of the elements that every record holds."""
    where = _coordinates(names)
    for v in variables:
        coordinates = "" if v.name in ("lon", "lat") else where
        create_variable(
            file,
            names.get(v.name, v.name),
            stored_kind(v),
            ("trajectory", "time"),
            layout.gaps,
            **_variable_attributes(v, names),
            coordinates=coordinates,
        )
