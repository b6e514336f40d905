"""One case: run, read and compared, in numbers that the tests judge and the table shows."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from riftberg.kid.run import KidReport, run_kid

from .cases import LATER, Case
from .records import Table, largest, offset, paired, read, select

ELEMENT = ("second", "id_cnt", "id_ij")
BOND = ("second", "id_cnt1", "id_ij1", "id_cnt2", "id_ij2")


@dataclass
class Comparison:
    """Differences of a case from the reference; arrays run over paired records.

    Attributes
    ----------
    case : Case
    expected : pathlib.Path
        Folder of the reference's output.
    report : KidReport
        Of our run.
    ours, theirs : Table
        Paired records of the trajectory.
    wall : float
        Wall time of our run with its files, s; with compilation where nothing is cached.
    distance : ndarray
        Of the positions, m.
    """

    case: Case
    expected: Path
    report: KidReport
    ours: Table
    theirs: Table
    wall: float
    distance: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self._offset = offset(self.ours, self.theirs, self.case.latlon)
        self.distance = np.hypot(*self._offset)
        self.stamps = np.unique(self.theirs["second"])

    def bonds_left(self, table: Table) -> np.ndarray:
        """Unbroken bonds at each stamp."""
        return np.asarray([table["n_bonds"][self.at(s)].sum() // 2 for s in self.stamps])

    def at(self, second: int) -> np.ndarray:
        """Rows of one stamp."""
        return np.asarray(self.theirs["second"] == second)

    @cached_property
    def before_break(self) -> np.ndarray:
        """Rows before the reference's first break: all rows where nothing breaks."""
        if not self.case.counts_bonds:
            return np.ones_like(self.distance, dtype=bool)
        left = self.bonds_left(self.theirs)
        whole = self.stamps[left == left[0]]
        return np.asarray(self.theirs["second"] <= whole.max())

    @property
    def broken(self) -> bool:
        """Whether a bond breaks in the reference."""
        return not bool(self.before_break.all())

    @property
    def same_until(self) -> int:
        """Last stamp (s) at which the breaks must be the same."""
        if self.case.same_breaks is not None:
            left = self.bonds_left(self.theirs)
            return int(self.stamps[np.argmax(left[0] - left >= self.case.same_breaks)])
        return int(min(self.case.same_until * 86400.0, self.stamps[-1]))

    @property
    def while_same(self) -> np.ndarray:
        """Rows in which the breaks must be the same."""
        return np.asarray(self.theirs["second"] <= self.same_until)

    def really_same_until(self) -> int | None:
        """Last stamp (s) up to which ``n_bonds`` of every element is the same; None if never."""
        if not self.case.counts_bonds:
            return None
        wrong = self.theirs["second"][self.ours["n_bonds"] != self.theirs["n_bonds"]]
        good = self.stamps[self.stamps < wrong.min()] if wrong.size else self.stamps
        return int(good[-1]) if good.size else None

    def position(self, rows: np.ndarray) -> float:
        """Largest distance (m) in some rows."""
        return float(self.distance[rows].max())

    def velocity(self, rows: np.ndarray) -> float:
        """Largest difference of velocity (m/s) in some rows."""
        return largest(self.ours, self.theirs, ("uvel", "vvel"), rows)

    def rotation(self, rows: np.ndarray) -> float:
        """Largest difference of rotation (rad) in some rows; NaN without rotation."""
        return largest(self.ours, self.theirs, ("rot",), rows)

    def later(self) -> list[tuple[int, int, int, float]]:
        """Stamp (s), bonds left here and there, and distance of the centroids (m), for two days after the same breaks."""
        ours, theirs = self.bonds_left(self.ours), self.bonds_left(self.theirs)
        chosen = (self.stamps > self.same_until) & (self.stamps <= self.same_until + LATER * 86400.0)
        dx, dy = self._offset
        rows = {s: self.at(s) for s in self.stamps[chosen]}
        return [
            (int(s), int(a), int(b), float(np.hypot(dx[rows[s]].mean(), dy[rows[s]].mean())))
            for s, a, b in zip(self.stamps[chosen], ours[chosen], theirs[chosen], strict=True)
        ]

    @cached_property
    def bonds(self) -> tuple[Table, Table] | None:
        """Paired records of the bond file while the breaks must be the same; None if the reference has no such file."""
        path = self.expected / "bonds.nc"
        if not path.exists():
            return None
        ours, theirs = read(self.file("_bonds")), read(path)
        theirs = select(theirs, theirs["second"] <= self.same_until)
        return paired(ours, theirs, BOND)

    def stress(self) -> float:
        """Largest difference of a stress (Pa) while the breaks must be the same; NaN without a bond file."""
        pair = self.bonds
        if pair is None:
            return np.nan
        return largest(*pair, ("nstress", "sstress"), np.ones(pair[0]["lon"].size, dtype=bool))

    def file(self, suffix: str = "") -> Path:
        """Return one of the files that our run wrote, by what its name ends in."""
        return next(path for path in self.report.files if path.stem == f"{self.case.name}{suffix}")


def compare(case: Case, folder: Path, out: Path) -> Comparison:
    """Run a case and pair its trajectory with the reference's."""
    began = time.perf_counter()
    report = run_kid(folder, out / f"{case.name}.nc")
    wall = time.perf_counter() - began
    expected = folder / "expected"
    ours, theirs = paired(read(report.files[0]), read(expected / "trajectories.nc"), ELEMENT)
    return Comparison(case, expected, report, ours, theirs, wall)
