"""What an exchange takes from the ocean: fields that are checked, put on its grid and handed to the bergs."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from riftberg.coupling.fields import TAKEN, OceanForcing, taken
from riftberg.errors import ForcingError, InputError
from riftberg.model import BareModel
from riftberg.ocean.cells import CORNER_FIELDS, Fields
from riftberg.ocean.grid import Staggering, at_corners, wind_from_stress
from riftberg.ocean.needs import find_missing_water
from riftberg.state import Floats

_LOG = logging.getLogger(__name__)


class OceanIntake:
    """Fields from the ocean.

    ``staggering``, ``wind_staggering``: as for `Exchange`; ``handed``: which fields a run had before its restart, 1 or 0 for each
    name of `Fields`.
    """

    def __init__(
        self,
        model: BareModel,
        forcing: OceanForcing,
        staggering: Staggering,
        wind_staggering: Staggering,
        handed: Floats,
    ) -> None:
        self.model, self.forcing, self.grid = model, forcing, forcing.ocean_grid
        self._staggering: Staggering = staggering
        self._wind_staggering: Staggering = wind_staggering
        self.handed = handed

    def note_handed(self, arrays: Mapping[str, Floats]) -> None:
        """Note which fields have been handed over: after a restart they are needed at once."""
        self.handed[[name in arrays for name in Fields._fields]] = 1.0

    def read(self, given: Mapping[str, Any] | xr.Dataset) -> dict[str, Floats]:
        """Return the fields that are handed over, by their names in the exchange, or refuse them."""
        items = {str(k): v for k, v in given.items()}
        if isinstance(given, xr.Dataset):
            items = {str(v.attrs.get("standard_name", k)): v for k, v in given.items()}
        g = self.grid.arrays
        cell = ((g.nj, g.ni), (g.nj + 2, g.ni + 2))
        corner = (*cell, (g.nj + 1, g.ni + 1))
        # Vectors may come with one more row and column: their corners.
        wide = {*CORNER_FIELDS, "taux", "tauy"}
        shapes: dict[str, tuple[tuple[int, int], ...]]
        shapes = {q.field: corner if q.field in wide else cell for q in TAKEN.values()}
        shapes |= {"calving": cell[:1], "calving_heat": cell[:1]}  # ice calves into cells of the ocean only
        arrays = taken(items, shapes, g.mask[self.grid.domain])
        for lacking, field in find_missing_water(self.model.parameters, arrays).items():
            name = next(name for name, q in TAKEN.items() if q.field == field)
            raise ForcingError(
                f"no {name}, but bergs melt", where="exchange",
                remedy=f"Hand it over, give melt.{lacking} as a number, or set melt.enabled = false",
            )  # fmt: skip
        for pair in (("uo", "vo"), ("ui", "vi"), ("ua", "va"), ("taux", "tauy")):
            if (pair[0] in arrays) != (pair[1] in arrays):
                raise InputError(
                    f"one of {pair[0]} and {pair[1]} alone", where="exchange", remedy="Hand over both parts"
                )
        if "taux" in arrays and "ua" in arrays:
            raise InputError("wind and its stress", where="exchange", remedy="Hand over one of them")
        return arrays

    def deliver(self, arrays: dict[str, Floats]) -> None:
        """Let the bergs meet these fields, on the grid with its halo, vectors at its corners."""
        if "taux" in arrays:
            tau_x, tau_y = np.broadcast_arrays(arrays.pop("taux"), arrays.pop("tauy"))
            arrays["ua"], arrays["va"] = wind_from_stress(np.atleast_2d(tau_x), np.atleast_2d(tau_y))
            if tau_x.ndim == 0:
                arrays["ua"], arrays["va"] = arrays["ua"][0, 0], arrays["va"][0, 0]
        self._refuse_lacking(arrays)
        if "ssh" not in arrays and not self.forcing.given:  # the first step says it for all
            _LOG.warning(
                "the ocean gives no sea level (sea_surface_height_above_geoid): its slope is 0, and large bergs lag behind the "
                "current that it balances"
            )
        # A pack that only seems to stand still would hold bergs.
        model = self.model
        model.constants = model.constants._replace(ice_drift_known="ui" in arrays or "ice_thickness" not in arrays)
        previous = self.forcing.fields_at(0.0)
        fields = {name: self.grid.extended(a) for name, a in arrays.items()}
        for u, v, where in (
            ("uo", "vo", self._staggering),
            ("ui", "vi", self._staggering),
            ("ua", "va", self._wind_staggering),
        ):
            if u in fields:
                fields[u], fields[v] = at_corners(fields[u], fields[v], self.grid, where)
        self.forcing.put(previous._replace(**fields))

    def _refuse_lacking(self, arrays: Mapping[str, Floats]) -> None:
        """Refuse the first step after a restart unless all is there that was handed over before: a restart has no fields."""
        handed = (name for name, once in zip(Fields._fields, self.handed, strict=True) if once)
        lacking = [name for name in handed if name not in arrays]
        if lacking and not self.forcing.given:
            names = [name for name, q in TAKEN.items() if q.field in lacking]
            raise InputError(
                f"no {' and no '.join(names)}, which the run had before its restart", where="exchange",
                remedy="Hand over in the first step all that was handed over before; a restart holds no fields of the ocean",
            )  # fmt: skip
