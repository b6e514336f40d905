"""Usual ranges of what a run is given, and what is said of a value outside: a slip of units is seldom impossible.

One table for all numbers that have a usual magnitude; what is physically impossible is refused where the parameter or key is
defined. Names are those of parameters (``group.name``), of a berg and its elements (``berg.name``), and of formulas of
forcing (``Class.name``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final, NamedTuple

import numpy as np

from riftberg.config.values import unit_of


class Usual(NamedTuple):
    """Smallest and largest usual value, their unit where no field has it, and where the range comes from.

    A value of 0 that leaves a law out (``off``) is as usual.
    """

    low: float
    high: float
    source: str
    unit: str = ""
    off: bool = False


_CURRENT: Final = Usual(-3.0, 3.0, "the Gulf Stream reaches 2.5 m s-1", "m s-1")
_WIND: Final = Usual(-50.0, 50.0, "a hurricane begins at 33 m s-1", "m s-1")
_ACROSS: Final = Usual(1e3, 5e5, "fronts and eddies are some to some hundred km wide", "m")
_DEPTH: Final = Usual(1.0, 11_000.0, "the deepest sea floor", "m", off=True)
_SPRING: Final = Usual(1e-9, 10.0, "E / (rho (R1 + R2)^2) of elements of 10 m to 10 km")
_SIZE: Final = Usual(5.0, 2e4, "elements of lattices are some m to some km wide", off=True)
_SEA: Final = Usual(-2.0, 15.0, "freezing point of sea water, and where the last bergs melt", "degree_Celsius")
_SALT: Final = Usual(20.0, 37.0, "from fjords to the open Atlantic", "1e-3")

USUAL: Final[dict[str, Usual]] = {
    "ice.density": Usual(800.0, 920.0, "from firn-covered shelves (850, Silva et al. 2006) to solid ice (917)"),
    "drag.water_side": Usual(0.2, 2.0, "0.25 in Keghouche et al. 2010, 0.9 in Gladstone et al. 2001", off=True),
    "drag.water_base": Usual(
        5e-4, 0.01, "0.0012, Gladstone et al. 2001, to 0.0097 under a shelf, Jenkins et al. 2010", off=True
    ),
    "drag.air_side": Usual(0.2, 2.6, "0.8 in Keghouche et al. 2010, 1.3 in Gladstone et al. 2001", off=True),
    "drag.air_top": Usual(5e-4, 0.006, "0.0013 over smooth snow to 0.0055 in Gladstone et al. 2001", off=True),
    "drag.ice_side": Usual(0.1, 10.0, "0.9 in Gladstone et al. 2001", off=True),
    "drag.ocean_scale": Usual(0.05, 20.0, "A68a was fitted with 17.8 (Huth et al. 2022)", off=True),
    "sea_ice.strength": Usual(5e3, 5e4, "5 to 27.5 kPa in models of sea ice (Hibler 1979)", off=True),
    "sea_ice.decay": Usual(5.0, 40.0, "20 in models of sea ice (Hibler 1979)"),
    "sea_ice.locked_strength": Usual(1e3, 1e5, "10 to 13 kN m-1 in models of icebergs", off=True),
    "grounding.coefficient": Usual(1e2, 1e6, "1e4 in Huth et al. 2022", off=True),
    "grounding.quadratic_coefficient": Usual(
        1.0, 1e6, "of the order of 1e3: as much drag as 1e4 at some m and m s-1", off=True
    ),
    "grounding.ramp_height": Usual(0.1, 100.0, "KID's h_to_init_grounding: a part of the draft", off=True),
    "grounding.stiffness": Usual(1e5, 1e10, "1e6 clay to 1e9 rock"),
    "grounding.bearing_strength": Usual(1e4, 5e7, "1.2e5 clay to 1e7 rock, on which ice is crushed first"),
    "grounding.friction": Usual(0.1, 0.8, "0.3 to 0.6 between keels and beds", off=True),
    "grounding.shear_strength": Usual(2e3, 2e5, "5 to 50 kPa of marine clay"),
    "grounding.ice_modulus": Usual(5e8, 1e10, "1 GPa of warm, crevassed ice, 9 GPa in laboratories"),
    "contact.spring": _SPRING,
    "contact.crushing_strength": Usual(1e5, 5e7, "1.5 MPa for faces of kilometres; 25 to 41 MPa in small impacts"),
    "contact.crushing_depth": Usual(0.1, 200.0, "20 m for faces of kilometres"),
    "contact.unloading_ratio": Usual(4.0, 1e4, "100, a restitution of 0.1"),
    "contact.friction": Usual(0.01, 1.0, "0.2 by default, a choice", off=True),
    "contact.distance": Usual(1.0, 1e4, "4000 m in Huth et al. 2022", off=True),
    "contact.tolerance": Usual(1e-12, 1e-2, "1e-4 in KID"),
    "bonds.spring": _SPRING,
    "bonds.youngs_modulus": Usual(1e6, 1e10, "5 MPa in Huth et al. 2022, 9 GPa in laboratories"),
    "bonds.poisson": Usual(0.2, 0.4, "0.3 of ice in laboratories"),
    "bonds.damping": Usual(0.01, 2.0, "1 is critical damping", off=True),
    "bonds.constant_length": _SIZE,
    "bonds.constant_width": _SIZE,
    "fracture.normal_strength": Usual(
        1e3, 2e6, "18 kPa for A68a (Huth et al. 2022), 1 MPa in laboratories (Petrovic 2003)"
    ),
    "fracture.crevasse_strength": Usual(
        2e4, 1e6, "90 to 320 kPa where crevasses are seen (Vaughan 1993); 79 kPa for A68a"
    ),
    "fracture.shear_strength": Usual(1e3, 5e6, "100 kPa for A68a (Huth et al. 2022), 1 MPa in laboratories"),
    "fracture.flexural_strength": Usual(
        5e4, 3e6, "90 to 320 kPa of glaciers (Vaughan 1993), 1 to 2 MPa in laboratories"
    ),
    "fracture.toughness": Usual(3e4, 5e5, "5e4 to 1.5e5 in laboratories (Petrovic 2003)", off=True),
    "damage.time_scale": Usual(60.0, 3.2e7, "from a minute to a year"),
    "damage.exponent": Usual(0.5, 10.0, "laws of creep and fatigue have 1 to 4"),
    "stepping.time_step": Usual(0.1, 7200.0, "steps of an hour resolve tides and inertial motion"),
    "stepping.fixed_velocity": Usual(-3.0, 3.0, "bergs drift at some dm s-1"),
    "earth.radius": Usual(6.35e6, 6.39e6, "the radius of the Earth"),
    "melt.temperature": _SEA,
    "melt.salinity": _SALT,
    "melt.gamma_t": Usual(1e-3, 0.1, "0.011 to 0.031 under ice shelves (Jenkins et al. 2010)"),
    "melt.friction_drag": Usual(5e-4, 0.02, "1e-3 to 1e-2 under ice shelves", off=True),
    "melt.least_friction": Usual(1e-5, 0.05, "1e-3 in KID", off=True),
    "melt.tide": Usual(0.01, 1.0, "speeds of tides on shelves", off=True),
    "melt.least_gap": Usual(0.1, 100.0, "some m in ocean models", off=True),
    "rolling.tip": Usual(0.5, 1.5, "0.8 to 1 by the densities of ice and water", off=True),
    "footloose.youngs": Usual(1e6, 1e10, "10 MPa in KID, 9 GPa in laboratories"),
    "footloose.strength": Usual(1e4, 2e6, "250 kPa in KID, 1 MPa in laboratories"),
    "footloose.berg_mass": Usual(1e6, 1e14, "1e12 kg in KID"),
    "calving.length_over_width": Usual(1.0, 4.0, "1.5 in KID"),
    "calving.smoothing_time": Usual(3600.0, 3.2e8, "from an hour to ten years", off=True),
    "berg.thickness": Usual(20.0, 600.0, "tabular bergs are 100 to 400 m thick", "m"),
    "berg.radius": Usual(5.0, 1e4, "half the width of an element: some m to some km", "m"),
    "berg.area": Usual(100.0, 1.2e10, "B-15, the largest berg seen, had 1.1e10 m2", "m2"),
    "berg.speed": Usual(0.0, 3.0, "bergs drift at some dm s-1", "m s-1"),
    "berg.spin": Usual(0.0, 1e-3, "a turn in two hours", "rad s-1"),
    "berg.latitude": Usual(
        35.0, 88.0, "bergs are rarely seen closer to the equator; longitude stands first", "degrees N or S"
    ),
    "Steady.current": _CURRENT,
    "Steady.wind": _WIND,
    "Steady.slope": Usual(-1e-4, 1e-4, "4e-5 holds a current of 3 m s-1 in balance at 60 degrees", "1"),
    "Steady.sea_ice": Usual(-2.0, 10.0, "sea ice drifts at some dm s-1 and is some m thick", "m s-1 or m"),
    "Steady.water": _DEPTH,
    "Steady.temperature": _SEA,
    "Steady.salinity": _SALT,
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

STEPS_IN_A_TIDE: Final = 10.0
"""Long steps in the period of a tide below which its current is poorly followed."""


def unusual(parameters: Any, elements: Any, forcing: Any, *, placed: bool = True) -> dict[str, str]:
    """Return what lies outside its usual range or is set without effect, a sentence for each name."""
    said: dict[str, str] = {}
    given = [*_of_parameters(parameters), *_of_forcing(forcing), *(_of_bergs(parameters, elements) if placed else [])]
    for name, values, unit in given:
        usual, array = USUAL[name], np.ravel(np.asarray(values, np.float64))
        low, high = usual.low, usual.high
        bad = array[((array < low) | (array > high)) & ~((array == 0.0) & usual.off)]
        if bad.size:
            value = bad[np.argmax(np.abs(bad))]
            unit = "" if unit == "1" else f" {unit}"
            kind, _, key = name.partition(".")  # the name as the user wrote it
            label = f"forcing, {kind}: {'depth' if key in _DEPTHS else key}" if kind[0].isupper() else name
            said[name] = (
                f"{label} = {value:g}{unit} is unusual: from {low:g} to {high:g}{unit} would be usual ({usual.source})"
            )
    step = parameters.stepping.time_step
    for what, seconds, most in _changes(forcing):
        if step > most:
            said[what] = (
                f"the long step of {step / 3600.0:g} h is too long for {what} {seconds / 3600.0:.4g} h, which it passes over: "
                f"set stepping.time_step to {most:g} s or less"
            )
    if parameters.stepping.scheme == "quasi_static" and _lacks_concentration(forcing):
        said["sea_ice"] = "sea ice without its concentration (ice_fraction) exerts no force in the default scheme"
    return {**said, **without_effect(parameters)}


def _lacks_concentration(forcing: Any) -> bool:
    """Whether formulas give a thickness of sea ice, and nothing its concentration."""
    parts = getattr(forcing, "parts", (forcing,))
    given = [part for part in parts if {"Steady", "Uniform"} & set(_own_kinds(part)) and part.sea_ice[2] > 0.0]
    known = any(
        getattr(part, "ice_fraction", 0.0) > 0.0 or "ice_fraction" in getattr(part, "provides", ()) for part in parts
    )
    return bool(given) and not known


def of_records(hours: float, days: float, parameters: Any) -> list[str]:
    """Return what is unusual about the interval of the records of a run of some days, a sentence each."""
    steps = 3600.0 * hours / parameters.stepping.time_step
    said = []
    if steps > 1.0 and abs(steps - round(steps)) > 1e-6 * steps:
        said.append(
            f"records every {hours:g} h are no whole number of long steps ({parameters.stepping.time_step / 3600.0:g} h): each "
            "comes with the first step that ends at its time or later"
        )
    if hours > 24.0 * days * (1.0 + 1e-9):
        said.append(
            f"records every {hours:g} h, but the run ends after {24.0 * days:g} h: it has its start and its end alone"
        )
    return said


def of_length(days: float, parameters: Any) -> list[str]:
    """Return where a run of some days ends if these are no whole number of time steps, a sentence."""
    step = parameters.stepping.time_step
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


def _of_parameters(parameters: Any) -> Iterator[tuple[str, Any, str]]:
    """Give the parameters that have a usual range and are neither left open nor as by default."""
    for name in USUAL:
        group, _, key = name.partition(".")
        section = getattr(parameters, group) if group in type(parameters).model_fields else None
        value = getattr(section, key, None)
        if section is None or value is None or (name == "earth.radius" and not section.latlon):
            continue
        yield name, value, unit_of(type(section).model_fields[key])


def _of_forcing(forcing: Any) -> Iterator[tuple[str, Any, str]]:
    """Give the values of formulas that have a usual range."""
    for part in getattr(forcing, "parts", (forcing,)):
        for kind in _own_kinds(part):
            for name, usual in USUAL.items():
                value = getattr(part, name.partition(".")[2], None) if name.startswith(f"{kind}.") else None
                if value is not None and value != np.inf:
                    yield name, value, usual.unit


def _own_kinds(part: Any) -> list[str]:
    """Names of the package's own classes of a forcing; a user's class may share a name and hold something else."""
    return [kind.__name__ for kind in type(part).__mro__ if kind.__module__.startswith("riftberg.")]


def _of_bergs(parameters: Any, elements: Any) -> Iterator[tuple[str, Any, str]]:
    """Give what the bergs and their elements are like."""
    body, place = elements.body, elements.place
    area = body.length * body.width
    values = {
        "thickness": body.thickness, "radius": 0.5 * np.sqrt(area),
        "area": np.bincount(np.unique(body.berg, return_inverse=True)[1], area), "spin": np.abs(elements.spin),
        "speed": np.hypot(elements.u, elements.v), "latitude": np.abs(place.lat) if parameters.earth.latlon else [],
    }  # fmt: skip
    for key, value in values.items():
        yield f"berg.{key}", value, USUAL[f"berg.{key}"].unit


def _changes(forcing: Any) -> Iterator[tuple[str, float, float]]:
    """Give what changes in a forcing, its period or interval (s), and the longest step that follows it."""
    for part in getattr(forcing, "parts", (forcing,)):
        times = getattr(getattr(part, "records", part), "times", None)
        if times is not None and len(times) > 1:
            interval = float(np.median(np.diff(times)))
            yield f"{getattr(part, 'shown', '') or 'forcing'} with records every", interval, interval
        if "Tide" in _own_kinds(part):
            yield "a tide with a period of", part.period, part.period / STEPS_IN_A_TIDE


# Parameters that only one law reads: a user who sets the friction of crushing faces while springs act is told before the run.


class Law(NamedTuple):
    """When parameters are read: in words, and of a set of parameters; and their names."""

    needs: str
    acts: Callable[[Any], bool]
    group: str
    names: tuple[str, ...]


LAWS: Final = (
    Law("stepping.scheme = 'quasi_static'", lambda p: p.stepping.scheme == "quasi_static", "sea_ice", (
        "strength", "decay", "least_concentration", "locked_concentration", "locked_strength")),
    Law("sea_ice.capture = 'limited' or 'locked'", lambda p: p.sea_ice.capture != "none", "sea_ice", ("strength", "decay")),
    Law("sea_ice.capture = 'locked'", lambda p: p.sea_ice.capture == "locked", "sea_ice", (
        "locked_concentration", "locked_strength")),
    Law("grounding.law = 'seabed'", lambda p: p.grounding_law == "seabed", "grounding", (
        "sediment", "stiffness", "bearing_strength", "friction", "shear_strength", "adhesion", "anchor_way", "bending",
        "ice_modulus", "start")),
    Law("grounding.law = 'quadratic'", lambda p: p.grounding_law == "quadratic", "grounding", ("quadratic_coefficient",)),
    Law("grounding.law = 'linear'", lambda p: p.grounding_law == "linear", "grounding", ("coefficient", "ramp_height", "torque")),
    Law("stepping.scheme = 'quasi_static'", lambda p: p.stepping.scheme == "quasi_static", "contact", (
        "crushing_strength", "crushing_depth", "unloading_ratio", "friction")),
    Law("a scheme other than quasi_static", lambda p: p.stepping.scheme != "quasi_static", "contact", (
        "spring", "distance", "on_substeps", "critical_damping", "tangential_critical_damping", "radial_damping",
        "tangential_damping", "iterate", "tolerance", "max_iterations")),
    Law("bonds.law = 'dem'", lambda p: p.bonds.law == "dem", "bonds", ("poisson", "damping")),
    Law("fracture.criterion = 'toughness'", lambda p: p.fracture.criterion == "toughness", "fracture", ("toughness",)),
    Law("damage.enabled", lambda p: p.damage.enabled, "damage", ("threshold", "time_scale", "exponent")),
    Law("rolling.enabled", lambda p: p.rolling.enabled, "rolling", ("scheme", "tip")),
    Law("footloose.enabled", lambda p: p.footloose.enabled, "footloose", (
        "youngs", "strength", "style", "displace", "berg_mass", "seed")),
    Law("melt.enabled", lambda p: p.melt.enabled or p.footloose.enabled or p.rolling.enabled, "melt", (
        "mode", "base", "split", "bits_fraction", "const_gamma", "gamma_t", "friction_drag", "least_friction", "tide",
        "least_gap")),
)  # fmt: skip
"""Parameters that other laws leave unread."""


PUBLISHED_SPRINGS: Final[dict[str, Any]] = {"spring": 1e-7, "distance": 4000.0, "on_substeps": False}
"""Contact of the published A68a run (equations 10.5), which its preset has for the schemes with springs."""


def without_effect(parameters: Any) -> dict[str, str]:
    """Return what is set otherwise than by default although nothing reads it, a sentence for each name.

    Runs with the numerics of the reference are left out: a namelist gives values for laws that it switches off. So are the
    springs of the preset, which no user has given.
    """
    default = type(parameters)()
    if parameters.compatibility != default.compatibility:
        return {}
    said = {}
    if all(getattr(parameters.contact, name) == value for name, value in PUBLISHED_SPRINGS.items()):
        default = default.changed(contact=PUBLISHED_SPRINGS)
    for law in LAWS:
        if not law.acts(parameters):
            group, usual = getattr(parameters, law.group), getattr(default, law.group)
            for name in law.names:
                value = getattr(group, name)
                if value != getattr(usual, name):
                    shown = f"{value:g}" if isinstance(value, float) else str(value).lower()
                    said[f"{law.group}.{name}"] = f"{law.group}.{name} = {shown} has no effect: it needs {law.needs}"
    return said
