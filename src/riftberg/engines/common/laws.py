"""Laws of one's own: a force, a melt law and a fracture criterion as plain functions, beside or instead of those of `physics`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from riftberg.engines.common.forces.media import FORCES
from riftberg.errors import InputError, RunError
from riftberg.ocean.forcing import Forcing, WrappedForcing
from riftberg.parameters import Parameters
from riftberg.state import Elements, Floats
from riftberg.system.input_files import value_shown

ElementLaw = Callable[[Elements, float], Sequence[Any]]
"""A function of the elements and the time (s since the start)."""

Ratios = Callable[[Any, Any], Any]
"""Stress over strength: a function of `riftberg.engines.quasi_static.fracture.criteria.Equilibrium` and the strengths of its
intact bonds."""


LAW_NAMES: Final = ("force", "melt", "fracture", "drag")
"""What a user may give, in the order in which a restart file says which were there."""

DRAGS: Final = {"water": "own_water_drag", "air": "own_air_drag", "sea_ice": "own_ice_drag"}
"""Media whose drag a user may give, and where the elements keep it."""

OWN_VARIABLES: Final = ("own_x", "own_y", "own_rate", *DRAGS.values())
"""Variables of the environment that laws of the user fill."""


@dataclass(frozen=True)
class Laws:
    """Functions that a model calls for a force, for drag, for melt and for fracture.

    A function that `numba.njit` compiles will do as well. A run that is resumed needs the same laws again.

    Parameters
    ----------
    force : callable, mapping of str to callable, or sequence of callable, optional
        ``force(elements, time)`` returns the eastward and the northward force (N) on each element, beside all others. It is
        called wherever the forcing is sampled, with the environment already in ``elements.environment``. Several forces act
        together, and stand in outputs and budgets each under its name: the key, or the name of the function. A third value is
        the rate (kg s-1, 0 or more) at which the force falls with the velocity of the element: with it the force is taken
        implicitly, and a stiff one needs no short step.
    drag : mapping of str to callable, optional
        ``drag(elements, time)`` by medium (``water``, ``air``, ``sea_ice``) returns the coefficient C (kg m-1) of the force
        ``C |U - u| (U - u)`` by the medium's velocity U on an element that moves at u, in place of the built-in drag of that
        medium. It is taken implicitly as the built-in one is. The hold of a dense pack and the drag on rotation stay.
    melt : callable, optional
        ``melt(elements, time)`` returns the rates (m s-1) at which base, sides and waves take ice, in place of the built-in
        ones; None for a process leaves it as it is. It needs ``melt.enabled``.
    fracture : callable, optional
        ``fracture(equilibrium, strengths)`` returns stress over strength of each intact bond; above 1 a bond breaks. It takes the
        place of ``fracture.criterion`` in the scheme ``quasi_static``. ``equilibrium.stress`` is the tension and shear (Pa) of
        the intact bonds, ``equilibrium.tensor`` the stress of elastic cells there (xx, yy, xy; tension is positive);
        ``strengths.normal`` and ``strengths.shear`` are what damage has left of the strengths (Pa).
    """

    force: ElementLaw | Mapping[str, ElementLaw] | Sequence[ElementLaw] | None = None
    melt: ElementLaw | None = None
    fracture: Ratios | None = None
    drag: Mapping[str, ElementLaw] | None = None

    def given(self) -> dict[str, Callable[..., Any]]:
        """Return the laws that are there, by name."""
        return {name: law for name in LAW_NAMES if (law := getattr(self, name)) is not None}

    def forces(self) -> dict[str, ElementLaw]:
        """Return the forces by name."""
        if self.force is None or callable(self.force):
            return {} if self.force is None else {law_name(self.force): self.force}
        if isinstance(self.force, Mapping):
            return dict(self.force)
        by_name = {law_name(law): law for law in self.force}
        if len(by_name) < len(self.force):
            raise InputError(
                "two forces of one name", where="Laws, force", remedy="Name them: force={'tug': ..., 'mooring': ...}"
            )
        return by_name

    def several(self) -> tuple[str, ...]:
        """Return the names of forces that stand in outputs and budgets beside their sum; none where there is only one."""
        names = tuple(self.forces())
        return names if len(names) > 1 else ()

    def named(self) -> str:
        """Return the functions by name, such as ``force by tug, melt by convective_melt``; nothing where there are none."""
        whose = {kind: law_name(law) for kind, law in self.given().items()}
        for kind, laws in (("force", self.forces()), ("drag", self.drag or {})):
            if kind in whose:
                whose[kind] = " and ".join(laws)
        return ", ".join(f"{kind} by {name}" for kind, name in whose.items())

    def check(self, p: Parameters) -> None:
        """Refuse what is no function, and a law that the parameters leave no room for."""
        if not (self.force is None or callable(self.force) or isinstance(self.force, Mapping | list | tuple)):
            raise InputError(f"{value_shown(self.force)} is no function", where="Laws, force", remedy="Give a function")
        if self.drag is not None and (not isinstance(self.drag, Mapping) or self.drag.keys() - DRAGS):
            raise InputError(
                f"{value_shown(self.drag)} names no medium whose drag it is", where="Laws, drag",
                remedy="Name it: drag={'water': ..., 'air': ..., 'sea_ice': ...}",
            )  # fmt: skip
        own_drag = (self.drag or {}).items()
        for name, law in (*self.forces().items(), *own_drag, ("melt", self.melt), ("fracture", self.fracture)):
            if law is not None and not callable(law):
                raise InputError(f"{value_shown(law)} is no function", where=f"Laws, {name}", remedy="Give a function")
        for name in self.several():
            if not name.isidentifier() or name in FORCES:
                raise InputError(
                    f"{name!r} cannot name a force", where="Laws, force",
                    remedy="Give each a name of letters, digits and _ that no built-in force has: {'tug': ...}",
                )  # fmt: skip
        if self.melt is not None and not p.melt.enabled:
            raise InputError(
                "a melt law is given, but nothing melts", where="Laws, melt", remedy="Set melt.enabled = true"
            )
        if self.fracture is not None and not (p.fracture.enabled and p.stepping.scheme == "quasi_static"):
            raise InputError(
                "a fracture criterion is given, but "
                + ("no bond can break" if not p.fracture.enabled else f"the scheme {p.stepping.scheme} has its own"),
                where="Laws, fracture",
                remedy="Set fracture.enabled = true and stepping.scheme = 'quasi_static'",
            )


class WithOwnForces(WrappedForcing):
    """A forcing with forces and drags of one's own.

    They are sampled with the environment, so that each scheme takes them at its own moments.
    """

    def __init__(self, forcing: Forcing, laws: Laws) -> None:
        self.forcing, self.forces, self.drags = forcing, laws.forces(), laws.drag or {}
        self.called: list[Floats] = []  # What they gave, N, shape (forces, 2, elements), each time in this step

    def describe(self) -> str:
        """Describe the forcing, and name the forces."""
        custom = ((f"force of one's own: {' and '.join(self.forces)}", self.forces),
               (f"drag of one's own: {' and '.join(self.drags)}", self.drags))  # fmt: skip
        return "; ".join([self.forcing.describe(), *(text for text, laws in custom if laws)])

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements, and the forces and drags on them."""
        self.forcing.sample(elements, time)
        environment, motion = elements.environment, elements.motion
        for medium, law in self.drags.items():
            getattr(environment, DRAGS[medium])[:] = drag_values(law, elements, time, medium)
        if not self.forces:
            return
        rows = [force_values(law, elements, time) for law in self.forces.values()]
        x, y, rate = np.sum(rows, axis=0)
        self.called.append(np.stack(rows)[:, :2])
        # A force that falls with the velocity is what it would be at rest, less the rate times the velocity.
        environment.own_x[:], environment.own_y[:] = x + rate * motion.u, y + rate * motion.v
        environment.own_rate[:] = rate

    def begin_step(self) -> None:
        """Forget what was called in the steps before, but for the last time: a scheme may begin with it."""
        self.called = self.called[-1:]

    def shared(self, mass: Floats, applied: Floats) -> Floats:
        """Share the acceleration (m s-2, shape (elements, 2)) that all forces gave in a step among them.

        A scheme that calls the forces more than once in a step applies a mean of them. Its weights are found by least squares
        from the sums; what they leave goes to each force by its size, so that the shares add up. Returns an array of shape
        (elements, forces, 2).
        """
        each = np.stack([forces for forces in self.called if forces.shape[-1] == mass.size])
        total_force = mass * applied.T
        sums = each.sum(axis=1).reshape(len(each), -1)
        # The last row counts only where the forces cancel: there the weights are those of a mean.
        scale = 1e-7 * float(np.abs(each).max()) or 1.0
        rows = np.concatenate([sums, np.full((len(each), 1), scale)], axis=1).T
        weight = np.linalg.lstsq(rows, np.append(total_force.ravel(), scale), rcond=None)[0]
        estimate = np.tensordot(weight, each, 1)
        size = np.abs(estimate)
        total = size.sum(axis=0)
        share = np.divide(size, total, out=np.full(size.shape, 1.0 / len(size)), where=total > 0.0)
        return np.asarray(
            np.moveaxis(estimate + share * (total_force - estimate.sum(axis=0)), -1, 0) / mass[:, None, None]
        )


