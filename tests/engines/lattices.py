"""Small random lattices in general motion, and the kernels called on them as the steppers call them."""

from __future__ import annotations

from datetime import datetime

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix

from riftberg import Parameters
from riftberg.engines.common.forces.media import MEDIA, Medium, Surroundings, allocate_surroundings, find_surroundings
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.common.fragments.tree import FragmentTree
from riftberg.engines.common.run_state import RunState
from riftberg.engines.schemes import make_stepper
from riftberg.ocean.forcing import Forcing
from riftberg.state import new_bonds, new_elements
from riftberg.state.population import Population

RADIUS = 1500.0


def parameters(**groups):
    """Kernel parameters of `settings`."""
    return settings(**groups).kernel_values()


def settings(**groups):
    """Parameters of the published run with some values of some groups changed; no rotational water drag."""
    base = {
        "drag": {"ocean_scale": 17.8, "rotational": False},
        "grounding": {"coefficient": 1e4, "ramp_height": 20.0},
        "contact": {"spring": 1e-7, "distance": 4000.0, "tolerance": 1e-6, "on_substeps": False},
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


def run_of(el, bonds, p, constants, step_number=0):
    """Return a run of the state, whose steps have begun before unless ``step_number`` is 0."""
    start = datetime(2020, 12, 9)
    return RunState(Population(el, bonds), AsItIs(), p, constants, FragmentTree(), start, step_number=step_number)


def step(el, bonds, p):
    """Take one time step by the scheme that the parameters name; changes the state in place."""
    run = run_of(el, bonds, p, p.kernel_values())
    make_stepper(run).step(run)


def long_step(el, bonds, p, dt, substeps, *, starting=False, skip_outer=False, may_break=False, at_once=None):
    """Take one long step of the explicit scheme; changes the state in place, and returns how many bonds broke.

    Parameters
    ----------
    starting, skip_outer : bool
        Whether it is the first of the run; without its outer kick.
    at_once : int, optional
        Sub-steps that tiles of bonds take at once.
    """
    stepping = {"time_step": dt, "substeps": substeps, "skip_first_long_force": skip_outer}
    quirks = {"zero_start": not starting}
    asked = p.changed(stepping=stepping, fracture={"enabled": may_break}, compatibility=quirks)
    el.body.substeps[:] = substeps
    run = run_of(el, bonds, asked, p.kernel_values(), 0 if starting or skip_outer else 1)
    stepper, unbroken = make_stepper(run), int((bonds.status == 0).sum())
    if at_once is not None:
        plan = stepper._plan
        stepper._plan = lambda run: plan(run)._replace(at_once=at_once)
    stepper.step(run)
    return unbroken - int((bonds.status == 0).sum())


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


def stiffness_matrix(at, stiffness, nodes: int) -> csr_matrix:
    """Stiffness of triangles with the unknowns ``at`` added up number by number; of shape (3 nodes, 3 nodes)."""
    row, column = np.repeat(at, 9, axis=1), np.tile(at, (1, 9))
    return coo_matrix((stiffness.ravel(), (row.ravel(), column.ravel())), shape=(3 * nodes, 3 * nodes)).tocsr()
