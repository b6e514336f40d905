"""The bonds of a run as its file has them: which hold, their stress, strength and damage, and the tips of rifts."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from riftberg.engines.common.reserves import bond_strengths
from riftberg.engines.common.rift_tips import RiftTip
from riftberg.parameters import Parameters
from riftberg.runs.positions import read_thickness
from riftberg.state import Floats

if TYPE_CHECKING:
    import xarray as xr


class BondHistory:
    """Stress, strength and damage of the bonds of a run.

    ``times``: of the records.
    """

    def __init__(self, run: xr.Dataset, times: NDArray[np.datetime64], parameters: Parameters) -> None:
        self.run, self.times, self.parameters = run, times, parameters

    @cached_property
    def unbroken(self) -> NDArray[np.bool_]:
        """Which bonds hold at each record, (time, bond)."""
        return self._holding(self.times)

    def _holding(self, moments: NDArray[np.datetime64]) -> NDArray[np.bool_]:
        """Which bonds hold at moments, (moment, bond)."""
        broken_at = self.run["break_time"].values
        holds: NDArray[np.bool_] = np.isnat(broken_at)[None, :] | (broken_at[None, :] > moments[:, None])
        return holds

    def tension(self) -> Floats:
        """Largest tensile stress (Pa) of each bond since the record before, (time, bond); 0 for bonds broken earlier.

        Files without ``peak_stress`` give the stress at the records, of the bonds that hold then.
        """
        if "peak_stress" in self.run:
            # A bond that broke since the record before had its largest stress in that interval: it still counts.
            intact = self._holding(np.r_[self.times[:1], self.times[:-1]])
            stress = self.run["peak_stress"].transpose("time", "bond").values
        else:
            intact, stress = self.unbroken, self.run["normal_stress"].transpose("time", "bond").values
        return np.where(intact & np.isfinite(stress), np.maximum(stress, 0.0), 0.0)

    def damage(self) -> Floats | None:
        """Damage of the bonds at each record, (time, bond), 0 for broken ones; None in a run without damage."""
        if "damage" not in self.run:
            return None
        damage: Floats = np.nan_to_num(self.run["damage"].transpose("time", "bond").values)
        return np.where(self.unbroken, damage, 0.0)

    @cached_property
    def _thickness(self) -> Floats:
        return read_thickness(self.run)

    @cached_property
    def strengths(self) -> Floats:
        """Tensile strength (Pa) of the ice of each bond, without the factors of its rift, scatter and damage; (time, bond)."""
        first, second = self.run["bond_first"].values, self.run["bond_second"].values
        strengths = bond_strengths(self._thickness, first, second, self.parameters.kernel_values())
        return np.broadcast_to(strengths, (self.times.size, first.size))

    @cached_property
    def strength(self) -> float:
        """Lowest of them (Pa) in the run, where the ice is thickest."""
        elements = np.arange(self._thickness.shape[1])
        return float(bond_strengths(self._thickness, elements, elements, self.parameters.kernel_values()).min())

    def lowest_strength(self) -> Floats | None:
        """Lowest normal strength (Pa) that damage has left to a bond at each record, NaN where none holds.

        Bonds of a rift without any strength do not count. None in a run without damage.
        """
        damage = self.damage()
        if damage is None:
            return None
        relative_strength = self.run["strength"].values
        left = self.strengths * relative_strength * (1.0 - damage)
        lowest = np.where(self.unbroken & (relative_strength > 0.0), left, np.inf).min(axis=1, initial=np.inf)
        return np.where(np.isfinite(lowest), lowest, np.nan)


def read_rift_tips(run: xr.Dataset) -> list[RiftTip]:
    """Return the tips of rifts that stand at the end of a run."""
    if "rift_tip_crack" not in run:
        return []
    coordinates = {} if "rift_tip_lon" in run else {"lon": "x", "lat": "y"}
    columns = [run[f"rift_tip_{coordinates.get(name, name)}"].values.tolist() for name in RiftTip.__dataclass_fields__]
    return [RiftTip(int(crack), *values) for crack, *values in zip(*columns, strict=True) if crack > 0]