@contextmanager
def to_read(groups: Iterable[Iterable[Any]], contents: str, where: str) -> Iterator[None]:
    """Let a law read arrays and change none: a law is called several times in a step, also in one that is taken back."""
    arrays = [array for group in groups for array in group if isinstance(array, np.ndarray) and array.flags.writeable]
    for array in arrays:
        array.flags.writeable = False
    try:
        yield
    except ValueError as error:
        if "read-only" not in str(error):
            raise
        raise RunError(f"{where} changes the {contents}. Return what it gives; what changes elements is a process "
                       "(Model.after_step)") from error  # fmt: skip
    finally:
        for array in arrays:
            array.flags.writeable = True


def law_name(law: object) -> str:
    """Return the name of a function of the user."""
    return str(getattr(law, "__name__", "a function"))


def force_values(law: ElementLaw, elements: Elements, time: float) -> Floats:
    """Return force (N, east and north) and rate (kg s-1; 0 where a law gives none) of a law, shape (3, elements)."""
    values = law_values(law, elements, time, "force", ("eastward", "northward"), optional=("rate",))
    if (values[2] < 0.0).any():
        e = int(np.flatnonzero(values[2] < 0.0)[0])
        raise RunError(
            f"Laws, force: {law_name(law)}, rate: {values[2, e]:g} kg s-1 for element {int(elements.body.id[e])}. A force that "
            "grows with the velocity of the ice has no rate: return the force alone"
        )
    return values


