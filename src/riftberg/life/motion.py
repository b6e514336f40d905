"""The ledger of motion: the momentum and mechanical energy that each force gives the bergs, and where they go.

The momentum of the elements includes the impulse that the last explicit accelerations still owe: forces change it to round-off.
The residual of a step is the momentum that elements exchange; by Newton's third law it vanishes, except where land stops one.

The work of a force is its impulse times the mean of the velocities before and after it has acted; for a single element the sum of
all work is exactly the change of kinetic energy. The residual is the work of bonds and contacts: energy stored in bonds or
dissipated there.
The impulse of supports holds their berg in place; supports do no work.

On the sphere momentum has eastward and northward components, as the explicit schemes step them. A fragment of the quasi-static
engine keeps its own axes while it moves, which turn against east and north: a residual of some 1e-4 of the impulses.
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
"""Causes of a change of momentum and energy: external forces, prescribed loads and the supports that hold them, the error of the
time step in a Coriolis force that does no work, elements among each other (with land), melt and births, processes of the user."""

LOADS, SUPPORTS, TIME_STEP, ELEMENTS, OTHER = map(GIVERS.index, ("loads", "supports", "time_step", "elements", "other"))

START, NOW, BONDS = range(len(GIVERS), len(GIVERS) + 3)
"""Rows after those of the givers: stock at the start, stock now; elastic energy at the start, released by cracks, lost by
crushing."""

LEDGER, BED_FRICTION = "motion_ledger", "motion_on_bed"
"""Names under which a restart keeps the ledger, and the work of friction on a bed of sediment beside it."""

CLOSES: Final = 1e-9
"""Largest residual between bonded elements as a fraction of the impulses."""


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
        """Momentum that elements exchanged as a fraction of all impulses: 0 except for round-off and land."""
        total = sum(np.hypot(*self.impulse[name]) for name in (*FORCES, "loads")) + np.hypot(*self.momentum_start)
        return float(np.hypot(*self.impulse["elements"]) / max(total, 1e-30))

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
        """Return in one line how well the ledger closes, relative to the impulses."""
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
        impulses = [
            f"{_giver_text(name)} {x:+.3g}, {y:+.3g}"
            for name, (x, y) in self.impulse.items() if name != "elements" and (x or y)
        ]  # fmt: skip
        work = [f"{_giver_text(name)} {w:+.3g}" for name, w in self.work.items() if name != "elements" and w]
        if self.rubbed:
            work.append(f"of that of the sea floor friction {-self.rubbed:+.3g}")
        impulses += [f"of it {name} {x:+.3g}, {y:+.3g}" for name, (x, y, _) in self.own.items()]
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
            f"{'; '.join(impulses) or 'none given'}; left over {self.momentum_error:.0e}",
            f"mechanical energy (J): {', '.join(ends)}; work of {', '.join(work) or 'nothing'}",
        ]


def _giver_text(name: str) -> str:
    """Return the name of a giver of momentum in words."""
    return "own force" if name == "own" else name.replace("_", " ")


class _Ice(NamedTuple):
    """Properties of the ice that momentum and energy depend on."""

    mass: Floats
    scaling: Floats  # Bergs that each stands for
    sides: Ints
    length: Floats
    width: Floats
    rigid_bodies: bool


class _Moving(NamedTuple):
    """Velocities of elements, and the explicit accelerations, which still have half a step to act."""

    u: Floats
    v: Floats
    ax: Floats
    ay: Floats
    spin: Floats


def _ice(el: Elements, p: Parameters) -> _Ice:
    return _Ice(
        el.body.mass, el.life.mass_scaling, el.body.sides, el.body.length, el.body.width, p.stepping.in_equilibrium
    )


def _moving(el: Elements) -> _Moving:
    return _Moving(el.motion.u, el.motion.v, el.kicks.ax, el.kicks.ay, el.motion.spin)


def stock(elements: Elements, p: Parameters) -> Floats:
    """Return momentum east and north (N s) and kinetic energy (J), each the sum over all bergs."""
    motion, kicks, dt, out = elements.motion, elements.kicks, p.time_step, np.zeros(3)
    if p.stepping.has_substeps:
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
    ice: _Ice, moving: _Moving, bx: Floats, by: Floats, spin_rate: Floats, substeps: Ints, dt: float, out: Floats
) -> None:
    """Add momentum and kinetic energy of elements in sub-steps; spins of the state are half a sub-step ahead of the positions."""
    for e in range(ice.mass.size):
        m, half, u, v = ice.mass[e] * ice.scaling[e], 0.5 * dt / max(substeps[e], 1), moving.u[e], moving.v[e]
        turning = moving.spin[e] - half * spin_rate[e]
        out[0] += m * (u + half * (moving.ax[e] + bx[e]))
        out[1] += m * (v + half * (moving.ay[e] + by[e]))
        out[2] += 0.5 * m * (u * u + v * v) + 0.5 * _inertia(ice, e, m) * turning * turning


@borrower
def _gliding(ice: _Ice, moving: _Moving, dt: float, out: Floats) -> None:
    """Add momentum and kinetic energy of elements in single steps, whose explicit accelerations still have half a step to act."""
    for e in range(ice.mass.size):
        m = ice.mass[e] * ice.scaling[e]
        uu, vv = moving.u[e] + 0.5 * dt * moving.ax[e], moving.v[e] + 0.5 * dt * moving.ay[e]
        out[0] += m * uu
        out[1] += m * vv
        out[2] += 0.5 * m * (uu * uu + vv * vv) + 0.5 * _inertia(ice, e, m) * moving.spin[e] * moving.spin[e]


@kernel
def _add_impulses(
    mass: Floats, scaling: Floats, u: Floats, v: Floats, u_before: Floats, v_before: Floats, applied: Floats,
    kicks: Booleans, dt: float, sums: Floats,
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
            sums[k, 0] += x
            sums[k, 1] += y
            sums[k, 2] += x * um + y * vm


def _entries_in_substeps(
    start: Elements, end: Elements, applied: Floats, run: RunState
) -> tuple[Floats, Floats, Floats]:
    """Return the stock before and after a step with sub-steps, and impulse and work of each force, shape (forces, 3)."""
    p, sums = run.parameters, np.zeros((applied.shape[1], 3))
    # All forces act as kicks at the start of a step, but a floor in the sub-steps.
    kicks = np.ones(applied.shape[1], np.bool_)
    kicks[SEA_FLOOR] = not run.constants.ground_on_substeps
    motion, previous = end.motion, start.motion
    _add_impulses(
        end.body.mass, end.life.mass_scaling, motion.u, motion.v, previous.u, previous.v, applied, kicks, p.time_step, sums
    )  # fmt: skip
    return stock(start, p), stock(end, p), sums


def _entries_in_steps(start: Elements, end: Elements, applied: Floats, run: RunState) -> tuple[Floats, Floats, Floats]:
    """Return the stock before and after a single step, and impulse and work of each force, shape (forces, 3)."""
    ice, dt, entries = _ice(end, run.parameters), run.parameters.time_step, np.zeros((2 + applied.shape[1], 3))
    _add_entries(ice, _moving(start), _moving(end), applied, dt, entries)
    return entries[0], entries[1], entries[2:]


@borrower
def _add_entries(ice: _Ice, start: _Moving, end: _Moving, applied: Floats, dt: float, entries: Floats) -> None:
    """Add the rows of `_entries_in_steps`: no force kicks, so each works at the mean of both velocities."""
    _gliding(ice, start, dt, entries[0])
    _gliding(ice, end, dt, entries[1])
    for e in range(ice.mass.size):
        # The velocities that belong to the positions.
        u, v = end.u[e] + 0.5 * dt * end.ax[e], end.v[e] + 0.5 * dt * end.ay[e]
        u_before, v_before = start.u[e] + 0.5 * dt * start.ax[e], start.v[e] + 0.5 * dt * start.ay[e]
        m, um, vm = ice.mass[e] * ice.scaling[e] * dt, 0.5 * (u_before + u), 0.5 * (v_before + v)
        for k in range(applied.shape[1]):
            x, y = m * applied[e, k, 0], m * applied[e, k, 1]
            entries[2 + k, 0] += x
            entries[2 + k, 1] += y
            entries[2 + k, 2] += x * um + y * vm


class MotionLedger:
    """Sums over the steps of a run; its numbers live in one array, which a restart keeps with the model."""

    def __init__(self, parameters: Parameters, own_laws: tuple[str, ...] = ()) -> None:
        self.parameters, self.own = parameters, own_laws  # several laws of one's own have a row each after all others
        self.rows = BONDS + 1 + len(own_laws)

    def moved(
        self, start: Elements, start_bonds: Bonds, run: RunState, applied: Floats,
        remembered: MutableMapping[str, Floats], plastic: Floats, each_law: Floats | None = None,
    ) -> None:  # fmt: skip
        """Enter a step of motion.

        ``applied``: mean accelerations, m s-2 (shape (elements, forces, 2)); ``each_law``: those of several laws of one's own, in
        place of the row of their sum; ``plastic``: as `Stepper.plastic`, J.
        """
        if each_law is not None:
            applied = np.concatenate([applied, each_law], axis=1)
            applied[:, OWN] = 0.0
        end, body = run.elements, run.elements.body
        has_supports, has_loads = _has_supports_or_loads(body.static, body.free_y, body.load_x, body.load_y)
        start_stock, end_stock, forces, sums = self._account(start, end, applied, run, has_loads)
        if has_supports:
            # Only of bergs with supports and those that may touch them: no support has taken the residual elsewhere.
            tied = _rows_near_supports(start, end, run)
            states = (start.taken(tied), end.taken(tied), applied[tied])
            tied_start, tied_end, _, tied_sums = (
                (start_stock, end_stock, forces, sums)
                if tied.size == end.size
                else self._account(*states, run, has_loads)
            )
            sums[SUPPORTS, :2] = tied_end[:2] - tied_start[:2] - tied_sums[:, :2].sum(axis=0)
        ledger = self._open(remembered, start, start_bonds, run, start_stock)
        _enter_step(ledger, start_stock, end_stock, sums)
        self._enter_cracks(ledger, start, start_bonds, run)
        ledger[BONDS, 2] = plastic[0]
        if self.own:
            ledger[BONDS + 1 :] += forces[len(FORCES) :]
        remembered[LEDGER], remembered[BED_FRICTION] = ledger, plastic[1:].copy()

    def _account(
        self, start: Elements, end: Elements, applied: Floats, run: RunState, has_loads: bool
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return stock before and after a step, sums by force, and the rows of `GIVERS` that precede the elements."""
        entries = _entries_in_substeps if self.parameters.stepping.has_substeps else _entries_in_steps
        start_stock, end_stock, forces = entries(start, end, applied, run)
        sums = np.zeros((ELEMENTS, 3))
        sums[: len(FORCES)] = forces[: len(FORCES)]
        if self.own:
            sums[OWN] += forces[len(FORCES) :].sum(axis=0)
        # The Coriolis force is normal to the velocity; its work along the mean of two velocities is the error of the step.
        sums[TIME_STEP, 2], sums[CORIOLIS, 2] = sums[CORIOLIS, 2], 0.0
        if has_loads:
            _add_loads(sums, start, end, run)
        return start_stock, end_stock, forces, sums

    def changed(self, run: RunState, giver: str, remembered: MutableMapping[str, Floats]) -> None:
        """Enter the effect of another process under one of `GIVERS`."""
        ledger = self._read(remembered)
        if ledger is not None:
            _enter_difference(ledger, giver, stock(run.elements, self.parameters))
            remembered[LEDGER] = ledger

    def _open(
        self,
        remembered: MutableMapping[str, Floats],
        elements: Elements,
        bonds: Bonds,
        run: RunState,
        start_stock: Floats,
    ) -> Floats:
        ledger = self._read(remembered)
        if ledger is not None:
            return ledger
        ledger = np.zeros((self.rows, 3))
        ledger[START] = ledger[NOW] = start_stock
        ledger[BONDS, 0] = energy_in_bonds(elements, bonds, run) or 0.0
        return ledger

    def _enter_cracks(self, ledger: Floats, start: Elements, start_bonds: Bonds, run: RunState) -> None:
        """Enter the elastic energy of the bonds that broke in the step."""
        bonds = run.bonds
        if start_bonds.status.tobytes() == bonds.status.tobytes():  # nearly always, and quick
            return
        broke = (start_bonds.status == 0) & (bonds.status != 0)
        if not broke.any():
            return
        if self.parameters.stepping.in_equilibrium:
            ledger[BONDS, 1] += float((bonds.released_energy - start_bonds.released_energy)[broke].sum())
            return
        unbroken = start_bonds.copy()
        unbroken.status[broke] = 1
        energies = [energy_in_bonds(start, intact, run) or 0.0 for intact in (start_bonds, unbroken)]
        ledger[BONDS, 1] += energies[0] - energies[1]

    def balance(self, run: RunState, remembered: MutableMapping[str, Floats]) -> MotionBalance:
        """Return the ledger from the start to now."""
        end_stock = stock(run.elements, self.parameters)
        ledger = self._read(remembered)
        elastic = energy_in_bonds(run.elements, run.bonds, run)
        if ledger is None:
            ledger = np.zeros((self.rows, 3))
            ledger[START] = ledger[NOW] = end_stock
            ledger[BONDS, 0] = elastic or 0.0
        _enter_difference(ledger, "other", end_stock)
        rows = ledger.tolist()
        rubbed = float(remembered.get(BED_FRICTION, np.zeros(1))[0])
        return MotionBalance(
            (rows[START][0], rows[START][1]), (rows[NOW][0], rows[NOW][1]),
            {name: (row[0], row[1]) for name, row in zip(GIVERS, rows, strict=False)}, rows[START][2], rows[NOW][2],
            {name: row[2] for name, row in zip(GIVERS, rows, strict=False)},
            None if elastic is None else rows[BONDS][0], elastic, rows[BONDS][1], rows[BONDS][2],
            rubbed, {name: (row[0], row[1], row[2]) for name, row in zip(self.own, rows[BONDS + 1 :], strict=True)},
        )  # fmt: skip

    def _read(self, remembered: Mapping[str, Floats]) -> Floats | None:
        """Return a copy of the numbers so far, None where there are none."""
        if LEDGER not in remembered:
            return None
        ledger = np.asarray(remembered[LEDGER])
        if ledger.shape != (self.rows, 3) or ledger.dtype.kind not in "fiu":
            raise InputError(
                f"a ledger of shape {ledger.shape} and type {ledger.dtype}", where=f"restart file, extra/{LEDGER}",
                remedy=f"Name a restart file that Riftberg wrote: it has {self.rows} by 3 numbers there. Several forces of "
                "one's own must be as many as before",
            )  # fmt: skip
        return ledger.astype(float)  # a copy


