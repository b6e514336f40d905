"""The ledger of motion: what momentum and mechanical energy the bergs got, by force, and what became of it.

Momentum is that of the elements, with what the last explicit accelerations still have to give: forces change it to round-off.
What is left over in a step is what elements did to each other; by Newton's third law that is nothing, but where land stops one.

Work of a force is its momentum times the mean of the velocities before and after it has acted; together they make the change of
kinetic energy of a single element exactly. What is left over is the work of bonds and contacts: energy that goes into bonds, or
is dissipated there.
The impulse of supports is what their berg needs to stay in its place; they do no work.

Sums over spheres are of eastward and northward parts, as the explicit schemes step them. A fragment of the quasi-static
scheme keeps its own axes on its way, which turn against east and north: that shows as left over, some 1e-4 of what was given.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from riftberg.bergs.bonding import Metric, pieces, separations
from riftberg.bergs.lattice import Booleans
from riftberg.compiled.kernels import borrower, kernel, plain
from riftberg.engines.common.forces.media import CORIOLIS, FORCES, OWN, SEA_FLOOR
from riftberg.engines.common.forces.sizes import disc_inertia, interaction_radius, interaction_sizes, rectangle_inertia
from riftberg.errors import InputError
from riftberg.parameters import Parameters
from riftberg.physics.bonds import bond_section
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.neighbours import ANY, find_pairs

if TYPE_CHECKING:
    from riftberg.engines.common.run_state import RunState

GIVERS: Final = (*FORCES, "loads", "supports", "time_step", "elements", "life", "other")
"""What changes momentum and energy: forces from outside, given loads and the supports that hold them, the error of the time
step in a Coriolis force that does no work, elements among each other (with land), melt and births, processes of the user."""

LOADS, SUPPORTS, TIME_STEP, ELEMENTS, OTHER = map(GIVERS.index, ("loads", "supports", "time_step", "elements", "other"))

START, NOW, BONDS = range(len(GIVERS), len(GIVERS) + 3)
"""Rows after those of the givers: stock at the start, stock now; elastic energy at the start, released by cracks, lost by
crushing."""

KEPT, KEPT_ON_BED = "motion_ledger", "motion_on_bed"
"""Names under which a restart keeps the ledger, and the work of friction on a bed of sediment beside it."""

CLOSES: Final = 1e-9
"""Largest part of the momentum given that may be left over between bonded elements."""


class MotionBalance(NamedTuple):
    """The ledger of motion between two moments."""

    momentum_start: tuple[float, float]  # East and north, N s
    momentum_now: tuple[float, float]  # East and north, N s
    impulse: dict[str, tuple[float, float]]  # Momentum given by each of `GIVERS`, N s
    kinetic_start: float  # Kinetic energy, J, with that of spin
    kinetic_now: float  # Kinetic energy, J, with that of spin
    work: dict[str, float]  # Work of each of `GIVERS`, J
    # Elastic energy in bonds, J; None where bonds are not those of a lattice that vibrates (scheme mts, law dem)
    elastic_start: float | None
    elastic_now: float | None
    # Elastic energy that bonds held before the step in which they broke; in the quasi-static scheme that of the cracks.
    # J
    released: float
    crushed: (
        float  # Plastic work and friction of faces that crush each other, J: a part of what is lost between elements
    )
    rubbed: float  # Work of friction on a bed of sediment, J: a part of that of the sea floor
    # Momentum (N s, east and north) and work (J) of each of several laws of one's own; together those of "own".
    own: dict[str, tuple[float, float, float]]

    @property
    def momentum_error(self) -> float:
        """Momentum that elements gave each other, as part of all that was given: 0 but for round-off and land."""
        given = sum(np.hypot(*self.impulse[name]) for name in (*FORCES, "loads")) + np.hypot(*self.momentum_start)
        return float(np.hypot(*self.impulse["elements"]) / max(given, 1e-30))

    @property
    def dissipated(self) -> float | None:
        """Energy lost in dampers, contacts and at land, with the error of the time steps, J; None where bonds are unknown."""
        if self.elastic_start is None or self.elastic_now is None:
            return None
        return -self.work["elements"] - (self.elastic_now - self.elastic_start) - self.released

    def as_dict(self) -> dict[str, Any]:
        """Return the ledger with what follows from it, for a summary."""
        return {**self._asdict(), "dissipated": self.dissipated, "momentum_error": self.momentum_error}

    def closing(self) -> str:
        """Return in one line to which part of what was given the ledger closes."""
        lost = self.work["elements"] if self.dissipated is None else -self.dissipated
        turned = max(sum(abs(w) for name, w in self.work.items() if name != "elements"), abs(self.kinetic_start), 1e-30)
        ends = "between elements" if self.dissipated is None else "dissipated"
        return (
            f"motion: momentum closes to {self.momentum_error:.0e} of what was given; {ends} {abs(lost) / turned:.1g} "
            "of the energy given"
        )

    def lines(self) -> list[str]:
        """Return the ledger as two lines of text."""
        (east, north), (was_east, was_north) = self.momentum_now, self.momentum_start
        given = [
            f"{_shown(name)} {x:+.3g}, {y:+.3g}"
            for name, (x, y) in self.impulse.items() if name != "elements" and (x or y)
        ]  # fmt: skip
        work = [f"{_shown(name)} {w:+.3g}" for name, w in self.work.items() if name != "elements" and w]
        if self.rubbed:
            work.append(f"of that of the sea floor friction {-self.rubbed:+.3g}")
        given += [f"of it {name} {x:+.3g}, {y:+.3g}" for name, (x, y, _) in self.own.items()]
        work += [f"of it {name} {w:+.3g}" for name, (_, _, w) in self.own.items()]
        ends = [f"kinetic {self.kinetic_start:.3g} to {self.kinetic_now:.3g}"]
        if self.dissipated is None:
            between = self.work["elements"]
            ends.append(f"between elements {between:+.3g}")
            if self.crushed:
                ends[-1] += (
                    f" (crushing and friction {-self.crushed:+.3g}, time steps and land {between + self.crushed:+.3g})"
                )
        else:
            ends.append(
                f"in bonds {self.elastic_start:.3g} to {self.elastic_now:.3g}, dissipated {self.dissipated:.3g}"
            )
        ends += [f"released by cracks {self.released:.3g}"] if self.released else []
        return [
            f"momentum (east, north; N s): {was_east:.3g}, {was_north:.3g} to {east:.3g}, {north:.3g}; "
            f"{'; '.join(given) or 'none given'}; left over {self.momentum_error:.0e}",
            f"mechanical energy (J): {', '.join(ends)}; work of {', '.join(work) or 'nothing'}",
        ]


def _shown(name: str) -> str:
    """Return the name of a giver of momentum in words."""
    return "own force" if name == "own" else name.replace("_", " ")


class _Ice(NamedTuple):
    """What momentum and energy need of the ice of elements."""

    mass: Floats
    scaling: Floats  # Bergs that each stands for
    sides: Ints
    length: Floats
    width: Floats
    rigid_bodies: bool


class _Moving(NamedTuple):
    """Velocities of elements, and the explicit accelerations that have still half of their step to give."""

    u: Floats
    v: Floats
    ax: Floats
    ay: Floats
    spin: Floats


def _ice(el: Elements, p: Parameters) -> _Ice:
    rigid_bodies = p.stepping.scheme == "quasi_static"
    return _Ice(el.body.mass, el.life.mass_scaling, el.body.sides, el.body.length, el.body.width, rigid_bodies)


def _moving(el: Elements) -> _Moving:
    return _Moving(el.motion.u, el.motion.v, el.kicks.ax, el.kicks.ay, el.motion.spin)


def stock(elements: Elements, p: Parameters) -> Floats:
    """Return momentum east and north (N s) and kinetic energy (J), each the sum over all bergs."""
    motion, kicks, dt, out = elements.motion, elements.kicks, p.time_step, np.zeros(3)
    if p.stepping.scheme == "mts":
        fast = _Moving(motion.u, motion.v, kicks.ax_fast, kicks.ay_fast, motion.spin)
        implicit = kicks.bx_fast, kicks.by_fast, kicks.spin_rate
        _vibrating(_ice(elements, p), fast, *implicit, elements.body.substeps, dt, out)
    else:
        _gliding(_ice(elements, p), _moving(elements), dt, out)
    return out


@borrower
def _inertia(ice: _Ice, e: int, mass: float) -> float:
    """Moment of inertia (kg m2) with which an element spins (equations 6.5)."""
    length, width = ice.length[e], ice.width[e]
    if ice.rigid_bodies:
        return rectangle_inertia(mass, length, width)
    return disc_inertia(mass, interaction_radius(length * width, ice.sides[e] == 6, True))


@borrower
def _vibrating(
    ice: _Ice, now: _Moving, bx: Floats, by: Floats, spin_rate: Floats, substeps: Ints, dt: float, out: Floats
) -> None:
    """Add momentum and kinetic energy of elements in sub-steps; spins of the state are half a sub-step ahead of the positions."""
    for e in range(ice.mass.size):
        m, half, u, v = ice.mass[e] * ice.scaling[e], 0.5 * dt / max(substeps[e], 1), now.u[e], now.v[e]
        turning = now.spin[e] - half * spin_rate[e]
        out[0] += m * (u + half * (now.ax[e] + bx[e]))
        out[1] += m * (v + half * (now.ay[e] + by[e]))
        out[2] += 0.5 * m * (u * u + v * v) + 0.5 * _inertia(ice, e, m) * turning * turning


@borrower
def _gliding(ice: _Ice, now: _Moving, dt: float, out: Floats) -> None:
    """Add momentum and kinetic energy of elements in single steps, whose explicit accelerations have still half to give."""
    for e in range(ice.mass.size):
        m = ice.mass[e] * ice.scaling[e]
        uu, vv = now.u[e] + 0.5 * dt * now.ax[e], now.v[e] + 0.5 * dt * now.ay[e]
        out[0] += m * uu
        out[1] += m * vv
        out[2] += 0.5 * m * (uu * uu + vv * vv) + 0.5 * _inertia(ice, e, m) * now.spin[e] * now.spin[e]


@kernel
def _add_given(
    mass: Floats, scaling: Floats, u: Floats, v: Floats, u_before: Floats, v_before: Floats, applied: Floats,
    kicks: Booleans, dt: float, given: Floats,
) -> None:  # fmt: skip
    """Add momentum east and north, and work, of each force.

    Work is at the mean of the velocities before and after a force has acted: of those that kick at the start of a step, which
    ``kicks`` marks, between the first velocity and that after the kicks; of others from there to the end of the step.
    """
    for e in range(mass.size):
        u_kicked, v_kicked = u_before[e], v_before[e]
        for k in range(applied.shape[1]):
            if kicks[k]:
                u_kicked += dt * applied[e, k, 0]
                v_kicked += dt * applied[e, k, 1]
        m = mass[e] * scaling[e] * dt
        for k in range(applied.shape[1]):
            um = 0.5 * (u_kicked + (u_before[e] if kicks[k] else u[e]))
            vm = 0.5 * (v_kicked + (v_before[e] if kicks[k] else v[e]))
            x, y = m * applied[e, k, 0], m * applied[e, k, 1]
            given[k, 0] += x
            given[k, 1] += y
            given[k, 2] += x * um + y * vm


def _entries_in_substeps(
    before: Elements, now: Elements, applied: Floats, run: RunState
) -> tuple[Floats, Floats, Floats]:
    """Return the stock before and after a step with sub-steps, and what each force gave, shape (forces, 3)."""
    p, given = run.parameters, np.zeros((applied.shape[1], 3))
    # All forces act as kicks at the start of a step, but a floor in the sub-steps.
    kicks = np.ones(applied.shape[1], np.bool_)
    kicks[SEA_FLOOR] = not run.constants.ground_on_substeps
    motion, old = now.motion, before.motion
    _add_given(
        now.body.mass, now.life.mass_scaling, motion.u, motion.v, old.u, old.v, applied, kicks, p.time_step, given
    )  # fmt: skip
    return stock(before, p), stock(now, p), given


def _entries_in_steps(before: Elements, now: Elements, applied: Floats, run: RunState) -> tuple[Floats, Floats, Floats]:
    """Return the stock before and after a single step, and what each force gave, shape (forces, 3)."""
    entries, kicks = np.zeros((2 + applied.shape[1], 3)), np.zeros(applied.shape[1], np.bool_)
    dt, room = run.parameters.time_step, np.empty((4, now.size))
    _add_entries(_ice(now, run.parameters), _moving(before), _moving(now), applied, kicks, dt, room, entries)
    return entries[0], entries[1], entries[2:]


@borrower
def _add_entries(
    ice: _Ice, before: _Moving, now: _Moving, applied: Floats, kicks: Booleans, dt: float, room: Floats, entries: Floats
) -> None:
    """Add the rows of `_entries_in_steps`; ``room`` takes the velocities that belong to the positions, after and before."""
    _gliding(ice, before, dt, entries[0])
    _gliding(ice, now, dt, entries[1])
    for e in range(ice.mass.size):
        room[0, e], room[1, e] = now.u[e] + 0.5 * dt * now.ax[e], now.v[e] + 0.5 * dt * now.ay[e]
        room[2, e], room[3, e] = before.u[e] + 0.5 * dt * before.ax[e], before.v[e] + 0.5 * dt * before.ay[e]
    _add_given(ice.mass, ice.scaling, room[0], room[1], room[2], room[3], applied, kicks, dt, entries[2:])


class MotionLedger:
    """Sums over the steps of a run; its numbers live in one array, which a restart keeps with the model."""

    def __init__(self, parameters: Parameters, own: tuple[str, ...] = ()) -> None:
        self.parameters, self.own = parameters, own  # several laws of one's own have a row each after all others
        self.rows = BONDS + 1 + len(own)

    def moved(
        self, before: Elements, bonds_before: Bonds, run: RunState, applied: Floats,
        remembered: MutableMapping[str, Floats], plastic: Floats, own: Floats | None = None,
    ) -> None:  # fmt: skip
        """Enter a step of motion.

        ``applied``: mean accelerations, m s-2 (shape (elements, forces, 2)); ``own``: those of several laws of one's own in
        place of the row of all of them; ``plastic``: as `Stepper.plastic`, J.
        """
        if own is not None:
            applied = np.concatenate([applied, own], axis=1)
            applied[:, OWN] = 0.0
        now, body = run.elements, run.elements.body
        held, pushed = _held_or_pushed(body.static, body.free_y, body.load_x, body.load_y)
        was, stands, forces, given = self._given(before, now, applied, run, pushed)
        if held:
            # Of bergs with supports and of what may touch them alone: what is left over elsewhere no support has taken.
            tied = _tied(before, now, run)
            some = (before.taken(tied), now.taken(tied), applied[tied])
            w, s, _, g = (was, stands, forces, given) if tied.size == now.size else self._given(*some, run, pushed)
            given[SUPPORTS, :2] = s[:2] - w[:2] - g[:, :2].sum(axis=0)
        kept = self._begun(remembered, before, bonds_before, run, was)
        _enter_step(kept, was, stands, given)
        self._cracks(kept, before, bonds_before, run)
        kept[BONDS, 2] = plastic[0]
        kept[BONDS + 1 :] += forces[len(FORCES) :]
        remembered[KEPT], remembered[KEPT_ON_BED] = kept, plastic[1:].copy()

    def _given(
        self, before: Elements, now: Elements, applied: Floats, run: RunState, pushed: bool
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return stock before and after a step, what each force gave, and the rows of `GIVERS` before the elements' own."""
        entries = _entries_in_substeps if self.parameters.stepping.scheme == "mts" else _entries_in_steps
        was, stands, forces = entries(before, now, applied, run)
        given = np.zeros((ELEMENTS, 3))
        given[: len(FORCES)] = forces[: len(FORCES)]
        given[OWN] += forces[len(FORCES) :].sum(axis=0)
        # The Coriolis force stands across the velocity; what it does along the mean of two velocities is the step's error.
        given[TIME_STEP, 2], given[CORIOLIS, 2] = given[CORIOLIS, 2], 0.0
        if pushed:
            _add_loads(given, before, now, run)
        return was, stands, forces, given

    def changed(self, run: RunState, who: str, remembered: MutableMapping[str, Floats]) -> None:
        """Enter what another process has done, under one of `GIVERS`."""
        kept = self._known(remembered)
        if kept is not None:
            _enter(kept, who, stock(run.elements, self.parameters))
            remembered[KEPT] = kept

    def _begun(
        self, remembered: MutableMapping[str, Floats], elements: Elements, bonds: Bonds, run: RunState, was: Floats
    ) -> Floats:
        known = self._known(remembered)
        if known is not None:
            return known
        kept = np.zeros((self.rows, 3))
        kept[START] = kept[NOW] = was
        kept[BONDS, 0] = energy_in_bonds(elements, bonds, run) or 0.0
        return kept

    def _cracks(self, kept: Floats, before: Elements, bonds_before: Bonds, run: RunState) -> None:
        """Enter the energy that bonds held that broke in the step."""
        bonds = run.bonds
        if bonds_before.status.tobytes() == bonds.status.tobytes():  # nearly always, and quick
            return
        broke = (bonds_before.status == 0) & (bonds.status != 0)
        if not broke.any():
            return
        if self.parameters.stepping.scheme == "quasi_static":
            kept[BONDS, 1] += float((bonds.released_energy - bonds_before.released_energy)[broke].sum())
            return
        left = bonds_before.copy()
        left.status[broke] = 1
        held = [energy_in_bonds(before, some, run) or 0.0 for some in (bonds_before, left)]
        kept[BONDS, 1] += held[0] - held[1]

    def balance(self, run: RunState, remembered: MutableMapping[str, Floats]) -> MotionBalance:
        """Return the ledger from the start to now."""
        now = stock(run.elements, self.parameters)
        kept = self._known(remembered)
        elastic = energy_in_bonds(run.elements, run.bonds, run)
        if kept is None:
            kept = np.zeros((self.rows, 3))
            kept[START] = kept[NOW] = now
            kept[BONDS, 0] = elastic or 0.0
        _enter(kept, "other", now)
        rows = kept.tolist()
        rubbed = float(remembered.get(KEPT_ON_BED, np.zeros(1))[0])
        return MotionBalance(
            (rows[START][0], rows[START][1]), (rows[NOW][0], rows[NOW][1]),
            {name: (row[0], row[1]) for name, row in zip(GIVERS, rows, strict=False)}, rows[START][2], rows[NOW][2],
            {name: row[2] for name, row in zip(GIVERS, rows, strict=False)},
            None if elastic is None else rows[BONDS][0], elastic, rows[BONDS][1], rows[BONDS][2],
            rubbed, {name: (row[0], row[1], row[2]) for name, row in zip(self.own, rows[BONDS + 1 :], strict=True)},
        )  # fmt: skip

    def _known(self, remembered: Mapping[str, Floats]) -> Floats | None:
        """Return a copy of the numbers so far, None where there are none."""
        if KEPT not in remembered:
            return None
        kept = np.asarray(remembered[KEPT])
        if kept.shape != (self.rows, 3) or kept.dtype.kind not in "fiu":
            raise InputError(
                f"a ledger of shape {kept.shape} and type {kept.dtype}", where=f"restart file, extra/{KEPT}",
                remedy=f"Name a restart file that Riftberg wrote: it has {self.rows} by 3 numbers there. Several forces of "
                "one's own must be as many as before",
            )  # fmt: skip
        return kept.astype(float)  # a copy