def drag_values(law: ElementLaw, elements: Elements, time: float, medium: str) -> Floats:
    """Return the coefficient (kg m-1) of a drag by a law, shape (elements,)."""

    def as_sequence(elements: Elements, time: float) -> Sequence[Any]:
        return (law(elements, time),)

    as_sequence.__name__ = law_name(law)
    (coefficients,) = law_values(as_sequence, elements, time, f"drag of {medium}", ("coefficient",), least=0.0)
    return np.asarray(coefficients)


def law_values(
    law: ElementLaw, elements: Elements, time: float, kind: str, names: tuple[str, ...], least: float = -math.inf,
    optional: tuple[str, ...] = (), may_leave: bool = False,
) -> Floats:  # fmt: skip
    """Return the values of a law for each of some names, shape (names, elements).

    0 for ``optional`` names that it leaves out, NaN where it gives None: it ``may_leave`` that to the built-in law.
    """
    where = f"Laws, {kind}: {law_name(law)}"
    with to_read(elements, "elements", where):
        returned = law(elements, time)
    all_names = names + optional
    if not isinstance(returned, Sequence | np.ndarray) or len(returned) not in (len(names), len(all_names)):
        raise RunError(f"{where} returns {value_shown(returned)} instead of {len(names)} arrays ({', '.join(names)})")
    out = np.zeros((len(all_names), elements.size))
    for row, name, values in zip(out, all_names, returned, strict=False):
        remedy = f"Return a number{'' if least < 0.0 else ' of 0 or more'}, or an array of one for each of the elements"
        try:
            row[:] = np.nan if values is None else values
        except (TypeError, ValueError) as error:
            raise RunError(
                f"{where}, {name}: {value_shown(values)} is no number and no array of {elements.size}. {remedy}"
            ) from error
        bad = ~(np.isfinite(row) & (row >= least))
        if bad.any() and not (values is None and may_leave):
            e = int(np.flatnonzero(bad)[0])
            raise RunError(f"{where}, {name}: {row[e]:g} for element {int(elements.body.id[e])}. {remedy}")
    return out
