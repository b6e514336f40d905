"""Laws of one's own: a force, a melt law and a fracture criterion as plain functions, beside or instead of those of `physics`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from riftberg.errors import InputError, RunError
from riftberg.ocean.forcing import Forcing, WrappedForcing
from riftberg.parameters import Parameters
from riftberg.state import Elements, Floats
from riftberg.stepping.forces.media import FORCES
from riftberg.system.input_files import value_shown

ElementLaw = Callable[[Elements, float], Sequence[Any]]
"""A function of the elements and the time (s since the start)."""

Ratios = Callable[[Any, Any], Any]
"""A function of `riftberg.stepping.fracture.criteria.Equilibrium` and the strengths of its intact bonds: stress over strength."""


LAW_NAMES: Final = ("force", "melt", "fracture")
"""What a user may give, in the order in which a restart file says which were there."""


@dataclass(frozen=True)
class Laws:
    """Functions that a model calls for a force, for melt and for fracture.

    A function that `numba.njit` compiles will do as well. A run that is resumed needs the same laws again.

    Parameters
    ----------
    force : callable, mapping of str to callable, or sequence of callable, optional
        ``force(elements, time)`` returns the eastward and the northward force (N) on each element, beside all others. It is
        called wherever the forcing is sampled, with the environment already in ``elements.environment``. Several forces act
        together, and stand in outputs and budgets each under its name: the key, or the name of the function.
    melt : callable, optional
        ``melt(elements, time)`` returns the rates (m s-1) at which base, sides and waves take ice, in place of the built-in
        ones; None for a process leaves it as it is. It needs ``melt.enabled``.
    fracture : callable, optional
        ``fracture(moment, strengths)`` returns stress over strength of each intact bond; above 1 a bond breaks. It takes the
        place of ``fracture.criterion`` in the scheme ``quasi_static``. ``moment.stress`` is the tension and shear (Pa) of the
        intact bonds, ``moment.tensor`` the stress of elastic cells there (xx, yy, xy; tension is positive);
        ``strengths.normal`` and ``strengths.shear`` are what damage has left of the strengths (Pa).
    """

    force: ElementLaw | Mapping[str, ElementLaw] | Sequence[ElementLaw] | None = None
    melt: ElementLaw | None = None
    fracture: Ratios | None = None

    def given(self) -> dict[str, Callable[..., Any]]:
        """Return the laws that are there, by name."""
        return {name: law for name in LAW_NAMES if (law := getattr(self, name)) is not None}

    def forces(self) -> dict[str, ElementLaw]:
        """Return the forces by name."""
        if self.force is None or callable(self.force):
            return {} if self.force is None else {name_of(self.force): self.force}
        if isinstance(self.force, Mapping):
            return dict(self.force)
        named = {name_of(law): law for law in self.force}
        if len(named) < len(self.force):
            raise InputError(
                "two forces of one name", where="Laws, force", remedy="Name them: force={'tug': ..., 'mooring': ...}"
            )
        return named

    def several(self) -> tuple[str, ...]:
        """Return the names of forces that stand in outputs and budgets beside their sum; none where there is only one."""
        names = tuple(self.forces())
        return names if len(names) > 1 else ()

    def named(self) -> str:
        """Return the functions by name, such as ``force by tug, melt by convective_melt``; nothing where there are none."""
        whose = {
            kind: " and ".join(self.forces()) if kind == "force" else name_of(law) for kind, law in self.given().items()
        }
        return ", ".join(f"{kind} by {name}" for kind, name in whose.items())

    def check(self, p: Parameters) -> None:
        """Refuse what is no function, and a law that the parameters leave no room for."""
        if not (self.force is None or callable(self.force) or isinstance(self.force, Mapping | list | tuple)):
            raise InputError(f"{value_shown(self.force)} is no function", where="Laws, force", remedy="Give a function")
        for name, law in (*self.forces().items(), ("melt", self.melt), ("fracture", self.fracture)):
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


class WithForce(WrappedForcing):
    """A forcing with a force of one's own: sampled with the environment, so that each scheme takes it at its own moments."""

    def __init__(self, forcing: Forcing, forces: Mapping[str, ElementLaw]) -> None:
        self.forcing, self.forces = forcing, forces
        self.called: list[Floats] = []  # What they gave, N, shape (forces, 2, elements), each time in this step

    def describe(self) -> str:
        """Return what the forcing is, and the names of the forces."""
        return f"{self.forcing.describe()}; force of one's own: {' and '.join(self.forces)}"

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements, and the force on them."""
        self.forcing.sample(elements, time)
        rows = [law_values(law, elements, time, "force", ("eastward", "northward")) for law in self.forces.values()]
        self.called.append(np.stack(rows))
        elements.environment.own_x[:], elements.environment.own_y[:] = self.called[-1].sum(axis=0)

    def begin_step(self) -> None:
        """Forget what was called in the steps before, but for the last time: a scheme may begin with it."""
        self.called = self.called[-1:]

    def shared(self, mass: Floats, applied: Floats) -> Floats:
        """Share the acceleration (m s-2, shape (elements, 2)) that all forces gave in a step among them.

        A scheme that calls the forces more than once in a step applies a mean of them. Its weights are found by least squares
        from the sums; what they leave goes to each force by its size, so that the shares add up. Returns an array of shape
        (elements, forces, 2).
        """
        each = np.stack([one for one in self.called if one.shape[-1] == mass.size])
        whole = mass * applied.T
        sums = each.sum(axis=1).reshape(len(each), -1)
        # The last row counts only where the forces cancel: there the weights are those of a mean.
        scale = 1e-7 * float(np.abs(each).max()) or 1.0
        rows = np.concatenate([sums, np.full((len(each), 1), scale)], axis=1).T
        weight = np.linalg.lstsq(rows, np.append(whole.ravel(), scale), rcond=None)[0]
        given = np.tensordot(weight, each, 1)
        size = np.abs(given)
        total = size.sum(axis=0)
        share = np.divide(size, total, out=np.full(size.shape, 1.0 / len(size)), where=total > 0.0)
        return np.asarray(np.moveaxis(given + share * (whole - given.sum(axis=0)), -1, 0) / mass[:, None, None])


@contextmanager
def to_read(groups: Iterable[Iterable[Any]], what: str, where: str) -> Iterator[None]:
    """Let a law read arrays and change none: a law is called several times in a step, also in one that is taken back."""
    arrays = [array for group in groups for array in group if isinstance(array, np.ndarray) and array.flags.writeable]
    for array in arrays:
        array.flags.writeable = False
    try:
        yield
    except ValueError as error:
        if "read-only" not in str(error):
            raise
        raise RunError(f"{where} changes the {what}. Return what it gives; what changes elements is a process "
                       "(Model.after_step)") from error  # fmt: skip
    finally:
        for array in arrays:
            array.flags.writeable = True


def name_of(law: object) -> str:
    """Return the name of a function of the user."""
    return str(getattr(law, "__name__", "a function"))


def law_values(
    law: ElementLaw, elements: Elements, time: float, kind: str, names: tuple[str, ...], least: float = -math.inf
) -> Floats:
    """Return what a law gives for each of some names, shape (names, elements); NaN where it gives None."""
    where = f"Laws, {kind}: {name_of(law)}"
    with to_read(elements, "elements", where):
        given = law(elements, time)
    if not isinstance(given, Sequence | np.ndarray) or len(given) != len(names):
        raise RunError(f"{where} returns {value_shown(given)} instead of {len(names)} arrays ({', '.join(names)})")
    out = np.empty((len(names), elements.size))
    for row, name, values in zip(out, names, given, strict=True):
        try:
            row[:] = np.nan if values is None else values
        except (TypeError, ValueError) as error:
            raise RunError(f"{where}, {name}: {error}; there are {elements.size} elements") from error
        bad = ~(np.isfinite(row) & (row >= least))
        if values is not None and bad.any():
            e = int(np.flatnonzero(bad)[0])
            raise RunError(f"{where}, {name}: {row[e]:g} for element {int(elements.body.id[e])}")
    return out