def _add_loads(sums: Floats, start: Elements, end: Elements, run: RunState) -> None:
    """Add impulse and work of the loads on the elements, which act in the schemes with sub-steps of beams or in equilibrium."""
    c, x, y = run.constants, end.body.load_x, end.body.load_y
    if not (c.rigid_bodies or (c.multiple_steps and c.dem)):
        return
    scaling, dt, positions, start_positions = end.life.mass_scaling, run.parameters.time_step, end.place, start.place
    east, north = separations(
        Metric(c.latlon, c.earth_radius, c.period),
        positions.lon,
        positions.lat,
        start_positions.lon,
        start_positions.lat,
    )
    sums[LOADS] += dt * (scaling * x).sum(), dt * (scaling * y).sum(), (scaling * (x * east + y * north)).sum()


@borrower
def _has_supports_or_loads(static: Floats, free_y: Floats, load_x: Floats, load_y: Floats) -> tuple[bool, bool]:
    """Whether any element has a support, and whether any bears a given load."""
    has_supports = has_loads = False
    for e in range(static.size):
        has_supports = has_supports or static[e] >= 0.5 or free_y[e] < 0.5
        has_loads = has_loads or load_x[e] != 0.0 or load_y[e] != 0.0
    return has_supports, has_loads


def _rows_near_supports(start: Elements, end: Elements, run: RunState) -> Ints:
    """Rows of bergs that have supports, and of those that may touch one in the step, by way of others too."""
    positions, berg, motion, p = start.place, start.body.berg, start.motion, run.parameters
    if (berg == berg[0]).all():
        return np.arange(berg.size)
    speed = max(np.hypot(a.u, a.v).max() for a in (motion, end.motion))
    sizes = np.sqrt(2.0 * start.body.length * start.body.width)
    reach = max(float(sizes.max()), p.contact_distance) + 2.0 * float(speed) * p.time_step
    earth = p.earth
    pairs = find_pairs(positions.lon, positions.lat, berg, reach, ANY, earth.latlon, earth.radius, earth.period)
    row = np.arange(berg.size)
    _, first_rows, number = np.unique(berg, return_index=True, return_inverse=True)
    first, second = np.repeat(row, np.diff(pairs.start)), pairs.partner
    group = pieces(berg.size, np.append(first, row), np.append(second, first_rows[number]))
    return np.flatnonzero(np.isin(group, group[(end.body.static >= 0.5) | (end.body.free_y < 0.5)]))


