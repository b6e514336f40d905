"""Variables of a run file besides the state: names, units, and a function of the model that gives the values at each record.

Applied forces, the ledgers of momentum, energy, ice and heat, and the variables of a user are all of this kind.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import netCDF4
import numpy as np

from riftberg.engines.common.forces.media import FORCES
from riftberg.errors import RunError
from riftberg.life.ledger import PROCESSES, SOURCES, mass_in_bits, read_melt
from riftberg.life.motion import GIVERS, bonds_vibrate
from riftberg.runs.layout import define_texts, texts
from riftberg.state import Floats, Variable
from riftberg.state.population import by_identifier

if TYPE_CHECKING:
    from riftberg.model import BareModel


class Derived(NamedTuple):
    """Quantities of a run file that come from one function of the model."""

    variables: tuple[Variable, ...]
    of: Callable[[Any], Sequence[Any]]  # Takes the model and returns the values of each variable
    over: str = "trajectory"  # Dimension of the values: the elements, or one of `LABELS`
    mean: bool = False  # Mean of the long steps since the record before, instead of the value at the record


LABELS: Final[dict[str, tuple[Sequence[str], str]]] = {
    "force": (
        GIVERS, "what gives momentum and energy: forces from outside, elements to each other, melt and births, others",
    ),
    "process": (PROCESSES, "way in which ice becomes melt water"),
    "total": ((), ""),
}  # fmt: skip
"""Dimensions of the ledgers, with their labels and the meaning of these; ``total`` has one entry and no label."""


# ---- what is written --------------------------------------------------------------------------------------------------


def force_variables() -> list[Variable]:
    """Return the variables of a run file with forces: east and north for every row of the table of media."""
    return [
        Variable(f"force_{name}_{axis}", "N", f"mean {word} force of {name.replace('_', ' ')} since the record before")
        for name in FORCES
        for axis, word in (("x", "eastward"), ("y", "northward"))
    ]


# A long step of the multiple-time-step scheme applies its slow forces about its start and the sea floor in its sub-steps;
# both count for the step in which they change the velocities.
APPLIED: Final = Derived(
    tuple(force_variables()), lambda model: model.applied_forces().reshape(model.elements.size, -1).T, mean=True
)
"""Mean force of each medium on each element."""


USER_LAW: Final = "a law of the user"
"""Words in the description of a force by which readers know it."""


def own_applied(model: BareModel) -> list[Derived]:
    """Return the mean force of each of several laws of the user on each element."""
    variables = tuple(
        Variable(f"force_{name}_{axis}", "N", f"mean {word} force of {name}, {USER_LAW}, since the record before")
        for name in model.laws.several()
        for axis, word in (("x", "eastward"), ("y", "northward"))
    )
    of = lambda model: model.own_forces().reshape(model.elements.size, -1).T  # noqa: E731
    return [Derived(variables, of, mean=True)] if variables else []


def _own_totals(names: Sequence[str]) -> Derived:
    """Return impulse and work of each of several laws of the user since the start."""
    variables = tuple(
        Variable(f"{quantity}_{name}{axis}", unit, f"{text} {name}, a law of the user, since the start")
        for name in names
        for quantity, axis, unit, text in (
            ("impulse", "_x", "N s", "eastward momentum given by"), ("impulse", "_y", "N s", "northward momentum given by"),
            ("work", "", "J", "work of"),
        )
    )  # fmt: skip

    return Derived(variables, _motion(lambda b: [value for totals in b.own.values() for value in totals]), "total")


def user_variables(functions: Mapping[str, tuple[str, Callable[[Any], Any]]]) -> list[Derived]:
    """Return the variables of a user: unit and function of the model, by name."""

    def checked(name: str, function: Callable[[Any], Any]) -> Callable[[Any], Sequence[Any]]:
        def values(model: BareModel) -> Sequence[Any]:
            array = np.asarray(function(model), np.float64)
            if array.shape != (model.elements.size,):
                raise RunError(
                    f"derived variable {name}: shape {array.shape}, but there are {model.elements.size} elements"
                )
            return (array,)

        return values

    return [
        Derived((Variable(name, unit, name.replace("_", " ")),), checked(name, function))
        for name, (unit, function) in functions.items()
    ]


def _motion(of: Callable[[Any], Sequence[Any]]) -> Callable[[Any], Sequence[Any]]:
    """Return a function of the ledger of momentum and energy as one of the model."""
    return lambda model: of(model.motion.balance(model, model.remembered))


def _ice_totals(model: Any) -> Sequence[Any]:
    b = model.life.balance(model)
    gained = sum(b.gained[name] for name in SOURCES)
    return b.now, mass_in_bits(model.elements.life), gained, b.error, b.heat_error


def _melt_by_process(model: Any) -> Sequence[Any]:
    b = model.life.balance(model)
    return [[by[name] for name in PROCESSES] for by in (b.water, b.heat)]


MOTION: Final = (
    Derived((
        Variable("impulse_x", "N s", "eastward momentum given to the bergs since the start, by force"),
        Variable("impulse_y", "N s", "northward momentum given to the bergs since the start, by force"),
        Variable("work", "J", "work done on the bergs since the start, by force"),
    ), _motion(lambda b: [
        *zip(*(b.impulse[name] for name in GIVERS), strict=True), [b.work[name] for name in GIVERS],
    ]), "force"),
    Derived((
        Variable("momentum_x", "N s", "eastward momentum of all bergs"),
        Variable("momentum_y", "N s", "northward momentum of all bergs"),
        Variable("kinetic_energy", "J", "kinetic energy of all bergs, with that of spin"),
        Variable("cracks_energy", "J", "elastic energy that broken bonds have released since the start"),
        Variable("crushing_energy", "J", "plastic work and friction of faces that crush each other since the start"),
    ), _motion(lambda b: (*b.momentum_now, b.kinetic_now, b.released, b.crushed)), "total"),
)  # fmt: skip
"""The ledger of momentum and energy."""


def _state_digest(model: Any) -> tuple[float]:
    """Return a checksum of what moves and breaks: places, motion, ice and keels of the elements, and their bonds."""
    el, total = model.elements, 0
    for array in (*el.place, *el.motion, *el.body, *el.keel, model.bonds.status):
        values: Any = np.ascontiguousarray(array)
        total = zlib.crc32(values, total)
    return (float(total),)


STATE_DIGEST: Final = "state_digest"
"""Variable by which runs are compared bit by bit."""

DIGEST: Final = Derived((Variable(STATE_DIGEST, "1", "checksum of the state; the same in runs of the same bits"),),
                        _state_digest, "total")  # fmt: skip

IN_BONDS: Final = Derived((
    Variable("elastic_energy", "J", "elastic energy in bonds"),
    Variable("dissipated_energy", "J", "energy lost in dampers and contacts since the start"),
), _motion(lambda b: (b.elastic_now, b.dissipated)), "total")  # fmt: skip
"""Further entries of that ledger where bonds vibrate."""

IN_THE_BED: Final = Derived((
    Variable("bed_friction_energy", "J", "work of friction on a bed of sediment since the start"),
), _motion(lambda b: (b.rubbed,)), "total")  # fmt: skip
"""Further entries on a bed of sediment."""

ICE: Final = (
    Derived((
        Variable("melt_water", "kg", "melt water since the start by process"),
        Variable(
            "melt_heat", "J",
            "heat that melt water brought to the ocean since the start by process, negative as ice takes it",
        ),
    ), _melt_by_process, "process"),
    Derived((
        Variable("ice_mass", "kg", "ice in all bergs and bits"),
        Variable("ice_in_bits", "kg", "ice in bergy bits and footloose bits"),
        Variable("ice_gained", "kg", "ice that came since the start other than by melt and freezing, negative where it went"),
        Variable("ledger_error", "1", "what is left over in the ledger of mass, as part of its turnover"),
        Variable("ledger_heat_error", "1", "the same in the ledger of heat"),
    ), _ice_totals, "total"),
)  # fmt: skip
"""The ledger of ice and heat."""

FRAGMENT_MELT: Final = "fragment_melt_water"
"""Variable over fragments and processes; it is written anew with the family tree."""


def list_ledgers(model: BareModel) -> tuple[Derived, ...]:
    """Return the ledgers that a model keeps; not all models that may be written keep any."""
    motion: tuple[Derived, ...] = (*MOTION, DIGEST) if model.motion is not None else ()
    if motion and (names := model.laws.several()):
        motion = (*motion, _own_totals(names))
    if motion and bonds_vibrate(model):
        motion = (*motion, IN_BONDS)
    if motion and model.parameters.grounding.law == "seabed":
        motion = (*motion, IN_THE_BED)
    return motion if model.life is None else (*motion, *ICE)


# ---- how it is written ------------------------------------------------------------------------------------------------


class Means:
    """Means of derived variables over the long steps between records."""

    def __init__(self, model: BareModel, derived: Sequence[Derived]) -> None:
        self.derived = [entry for entry in derived if entry.mean]
        self._ids = model.elements.body.id.copy()
        self._width = sum(len(entry.variables) for entry in self.derived)
        self._sum: Floats = np.zeros((model.elements.size, self._width))
        self._seconds = 0.0

    def add(self, model: BareModel) -> None:
        """Add the long step that was just taken."""
        if not self.derived:
            return
        dt = model.parameters.time_step
        self._follow(model)
        self._sum = self._sum + dt * np.concatenate([np.asarray(entry.of(model)) for entry in self.derived]).T
        self._seconds += dt

    def _follow(self, model: BareModel) -> None:
        """Begin at zero for the newly born, and forget those that are no more."""
        ids = model.elements.body.id
        if not np.array_equal(self._ids, ids):
            self._sum = by_identifier(self._ids, self._sum, ids)
            self._ids = ids.copy()

    @property
    def kept(self) -> dict[str, Floats]:
        """The state to go on from: sums (of the unit times s) and length (s) since the record before."""
        return {"sums": self._sum.copy(), "seconds": np.array(self._seconds)} if self.derived else {}

    def take_up(self, sums: Floats | None, seconds: Floats | None) -> None:
        """Restore the sums of `kept`, where they are of these elements and quantities."""
        if self.derived and seconds is not None and sums is not None and np.size(sums) == self._sum.size:
            self._sum, self._seconds = np.array(sums).reshape(self._sum.shape), float(seconds)

    def begin(self) -> None:
        """Begin a new interval."""
        self._sum, self._seconds = np.zeros_like(self._sum), 0.0

    def values(self, model: BareModel) -> dict[str, Floats]:
        """Return the means since the interval began by name, NaN where no step was taken."""
        self._follow(model)
        mean = self._sum / self._seconds if self._seconds > 0.0 else np.full_like(self._sum, np.nan)
        names = [v.name for entry in self.derived for v in entry.variables]
        return dict(zip(names, mean.T, strict=True))


def values_now(model: BareModel, derived: Sequence[Derived]) -> dict[str, Floats]:
    """Return the derived variables of a model at this moment, by name."""
    return {
        v.name: np.atleast_1d(np.asarray(values, np.float64))
        for entry in derived if not entry.mean
        for v, values in zip(entry.variables, entry.of(model), strict=True)
    }  # fmt: skip


def define_ledgers(file: netCDF4.Dataset, model: BareModel) -> None:
    """Create dimensions and variables of the ledgers that a model keeps."""
    for entry in list_ledgers(model):
        if entry.over not in file.dimensions:
            labels, meaning = LABELS[entry.over]
            file.createDimension(entry.over, len(labels) or 1)
            if labels:
                names = define_texts(file, entry.over, entry.over)
                names[:] = texts(labels)
                names.long_name = meaning
        for v in entry.variables:
            variable = file.createVariable(v.name, "f8", (entry.over, "time"), fill_value=False, fletcher32=True)
            variable.setncatts({"units": v.units, "long_name": v.long_name})
    if model.life is not None:
        by_fragment = file.createVariable(
            FRAGMENT_MELT, "f8", ("fragment", "process"), fill_value=np.nan, fletcher32=True
        )
        by_fragment.setncatts(
            {"units": "kg", "long_name": "melt water of elements while they belonged to the fragment, by process"}
        )


def write_fragment_melt(file: netCDF4.Dataset, model: BareModel) -> None:
    """Write the melt water of all fragments so far, where something melts."""
    if model.life is not None and len(model.fragments.rows):
        numbers = np.array([row.number for row in model.fragments.rows], np.int64)
        file[FRAGMENT_MELT][: numbers.size] = read_melt(model.remembered, numbers)
