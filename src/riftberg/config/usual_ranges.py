"""Usual ranges of what a run is given, and what is said of a value outside: a slip of units is seldom impossible.

Usual ranges of parameters stand in their fields; here are those of a berg and its elements (``berg.name``) and of formulas of
forcing (``Class.name``). What is physically impossible is refused where the parameter or key is defined.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final, NamedTuple

import numpy as np

from riftberg.config.explicit_groups import Compatibility
from riftberg.config.values import Usual, field_extra, field_unit

_CURRENT: Final = Usual(-3.0, 3.0, "the Gulf Stream reaches 2.5 m s-1", "m s-1")
_WIND: Final = Usual(-50.0, 50.0, "a hurricane begins at 33 m s-1", "m s-1")
_ACROSS: Final = Usual(1e3, 5e5, "fronts and eddies are some to some hundred km wide", "m")
_DEPTH: Final = Usual(1.0, 11_000.0, "the deepest sea floor", "m", off=True)
_SEA: Final = Usual(-2.0, 15.0, "freezing point of sea water, and where the last bergs melt", "degree_Celsius")
_SALT: Final = Usual(20.0, 37.0, "from fjords to the open Atlantic", "1e-3")

USUAL: Final[dict[str, Usual]] = {
    "berg.thickness": Usual(20.0, 600.0, "tabular bergs are 100 to 400 m thick", "m"),
    "berg.radius": Usual(5.0, 1e4, "half the width of an element: some m to some km", "m"),
    "berg.area": Usual(100.0, 1.2e10, "B-15, the largest berg seen, had 1.1e10 m2", "m2"),
    "berg.speed": Usual(0.0, 3.0, "bergs drift at some dm s-1", "m s-1"),
    "berg.spin": Usual(0.0, 1e-3, "a turn in two hours", "rad s-1"),
    "berg.latitude": Usual(
        35.0, 88.0, "bergs are rarely seen closer to the equator; longitude stands first", "degrees N or S"
    ),
    "Uniform.slope": Usual(-1e-4, 1e-4, "4e-5 holds a current of 3 m s-1 in balance at 60 degrees", "1"),
    "Uniform.temperature": _SEA,
    "Uniform.salinity": _SALT,
    "Uniform.current": _CURRENT,
    "Uniform.wind": _WIND,
    "Uniform.sea_ice": Usual(-2.0, 10.0, "sea ice drifts at some dm s-1 and is some m thick", "m s-1 or m"),
    "Uniform.water": _DEPTH,
    "Eddy.radius": _ACROSS,
    "Eddy.speed": _CURRENT,
    "Eddy.velocity": Usual(-1.0, 1.0, "eddies travel at some cm s-1", "m s-1"),
    "Stream.speed": _CURRENT,
    "Straight.width": _ACROSS,
    "Front.step": Usual(-2.0, 2.0, "the Gulf Stream has 1 m", "m"),
    "Front.temperature": Usual(-2.0, 30.0, "sea water", "degree_Celsius"),
    "Tide.major": _CURRENT,
    "Tide.minor": _CURRENT,
    "Tide.period": Usual(1e4, 2.6e6, "from overtides of 3 hours to the month", "s"),
    "Seamount.height": Usual(1.0, 6000.0, "from shoals to volcanoes", "m"),
    "Seamount.width": Usual(50.0, 3e5, "from rocks to plateaus", "m"),
    "Seamount.plain": _DEPTH,
    "Slope.gradient": Usual(-0.3, 0.3, "continental slopes have 0.05 to 0.1", "1"),
    "Slope.middle": _DEPTH,
    "TurningWind.speed": Usual(0.0, 50.0, "a hurricane begins at 33 m s-1", "m s-1"),
    "TurningWind.turning": Usual(-60.0, 60.0, "fronts and lows turn it by some degrees in an hour", "degree h-1"),
}

STEPS_IN_A_TIDE: Final = 12.0
"""Long steps in the period of a tide below which its current is poorly followed."""


def unusual(parameters: Any, elements: Any, forcing: Any, *, placed: bool = True) -> dict[str, str]:
    """Return the values outside their usual range or without effect, a sentence for each name."""
    sentences: dict[str, str] = {}
    checked = [*_of_parameters(parameters), *_of_forcing(forcing), *(_of_bergs(parameters, elements) if placed else [])]
    for name, usual, values, unit in checked:
        array = np.ravel(np.asarray(values, np.float64))
        low, high = usual.low, usual.high
        bad = array[((array < low) | (array > high)) & ~((array == 0.0) & usual.off)]
        if bad.size:
            value = bad[np.argmax(np.abs(bad))]
            unit = "" if unit == "1" else f" {unit}"
            kind, _, key = name.partition(".")  # the name as the user wrote it
            label = f"forcing, {kind}: {'depth' if key in _DEPTHS else key}" if kind[0].isupper() else name
            sentences[name] = (
                f"{label} = {value:g}{unit} is unusual: from {low:g} to {high:g}{unit} would be usual ({usual.source})"
            )
    step = parameters.time_step
    for change, seconds, most in changes_in_time(forcing):
        if step > most:
            sentences[change] = (
                f"the long step of {step / 3600.0:g} h is too long for {change} {seconds / 3600.0:.4g} h, which it passes over: "
                f"set stepping.time_step to {most:g} s or less"
            )
    if parameters.stepping.in_equilibrium and _lacks_concentration(forcing):
        sentences["sea_ice"] = "sea ice without its concentration (ice_fraction) exerts no force in the default scheme"
    return {**sentences, **without_effect(parameters)}


def _lacks_concentration(forcing: Any) -> bool:
    """Whether formulas give a thickness of sea ice, and nothing its concentration."""
    components = forcing.components()
    formulas = [
        component for component in components if "Uniform" in _own_kinds(component) and component.sea_ice[2] > 0.0
    ]
    has_concentration = "ice_fraction" in forcing.provides or any(
        getattr(component, "ice_fraction", 0.0) > 0.0 for component in components
    )
    return bool(formulas) and not has_concentration


def of_records(hours: float, days: float, parameters: Any) -> list[str]:
    """Return warnings about the interval between the records of a run of some days, a sentence each."""
    steps = 3600.0 * hours / parameters.time_step
    sentences = []
    if steps > 1.0 and abs(steps - round(steps)) > 1e-6 * steps:
        sentences.append(
            f"records every {hours:g} h are no whole number of long steps ({parameters.time_step / 3600.0:g} h): each "
            "comes with the first step that ends at its time or later"
        )
    if hours > 24.0 * days * (1.0 + 1e-9):
        sentences.append(
            f"records every {hours:g} h, but the run ends after {24.0 * days:g} h: it has its start and its end alone"
        )
    return sentences


def of_length(days: float, parameters: Any) -> list[str]:
    """Return where a run of some days ends if these are no whole number of time steps, a sentence."""
    step = parameters.time_step
    steps = 86400.0 * days / step
    count = round(steps)
    if count < 1 or abs(steps - count) <= 1e-6 * steps:
        return []
    return [
        f"{days:g} days are no whole number of time steps of {step:g} s: the run ends after {count} of them, at "
        f"{count * step / 86400.0:.6g} days"
    ]


_DEPTHS: Final = ("water", "plain", "middle")
"""What the classes of forcing call the depth that they are given."""


def _of_parameters(parameters: Any) -> Iterator[tuple[str, Usual, Any, str]]:
    """Give the parameters that have a usual range and are not left open, each with its range."""
    for group in type(parameters).model_fields:
        section = getattr(parameters, group)
        for key, field in type(section).model_fields.items():
            usual, value = field_extra(field, "usual"), getattr(section, key)
            on_plane = (group, key) == ("earth", "radius") and not section.latlon
            if usual is not None and value is not None and not on_plane:
                yield f"{group}.{key}", usual, value, field_unit(field)


def _of_forcing(forcing: Any) -> Iterator[tuple[str, Usual, Any, str]]:
    """Give the values of formulas that have a usual range."""
    for component in forcing.components():
        for kind in _own_kinds(component):
            for name, usual in USUAL.items():
                value = getattr(component, name.partition(".")[2], None) if name.startswith(f"{kind}.") else None
                if value is not None and value != np.inf:
                    yield name, usual, value, usual.unit


def _own_kinds(component: Any) -> list[str]:
    """Names of the package's own classes of a forcing; a user's class may share a name and hold something else."""
    return [kind.__name__ for kind in type(component).__mro__ if kind.__module__.startswith("riftberg.")]


def _of_bergs(parameters: Any, elements: Any) -> Iterator[tuple[str, Usual, Any, str]]:
    """Give the sizes, speeds and places of the bergs and their elements."""
    body, place = elements.body, elements.place
    area = body.length * body.width
    values = {
        "thickness": body.thickness, "radius": 0.5 * np.sqrt(area),
        "area": np.bincount(np.unique(body.berg, return_inverse=True)[1], area), "spin": np.abs(elements.spin),
        "speed": np.hypot(elements.u, elements.v), "latitude": np.abs(place.lat) if parameters.earth.latlon else [],
    }  # fmt: skip
    for key, value in values.items():
        usual = USUAL[f"berg.{key}"]
        yield f"berg.{key}", usual, value, usual.unit


def changes_in_time(forcing: Any) -> Iterator[tuple[str, float, float]]:
    """Give each change in a forcing, its period or interval (s), and the longest step that follows it."""
    for component in forcing.components():
        times = getattr(getattr(component, "records", component), "times", None)
        if times is not None and len(times) > 1:
            interval = float(np.median(np.diff(times)))
            yield f"{getattr(component, 'shown', '') or 'forcing'} with records every", interval, interval
        if "Tide" in _own_kinds(component):
            yield "a tide with a period of", component.period, component.period / STEPS_IN_A_TIDE


# Parameters that only one law reads: a user who sets the exponent of damage while there is none is told before the run.


class Law(NamedTuple):
    """When parameters are read: in words, and of a set of parameters; and their names."""

    needs: str
    acts: Callable[[Any], bool]
    group: str
    names: tuple[str, ...]


LAWS: Final = (
    Law("sea_ice.capture = 'limited' or 'locked'", lambda p: p.sea_ice.capture != "none", "sea_ice", ("strength", "decay")),
    Law("sea_ice.capture = 'locked'", lambda p: p.sea_ice.capture == "locked", "sea_ice", (
        "locked_concentration", "locked_strength")),
    Law("grounding.law = 'seabed'", lambda p: p.grounding.law == "seabed", "grounding", (
        "sediment", "stiffness", "bearing_strength", "friction", "shear_strength", "adhesion", "anchor_way", "bending",
        "ice_modulus", "start")),
    Law("grounding.law = 'quadratic'", lambda p: p.grounding.law == "quadratic", "grounding", ("quadratic_coefficient",)),
    Law("grounding.law = 'linear'", lambda p: p.grounding.law == "linear", "grounding", ("coefficient", "ramp_height", "torque")),
    Law("bonds.law = 'dem'", lambda p: p.bonds.law == "dem", "bonds", ("poisson", "damping")),
    Law("fracture.criterion = 'toughness'", lambda p: p.fracture.criterion == "toughness", "fracture", ("toughness",)),
    Law("damage.enabled", lambda p: p.damage.enabled, "damage", ("threshold", "time_scale", "exponent")),
    Law("rolling.enabled", lambda p: p.rolling.enabled, "rolling", ("scheme", "tip")),
    Law("footloose.enabled", lambda p: p.footloose.enabled, "footloose", (
        "youngs", "strength", "modulus", "style", "displace", "berg_mass", "seed")),
    Law("footloose.modulus = 'relaxed'", lambda p: p.footloose.enabled and p.footloose.modulus == "relaxed",
        "footloose", ("viscosity",)),
    Law("melt.enabled", lambda p: p.melt.enabled or p.footloose.enabled or p.rolling.enabled, "melt", (
        "mode", "base", "split", "bits_fraction", "const_gamma", "gamma_t", "friction_drag", "least_friction", "tide",
        "least_gap")),
)  # fmt: skip
"""Parameters that other laws of the same engine leave unread."""


def without_effect(parameters: Any) -> dict[str, str]:
    """Return the parameters that differ from their default although nothing reads them, a sentence for each name.

    Runs with the numerics of the reference are left out: a namelist gives values for laws that it switches off.
    """
    if parameters.quirks != Compatibility():
        return {}
    sentences = {}
    for law in LAWS:
        group = getattr(parameters, law.group) if law.group in type(parameters).model_fields else None
        keys = {} if group is None else type(group).model_fields
        names = [name for name in law.names if name in keys]
        if names and not law.acts(parameters):
            for name in names:
                value = getattr(group, name)
                if value != keys[name].get_default():
                    text = f"{value:g}" if isinstance(value, float) else str(value).lower()
                    sentences[f"{law.group}.{name}"] = (
                        f"{law.group}.{name} = {text} has no effect: it needs {law.needs}"
                    )
    return sentences
