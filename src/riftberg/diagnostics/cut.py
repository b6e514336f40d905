"""The cut between a fragment and the rest of its parent: forces, load, and the bonds that fail.

The load that the cut has to carry
----------------------------------
Before it breaks off, a fragment A is held to the rest B of its parent by the cut between them. If each external force k
acted alone on the rigid body A + B, it would give it the acceleration ``a_k = F_k / M`` and the angular acceleration
``alpha_k = N_k / I``. A moves along only because the cut passes on to it the force

    T_k = sum over A of (m (a_k + alpha_k x r) - f_k)

and, about the centre of the cut, the couple ``C_k`` likewise. Their sums over k are the load of the cut; each T_k and
C_k is the share of one force, which is what "this force broke it" can mean. The load is also found without assuming a
rigid body, from the recorded acceleration of A. A cut of length L in ice of thickness H carries the nominal stress
``sigma = tension / (H L) + 6 |couple| / (H L^2)`` of a beam at its outer fibre; it is a guide, not the stress of a bond.
It is given for the whole cut, as it was before its first bond failed.

The sea floor is stiff: it stops an element within a minute, and the velocity of one moment says little about the force
over an hour. Where the run recorded the forces as they were applied, the force of the floor is its mean until the next
record. Elsewhere, where the berg is aground, it is the one that balances all others with the
change of the momentum of A + B until the next record; it acts on the elements that are aground at either. What passes
through the cut does not change that momentum, so this holds also while the cut breaks.

Breaks between records
----------------------
In the multiple-time-step scheme the slow forces act as two kicks per long step, and the ice rings in between. A bond can
fail in that ringing although no record shows a stress near its strength. Such a break is called sudden; whether it
depends on the length of the long step is one of the controls. In the quasi-static scheme nothing rings: a sudden break
there is one on impact, with the sea floor or another berg, or of a load that grows within the interval of the records.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.diagnostics.forces import FORCES, accelerations, applied_forces, external_forces, forces_recorded
from riftberg.plane import ConformalPlane
from riftberg.runs.scene import Scene
from riftberg.state import Floats, Ints
from riftberg.system.atomic_files import write_text


@dataclass(frozen=True)
class Load:
    """Load across the cut at one record."""

    time: str
    cut_km: float  # Length of the cut (km), and thickness of the ice there (m)
    thickness: float  # Length of the cut (km), and thickness of the ice there (m)
    bonds: int  # Bonds of the cut that still hold
    tension: dict[str, float]  # By force: pull across the cut and push along it, N
    shear: dict[str, float]  # By force: pull across the cut and push along it, N
    couple: dict[str, float]  # By force, about the centre of the cut, counter-clockwise on the fragment, N m
    stress: dict[str, float]  # By force: share of the nominal stress at the outer fibre that is pulled most, Pa
    tension_recorded: float | None  # The same from the recorded acceleration of the fragment
    couple_recorded: float | None  # The same from the recorded acceleration of the fragment
    aground: int  # Elements of fragment and rest that are aground

    @property
    def nominal(self) -> float:
        """Nominal stress, Pa."""
        return sum(self.stress.values())


@dataclass(frozen=True)
class Budget:
    """Forces on one body at one record, N, east and north."""

    mass: float  # kg
    forces: dict[str, list[float]]  # By name
    inertia: list[float] | None  # Mass times recorded acceleration
    # Inertia minus forces: what the rest of the berg and other bergs do to it, and errors of differences
    residual: list[float] | None


@dataclass(frozen=True)
class FirstBond:
    """History of a bond of the cut, from `HOURS_BEFORE` to its breaking."""

    bond: int  # Row in the run file
    time: str  # When it broke
    lon: float  # Where, at the record before
    lat: float  # Where, at the record before
    grounded: bool  # An end was aground when it broke
    strength: float  # Pa
    hours: list[float]  # Times of the history, h before its breaking (negative)
    tension: list[float]  # Pa, at these times
    shear: list[float]  # Pa, at these times
    # Largest tension in any sub-step since the record before, Pa; empty for files that do not hold it
    peak: list[float]


@dataclass(frozen=True)
class Collision:
    """Contact with another berg while the first bond failed."""

    berg: str  # Name of the other
    time: str  # When they first touched
    speed: float  # Relative speed before they touched, m s-1


@dataclass
class Breakup:
    """One break-up and its reasons; see the attributes of the parts.

    ``closure`` is the residual of the whole parent over the sum of the sizes of the forces on it, at the last record at
    which it was afloat: how well the recomputed forces explain the recorded acceleration. ``highest`` is the largest
    tensile stress (Pa) of any bond of the parent at the last record before the first bond failed; ``sudden`` that it was
    below `SUDDEN` of the strength; ``peak`` the largest in the sub-steps up to that record, None for files without it.
    ``hours_since_start`` tells when the first bond failed; ``floor_recorded`` that the force of the sea floor is the one
    that was applied, not the one that balances. ``name`` and ``parent_name`` are what both are called; ``collision`` tells of
    a berg that touched the parent while the first bond failed; ``scheme`` is that of the run.
    """

    fragment: int
    parent: int
    time: str
    lon: float
    lat: float
    area_km2: float
    elements: int
    grounded: bool
    bonds: int
    first_break: str
    decisive: Load
    budgets: dict[str, Budget]
    closure: float | None
    first_bonds: list[FirstBond]
    highest: float
    sudden: bool
    hours_since_start: float
    peak: float | None
    history: list[Load]
    floor_recorded: bool = False
    name: str = ""
    parent_name: str = ""
    collision: Collision | None = None
    latlon: bool = True
    scheme: str = "mts"
    members: list[int] = field(default_factory=list)
    controls: dict[str, str] = field(default_factory=dict)

    @property
    def on_impact(self) -> bool:
        """Whether the first bond failed as the berg met the sea floor, of which the record before tells nothing."""
        return self.sudden and self.first_bonds[0].grounded and not self.decisive.aground

    @property
    def causes(self) -> list[tuple[str, float]]:
        """Forces with their shares of the nominal stress, largest first."""
        return sorted(self.decisive.stress.items(), key=lambda item: -item[1])


@dataclass
class Reasons:
    """All break-ups of a run that are large enough to be shown, and what it lost by melting, in words."""

    experiment: str
    forcing: str
    breakups: list[Breakup]
    small: int
    strength: float | None
    melt: list[str] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain numbers, texts, lists and dicts."""
        return asdict(self)

    def write(self, path: str | Path) -> Path:
        """Write as JSON."""
        path = Path(path)
        write_text(path, json.dumps(self.as_dict(), indent=1, allow_nan=False) + "\n")
        return path


