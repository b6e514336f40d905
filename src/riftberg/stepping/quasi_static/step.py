"""Quasi-static stepping: fragments move as rigid bodies, their lattices stand in equilibrium with the loads.

One long step: the fragments move (`riftberg.stepping.bodies.dynamics`), the forces at the new place load the lattice, and
its equilibrium (`riftberg.stepping.lattice.equilibrium`) gives the stresses. Where a bond is overloaded, the step is cut
where the first one fails, the crack runs (`riftberg.stepping.fracture.strengths`), the pieces become bodies of their own, and the
rest of the step follows. Elastic waves are left out: they pass within minutes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import plain
from riftberg.errors import RunError
from riftberg.ocean.cells import settle_elements
from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Floats, Ints
from riftberg.state.neighbours import OTHER_BERG, PairList, find_pairs, no_pairs
from riftberg.stepping.bodies.pose import Bodies, flat_shape, free_bodies, place, regrouped
from riftberg.stepping.bodies.dynamics import BodyMotion, BodyRoom, allocate_body_room, touching_pairs
from riftberg.stepping.contact.broad_phase import NEWBORN_CHILD, among, pairs_that_may_meet
from riftberg.stepping.contact.groups import NOBODY, joined
from riftberg.stepping.contact.islands import Blow, Meeting, blow_on_all, caught_up, meet
from riftberg.stepping.contact.land import leaders, led, ways_back
from riftberg.stepping.forces.interactions import pair_law
from riftberg.stepping.forces.media import FORCES
from riftberg.stepping.forces.sizes import Sizes, interaction_sizes
from riftberg.stepping.fracture.criteria import (
    AveragedStress,
    BondStress,
    Criterion,
    Equilibrium,
    characteristic_distance,
)
from riftberg.stepping.fracture.strengths import Limits, keep_peaks, limits_of, store_stresses, wear
from riftberg.stepping.fragments.connectivity import connected_parts, drop_broken_bonds, drop_parted_bonds
from riftberg.stepping.lattice.equilibrium import (
    ElasticLattice,
    Factors,
    Holds,
    balanced_loads,
    elastic_energy,
    find_lattice,
)
from riftberg.stepping.quasi_static.rigid_step import (
    Standing,
    arrive,
    close_alone,
    depart,
    keep_applied_forces,
    motion_at,
    relax,
)
from riftberg.stepping.quasi_static.sync import Left, followed, left_by
from riftberg.stepping.run_state import RunState

EVENTS = 64
"""Cracks begin at most this often in a long step: overloads that follow each other sooner are met together."""

TOUCHDOWN = 64
"""Part of the shortest landing step within which the moment is found at which an element touches down."""

MOST_CORRECTIONS = 90
"""Columns of Woodbury's formula beyond which the matrix is factored anew."""


@dataclass
class Structure:
    """The lattice between two breaks: places of the elements in their fragments, bonds that hold, factors, criterion."""

    flat: Floats
    lattice: ElasticLattice
    alive: Ints
    holds: Holds
    factors: Factors
    criterion: Criterion
    latest: Equilibrium | None = None
    known: tuple[tuple[int, bytes, bytes], Limits] | None = None

    def limits(self, bonds: Bonds, p: KernelParameters) -> Limits:
        """Return the strengths that the bonds that hold have left, found anew where strength or damage has changed."""
        key = self.alive.size, bonds.strength.tobytes(), bonds.damage.tobytes()
        if self.known is None or self.known[0] != key:
            self.known = key, limits_of(bonds, self.alive, p)
        return self.known[1]

    def under(self, bend: Floats, p: KernelParameters) -> Equilibrium:
        """Return the equilibrium with these displacements, whose stresses are found once for all that ask one after the other."""
        known = self.latest
        if known is None or known.bend is not bend or known.alive is not self.alive:
            self.latest = known = Equilibrium(self.lattice, self.alive, bend, p)
        return known


