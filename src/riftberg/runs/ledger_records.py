"""The ledger of melt in a run file: melt water and heat by process at every record, since the start of the run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import netCDF4
import numpy as np

from riftberg.life.ledger import PROCESSES, SOURCES
from riftberg.runs.texts import define_texts, texts
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
    "ice_gained": ("kg", "ice that came since the start other than by melt and freezing, negative where it went"),
    "ledger_error": ("1", "what is left over in the ledger of mass, as part of what it turns over"),
    "ledger_heat_error": ("1", "the same in the ledger of heat"),
}
"""Variables over times."""

Row = dict[str, Floats]


def ledger_row(model: BareModel) -> Row:
    """Return the numbers of one record; none where nothing melts."""
    if model.life is None:
        return {}
    balance = model.life.balance(model)
    return {
        "melt_water": np.array([balance.water[name] for name in PROCESSES]),
        "melt_heat": np.array([balance.heat[name] for name in PROCESSES]),
        "ice_mass": np.array([balance.now]),
        "ice_gained": np.array([sum(balance.gained[name] for name in SOURCES)]),
        "ledger_error": np.array([balance.error]),
        "ledger_heat_error": np.array([balance.heat_error]),
    }


def define_ledger(file: netCDF4.Dataset, model: BareModel) -> None:
    """Create the variables, where something melts."""
    if model.life is None:
        return
    file.createDimension("process", len(PROCESSES))
    file.createDimension("total", 1)
    names = define_texts(file, "process", "process")
    names[:] = texts(PROCESSES)
    names.long_name = "way in which ice becomes melt water"
    for table, dim in ((SERIES, "process"), (TOTALS, "total")):
        for name, (units, meaning) in table.items():
            variable = file.createVariable(name, "f8", (dim, "time"), fill_value=False)
            variable.setncatts({"units": units, "long_name": meaning})


def write_ledger(file: netCDF4.Dataset, rows: list[Row], block: slice) -> None:
    """Write the numbers of some records."""
    names: list[Any] = list(rows[0]) if rows else []
    for name in names:
        file[name][:, block] = np.stack([row[name] for row in rows], axis=1)