@borrower
def _enter_step(ledger: Floats, start_stock: Floats, end_stock: Floats, sums: Floats) -> None:
    """Enter a step of motion: changes by others before it, the sums of each force, and the residual."""
    for i in range(3):
        ledger[OTHER, i] += start_stock[i] - ledger[NOW, i]
        total = 0.0
        for k in range(sums.shape[0]):
            ledger[k, i] += sums[k, i]
            total += sums[k, i]
        ledger[ELEMENTS, i] += end_stock[i] - start_stock[i] - total
        ledger[NOW, i] = end_stock[i]


def _enter_difference(ledger: Floats, giver: str, stock_now: Floats) -> None:
    """Enter the difference to the last stock under a name."""
    ledger[GIVERS.index(giver)] += stock_now - ledger[NOW]
    ledger[NOW] = stock_now


def bonds_vibrate(run: RunState) -> bool:
    """Return whether bonds store elastic energy in the motion of the elements."""
    return run.parameters.stepping.has_substeps and bool(run.constants.dem and run.constants.bonds_on)


BLOCK: Final = 2**17
"""Bonds of which the energy is found at a time."""


def energy_in_bonds(elements: Elements, bonds: Bonds, run: RunState) -> float | None:
    """Return the elastic energy (J) in unbroken bonds, None where their law is not that of a vibrating lattice.

    Normal ``K (l - l0)^2 / 2`` with ``K = E H w / l0``, shear ``K s^2 / (4 (1 + nu))``, bending ``K w^2 (1 - cos theta) / 12``.
    """
    if not bonds_vibrate(run):
        return None
    unbroken = bonds.taken(bonds.status == 0) if (bonds.status != 0).any() else bonds
    if unbroken.first.size == 0:
        return 0.0
    # In blocks: twenty numbers a bond would be the largest memory of a run of very many.
    return sum(
        _elastic_energy(elements, unbroken.taken(np.arange(k, min(k + BLOCK, unbroken.first.size))), run)
        for k in range(0, unbroken.first.size, BLOCK)
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