class QuasiStaticStepper:
    """Rigid bodies with lattices in equilibrium."""

    def __init__(self) -> None:
        self._bodies: Bodies | None = None
        self._structure: Structure | None = None
        self._now: Standing | None = None
        self._applied = np.zeros((0, len(FORCES), 2))
        self._ice: list[bytes] = []
        self._sizes: Sizes | None = None
        self._room: BodyRoom | None = None
        self._touched = NOBODY
        self._left: Left | None = None
        self._began: tuple[float, Bodies | None, Left | None] = math.nan, None, None  # the last step

    @property
    def applied(self) -> Floats:
        """See `riftberg.stepping.schemes.Stepper.applied`: means of both ends of each step, by its length."""
        return self._applied

    @property
    def touched(self) -> tuple[Ints, Ints]:
        """See `riftberg.stepping.schemes.Stepper.touched`."""
        return self._touched

    def memory(self) -> dict[str, Any]:
        """Return what a restart file must hold beside the state."""
        bodies = {} if self._bodies is None else dict(zip(MEMORY, self._bodies, strict=True))
        return bodies if self._left is None else {**bodies, **dict(zip(MEMORY_LEFT, self._left, strict=True))}

    def recall(self, kept: Mapping[str, Any]) -> None:
        """Take up what `memory` gave."""
        if all(name in kept for name in MEMORY):
            body, *rest = (np.asarray(kept[name]) for name in MEMORY)
            self._bodies = Bodies(body.astype(np.int64), *(np.array(a, np.float64) for a in rest))
        if all(name in kept for name in MEMORY_LEFT):  # files of earlier versions lack it
            ids, *rest = (np.asarray(kept[name]) for name in MEMORY_LEFT)
            self._left = Left(ids.astype(np.int64), *(np.array(a, np.float64) for a in rest))

    def surround(self, model: RunState) -> None:
        """Sample at the present positions."""
        model.forcing.sample(model.elements, model.time)

    def synchronised(self, model: RunState) -> tuple[Floats, Floats]:
        """Return the velocity, which belongs to the positions."""
        return model.elements.u_sync.copy(), model.elements.v_sync.copy()

    def step(self, model: RunState) -> None:
        """Advance by one long step."""
        if self._began[0] == model.time:  # the last step was taken back, after it had been taken here
            (_, self._bodies, self._left), self._now = self._began, None
        self._began = model.time, self._bodies, self._left
        unknown = self._follow_changes(model)
        step = LongStep(model, self._bodies, self._structure, self._now, self._sizes, unknown)
        step.room = step.room or self._room
        self._structure = self._now = None  # a step that fails leaves them half changed
        step.run()
        self._bodies, self._structure, self._now = step.now.bodies, step.structure, (None if step.cracked else step.now)
        self._applied = step.applied
        self._touched = joined(step.touched)
        self._sizes, self._room = step.sizes, step.room
        if step.cracked:
            self._ice = _ice(model)
        self._left = left_by(model.elements)
        model.time = step.start + model.parameters.stepping.time_step

    def _follow_changes(self, model: RunState) -> NDArray[np.bool_] | None:
        """Forget the lattice where ice, bonds or supports have changed, and follow what happened to the bodies.

        Returns which bodies take the velocity of their elements; None where all are as the last step has left them.
        """
        now, count = _ice(model), model.elements.size
        rows, same = self._ice[:HANGS] == now[:HANGS], self._ice == now
        if self._ice and not same:
            self._structure = self._now = self._sizes = None
        self._ice = now
        if self._bodies is None:
            return None
        if self._left is None or self._left.id.size != self._bodies.body.size:
            self._bodies = self._bodies if self._bodies.body.size == count else None
        elif not (rows and self._left.is_still(model.elements)):
            bodies, unknown = followed(model.elements, model.bonds, self._bodies, self._left, model.constants)
            self._now = None  # loads may be other ones
            if unknown.any() or not np.array_equal(bodies.body, self._bodies.body):
                self._bodies, self._structure = bodies, None
                return unknown
        return None


