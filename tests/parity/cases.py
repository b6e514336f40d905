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

MIXED: Final = {
    "contact_big": (1, 1),
    "drv_ice_land": (1, 1),
    "fl_inter_bits": (2, 2),
    "leave_north": (1, 1),
    "melt_rk4_wide": (1, 1),
    "override_rk": (1, 1),
    "rk_bonded_pc": (1, 1),
    "vt_T": (1, 1),
}
"""Cases of ``reference/more``, with options mixed, and the processes of the reference; each shows a rule of its own."""

POSITION_MIXED: Final = 1e-6
"""Largest difference of position (m) in these, to the end of the run."""
