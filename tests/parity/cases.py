"""The cases of the reference that Riftberg runs, the cases that it refuses, and how close is close."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

POSITION: Final = 1e-5
"""Largest difference of position (m) before the first break, and to the end in cases without fracture."""

RELATIVE: Final = 1e-6
"""Largest difference of any other variable before the first break, as part of its largest value in the case."""

POSITION_WHILE_SAME: Final = 1e-3
"""Largest difference of position (m) as long as the breaks must be the same."""

STRESS: Final = 1.0
"""Largest difference of a stress (Pa) as long as the breaks must be the same; bonds break at 18 kPa."""

BOND: Final = 1e-5
"""Largest difference of a length or shear displacement (m) as long as the breaks must be the same."""

BONDS_LEFT: Final = 0.10
"""Difference of the number of bonds left, as part of it, for two more days."""

CENTROID: Final = 2e3
"""Distance (m) of the centroids of all elements for two more days."""

LATER: Final = 2.0
"""Days after the same breaks for which `BONDS_LEFT` and `CENTROID` hold."""


@dataclass(frozen=True)
class Case:
    """One case of the reference.

    Attributes
    ----------
    name : str
        Folder.
    ranks : int
        Processes of the reference; on more than one its ``n_bonds`` is wrong (quirk Q32) and is not compared.
    same_until : float
        Stamp (d) through which the breaks must be the same.
    same_breaks : int or None
        Instead: through the record by which the reference has broken so many bonds.
    chaotic_end : bool
        The end of the run lies where the reference does not agree with itself, so that only what never changes is
        compared in the final restart.
    relative, relative_acceleration : float
        As `RELATIVE`, for all variables but accelerations and for accelerations. The stiff beam is the exception: its
        elements stand at x = 101 km, where numbers are 1.5e-11 m apart, and its bonds (E / (rho L2) = 5e6 s-2) turn
        that into 1e-4 m s-2, which a million sub-steps without losses keep ringing. Positions are not affected.
    """

    name: str
    ranks: int = 1
    same_until: float = math.inf
    same_breaks: int | None = None
    chaotic_end: bool = False
    relative: float = RELATIVE
    relative_acceleration: float = RELATIVE

    @property
    def counts_bonds(self) -> bool:
        """Whether the reference has written ``n_bonds``, and rightly: not on several processes (Q32), not in KID's case."""
        return self.ranks == 1 and self.name != "collision_KID_wide"

    @property
    def latlon(self) -> bool:
        """Whether positions are degrees."""
        return self.name.startswith("a68")


CASES: Final = {
    case.name: case
    for case in (
        Case("collision_KID", ranks=4),
        Case("collision_KID_wide"),
        Case("collision_MTS_KID", ranks=4),
        Case("collision_MTS_KID_wide"),
        Case("collision_iKID", ranks=4),
        Case("collision_iKID_wide"),
        Case("dem_ssbeam", relative=1e-5, relative_acceleration=1e-2),
        Case("dem_cbeam"),
        Case("dem_ground_frac"),
        Case("a68_synthetic", same_breaks=10, chaotic_end=True),
        Case("a68_story"),
        Case("a68_oras5", same_until=4.25, chaotic_end=True),
    )
}

MELTING: Final = {
    "melt_point_bergs": (1, 1),
    "melt_bergy_bits": (1, 1),
    "melt_tip_parameter": (1, 1),
    "iKID_collision_melting": (1, 1),
    "footloose": (2, 2),
}
"""Cases with melt or footloose calving, and the processes of the reference whose random numbers are followed."""

MASS_AND_SHAPE: Final = 1e-9
"""Largest difference of mass, sizes and bits of an element in these, relative."""


@dataclass(frozen=True)
class MixedCase:
    """A case with options mixed, which shows a rule of its own.

    Attributes
    ----------
    folder : str
        Under the reference data.
    ranks : tuple of int
        Processes of the reference along x and y.
    latlon : bool
        Whether positions are degrees.
    """

    folder: str = "reference/more"
    ranks: tuple[int, int] = (1, 1)
    latlon: bool = False


MIXED: Final = {
    "contact_big": MixedCase(),
    "drv_ice_land": MixedCase(),
    "fl_inter_bits": MixedCase(ranks=(2, 2)),
    "leave_north": MixedCase(),
    "melt_rk4_wide": MixedCase(),
    "override_rk": MixedCase(),
    "rk_bonded_pc": MixedCase(),
    "vt_T": MixedCase(),
    "a68_dt3600": MixedCase("mixed2", latlon=True),
    "births_standalone_melt": MixedCase("mixed2"),
    "calving_restart_on_top": MixedCase("mixed2"),
    "ll_leaves_east_west": MixedCase("mixed2", latlon=True),
    "melt_cutoff_cell_depth": MixedCase("mixed2"),
    "nbonds_broken_first_step": MixedCase("mixed2"),
}

POSITION_MIXED: Final = 1e-6
"""Largest difference of position (m) in these, to the end of the run."""