HOURS_BEFORE: Final = 48.0
"""Length of the histories before a break-up, h."""

SUDDEN: Final = 0.7
"""A break is sudden where no bond of the berg had this part of the strength at the record before."""

FIRST_BONDS: Final = 5
"""Bonds whose history is shown."""


def members_at_birth(scene: Scene, row: int) -> tuple[Ints, int] | None:
    """Return the elements of a fragment at the first record at which it exists, and that record."""
    number = int(scene.run["fragment_number"].values[row])
    start = int(np.searchsorted(scene.times, scene.run["fragment_birth_time"].values[row]))
    for record in range(start, len(scene.times)):
        inside = np.flatnonzero(scene.berg[record] == number)
        if len(inside):
            return inside, record
    return None


class Cut:
    """The cut between a fragment and the rest of its parent."""

    def __init__(self, scene: Scene, row: int) -> None:
        self.scene, self.run, self.row = scene, scene.run, row
        self.p = scene.parameters.kernel_values()
        self.birth = self.run["fragment_birth_time"].values[row]
        self.parent = int(self.run["fragment_parent"].values[row])
        self.broken_at = self.run["break_time"].values

    def breakup(self) -> Breakup | None:
        """Return the reasons; None where the records are too few to tell."""
        members = members_at_birth(self.scene, self.row)
        before = int(np.searchsorted(self.scene.times, self.birth)) - 1
        if members is None or before < 0:
            return None
        self.inside = np.zeros(self.run.sizes["trajectory"], bool)
        self.inside[members[0]] = True
        first, second = self.run["first"].values, self.run["second"].values
        rest = ~self.inside & (self.scene.berg[before] == self.parent)
        across = (self.inside[first] & rest[second]) | (rest[first] & self.inside[second])
        bonds = np.flatnonzero(across & ~np.isnat(self.broken_at))
        bonds = bonds[np.argsort(self.broken_at[bonds], kind="stable")]
        if not len(bonds) or not rest.any():
            return None
        self.bonds = bonds
        hours = (self.birth - self.scene.times) / np.timedelta64(1, "h")
        window = [int(k) for k in np.flatnonzero((hours <= HOURS_BEFORE) & (hours > 0.0))]
        loads = [load for k in window if (load := self.load(k, before)) is not None]
        if not loads:
            return None
        decisive = self._decisive(loads)
        return self._told(before, loads, decisive)

    def _decisive(self, loads: list[Load]) -> Load:
        """Return the load that began the breaking: the largest from the last record before it to the birth."""
        begin = int(np.searchsorted(self.scene.times, self.broken_at[self.bonds[0]])) - 1
        since = np.datetime_as_string(self.scene.times[max(begin, 0)], unit="s")
        late = [load for load in loads if load.time >= since] or loads[-1:]
        return max(late, key=lambda load: load.nominal)

    def _told(self, before: int, loads: list[Load], decisive: Load) -> Breakup:
        run, row = self.run, self.row
        record = int(np.searchsorted(self.scene.times, np.datetime64(decisive.time)))
        budgets = self.budgets(record, before)
        highest = self.highest_stress()
        names = ("lon", "lat") if self.scene.latlon else ("x", "y")
        return Breakup(
            fragment=int(run["fragment_number"].values[row]),
            parent=self.parent,
            time=iso(self.birth),
            lon=float(run[f"fragment_{names[0]}"].values[row]),
            lat=float(run[f"fragment_{names[1]}"].values[row]),
            area_km2=float(run["fragment_area"].values[row]) / 1e6,
            elements=int(run["fragment_elements"].values[row]),
            grounded=bool(run["fragment_grounded"].values[row] == 1),
            bonds=len(self.bonds),
            first_break=iso(self.broken_at[self.bonds[0]]),
            decisive=decisive,
            budgets=budgets,
            closure=self.closure(record, before),
            first_bonds=[self.first_bond(int(b)) for b in self.bonds[:FIRST_BONDS]],
            highest=highest,
            scheme=self.scene.parameters.stepping.scheme,
            sudden=self.highest_stress(of_what_is_left=True) < SUDDEN * self.scene.parameters.fracture.normal_strength,
            hours_since_start=float((self.broken_at[self.bonds[0]] - self.scene.times[0]) / np.timedelta64(1, "h")),
            peak=self.highest_stress("peak_stress") if "peak_stress" in run else None,
            history=loads,
            floor_recorded=forces_recorded(run),
            latlon=self.scene.latlon,
            members=[int(n) for n in run["trajectory"].values[self.inside]],
        )

    # --- forces ----------------------------------------------------------------------------------------------------

    def body(self, record: int) -> NDArray[np.bool_]:
        """Return the elements of fragment and rest at a record."""
        return np.asarray(self.inside | (self.scene.berg[record] == self.parent))

    def closure(self, record: int, last: int) -> float | None:
        """Return how well the budget of fragment and rest closes, at the last record afloat."""
        for k in range(record, max(record - 48, 0), -1):
            if not (self.aground(k) & self.body(k)).any() and (self.body(k) == self.body(record)).all():
                both = self.budgets(k, last)["both"]
                size = sum(math.hypot(*force) for force in both.forces.values())
                return math.hypot(*both.residual) / size if both.residual and size > 0.0 else None
        return None

    def budgets(self, record: int, last: int) -> dict[str, Budget]:
        """Return the budgets of fragment, rest and both."""
        forces = external_forces(self.run, record, self.p)
        rate = accelerations(self.run, record, 0, last)
        mass, body = self.run["mass"].values, self.body(record)
        self.put_floor(forces, record, body)
        return {
            name: _budget(rows, forces, mass, rate)
            for name, rows in (("fragment", self.inside), ("rest", body & ~self.inside), ("both", body))
        }

    def load(self, record: int, last: int) -> Load | None:
        """Return the load across the cut at a record; None where no bond of it holds any more."""
        whole = self.bonds[self.broken_at[self.bonds] > self.scene.times[record]]
        if not len(whole):
            return None
        body = self.body(record)
        geometry = _Geometry(self, record, body, self.bonds)
        forces = external_forces(self.run, record, self.p)
        rate = accelerations(self.run, record, 0, last)
        aground = self.put_floor(forces, record, body)
        shares = {name: geometry.passed_on(geometry.turned(force)) for name, force in forces.items()}
        tension, shear, couple = ({n: s[k] for n, s in shares.items()} for k in range(3))
        sign = 1.0 if sum(couple.values()) >= 0.0 else -1.0
        section = geometry.thickness * geometry.length
        stress = {n: tension[n] / section + sign * 6.0 * couple[n] / (section * geometry.length) for n in FORCES}
        recorded = geometry.recorded(geometry.turned(rate), geometry.turned(sum(forces.values(), np.zeros_like(rate))))
        return Load(
            time=iso(self.scene.times[record]),
            cut_km=geometry.length / 1e3,
            thickness=geometry.thickness,
            bonds=len(whole),
            tension=tension,
            shear=shear,
            couple=couple,
            stress=stress,
            tension_recorded=recorded[0],
            couple_recorded=recorded[1],
            aground=int(aground.sum()),
        )

    def put_floor(self, forces: dict[str, Floats], record: int, body: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Replace the force of the sea floor by its mean until the next record; returns the elements that it acts on.

        Where the run did not record that, it is the one that balances.
        """
        after = record + 1
        aground = self.aground(record) & body
        if after >= len(self.scene.times):
            return aground
        aground |= self.aground(after) & body
        if forces_recorded(self.run):
            forces["sea floor"] = applied_forces(self.run, after)["sea floor"]
        elif aground.any():
            rate, mass = accelerations(self.run, record, record, after), self.run["mass"].values
            others = np.sum([f[body].sum(axis=0) for name, f in forces.items() if name != "sea floor"], axis=0)
            missing = (mass[body, None] * rate[body]).sum(axis=0) - others
            forces["sea floor"] = np.where(aground[:, None], missing[None, :] / aground.sum(), 0.0)
        return aground

    def aground(self, record: int) -> NDArray[np.bool_]:
        """Return which elements are aground at a record."""
        return np.asarray(self.scene.aground([record])[0])

    # --- bonds -----------------------------------------------------------------------------------------------------

    def highest_stress(self, of: str = "normal_stress", *, of_what_is_left: bool = False) -> float:
        """Return the largest tensile stress (Pa) of the parent at the last record before the first bond failed.

        With ``of="peak_stress"`` it is that of the sub-steps up to this record, since the one before. With
        ``of_what_is_left`` each is divided by the part of the strength that damage has left at that record.
        """
        record = max(int(np.searchsorted(self.scene.times, self.broken_at[self.bonds[0]])) - 1, 0)
        body = self.body(record)
        held = body[self.run["first"].values] & body[self.run["second"].values]
        held &= np.isnat(self.broken_at) | (self.broken_at > self.scene.times[record])
        stress = self.run[of].isel(time=record).values[held]
        if of_what_is_left and "damage" in self.run:
            stress = stress / (1.0 - self.run["damage"].isel(time=record).values[held])
        return float(stress.max(initial=0.0))

    def first_bond(self, bond: int) -> FirstBond:
        """Return the history of a bond."""
        scene, run = self.scene, self.run
        hours = (scene.times - self.broken_at[bond]) / np.timedelta64(1, "h")
        rows = np.flatnonzero((hours >= -HOURS_BEFORE) & (hours <= 0.0))
        ends = [int(run[name].values[bond]) for name in ("first", "second")]
        at = int(rows[-1]) if len(rows) else 0
        strength = scene.parameters.fracture.normal_strength * float(run["strength"].values[bond])
        if "damage" in run:  # a bond keeps the damage with which it broke
            strength *= 1.0 - float(run["damage"].values[bond, -1])
        names = [name for name in ("normal_stress", "shear_stress", "peak_stress") if name in run]
        history = run[names].isel(bond=bond, time=rows)
        return FirstBond(
            bond=bond,
            time=iso(self.broken_at[bond]),
            lon=float(np.mean(scene.x[at][ends])),
            lat=float(np.mean(scene.y[at][ends])),
            grounded=bool(run["break_grounded"].values[bond] > 0),
            strength=strength,
            hours=[round(float(h), 4) for h in hours[rows]],
            tension=[float(s) for s in history["normal_stress"].values],
            shear=[float(s) for s in history["shear_stress"].values],
            peak=[float(s) for s in history["peak_stress"].values] if "peak_stress" in run else [],
        )


class _Geometry:
    """Plane geometry of a body and its cut at a record; metres from the centre of mass."""

    def __init__(self, cut: Cut, record: int, body: NDArray[np.bool_], whole: Ints) -> None:
        scene, run = cut.scene, cut.run
        self.mass, self.body, self.inside = run["mass"].values, body, cut.inside
        lon, lat = scene.x[record], scene.y[record]
        weight = self.mass[body]
        centre = float(np.average(lon[body], weights=weight)), float(np.average(lat[body], weights=weight))
        plane = ConformalPlane(*centre, scene.radius, scene.latlon)
        x, y = plane.forward(lon, lat)
        self.x, self.y = x - np.average(x[body], weights=weight), y - np.average(y[body], weights=weight)
        self.angle = plane.eastward(lon, lat)
        # Each element turns with the body, as a disc of its area.
        disc = scene.area[body] / (2.0 * np.pi)
        self.inertia = float((weight * (self.x[body] ** 2 + self.y[body] ** 2 + disc)).sum())
        self._lay_cut(run, scene, record, whole)

    def _lay_cut(self, run: xr.Dataset, scene: Scene, record: int, whole: Ints) -> None:
        first, second = run["first"].values[whole], run["second"].values[whole]
        inner = np.where(self.inside[first], first, second)
        outer = np.where(self.inside[first], second, first)
        self.cx = float(0.5 * (self.x[inner] + self.x[outer]).mean())
        self.cy = float(0.5 * (self.y[inner] + self.y[outer]).mean())
        middle = np.column_stack([self.x[inner] + self.x[outer], self.y[inner] + self.y[outer]]) / 2.0
        side = float(np.sqrt(scene.area[inner].mean()))
        towards = np.array([(self.x[inner] - self.x[outer]).sum(), (self.y[inner] - self.y[outer]).sum()])
        self.normal = _normal(middle, towards, side)
        along = middle @ np.array([-self.normal[1], self.normal[0]])
        self.length = float(np.ptp(along)) + side
        ends = np.r_[inner, outer]
        self.thickness = float(run["thickness"].isel(time=record).values[ends].mean())

    def turned(self, vectors: Floats) -> Floats:
        """Turn vectors given east and north onto the plane."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        return np.stack([c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]], axis=-1)

    def passed_on(self, force: Floats) -> tuple[float, float, float]:
        """Return tension, shear and couple that the cut passes on to the fragment if this force acts alone."""
        b, total = self.body, force[self.body].sum(axis=0) / self.mass[self.body].sum()
        turn = float((self.x[b] * force[b, 1] - self.y[b] * force[b, 0]).sum()) / self.inertia
        rigid = np.stack([total[0] - turn * self.y, total[1] + turn * self.x], axis=-1)
        return self._across(self.mass[:, None] * rigid - force)

    def recorded(self, rate: Floats, force: Floats) -> tuple[float | None, float | None]:
        """Return tension and couple from the recorded acceleration."""
        if not np.isfinite(rate[self.inside]).all():
            return None, None
        tension, _, couple = self._across(self.mass[:, None] * rate - force)
        return tension, couple

    def _across(self, needed: Floats) -> tuple[float, float, float]:
        """Sum what the elements of the fragment need; tension pulls the fragment back to the rest."""
        a = self.inside
        fx, fy = needed[a].sum(axis=0)
        couple = ((self.x[a] - self.cx) * needed[a, 1] - (self.y[a] - self.cy) * needed[a, 0]).sum()
        n = self.normal
        return -float(fx * n[0] + fy * n[1]), float(-fx * n[1] + fy * n[0]), float(couple)


def _normal(middle: Floats, towards: Floats, side: float) -> Floats:
    """Return the direction across a cut, towards the fragment: square to the line through the middles of its bonds."""
    spread = middle - middle.mean(axis=0)
    values, axes = np.linalg.eigh(spread.T @ spread)
    # A short or crooked cut has no direction of its own; its bonds have.
    normal = axes[:, 0] if values[1] > 4.0 * values[0] and np.sqrt(values[1]) > 0.5 * side else towards
    normal = normal / np.hypot(*normal) if np.hypot(*normal) > 0.0 else np.array([1.0, 0.0])
    return np.asarray(normal if normal @ towards >= 0.0 else -normal)


def _budget(rows: NDArray[np.bool_], forces: dict[str, Floats], mass: Floats, rate: Floats) -> Budget:
    sums = {name: [float(c) for c in force[rows].sum(axis=0)] for name, force in forces.items()}
    inertia = (mass[rows, None] * rate[rows]).sum(axis=0)
    if not np.isfinite(inertia).all():
        return Budget(float(mass[rows].sum()), sums, None, None)
    rest = inertia - np.sum(list(sums.values()), axis=0)
    return Budget(float(mass[rows].sum()), sums, [float(c) for c in inertia], [float(c) for c in rest])


def iso(moment: np.datetime64) -> str:
    """Return a date as text, to the second."""
    return str(np.datetime_as_string(moment, unit="s"))
