"""Laws of one's own: a force, a melt law and a fracture criterion as plain functions, beside or instead of those of `physics`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from riftberg.errors import InputError, RunError
from riftberg.ocean.forcing import Forcing, WrappedForcing
from riftberg.parameters import Parameters
from riftberg.state import Elements, Floats
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
    force : callable, optional
        ``force(elements, time)`` returns the eastward and the northward force (N) on each element, beside all others. It is
        called wherever the forcing is sampled, with the environment already in ``elements.environment``.
    melt : callable, optional
        ``melt(elements, time)`` returns the rates (m s-1) at which base, sides and waves take ice, in place of the built-in
        ones; None for a process leaves it as it is. It needs ``melt.enabled``.
    fracture : callable, optional
        ``fracture(moment, strengths)`` returns stress over strength of each intact bond; above 1 a bond breaks. It takes the
        place of ``fracture.criterion`` in the scheme ``quasi_static``. ``moment.stress`` is the tension and shear (Pa) of the
        intact bonds, ``moment.tensor`` the stress of elastic cells there (xx, yy, xy; tension is positive);
        ``strengths.normal`` and ``strengths.shear`` are what damage has left of the strengths (Pa).
    """

    force: ElementLaw | None = None
    melt: ElementLaw | None = None
    fracture: Ratios | None = None

    def given(self) -> dict[str, Callable[..., Any]]:
        """Return the laws that are there, by name."""
        return {name: law for name in LAW_NAMES if (law := getattr(self, name)) is not None}

    def named(self) -> str:
        """Return the functions by name, such as ``force by tug, melt by convective_melt``; nothing where there are none."""
        return ", ".join(f"{kind} by {name_of(law)}" for kind, law in self.given().items())

    def check(self, p: Parameters) -> None:
        """Refuse what is no function, and a law that the parameters leave no room for."""
        for name, law in self.given().items():
            if not callable(law):
                raise InputError(f"{value_shown(law)} is no function", where=f"Laws, {name}", remedy="Give a function")
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

    def __init__(self, forcing: Forcing, force: ElementLaw) -> None:
        self.forcing, self.force = forcing, force

    def describe(self) -> str:
        """Return what the forcing is, and the name of the force."""
        return f"{self.forcing.describe()}; force of one's own: {name_of(self.force)}"

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements, and the force on them."""
        self.forcing.sample(elements, time)
        x, y = rows_of(self.force, elements, time, "force", ("eastward", "northward"))
        elements.environment.own_x[:], elements.environment.own_y[:] = x, y


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


def rows_of(
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
