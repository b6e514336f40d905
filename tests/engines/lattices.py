"""Small random lattices in general motion, and the kernels called on them as the steppers call them."""

from __future__ import annotations

from datetime import datetime

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix

from riftberg import Parameters
from riftberg.engines.common.broad_phase import excluding
from riftberg.engines.common.forces.media import MEDIA, Medium, Surroundings, allocate_surroundings, find_surroundings
from riftberg.engines.common.forces.pair_law import NeighbourLists
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.common.fragments.tree import FragmentTree
from riftberg.engines.common.run_state import RunState
from riftberg.engines.explicit.contact import allocate_pairs, pairs_from_list
from riftberg.engines.explicit.mts import StepReport, take_long_step
from riftberg.engines.explicit.substeps import StepPlan, Workspace, allocate_fields
from riftberg.engines.explicit.tiles import AT_ONCE, allocate_tiles
from riftberg.engines.schemes import make_stepper
from riftberg.ocean.forcing import Forcing
from riftberg.state import new_bonds, new_elements
from riftberg.state.neighbours import ANY, OTHER_BERG, SAME_BERG, adjacency, find_pairs, no_pairs
from riftberg.state.population import Population

RADIUS = 1500.0
FAR = 3 * RADIUS


def parameters(**groups):
    """Kernel parameters of `settings`."""
    return settings(**groups).kernel_values()


def settings(**groups):
    """Parameters of the published run with some values of some groups changed; no rotational water drag."""
    base = {
        "drag": {"ocean_scale": 17.8, "rotational": False},
        "grounding": {"coefficient": 1e4, "ramp_height": 20.0},
        "contact": {"spring": 1e-7, "distance": 4000.0, "tolerance": 1e-6},
        "stepping": {"scheme": "mts"},  # whose sea floor is a drag
        "fracture": {"enabled": False},
        "earth": {"latlon": True},
        # The twins take one element after the other; what acts on the outline has tests of its own.
        "compatibility": {"forces_by_element": True},
    }
    for group, values in groups.items():
        base[group] = {**base.get(group, {}), **values}
    return Parameters(**base)


class AsItIs(Forcing):
    """An environment that stays as the elements carry it."""

    def sample(self, elements, time):
        """Leave it."""


def step(el, bonds, p):
    """Take one time step by the scheme that the parameters name; changes the state in place."""
    c, start = p.kernel_values(), datetime(2020, 12, 9)
    run = RunState(Population(el, bonds), AsItIs(), p, c, FragmentTree(), start)
    make_stepper(run).step(run)


def lattice(
    seed, p, *, columns=3, rows=2, unequal=True, touching=True, gap=1.15, speed=0.3, strain=0.02, latitude=-55.0
):
    """Two bergs of ``columns`` x ``rows`` and 2 x 1 elements with random state and environment.

    Parameters
    ----------
    p : KernelParameters
    unequal : bool
        Whether sizes and thicknesses differ.
    touching : bool
        Whether the bergs are within reach of contact.
    gap : float
        Distance of the bergs over that of neighbours, if they touch.
    speed : float
        Size of the velocities, m s-1.
    strain : float
        Size of the displacements over the distance of neighbours.
    latitude : float
        Degrees, of the southern row.
    """
    r = np.random.default_rng(seed)
    places = [(i, j, 1) for j in range(rows) for i in range(columns)]
    away = columns - 1 + (gap if touching else 40.0)
    places += [(away + i, 0.3, 2) for i in range(2)]
    n = len(places)
    el = new_elements(n)
    x, y, berg = (np.array(q, dtype=float) for q in zip(*places, strict=True))
    x = 2 * RADIUS * (x + strain * r.normal(size=n))
    y = 2 * RADIUS * (y + strain * r.normal(size=n))
    el.berg[:] = berg
    if p.latlon:
        el.lat[:] = latitude + np.degrees(y / p.earth_radius)
        el.lon[:] = 321.0 + np.degrees(x / p.earth_radius) / np.cos(np.radians(el.lat))
    else:
        el.lon[:], el.lat[:] = x, y
    el.length[:] = el.width[:] = 2 * RADIUS
    el.thickness[:] = 200.0
    if unequal:
        el.length[:] *= r.uniform(0.9, 1.1, n)
        el.width[:] *= r.uniform(0.9, 1.1, n)
        el.thickness[:] *= r.uniform(0.7, 1.3, n)
    el.mass[:] = 850.0 * el.thickness * el.length * el.width * (r.uniform(0.98, 1.02, n) if unequal else 1.0)
    for name in ("u", "v", "u_pair", "v_pair"):
        getattr(el, name)[:] = speed * r.normal(size=n)
    el.u_sync[:], el.v_sync[:] = el.u, el.v
    el.lon_pair[:], el.lat_pair[:] = el.lon, el.lat
    for name in ("ax", "ay", "ax_fast", "ay_fast"):
        getattr(el, name)[:] = 1e-6 * r.normal(size=n)
    el.bx[:], el.by[:] = 1e-6 * r.normal(size=(2, n))
    el.spin[:] = 1e-5 * r.normal(size=n)
    el.rotation[:] = 0.01 * r.normal(size=n)
    _environment(el, r)
    return el, _bonds(el, places, r)