def _add_loads(given: Floats, before: Elements, now: Elements, run: RunState) -> None:
    """Add impulse and work of the loads on the elements, which act in the schemes with sub-steps of beams or in equilibrium."""
    c, x, y = run.constants, now.body.load_x, now.body.load_y
    if not (c.rigid_bodies or (c.multiple_steps and c.dem)):
        return
    scaling, dt, place, was = now.life.mass_scaling, run.parameters.time_step, now.place, before.place
    east, north = separations(Metric(c.latlon, c.earth_radius, c.period), place.lon, place.lat, was.lon, was.lat)
    given[LOADS] += dt * (scaling * x).sum(), dt * (scaling * y).sum(), (scaling * (x * east + y * north)).sum()


@borrower
def _held_or_pushed(static: Floats, free_y: Floats, load_x: Floats, load_y: Floats) -> tuple[bool, bool]:
    """Whether any element has a support, and whether any bears a given load."""
    held = pushed = False
    for e in range(static.size):
        held = held or static[e] >= 0.5 or free_y[e] < 0.5
        pushed = pushed or load_x[e] != 0.0 or load_y[e] != 0.0
    return held, pushed


def _tied(before: Elements, now: Elements, run: RunState) -> Ints:
    """Rows of bergs that have supports, and of those that may touch one in the step, by way of others too."""
    place, berg, motion, p = before.place, before.body.berg, before.motion, run.parameters
    if (berg == berg[0]).all():
        return np.arange(berg.size)
    speed = max(np.hypot(a.u, a.v).max() for a in (motion, now.motion))
    sizes = np.sqrt(2.0 * before.body.length * before.body.width)
    reach = max(float(sizes.max()), p.contact_distance) + 2.0 * float(speed) * p.time_step
    earth = p.earth
    near = find_pairs(place.lon, place.lat, berg, reach, ANY, earth.latlon, earth.radius, earth.period)
    row = np.arange(berg.size)
    _, one, number = np.unique(berg, return_index=True, return_inverse=True)
    first, second = np.repeat(row, np.diff(near.start)), near.partner
    group = pieces(berg.size, np.append(first, row), np.append(second, one[number]))
    return np.flatnonzero(np.isin(group, group[(now.body.static >= 0.5) | (now.body.free_y < 0.5)]))


