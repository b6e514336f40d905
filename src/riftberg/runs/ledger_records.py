"""The ledgers in a run file, at every record since the start: momentum and energy by force; melt water and heat by process."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import netCDF4
import numpy as np

from riftberg.life.ledger import PROCESSES, SOURCES, melt_of
from riftberg.life.melt import mass_in_bits
from riftberg.life.motion import GIVERS
from riftberg.runs.layout import define_texts, texts
from riftberg.state import Floats

if TYPE_CHECKING:
    from riftberg.model import BareModel

SERIES: Final = {
    "melt_water": ("kg", "melt water since the start by process"),
    "melt_heat": (
        "J",
        "heat that melt water brought to the ocean since the start by process, negative as ice takes it",
    ),
}
"""Variables over processes and times."""

TOTALS: Final = {
    "ice_mass": ("kg", "ice in all bergs and bits"),
    "ice_in_bits": ("kg", "ice in bergy bits and footloose bits"),
    "ice_gained": ("kg", "ice that came since the start other than by melt and freezing, negative where it went"),
    "ledger_error": ("1", "what is left over in the ledger of mass, as part of what it turns over"),
    "ledger_heat_error": ("1", "the same in the ledger of heat"),
}
"""Variables over times."""

MOTION: Final = {
    "impulse_x": ("N s", "eastward momentum given to the bergs since the start, by force", "force"),
    "impulse_y": ("N s", "northward momentum given to the bergs since the start, by force", "force"),
    "work": ("J", "work done on the bergs since the start, by force", "force"),
    "momentum_x": ("N s", "eastward momentum of all bergs", "total"),
    "momentum_y": ("N s", "northward momentum of all bergs", "total"),
    "kinetic_energy": ("J", "kinetic energy of all bergs, with that of spin", "total"),
    "elastic_energy": ("J", "elastic energy in bonds; no value where their law does not vibrate", "total"),
    "dissipated_energy": ("J", "energy lost in dampers and contacts since the start; no value as above", "total"),
    "cracks_energy": ("J", "elastic energy that broken bonds have released since the start", "total"),
}
"""Variables over forces, or none, and times."""

FRAGMENT_MELT: Final = "fragment_melt_water"
"""Variable over fragments and processes."""

Row = dict[str, Floats]


def ledger_row(model: BareModel) -> Row:
    """Return the numbers of one record; of melt none where nothing melts."""
    motion = _motion_row(model) if _moves(model) else {}
    if model.life is None:
        return motion
    balance = model.life.balance(model)
    return {
        **motion,
        "melt_water": np.array([balance.water[name] for name in PROCESSES]),
        "melt_heat": np.array([balance.heat[name] for name in PROCESSES]),
        "ice_mass": np.array([balance.now]),
        "ice_in_bits": np.array([mass_in_bits(model.elements.life)]),
        "ice_gained": np.array([sum(balance.gained[name] for name in SOURCES)]),
        "ledger_error": np.array([balance.error]),
        "ledger_heat_error": np.array([balance.heat_error]),
    }


def _moves(model: BareModel) -> bool:
    """Whether a model keeps a ledger of motion; not all that may be written do."""
    return getattr(model, "motion", None) is not None


def _motion_row(model: BareModel) -> Row:
    b = model.motion.balance(model, model.remembered)
    totals = (
        *b.momentum_now, b.kinetic_now, np.nan if b.elastic_now is None else b.elastic_now,
        np.nan if b.dissipated is None else b.dissipated, b.released,
    )  # fmt: skip
    impulse = np.array([b.impulse[name] for name in GIVERS])
    by_force = (impulse[:, 0], impulse[:, 1], np.array([b.work[name] for name in GIVERS]))
    return dict(zip(MOTION, (*by_force, *(np.array([value]) for value in totals)), strict=True))


def define_ledger(file: netCDF4.Dataset, model: BareModel) -> None:
    """Create the variables; those of melt where something melts."""
    if _moves(model) or model.life is not None:
        file.createDimension("total", 1)
    if _moves(model):
        _define_motion(file)
    if model.life is None:
        return
    file.createDimension("process", len(PROCESSES))
    names = define_texts(file, "process", "process")
    names[:] = texts(PROCESSES)
    names.long_name = "way in which ice becomes melt water"
    for table, dim in ((SERIES, "process"), (TOTALS, "total")):
        for name, (units, meaning) in table.items():
            variable = file.createVariable(name, "f8", (dim, "time"), fill_value=False)
            variable.setncatts({"units": units, "long_name": meaning})
    by_fragment = file.createVariable(FRAGMENT_MELT, "f8", ("fragment", "process"), fill_value=np.nan)
    by_fragment.setncatts(
        {"units": "kg", "long_name": "melt water of elements while they belonged to the fragment, by process"}
    )


def write_fragment_melt(file: netCDF4.Dataset, model: BareModel) -> None:
    """Write the melt water of all fragments so far, where something melts."""
    if getattr(model, "life", None) is not None and len(model.fragments.rows):
        numbers = np.array([row.number for row in model.fragments.rows], np.int64)
        file[FRAGMENT_MELT][: numbers.size] = melt_of(model.remembered, numbers)


def _define_motion(file: netCDF4.Dataset) -> None:
    file.createDimension("force", len(GIVERS))
    names = define_texts(file, "force", "force")
    names[:] = texts(GIVERS)
    names.long_name = (
        "what gives momentum and energy: forces from outside, elements to each other, melt and births, others"
    )
    for name, (units, meaning, dim) in MOTION.items():
        variable = file.createVariable(name, "f8", (dim, "time"), fill_value=False)
        variable.setncatts({"units": units, "long_name": meaning})


def write_ledger(file: netCDF4.Dataset, rows: list[Row], block: slice) -> None:
    """Write the numbers of some records."""
    names: list[Any] = list(rows[0]) if rows else []
    for name in names:
        file[name][:, block] = np.stack([row[name] for row in rows], axis=1)