def _ice(model: RunState) -> list[bytes]:
    """What frames and lattice are made of: elements, supports, bonds that hold, and ice; as bytes, which compare quickly."""
    body, bonds = model.elements.body, model.bonds
    kept = body.id, body.static, body.free_y, bonds.id, bonds.status, body.mass, body.thickness, body.length, body.width
    return [array.tobytes() for array in kept]


HANGS = 5
"""How many of them say which elements there are, and what holds them together and in place."""

MEMORY = ("rigid_body", "rigid_shape", "rigid_pose", "rigid_rate", "rigid_bend")
"""Names of the fields of `Bodies` in a restart file."""

MEMORY_LEFT = tuple(f"rigid_left_{name}" for name in Left._fields)
"""Names of the fields of `Left` there."""


class LongStep:
    """One long step of a model."""

    def __init__(
        self, model: RunState, bodies: Bodies | None, structure: Structure | None, now: Standing | None,
        sizes: Sizes | None, unknown: NDArray[np.bool_] | None = None,
    ) -> None:  # fmt: skip
        self.model, self.el, self.bonds, self.c = model, model.elements, model.bonds, model.constants
        self.sizes: Sizes = sizes or interaction_sizes(self.el, self.c)
        self.start, self.cracked = model.time, False
        self.applied = np.zeros((self.el.size, len(FORCES), 2))
        self.touched: list[tuple[Ints, Ints]] = []
        self._soon = math.inf  # longest next part, s
        self._near = no_pairs(self.el.mass.size)
        self.meeting: Meeting | None = None  # of the last step
        self._blown: tuple[Meeting, Equilibrium] | None = None
        self.room: BodyRoom | None = None
        fresh = bodies is None or unknown is not None
        bodies = self._first_bodies() if bodies is None else bodies
        self.structure = structure or self._build(bodies)
        if unknown is not None:
            bodies = bodies._replace(rate=np.where(unknown[:, None], self._rates(bodies), bodies.rate))
        self.now = now or self._moment(bodies, model.time)
        if fresh:
            self._bend()
        self.seat = self.now.bodies.bend
        self.bonds.peak_stress[self.structure.alive] = self._equilibrium().stress[:, 0]

    def run(self) -> None:
        """Go to the end of the long step, over breaks and landings."""
        p = self.model.parameters
        end, dt = self.start + p.stepping.time_step, p.stepping.time_step
        may_break = p.fracture.enabled and not (self.model.step_number == 0 and p.fracture.not_in_first_step)
        if may_break and self.model.step_number == 0:
            self._crack(-1)
        longest = dt
        while (left := end - self.now.time) > 1e-9 * dt:
            pieces = math.ceil(left / longest - 1e-9)
            h, self._soon = min(left / pieces, self._soon), math.inf
            longest = min(longest, self._go(h, dt, may_break))
            if self.meeting is not None or end - self.now.time > 1e-9 * dt:  # the last equilibrium is stored below
                self._peak()
        self._store(self._equilibrium())

    def _go(self, h: float, dt: float, may_break: bool) -> float:
        """Take one step of at most ``h`` s, up to the first break; returns the longest step that is right from here on."""
        landing = dt / self.model.parameters.stepping.landing_steps
        before, kept = self.now, self._keep()
        taken = h
        aground = before.motion.load.aground
        self._advance(h)
        if h > landing * (1.0 + 1e-9) and self._touch_changed(aground):
            # An element has touched down or come off: shorter steps, for the rest of this long step.
            self._back(before, kept)
            return landing
        landed = False
        if landing < dt and self._landed(aground):
            h = taken = self._touchdown(before, kept, h, landing / TOUCHDOWN)
            landed = self._landed(aground)
        if may_break:
            s, limits = self.structure, self.structure.limits(self.bonds, self.c)
            least = dt / EVENTS if self.cracked else 0.0
            if self._fails(self._struck()):
                taken = self._broken_by_blow(before, kept, h, least)
                self._apply(before, taken)
                self._crack(-1)
                return dt
            place, share = s.criterion.first_break(before.bodies.bend, self._equilibrium(), limits)
            if place >= 0:
                # The load of a landing sets in at its end, not evenly over the step.
                if (short := max(share * h, least)) < h * (1.0 - 1e-9) and not landed:
                    self._back(before, kept)
                    self._advance(short)
                    taken = short
                self._apply(before, taken)
                self._crack(int(s.alive[s.criterion.bond_at(place, self._equilibrium(), limits)]))
                return dt
        self._apply(before, taken)
        return dt

    def _landed(self, aground: Floats) -> bool:
        """Whether an element touches the floor that did not by ``aground``."""
        now = self.now.motion.load.aground
        return now.tobytes() != aground.tobytes() and bool(((now > 0.0) & (aground == 0.0)).any())

    def _touch_changed(self, aground: Floats) -> bool:
        """Whether an element touches the floor that did not by ``aground``, or the other way round."""
        now = self.now.motion.load.aground
        # Afloat, as nearly always, the bytes are the same, and compared quickly.
        return now.tobytes() != aground.tobytes() and bool(((now > 0.0) != (aground > 0.0)).any())

    def _touchdown(self, before: Standing, kept: list[np.ndarray], h: float, near: float) -> float:
        """Shorten a step in which an element touches down: it ends before, and the next one just after; returns its length.

        The force of the floor sets in at once and then slows the fragment: stress is largest at the moment of touching. A
        step that ends within ``near`` s after it begins is left as it is.
        """
        free, landed = 0.0, h
        while landed - free > near:
            middle = 0.5 * (free + landed)
            self._back(before, kept)
            self._advance(middle)
            free, landed = (free, middle) if self._landed(before.motion.load.aground) else (middle, landed)
        if h <= near:
            return h
        self._back(before, kept)
        self._advance(free or landed)
        if free:
            self._soon = 1.5 * (landed - free)
        return free or landed

    def _peak(self) -> None:
        """Keep the largest stress of each bond within the long step."""
        for moment in (self._equilibrium(), self._struck()):
            if moment is not None:
                keep_peaks(self.bonds.peak_stress, self.structure.alive, moment.stress)

    def _apply(self, before: Standing, taken: float) -> None:
        """Keep the forces of a step of ``taken`` s: the mean of both ends, by its part of the long step."""
        dt, met = self.model.parameters.stepping.time_step, self.meeting
        earlier = self.applied[met.rows] if met else self.applied[:0]
        part, room = 0.5 * taken / dt, self._room_for(self.now.bodies)
        keep_applied_forces(before, self.now, 0.5 * taken, part, self.applied, room)
        self.touched.append((self.now.motion.touching.first, self.now.motion.touching.second))
        if met is not None:
            self.applied[met.rows] = earlier + met.applied / dt
            self.touched.append((met.first, met.second))

    def _keep(self) -> list[np.ndarray]:
        """Return what a trial step changes and the next trial needs as it was; all else is found anew."""
        el = self.el
        return [array.copy() for array in (*el.place, *el.shown, el.motion.rotation, self.bonds.damage)]

    def _back(self, before: Standing, kept: list[np.ndarray]) -> None:
        """Return to the start of a trial step."""
        el = self.el
        for array, values in zip((*el.place, *el.shown, el.motion.rotation, self.bonds.damage), kept, strict=True):
            array[:] = values
        self.now, self.meeting = before, None

    def _advance(self, h: float) -> None:
        """Move the fragments over ``h`` s and find loads and equilibrium at the new place."""
        c, now = self.c, self.now
        met = self.meeting = self._meet(h)
        bodies = self._place(depart(self.el, now, self.seat, h, c, self._room_for(now.bodies), met))
        self.model.forcing.sample(self.el, now.time + h)
        motion = self._motion(bodies)
        if met is None:
            self.now = self._loaded(bodies, motion, now.time + h, now.bodies.rate, 0.5 * h)
        else:
            rate = close_alone(motion, bodies.rate, now.bodies.rate, 0.5 * h, met.bodies, self._room_for(bodies))
            rate, self.meeting = caught_up(met, now.motion, motion, rate, h)
            self.now = self._loaded(bodies._replace(rate=rate), motion, now.time + h)
        before = now.bodies.bend
        self._bend()
        if self.model.parameters.damage.enabled:
            s = self.structure
            middle = Equilibrium(s.lattice, s.alive, 0.5 * (before + self.now.bodies.bend), c)
            wear(self.bonds, s.alive, s.criterion.ratios(middle, limits_of(self.bonds, s.alive, c)), h, c)

    def _meet(self, h: float) -> Meeting | None:
        """Let the fragments that may touch each other within ``h`` s do so."""
        now, c = self.now, self.c
        if now.bodies.pose.shape[0] < 2:
            return None
        first, second = pairs_that_may_meet(self.el, now.bodies.body, self.sizes, h, c)
        try:
            return meet(self.el, now.motion, now.bodies.rate, first, second, h, self.sizes, c)
        except FloatingPointError:
            raise RunError(
                f"the velocities of bergs in contact did not settle at {self.model.date:%Y-%m-%d %H:%M}"
            ) from None

    def _place(self, bodies: Bodies) -> Bodies:
        """Set the cells of the elements; where land stops one, its fragment goes back as a whole, with those in its way."""
        el, c, grid = self.el, self.c, self.model.forcing.grid
        for n in range(5):
            if grid is None:
                break
            if n > 0:
                # The floor slows an element, it does not throw it back: displacements stay for the whole long step.
                seated = bodies._replace(bend=self.seat)
                place(seated, el.lon, el.lat, el.static, c.latlon, c.earth_radius, c.period)
            lon, lat = el.lon.copy(), el.lat.copy()
            settle_elements(el, grid.arrays, c)
            back = ways_back(el, lon, lat, c)
            if not back.any():
                break
            lead = leaders(el, lon, lat, back, bodies.body, c)
            bodies = bodies._replace(pose=led(bodies.pose, el, lon, lat, lead, c))
        self._show(bodies)
        return bodies

    def _show(self, bodies: Bodies) -> None:
        """Let fragments see each other as they are without load.

        Displacements lag by one step. A slender piece bends by more than its contact is pressed in: seen bent, it came out of
        contact in one step and deeper into it in the next.
        """
        el, c = self.el, self.c
        el.lon_pair[:], el.lat_pair[:] = el.lon, el.lat
        if bodies.pose.shape[0] > 1:
            straight = bodies._replace(bend=np.zeros_like(bodies.bend))
            place(straight, el.lon_pair, el.lat_pair, el.static, c.latlon, c.earth_radius, c.period)

    def _room_for(self, bodies: Bodies) -> BodyRoom:
        """Return room for the fragments."""
        if self.room is None or self.room.w.shape != bodies.pose.shape:
            self.room = allocate_body_room(bodies.pose.shape[0])
        return self.room

    def _motion(self, bodies: Bodies) -> BodyMotion:
        """Find what moves the fragments, from the environment that the elements carry."""
        el, c = self.el, self.c
        touching = touching_pairs(el, self._partners(bodies), self.sizes, plain(pair_law)(c))
        motion = motion_at(el, self.sizes, bodies, touching, c, self._room_for(bodies))
        s = self.structure
        for b, inside in self._supported(bodies):
            # Fragments with supports move only as these allow.
            z = s.holds.modes(inside, s.flat)
            motion.mobility[b] = z @ np.linalg.solve(z.T @ motion.inertia[b] @ z, z.T) if z.size else 0.0
        return motion

    def _partners(self, bodies: Bodies) -> PairList:
        """Elements of other fragments within reach of contact."""
        el, c = self.el, self.c
        if not c.interactions or bodies.pose.shape[0] < 2:
            return self._near
        reach = max(2.0 * float(self.sizes.radius.max()), c.contact_distance)
        pairs = find_pairs(el.lon_pair, el.lat_pair, bodies.body, reach, OTHER_BERG, c.latlon, c.earth_radius, c.period)
        newborn = el.life.fl_k == NEWBORN_CHILD
        return among(pairs, ~newborn) if newborn.any() else pairs

    def _supported(self, bodies: Bodies) -> list[tuple[int, Ints]]:
        """Fragments with supports, and their elements."""
        if not self.structure.holds.any:
            return []
        held = np.unique(bodies.body[(self.el.static >= 0.5) | (self.el.free_y < 0.5)])
        return [(int(b), np.flatnonzero(bodies.body == b)) for b in held]

    def _moment(self, bodies: Bodies, time: float) -> Standing:
        return self._loaded(bodies, self._motion(bodies), time)

    def _loaded(
        self, bodies: Bodies, motion: BodyMotion, time: float, before: Floats | None = None, half: float = 0.0
    ) -> Standing:
        """Forces and loads of a moment; see `riftberg.stepping.quasi_static.rigid_step.arrive`."""
        s = self.structure
        now = arrive(self.el, s.flat, bodies, motion, time, before, half, self._room_for(bodies))
        self._hold(now, now.load, motion.elements[:, 9:11], now.force)
        return now

    def _hold(self, now: Standing, balanced: Floats, turn: Floats, force: Floats) -> None:
        """Put the loads of fragments with supports, which carry a part of them, into those of free fragments."""
        s, load = self.structure, now.motion.load
        for _, inside in self._supported(now.bodies):
            z = s.holds.modes(inside, s.flat)
            balanced[inside] = _supported_loads(inside, z, s.flat, turn, force, load.mass, load.inertia)

    def _bend(self) -> None:
        """Find the equilibrium under the present loads."""
        now = self.now
        bend = self.structure.factors.solve(now.load)
        shifted = np.zeros(now.bodies.pose.shape[0], np.bool_)
        for b, _ in self._supported(now.bodies):
            shifted[b] = True
        if not relax(now.bodies, now.motion.load, self.structure.flat, bend, self.el.rotation, shifted):
            raise RunError(f"the equilibrium of the lattice is not a number at {self.model.date:%Y-%m-%d %H:%M}")
        self.now = now._replace(bodies=now.bodies._replace(bend=bend))

    # Blows

    def _struck(self) -> Equilibrium | None:
        """Return the equilibrium under the heaviest loads of contact in the last step; None where no bonded berg was touched."""
        met, s = self.meeting, self.structure
        if met is None or not met.blow.rows.size:
            return None
        if self._blown is None or self._blown[0] is not met:
            self._blown = met, Equilibrium(s.lattice, s.alive, s.factors.solve(self._load(met.blow)), self.c)
        return self._blown[1]

    def _load(self, blow: Blow) -> Floats:
        """Balanced loads with those of a blow, each fragment's at its own moment."""
        now, load, s = self.now, self.now.motion.load, self.structure
        force, turn, spin = blow_on_all(blow, self.el.size, now.bodies.pose.shape[0])
        struck = balanced_loads(now.bodies.body, s.flat, turn, force, load.mass, load.inertia, spin)
        self._hold(now, struck, turn, force)
        balanced = now.load.copy()
        balanced[blow.rows] = struck[blow.rows]
        return balanced

    def _fails(self, moment: Equilibrium | None) -> bool:
        """Whether a bond is overloaded."""
        return moment is not None and self._overloaded(moment) >= 0

    def _broken_by_blow(self, before: Standing, kept: list[np.ndarray], h: float, least: float) -> float:
        """Shorten a step in which contact breaks a bond to the moment at which the first is overloaded; returns its length.

        Sub-steps of contact are resolved to a sixteenth. The lattice then stands under the heaviest loads up to there.
        """
        met = self.meeting
        near = met.shortest / 16.0 if met else h
        whole, failed, least = 0.0, h, min(least, 16.0 * near)
        while failed - whole > near and failed > least:
            middle = 0.5 * (whole + failed)
            self._back(before, kept)
            self._advance(middle)
            fails = self._fails(self._struck()) or self._fails(self._equilibrium())
            whole, failed = (whole, middle) if fails else (middle, failed)
        taken = min(max(failed, least), h)
        self._back(before, kept)
        self._advance(taken)
        if self.meeting is not None and self._struck() is not None and not self._fails(self._equilibrium()):
            self.now = self.now._replace(load=self._load(self.meeting.blow))
            self._bend()
        return taken

    # Breaking

    def _crack(self, first: int) -> None:
        """Break bonds until none is overloaded; ``first`` breaks in any case (-1: only if it is overloaded)."""
        now = self._equilibrium()
        self._store(now)
        overloaded = self._overloaded(now)
        bond = overloaded if overloaded >= 0 else first
        if bond < 0:
            return
        self.cracked, self.meeting = True, None
        whole = elastic_energy(self.now.bodies.bend, self.now.load)
        starter = bond
        while bond >= 0:
            self._break(bond)
            now = self._equilibrium()
            bond = self._overloaded(now)
            if bond >= 0:
                self._store(now)
        self._released(starter, whole - elastic_energy(self.now.bodies.bend, self.now.load))
        self._settle_fragments()

    def _equilibrium(self) -> Equilibrium:
        """Return the present equilibrium."""
        return self.structure.under(self.now.bodies.bend, self.c)

    def _overloaded(self, now: Equilibrium) -> int:
        """Row in the state of the bond that breaks next, or -1 where none is overloaded."""
        criterion, limits = self.structure.criterion, limits_of(self.bonds, now.alive, self.c)
        row, ratio = criterion.worst(now, limits)
        return int(now.alive[criterion.bond_at(row, now, limits)]) if ratio > 1.0 else -1

    def _released(self, bond: int, energy: float) -> None:
        """Note the energy (J) that a crack has released with the bond that began it."""
        self.bonds.released_energy[bond] = energy

    def _break(self, bond: int) -> None:
        """Break one bond and find the equilibrium without it, with new bodies where a piece has parted."""
        el, bonds, s = self.el, self.bonds, self.structure
        i, j = bonds.first[bond], bonds.second[bond]
        aground = self.now.motion.load.aground
        bonds.status[bond] = 1
        bonds.break_time[bond] = self.now.time
        bonds.break_grounded[bond] = 1 if aground[i] > 0.0 or aground[j] > 0.0 else 0
        el.bond_count[i] -= 1
        el.bond_count[j] -= 1
        body = connected_parts(el.mass.size, bonds.first, bonds.second, bonds.status)
        if int(body.max()) + 1 != self.now.bodies.pose.shape[0]:
            # Pieces part where they stand: a crack runs faster than ice moves. Its last bonds would let them turn by 30 degrees.
            load, standing = self.now.motion.load, self.now.bodies._replace(bend=self.seat)
            el.rotation[:] += self.seat[:, 2] - self.now.bodies.bend[:, 2]
            bodies = regrouped(standing, body, load.mass, load.inertia, self.c.latlon, self.c.earth_radius)
            self.seat = bodies.bend
            self.structure = self._build(bodies)
            self._show(bodies)
            self.now = self._moment(bodies, self.now.time)
        elif s.factors.corrections >= MOST_CORRECTIONS:
            self.structure = self._build(self.now.bodies)
        else:
            s.factors.without(bond)
            s.alive = s.alive[s.alive != bond]
        self._bend()

    def _settle_fragments(self) -> None:
        """Number the fragments anew, and start from fresh factors, which a restarted run has too."""
        model, el, bonds = self.model, self.el, self.bonds
        if self.c.broken_as_contact:
            drop_parted_bonds(bonds, connected_parts(el.mass.size, bonds.first, bonds.second, bonds.status))
        else:
            drop_broken_bonds(bonds)
        model.fragments.update(el, bonds, self.now.time, self.c)
        self.structure = self._build(self.now.bodies)
        self.now = self._moment(self.now.bodies, self.now.time)

    # Set-up and output

    def _first_bodies(self) -> Bodies:
        """Make bodies of the elements as they stand, free of load, with the rigid motion nearest to their velocities."""
        el, bonds, c = self.el, self.bonds, self.c
        body = connected_parts(el.mass.size, bonds.first, bonds.second, bonds.status)
        bodies = free_bodies(el.lon, el.lat, body, el.mass, c.latlon, c.earth_radius, c.period)
        self.structure = self._build(bodies)
        return bodies._replace(rate=self._rates(bodies))

    def _rates(self, bodies: Bodies) -> Floats:
        """Return the rigid motions nearest to the velocities of the elements, of the same momentum."""
        el, body, motion = self.el, bodies.body, self._motion(bodies)
        m, load = motion.elements, motion.load
        momentum = load.mass[:, None] * (m[:, 0:3] * el.u[:, None] + m[:, 3:6] * el.v[:, None])
        momentum += (load.inertia * el.spin)[:, None] * m[:, 6:9]
        sums = np.array([np.bincount(body, momentum[:, k], bodies.pose.shape[0]) for k in range(3)]).T
        return np.asarray((motion.mobility @ sums[:, :, None])[:, :, 0])

    def _build(self, bodies: Bodies) -> Structure:
        """Describe and factor the lattice of the bonds that hold."""
        el, bonds, c = self.el, self.bonds, self.c
        flat = flat_shape(bodies.shape, c.latlon, c.earth_radius)
        lattice = find_lattice(bonds, flat, el.thickness, self.sizes, c)
        alive = np.flatnonzero(bonds.status == 0)
        holds = Holds(el.static, el.free_y)
        factors = Factors(lattice, alive, holds, holds.springs(bodies.body, flat))
        return Structure(flat, lattice, alive, holds, factors, self._criterion(lattice, alive, flat, bodies.body))

    def _criterion(self, lattice: ElasticLattice, alive: Ints, flat: Floats, body: Ints) -> Criterion:
        """What decides that bonds of this lattice break."""
        fracture, el = self.model.parameters.fracture, self.el
        if fracture.criterion == "bond":
            return BondStress(lattice, self.c)
        volume = el.length * el.width * el.thickness
        return AveragedStress(lattice, alive, flat, body, volume, characteristic_distance(fracture), self.c)

    def _store(self, now: Equilibrium) -> None:
        """Write stresses and deformations to the state."""
        store_stresses(self.bonds, now.lattice, now.alive, now.deformation, now.stress, self.now.motion.elements)


def _supported_loads(
    inside: Ints, z: Floats, flat: Floats, turn: Floats, force: Floats, mass: Floats, inertia: Floats
) -> Floats:
    """Loads on a fragment with supports: forces less what moves it in the rigid motions ``z`` that they allow."""
    c, s, f, m = turn[inside, 0], turn[inside, 1], force[inside], mass[inside]
    load = np.column_stack([c * f[:, 0] + s * f[:, 1], c * f[:, 1] - s * f[:, 0], f[:, 2]])
    if not z.size:
        return load
    x, y = flat[inside].T
    one, none = np.ones(inside.size), np.zeros(inside.size)
    rows = np.stack([np.array([one, none, -y]), np.array([none, one, x]), np.array([none, none, one])])
    weight = np.stack([m, m, inertia[inside]])
    matrix = np.einsum("ran,rn,rbn->ab", rows, weight, rows)
    sums = np.einsum("ran,nr->a", rows, load)
    acceleration = z @ np.linalg.solve(z.T @ matrix @ z, z.T @ sums)
    return np.asarray(load - (weight * np.einsum("ran,a->rn", rows, acceleration)).T)