@borrower
def _enter_step(kept: Floats, was: Floats, stands: Floats, given: Floats) -> None:
    """Enter a step of motion: what others did before it, what each force gave, and what is left over."""
    for i in range(3):
        kept[OTHER, i] += was[i] - kept[NOW, i]
        total = 0.0
        for k in range(given.shape[0]):
            kept[k, i] += given[k, i]
            total += given[k, i]
        kept[ELEMENTS, i] += stands[i] - was[i] - total
        kept[NOW, i] = stands[i]


def _enter(kept: Floats, who: str, now: Floats) -> None:
    """Enter the difference to the last stock under a name."""
    kept[GIVERS.index(who)] += now - kept[NOW]
    kept[NOW] = now


def bonds_vibrate(run: RunState) -> bool:
    """Return whether bonds store elastic energy of which the motion of the elements knows."""
    return run.parameters.stepping.scheme == "mts" and bool(run.constants.dem and run.constants.bonds_on)


BLOCK: Final = 2**17
"""Bonds of which the energy is found at a time."""


def energy_in_bonds(elements: Elements, bonds: Bonds, run: RunState) -> float | None:
    """Return the elastic energy (J) in unbroken bonds, None where their law is not that of a vibrating lattice.

    Normal ``K (l - l0)^2 / 2`` with ``K = E H w / l0``, shear ``K s^2 / (4 (1 + nu))``, bending ``K w^2 (1 - cos theta) / 12``.
    """
    if not bonds_vibrate(run):
        return None
    some = bonds.taken(bonds.status == 0) if (bonds.status != 0).any() else bonds
    if some.first.size == 0:
        return 0.0
    # In blocks: the twenty numbers that each bond needs would be the largest memory of a run of very many.
    return sum(
        _elastic_energy(elements, some.taken(np.arange(k, min(k + BLOCK, some.first.size))), run)
        for k in range(0, some.first.size, BLOCK)
    )


