"""The cut between a fragment and the rest of its parent: forces, load, and the bonds that fail.

The load that the cut has to carry
----------------------------------
Before it breaks off, a fragment A is held to the rest B of its parent by the cut between them. If each external force k
acted alone on the rigid body A + B, it would give it the acceleration ``a_k = F_k / M`` and the angular acceleration
``alpha_k = N_k / I``. A moves along only because the cut passes on to it the force

    T_k = sum over A of (m (a_k + alpha_k x r) - f_k)

and, about the centre of the cut, the couple ``C_k`` likewise. Their sums over k are the load of the cut; each T_k and
C_k is the share of one force: "this force broke it" can mean no more. The load is also found without assuming a
rigid body, from the recorded acceleration of A. A cut of length L in ice of thickness H carries the nominal stress
``sigma = tension / (H L) + 6 |couple| / (H L^2)`` of a beam at its outer fibre; it is a guide, not the stress of a bond.
It is given for the whole cut, as it was before its first bond failed.

The sea floor is stiff: it stops an element within a minute, and the velocity of one moment says little about the force
over an hour. Where the run recorded the forces as they were applied, the force of the floor is its mean until the next
record. Elsewhere, where the berg is aground, it is the one that balances all others with the
change of the momentum of A + B until the next record; it acts on the elements that are aground at either. A force
through the cut does not change that momentum, so this holds also while the cut breaks.

Breaks between records
----------------------
In the multiple-time-step scheme the slow forces act as two kicks per long step, and the ice rings in between. A bond can
fail in that ringing although no record shows a stress near its strength. Such a break is called sudden; whether it
depends on the length of the long step is one of the controls. In the quasi-static scheme nothing rings: a sudden break
there is one on impact, with the sea floor or another berg, or of a load that grows within the interval of the records.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.constants import DEGREE
from riftberg.engines.common.forces import media
from riftberg.engines.common.forces.implicit_velocity import record_current_forces
from riftberg.engines.common.forces.media import allocate_surroundings, find_surroundings
from riftberg.engines.common.forces.pack import hold_by_pack
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.common.fragments.tree import measure_outlines
from riftberg.parameters import KernelParameters
from riftberg.physics.crevasses import prestress
from riftberg.plane import ConformalPlane
from riftberg.runs.derived import USER_LAW, force_variables
from riftberg.runs.layout import in_file
from riftberg.runs.scene import Scene
from riftberg.state import ELEMENT_VARIABLES, Elements, Floats, Ints, new_elements

_WORDS: Final = {
    "water": "ocean drag",
    "slope": "surface slope",
    "coriolis": "Coriolis",
    "air": "wind drag",
    "waves": "waves",
    "sea_floor": "sea floor",
    "sea_ice": "sea ice",
    "own": "own force",
}
"""Names of the forces in tables, in the order of all tables; others go by their own name and follow."""

_ROWS: Final = {
    _WORDS.get(name, name.replace("_", " ")): media.FORCES.index(name)
    for name in (*_WORDS, *(n for n in media.FORCES if n not in _WORDS))
}

FORCES: Final = tuple(_ROWS)
"""External forces, in the order of all tables."""


GEOSTROPHIC: Final = "Coriolis and surface slope"
"""These two forces nearly balance, and each alone says little: they are one row wherever forces are weighed."""


def weighed(forces: dict[str, Floats]) -> dict[str, Floats]:
    """Return forces with those two as one row, in which the slope stood."""
    pair = forces["Coriolis"] + forces["surface slope"]
    return {
        GEOSTROPHIC if name == "surface slope" else name: pair if name == "surface slope" else force
        for name, force in forces.items()
        if name != "Coriolis"
    }


def external_forces(run: xr.Dataset, record: int, p: KernelParameters) -> dict[str, Floats]:
    """Return the external forces on all elements at a record: as applied where the run recorded that, else by the table.

    Applied forces are means between records; at a record it is the mean of those before and after, about which the
    acceleration by central differences is taken too.

    Returns for each name of `FORCES` an array of shape (elements, 2): eastward and northward force, N. Several forces of
    the user stand each under its own name.
    """
    if forces_recorded(run):
        sides = [applied_forces(run, k) for k in (record, record + 1) if 0 < k < run.sizes["time"]]
        return {name: np.mean([side[name] for side in sides], axis=0) for name in sides[0]}
    el = read_elements(run, record, p)
    surroundings = allocate_surroundings(el.mass.size)
    find_surroundings(el, interaction_sizes(el, p), surroundings, p)
    surroundings.acts[:] = True  # the sub-steps' part too
    record_current_forces(el, surroundings)
    surroundings.applied[:, media.SEA_ICE] += hold_by_pack(surroundings.media[:, media.SEA_ICE], el.u, el.v)
    return {name: el.mass[:, None] * surroundings.applied[:, row] for name, row in _ROWS.items()}


def forces_recorded(run: xr.Dataset) -> bool:
    """Whether a run holds the forces as they were applied (`riftberg.runs.derived`)."""
    return run.sizes["time"] > 1 and all(v.name in run.variables for v in force_variables())


def applied_forces(run: xr.Dataset, record: int) -> dict[str, Floats]:
    """Return the mean forces between the record before and this one, as applied; see `external_forces`."""
    names = {name: f"force_{media.FORCES[row]}" for name, row in _ROWS.items()}
    if user_names := user_forces(run):
        del names["own force"]  # their sum
        names |= {name.replace("_", " "): f"force_{name}" for name in user_names}
    state = run.isel(time=record)
    return {
        name: np.stack([state[f"{stored}_{axis}"].values.astype(np.float64) for axis in "xy"], axis=-1)
        for name, stored in names.items()
    }


def user_forces(run: xr.Dataset) -> list[str]:
    """Return the names of several forces of the user, whose parts a run recorded."""
    long_names = {str(name): str(v.attrs.get("long_name", "")) for name, v in run.variables.items()}
    user_names = [name for name, text in long_names.items() if name.startswith("force_") and USER_LAW in text]
    return [name.removeprefix("force_").removesuffix("_x") for name in user_names if name.endswith("_x")]


def read_elements(run: xr.Dataset, record: int, p: KernelParameters) -> Elements:
    """Return the elements of a run at a record, as far as its file holds them, at their synchronised velocity."""
    el = new_elements(run.sizes["trajectory"])
    names = {"lon": "x", "lat": "y"} if not p.latlon else {}
    for v in ELEMENT_VARIABLES:
        name = names.get(v.name, in_file(v.name))
        if name in run.variables:
            stored = run[name].isel(time=record) if "time" in run[name].dims else run[name]
            values, target = stored.values, getattr(el, v.name)
            # Elements that are not born yet are missing, and a whole number cannot be.
            target[:] = np.nan_to_num(values) if target.dtype.kind in "iu" else values
    # Drag acts at the velocity of the moment, which `u` of a restart would not be: it lacks the last half kick.
    el.u[:], el.v[:] = el.u_sync, el.v_sync
    measure_outlines(el, p)
    return el


def read_mass(run: xr.Dataset, record: int) -> Floats:
    """Return the masses of the elements (kg) at a record, which change in a run that melts."""
    mass = run["mass"]
    return np.asarray((mass.isel(time=record) if "time" in mass.dims else mass).values, np.float64)


def body_forces(
    scene: Scene, p: KernelParameters, record: int, body: NDArray[np.bool_]
) -> tuple[dict[str, Floats], int]:
    """Return the external forces at a record, and the number of elements of a body that are aground.

    The force of the sea floor is its mean until the next record: as recorded, else the one that balances.
    """
    run = scene.run
    forces, after = weighed(external_forces(run, record, p)), record + 1
    if after == len(scene.times):
        return forces, int((scene.aground([record])[0] & body).sum())
    aground = scene.aground([record, after]).any(axis=0) & body
    if forces_recorded(run):
        forces["sea floor"] = applied_forces(run, after)["sea floor"]
    elif aground.any():
        rate, mass = accelerations(run, record, record, after), read_mass(run, record)
        others = np.sum([f[body].sum(axis=0) for name, f in forces.items() if name != "sea floor"], axis=0)
        missing = (mass[body, None] * rate[body]).sum(axis=0) - others
        forces["sea floor"] = np.where(aground[:, None], missing[None, :] / aground.sum(), 0.0)
    return forces, int(aground.sum())


def accelerations(run: xr.Dataset, record: int, first: int, last: int) -> Floats:
    """Return accelerations (m s-2, east and north) by differences of the recorded velocities."""
    # Central differences, one-sided at the ends of the time in which the body is whole.
    low, high = max(first, record - 1), min(last, record + 1)
    if low == high:
        return np.full((run.sizes["trajectory"], 2), np.nan)
    times = run["time"].values
    dt = float((times[high] - times[low]) / np.timedelta64(1, "s"))
    pair = run[["u", "v"]].isel(time=[low, high]).load()
    return np.stack([np.diff(pair[n].transpose("trajectory", "time").values, axis=1)[:, 0] / dt for n in pair], axis=-1)


@dataclass(frozen=True)
class Load:
    """Load across the cut at one record."""

    time: str
    cut_km: float  # Length of the cut
    thickness: float  # Of the ice there, m
    bonds: int  # Intact bonds of the cut
    tension: dict[str, float]  # By force: pull across the cut, N
    shear: dict[str, float]  # By force: push along it, N
    couple: dict[str, float]  # By force, about the centre of the cut, counter-clockwise on the fragment, N m
    stress: dict[str, float]  # By force: share of the nominal stress at the outer fibre in the largest tension, Pa
    tension_recorded: float | None  # The same tension from the recorded acceleration of the fragment
    couple_recorded: float | None  # The same couple
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
    # Inertia minus forces: the force of the rest of the berg and of other bergs on it, and errors of differences
    residual: list[float] | None


@dataclass(frozen=True)
class FirstBond:
    """History of a bond of the cut, from `HOURS_BEFORE` to its failure."""

    bond: int  # Row in the run file
    time: str  # When it broke
    lon: float  # Where, at the record before
    lat: float
    grounded: bool  # An end was aground when it broke
    strength: float  # Pa
    prestress: float  # Of the ice there, Pa
    hours: list[float]  # Times of the history, h before its failure (negative)
    tension: list[float]  # Pa, at these times
    shear: list[float]  # Pa, at these times
    # Largest tension in any sub-step since the record before, Pa; empty for files that do not hold it
    peak: list[float]


@dataclass(frozen=True)
class Collision:
    """Contact with another berg while the first bond failed."""

    berg: str  # Name of the other
    time: str  # When contact began
    speed: float  # Relative speed before it, m s-1


@dataclass
class Breakup:
    """One break-up and its reasons."""

    fragment: int
    parent: int
    time: str
    lon: float
    lat: float
    area_km2: float
    elements: int
    grounded: bool
    bonds: int  # Bonds of the cut
    first_break: str  # When the first bond failed
    decisive: Load
    budgets: dict[str, Budget]
    # Residual of the whole parent over the sum of the forces on it, at the last record afloat: how well the recomputed
    # forces explain the recorded acceleration
    closure: float | None
    first_bonds: list[FirstBond]
    by_strength: dict[str, int]  # Bonds by the strength that they exceeded, where the file says it
    highest: (
        float  # Largest tensile stress (Pa) of any bond of the parent at the last record before the first bond failed
    )
    sudden: bool  # That was below `SUDDEN` of the strength
    hours_since_start: float  # When the first bond failed
    peak: float | None  # Largest stress (Pa) in the sub-steps up to that record; None for files without it
    history: list[Load]
    floor_recorded: bool = False  # The force of the sea floor is the one that was applied, not the one that balances
    name: str = ""
    parent_name: str = ""
    collision: Collision | None = None
    latlon: bool = True
    in_equilibrium: bool = False  # Nothing rings between the records
    # From end to end of the longest crack line of the cut (km), and where it heads (degrees clockwise from north, below 180)
    crack_km: float | None = None
    crack_towards: float | None = None
    # Elastic energy that the cracks of the cut released per area of crack (J m-2), and the K_Ic (Pa m^1/2) of ice that costs
    # as much, sqrt(E G); None where the scheme does not know it
    released_per_area: float | None = None
    released_toughness: float | None = None
    members: list[int] = field(default_factory=list)
    controls: dict[str, str] = field(default_factory=dict)

    @property
    def on_impact(self) -> bool:
        """Whether the first bond failed as the berg touched the sea floor, before any record aground."""
        return self.sudden and self.first_bonds[0].grounded and not self.decisive.aground

    @property
    def causes(self) -> list[tuple[str, float]]:
        """Forces with their shares of the nominal stress, largest first."""
        return sorted(self.decisive.stress.items(), key=lambda item: -item[1])


HOURS_BEFORE: Final = 48.0
"""Length of the histories before a break-up, h."""

SUDDEN: Final = 0.7
"""A break is sudden where no bond of the berg had this part of the strength at the record before."""

FIRST_BONDS: Final = 5
"""Bonds whose history is shown."""


def birth_members(scene: Scene, row: int) -> tuple[Ints, int] | None:
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
        self.parent = int(self.run["fragment_parent"].values[row])
        self.broken_at = self.run["break_time"].values

    def breakup(self) -> Breakup | None:
        """Return the reasons; None where there are too few records."""
        scene, run, row = self.scene, self.run, self.row
        birth = run["fragment_birth_time"].values[row]
        members, last_record = birth_members(scene, row), int(np.searchsorted(scene.times, birth)) - 1
        if members is None or last_record < 0:
            return None
        self.inside = np.zeros(run.sizes["trajectory"], bool)
        self.inside[members[0]] = True
        first, second = run["bond_first"].values, run["bond_second"].values
        rest = ~self.inside & (scene.berg[last_record] == self.parent)
        # Bonds that joined the fragment to the rest, whichever end was stored first.
        across = (self.inside[first] & rest[second]) | (rest[first] & self.inside[second])
        bonds = np.flatnonzero(across & ~np.isnat(self.broken_at))
        if not len(bonds) or not rest.any():
            return None
        self.bonds = bonds[np.argsort(self.broken_at[bonds], kind="stable")]
        hours = (birth - scene.times) / np.timedelta64(1, "h")
        window = np.flatnonzero((hours <= HOURS_BEFORE) & (hours > 0.0)).tolist()
        loads = [load for k in window if (load := self.load(k, last_record)) is not None]
        if not loads:
            return None
        # The load that began the breaking: the largest from the last record before the first failure to the birth.
        first_break = self.broken_at[self.bonds[0]]
        self.last_whole = max(int(np.searchsorted(scene.times, first_break)) - 1, 0)
        late = [load for load in loads if load.time >= iso(scene.times[self.last_whole])] or loads[-1:]
        decisive = max(late, key=lambda load: load.nominal)
        record = int(np.searchsorted(scene.times, np.datetime64(decisive.time)))
        x, y = ("lon", "lat") if scene.latlon else ("x", "y")
        released, crack = self.released_per_area(), self.crack()
        return Breakup(
            fragment=int(run["fragment_number"].values[row]),
            parent=self.parent,
            time=iso(birth),
            lon=float(run[f"fragment_{x}"].values[row]),
            lat=float(run[f"fragment_{y}"].values[row]),
            area_km2=float(run["fragment_area"].values[row]) / 1e6,
            elements=int(run["fragment_elements"].values[row]),
            grounded=bool(run["fragment_grounded"].values[row] == 1),
            bonds=len(self.bonds),
            first_break=iso(first_break),
            decisive=decisive,
            budgets=self.budgets(record, last_record),
            closure=self.closure(record, last_record),
            first_bonds=[self.first_bond(int(b)) for b in self.bonds[:FIRST_BONDS]],
            by_strength=self.by_strength(),
            highest=self.highest_stress(),
            in_equilibrium=scene.parameters.stepping.in_equilibrium,
            sudden=self.highest_stress(over_strength=True) < SUDDEN,
            hours_since_start=float((first_break - scene.times[0]) / np.timedelta64(1, "h")),
            peak=self.highest_stress("peak_stress") if "peak_stress" in run else None,
            history=loads,
            floor_recorded=forces_recorded(run),
            latlon=scene.latlon,
            crack_km=crack.get("length"),
            crack_towards=crack.get("towards"),
            released_per_area=released,
            released_toughness=None
            if released is None
            else math.sqrt(scene.parameters.bonds.youngs_modulus * released),
            members=[int(n) for n in run["trajectory"].values[self.inside]],
        )

    def crack(self) -> dict[str, float]:
        """Return length (km) and direction (degrees) of the longest crack line of the cut, as it lay before it opened."""
        longest: dict[str, float] = {}
        for rows, points in self.scene.crack_lines(self.last_whole):
            ours = points[np.isin(rows, self.bonds)]
            if len(ours) < 2:
                continue
            east, north = ours[-1] - ours[0]
            if self.scene.latlon:
                metre = DEGREE * self.scene.radius
                east, north = east * metre * math.cos(ours[:, 1].mean() * DEGREE), north * metre
            # The line begins and ends in the middle of a bond, half of one from the side of the ice.
            km = math.hypot(east, north) / 1e3 * len(ours) / (len(ours) - 1)
            if km > longest.get("length", 0.0):
                longest = {"length": km, "towards": math.degrees(math.atan2(east, north)) % 180.0}
        return longest

    def released_per_area(self) -> float | None:
        """Return the elastic energy that the cracks of the cut released per area, J m-2: G of Griffith."""
        if "cracked_area" not in self.run:
            return None
        # Both stand with the bond at which a crack began.
        energy, area = (float(self.run[name].values[self.bonds].sum()) for name in ("released_energy", "cracked_area"))
        # None released: an impact broke it off, or the file is older and holds the stored energy.
        return energy / area if energy > 0.0 and area > 0.0 else None

    # --- forces ----------------------------------------------------------------------------------------------------

    def body(self, record: int) -> NDArray[np.bool_]:
        """Return the elements of fragment and rest at a record."""
        return np.asarray(self.inside | (self.scene.berg[record] == self.parent))

    def budgets(self, record: int, last: int) -> dict[str, Budget]:
        """Return the budgets of fragment, rest and both."""
        body, mass = self.body(record), read_mass(self.run, record)
        forces, _ = body_forces(self.scene, self.p, record, body)
        rate = accelerations(self.run, record, 0, last)
        budgets = {}
        for name, rows in (("fragment", self.inside), ("rest", body & ~self.inside), ("both", body)):
            sums = {force: [float(c) for c in values[rows].sum(axis=0)] for force, values in forces.items()}
            inertia = (mass[rows, None] * rate[rows]).sum(axis=0)
            is_finite = bool(np.isfinite(inertia).all())
            rest = inertia - np.sum(list(sums.values()), axis=0)
            budgets[name] = Budget(
                float(mass[rows].sum()),
                sums,
                inertia.tolist() if is_finite else None,
                rest.tolist() if is_finite else None,
            )
        return budgets

    def closure(self, record: int, last: int) -> float | None:
        """Return how well the budget of fragment and rest closes, at the last record afloat.

        Afloat until the next record: else the floor takes what is left, and every budget closes.
        """
        for k in range(record, max(record - 48, 0), -1):
            body, until = self.body(k), min(k + 1, len(self.scene.times) - 1)
            if not (self.scene.aground([k, until]) & body).any() and (body == self.body(record)).all():
                combined = self.budgets(k, last)["both"]
                size = sum(math.hypot(*force) for force in combined.forces.values())
                return math.hypot(*combined.residual) / size if combined.residual and size > 0.0 else None
        return None

    def load(self, record: int, last: int) -> Load | None:
        """Return the load across the cut at a record; None where no bond of it is intact."""
        intact = int((self.broken_at[self.bonds] > self.scene.times[record]).sum())
        if not intact:
            return None
        body = self.body(record)
        geometry = _Geometry(self, record, body)
        forces, aground = body_forces(self.scene, self.p, record, body)
        shares = {name: geometry.cut_load(geometry.on_plane(force)) for name, force in forces.items()}
        tension, shear, couple = ({n: s[k] for n, s in shares.items()} for k in range(3))
        sign = 1.0 if sum(couple.values()) >= 0.0 else -1.0
        section = geometry.thickness * geometry.length
        rate = accelerations(self.run, record, 0, last)
        recorded: tuple[float | None, ...] = (None, None, None)
        if np.isfinite(rate[self.inside]).all():
            recorded = geometry.across(
                geometry.on_plane(rate), geometry.on_plane(np.sum(list(forces.values()), axis=0))
            )
        return Load(
            time=iso(self.scene.times[record]),
            cut_km=geometry.length / 1e3,
            thickness=geometry.thickness,
            bonds=intact,
            tension=tension,
            shear=shear,
            couple=couple,
            stress={n: tension[n] / section + sign * 6.0 * couple[n] / (section * geometry.length) for n in tension},
            tension_recorded=recorded[0],
            couple_recorded=recorded[2],
            aground=aground,
        )

    # --- bonds -----------------------------------------------------------------------------------------------------

    def highest_stress(self, of: str = "normal_stress", *, over_strength: bool = False) -> float:
        """Return the largest tensile stress (Pa) of the parent at the last record before the first bond failed.

        With ``of="peak_stress"`` it is the largest in the sub-steps up to this record, since the one before. With
        ``over_strength`` each is divided by the strength of its bond, as far as damage has left it at that record.
        """
        body = self.body(self.last_whole)
        intact = body[self.run["bond_first"].values] & body[self.run["bond_second"].values]
        intact &= np.isnat(self.broken_at) | (self.broken_at > self.scene.times[self.last_whole])
        stress = self.run[of].isel(time=self.last_whole).values[intact]
        if over_strength:
            left = self.scene.bonds.strengths[self.last_whole][intact] * self.run["strength"].values[intact]
            if "damage" in self.run:
                left = left * (1.0 - self.run["damage"].isel(time=self.last_whole).values[intact])
            stress = stress[left > 0.0] / left[left > 0.0]
        return float(stress.max(initial=0.0))

    def by_strength(self) -> dict[str, int]:
        """Count the bonds of the cut by the strength that they exceeded; empty for files that do not hold it."""
        if "break_strength" not in self.run:
            return {}
        kinds = self.run["break_strength"].values[self.bonds]
        counts = {name: int((kinds == n).sum()) for n, name in enumerate(("normal", "shear", "flexural"), 1)}
        return {name: count for name, count in counts.items() if count}

    def first_bond(self, bond: int) -> FirstBond:
        """Return the history of a bond."""
        scene, run = self.scene, self.run
        hours = (scene.times - self.broken_at[bond]) / np.timedelta64(1, "h")
        rows = np.flatnonzero((hours >= -HOURS_BEFORE) & (hours <= 0.0))
        ends = [int(run[name].values[bond]) for name in ("bond_first", "bond_second")]
        at = int(rows[-1]) if len(rows) else 0
        strength = float(scene.bonds.strengths[at][bond] * run["strength"].values[bond])
        if "damage" in run:  # a bond keeps the damage with which it failed
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
            prestress=float(prestress(scene.thickness(at), scene.parameters.ice.density)[ends].mean()),
            hours=[round(float(h), 4) for h in hours[rows]],
            tension=[float(s) for s in history["normal_stress"].values],
            shear=[float(s) for s in history["shear_stress"].values],
            peak=[float(s) for s in history["peak_stress"].values] if "peak_stress" in run else [],
        )


class _Geometry:
    """Plane geometry of a body and its cut at a record; metres from the centre of mass."""

    def __init__(self, cut: Cut, record: int, body: NDArray[np.bool_]) -> None:
        scene, run = cut.scene, cut.run
        self.mass, self.body, self.inside = read_mass(run, record), body, cut.inside
        lon, lat, weight = scene.x[record], scene.y[record], self.mass[body]
        centre = float(np.average(lon[body], weights=weight)), float(np.average(lat[body], weights=weight))
        plane = ConformalPlane(*centre, scene.radius, scene.latlon)
        x, y = plane.forward(lon, lat)
        self.x, self.y = x - np.average(x[body], weights=weight), y - np.average(y[body], weights=weight)
        self.angle = plane.eastward(lon, lat)
        # Each element turns with the body, as a square of its area.
        area = scene.areas[record]
        self.inertia = float((weight * (self.x[body] ** 2 + self.y[body] ** 2 + area[body] / 6.0)).sum())
        # The cut is the line through the middles of its bonds; its normal points to the fragment.
        first, second = run["bond_first"].values[cut.bonds], run["bond_second"].values[cut.bonds]
        inner, outer = np.where(self.inside[first], (first, second), (second, first))
        positions = np.column_stack([self.x, self.y])
        middle, side = 0.5 * (positions[inner] + positions[outer]), float(np.sqrt(area[inner].mean()))
        self.centre = middle.mean(axis=0)
        spread = middle - self.centre
        values, axes = np.linalg.eigh(spread.T @ spread)
        towards = (positions[inner] - positions[outer]).sum(axis=0)
        # A short or crooked cut has no direction of its own; its bonds have.
        straight = values[1] > 4.0 * values[0] and np.sqrt(values[1]) > 0.5 * side
        normal = axes[:, 0] if straight else towards
        size = float(np.hypot(*normal))
        normal = normal / size if size > 0.0 else np.array([1.0, 0.0])
        self.normal = normal if normal @ towards >= 0.0 else -normal
        self.length = float(np.ptp(middle @ np.array([-self.normal[1], self.normal[0]]))) + side
        self.thickness = float(run["thickness"].isel(time=record).values[np.r_[inner, outer]].mean())

    def on_plane(self, vectors: Floats) -> Floats:
        """Turn vectors given east and north onto the plane."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        return np.stack([c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]], axis=-1)

    def cut_load(self, force: Floats) -> tuple[float, float, float]:
        """Return tension, shear and couple that the cut passes on to the fragment if this force acts alone."""
        b, linear = self.body, force[self.body].sum(axis=0) / self.mass[self.body].sum()
        angular = float((self.x[b] * force[b, 1] - self.y[b] * force[b, 0]).sum()) / self.inertia
        rigid = np.stack([linear[0] - angular * self.y, linear[1] + angular * self.x], axis=-1)
        return self.across(rigid, force)

    def across(self, rate: Floats, force: Floats) -> tuple[float, float, float]:
        """Return tension, shear and couple of the cut, if elements accelerate so under a force; tension pulls to the rest."""
        a, needed = self.inside, self.mass[:, None] * rate - force
        fx, fy = needed[a].sum(axis=0)
        couple = ((self.x[a] - self.centre[0]) * needed[a, 1] - (self.y[a] - self.centre[1]) * needed[a, 0]).sum()
        n = self.normal
        return -float(fx * n[0] + fy * n[1]), float(-fx * n[1] + fy * n[0]), float(couple)


def iso(moment: np.datetime64) -> str:
    """Return a date as text, to the second."""
    return str(np.datetime_as_string(moment, unit="s"))