def _environment(el, r):
    """Random currents, wind, sea ice, slope and depth; some elements aground, some half way up the ramp."""
    n = el.mass.size
    for name, size in (("uo", 0.3), ("vo", 0.3), ("ui", 0.2), ("vi", 0.2), ("ua", 8.0), ("va", 8.0)):
        getattr(el, name)[:] = size * r.normal(size=n)
    el.ui[0] = el.vi[0] = 0.0
    el.slope_x[:], el.slope_y[:] = 1e-6 * r.normal(size=(2, n))
    el.ice_thickness[:] = np.maximum(0.0, r.normal(1.0, 1.0, n))
    el.depth[:] = r.choice([100.0, 180.0, 1000.0], n)
    el.ua[1] = el.va[1] = 0.0


def _bonds(el, places, r):
    """Bonds between lattice neighbours of one berg, in general deformation; ends in random order."""
    pairs = [
        (a, b)
        for a, (i, j, berg) in enumerate(places)
        for b, (k, m, other) in enumerate(places)
        if a < b and berg == other and np.isclose(np.hypot(i - k, j - m), 1.0)
    ]
    first, second = np.array([q if r.random() < 0.5 else q[::-1] for q in pairs]).T
    bonds = new_bonds(first, second)
    bonds.shear_x[:], bonds.shear_y[:] = 5.0 * r.normal(size=(2, first.size))
    bonds.strength[:] = r.uniform(0.5, 1.5, first.size)
    el.bond_count[:] = np.bincount(np.concatenate([first, second]), minlength=el.mass.size)
    return bonds


def surroundings_of(el, p) -> tuple[dict[str, Medium], Surroundings]:
    """Return the rows of all elements by the name of the medium, each field over the elements, and what they stand in."""
    around = allocate_surroundings(el.size)
    find_surroundings(el, interaction_sizes(el, p), around, p)
    return {name: Medium(*around.media[:, k].T) for k, name in enumerate(MEDIA)}, around


def partners_of(el, bonds, p, *, multiple):
    """Partners by the rules of equations 5.1, as the steppers gather them; all within far more than reach."""
    none = no_pairs(el.mass.size)

    def partners(*lists):
        return NeighbourLists(*lists, np.zeros(0), np.zeros(0, np.int64))

    def near(rule):
        return find_pairs(el.lon_pair, el.lat_pair, el.berg, FAR, rule, p.latlon, p.earth_radius, p.period)

    if not p.interactions:
        return partners(none, none, none)
    bonded = adjacency(bonds.first, bonds.second, bonds.status, el.mass.size)[0]
    if not multiple and p.plain_kid_branch:
        return partners(bonded if p.bonds_on else none, none, near(ANY))
    if not p.bonds_on or (multiple and p.dem):
        return partners(none, none, near(OTHER_BERG))
    return partners(bonded, excluding(near(SAME_BERG), bonded), near(OTHER_BERG))


def touching_pairs(el, bonds, p):
    """Pairs of one berg that may touch: ends of broken bonds, or candidates of a search."""
    waiting = np.flatnonzero(bonds.status == 1)
    pairs = allocate_pairs(max(200, bonds.first.size))
    if p.broken_as_contact:
        pairs.first[: waiting.size] = bonds.first[waiting]
        pairs.second[: waiting.size] = bonds.second[waiting]
        pairs.bond[: waiting.size] = -1
        pairs.used[0] = waiting.size
        return pairs
    found = find_pairs(el.lon_pair, el.lat_pair, el.berg, FAR, SAME_BERG, p.latlon, p.earth_radius, p.period)
    bonded, bond = adjacency(bonds.first, bonds.second, bonds.status, el.mass.size)
    pairs_from_list(pairs, found, bonded, bond)
    return pairs


def long_step(
    el,
    bonds,
    p,
    dt,
    substeps,
    *,
    starting=False,
    skip_outer=False,
    may_break=False,
    rank=None,
    around=None,
    at_once=AT_ONCE,
):
    """Take one long step by the kernels of `riftberg.engines.explicit.mts`; changes the state in place."""
    n = el.mass.size
    plan = StepPlan(
        dt=dt,
        substeps=substeps,
        time=0.0,
        starting=starting,
        skip_outer=skip_outer,
        by_search=not p.broken_as_contact,
        break_inline=may_break,
        break_after=False,
        at_once=at_once,
    )
    none, partners, sizes = no_pairs(n), partners_of(el, bonds, p, multiple=True), interaction_sizes(el, p)
    pairs = touching_pairs(el, bonds, p)
    around = allocate_surroundings(n) if around is None else around
    work = Workspace(allocate_tiles(el, bonds), pairs, allocate_fields(n))
    colliding, inside = partners._replace(bonded=none, same_berg=none), partners._replace(collision=none)
    rank = np.arange(n) if rank is None else rank

    def part(**which):
        return take_long_step(
            el, bonds, work, colliding, inside, sizes, around, rank, plan._replace(**which), p
        )  # fmt: skip

    outer = part(apply_inner=False)
    if outer.iterations < 0:
        return outer
    inner = part(apply_outer=False)
    explicit = p.explicit_substeps or p.dem
    return StepReport(
        outer.broken + inner.broken, outer.iterations if explicit and inner.iterations > 0 else inner.iterations
    )


def stiffness_matrix(at, stiffness, nodes: int) -> csr_matrix:
    """Stiffness of triangles with the unknowns ``at`` added up number by number; of shape (3 nodes, 3 nodes)."""
    row, column = np.repeat(at, 9, axis=1), np.tile(at, (1, 9))
    return coo_matrix((stiffness.ravel(), (row.ravel(), column.ravel())), shape=(3 * nodes, 3 * nodes)).tocsr()