def _elastic_energy(elements: Elements, bonds: Bonds, run: RunState) -> float:
    """Return the elastic energy (J) of bonds, none of them broken."""
    p, c = run.parameters, run.constants
    i, j, rest = bonds.first, bonds.second, bonds.rest_length
    sizes = interaction_sizes(elements, c)
    radius, thickness = sizes.bond_radius, elements.body.thickness
    x, y = elements.place.lon, elements.place.lat
    length = np.hypot(*separations(Metric(c.latlon, c.earth_radius, c.period), x[i], y[i], x[j], y[j]))
    formed = rest / (radius[i] + radius[j])  # the section is that with which the bond formed
    small = formed * np.minimum(radius[i], radius[j])
    section: Any = plain(bond_section)  # it has no branches, and takes arrays as well
    width, height = section(
        small, formed * np.abs(radius[i] - radius[j]), np.minimum(thickness[i], thickness[j]),
        np.abs(thickness[i] - thickness[j]), 0.5 * (rest - length), 1.0 / length,
    )  # fmt: skip
    stiffness = p.bonds.youngs_modulus * height * width / rest
    sub_step = p.time_step / np.maximum(elements.body.substeps, 1) if run.step_number else 0.0
    # The angles of the state are one sub-step ahead of the positions.
    angle = elements.motion.rotation - sub_step * elements.motion.spin
    bent = angle[i] - angle[j]
    bending = 0.5 * bent * bent if p.bonds.linear_bending else 1.0 - np.cos(bent)
    slid = (bonds.shear_x**2 + bonds.shear_y**2) * (0.0 if p.bonds.no_shear else 0.5 / (1.0 + p.bonds.poisson))
    return float((stiffness * (0.5 * ((length - rest) ** 2 + slid) + width * width / 12.0 * bending)).sum())
