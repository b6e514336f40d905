"""Groups of parameters of the quasi-static engine: bed of sediment, crushing faces, fracture of the ice, damage, pack ice."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Final, Literal

from pydantic import BeforeValidator, model_validator

from riftberg import constants
from riftberg.config.parameter_groups import BondParameters, Contact, Fracture, Grounding, Group, Stepping, quantity
from riftberg.config.values import UnfitError, Usual

Capture = Literal["limited", "locked", "none"]
Sediment = Literal["rock", "sand", "clay", "other"]
DeepKeel = Literal["aground", "refuse"]


class PackIce(Group):
    """Sea ice around bergs: what a pack bears and when it holds."""

    capture: Capture = quantity(
        "limited", "",
        "what a pack does beside its drag; limited: it holds a berg by as much as it bears on its front. locked: it carries "
        "a berg along where it is dense and strong, as published models have it. none: nothing",
        "limited: Riftberg; locked: Lichey & Hellmer 2001", trial="none",
    )  # fmt: skip
    strength: float = quantity(
        20e3, "Pa", "strength P* of a closed pack per metre of thickness", "Hibler 1979; 20 kPa in Lichey & Hellmer 2001", ge=0,
        le=1e7, usual=Usual(5e3, 5e4, "5 to 27.5 kPa in models of sea ice (Hibler 1979)", off=True), trial=1e3,
        kernel="ice_strength",
    )  # fmt: skip
    decay: float = quantity(
        20.0, "1", "how the strength falls with the open water: P = P* h exp(-decay (1 - A))", "Hibler 1979", ge=0, le=1e3,
        usual=Usual(5.0, 40.0, "20 in models of sea ice (Hibler 1979)"), trial=30.0, kernel="ice_decay",
    )  # fmt: skip
    least_concentration: float = quantity(
        0.15, "1", "concentration below which the sea counts as open", "Lichey & Hellmer 2001", ge=0, le=1, trial=0.99,
        kernel="least_ice",
    )  # fmt: skip
    locked_concentration: float = quantity(
        0.86, "1", "capture locked: concentration from which on a pack carries bergs along",
        "FESOM-IB (Rackow et al. 2017), whose capture begins there and is complete at 0.9", ge=0, le=1, trial=0.99,
        kernel="locked_fraction",
    )  # fmt: skip
    locked_strength: float = quantity(
        13e3, "N m-1", "capture locked: strength P of the pack from which on it does", "Lichey & Hellmer 2001", ge=0, le=1e9,
        usual=Usual(1e3, 1e5, "10 to 13 kN m-1 in models of icebergs", off=True), trial=1e6, kernel="locked_strength",
    )  # fmt: skip


_BED: Final = "leave it out; grounding.sediment, friction and shear_strength say what a bed of sediment holds"
_PADS: Final = "leave it out; a bed of sediment takes the sub-steps that it needs"


class Seabed(Grounding):
    """The sea floor: a bed of sediment that carries the keels on it."""

    _instead: ClassVar[dict[str, str]] = {
        "law = 'linear'": "leave it out (a bed of sediment, seabed) or write none (no sea floor)",
        "law = 'quadratic'": "leave it out (a bed of sediment, seabed) or write none (no sea floor)",
        "coefficient": "leave it out, or write grounding.law: none in place of coefficient: 0; grounding.sediment, friction and "
        "shear_strength say what a bed of sediment holds",
        "quadratic_coefficient": _BED,
        "ramp_height": "leave it out; a bed of sediment carries the keel where it touches",
        "torque": "leave it out; friction on a bed of sediment brakes rotation too",
        "on_substeps": _PADS,
        "implicit": _PADS,
    }

    _gone: ClassVar[dict[str, str]] = {
        "cell": "Leave it out: the keel is cut into pads by the length over which the ice bends",
        "depth_error": "Write floor_error.offset for one run; forecasts draw floor_error.spread, share and length",
    }

    law: Literal["seabed", "none"] = quantity(
        "seabed", "", "law of the sea floor; seabed: a bed that carries the berg and holds it by friction. none: no sea floor",
        "Riftberg",
    )  # fmt: skip
    sediment: Sediment = quantity(
        "sand", "", "bed of the law seabed, which sets what is left out below; other needs all of it", "Riftberg", trial="clay",
    )  # fmt: skip
    stiffness: float | None = quantity(
        None, "Pa m-1", "k_v, stiffness of the bed: 1e9 rock, 1e7 sand, 1e6 clay", "order of Terzaghi 1955", gt=0,
        usual=Usual(1e5, 1e10, "1e6 clay to 1e9 rock"), trial=1e8,
    )  # fmt: skip
    bearing_strength: float | None = quantity(
        None, "Pa",
        "q_u, pressure at which the bed yields: 1e7 rock (that of ice), 1e6 sand, six times the shear strength on clay",
        "handbook soil mechanics", gt=0, usual=Usual(1e4, 5e7, "1.2e5 clay to 1e7 rock, on which ice is crushed first"),
        trial=2e6,
    )  # fmt: skip
    friction: float | None = quantity(
        None, "1", "Coulomb friction between keel and bed: 0.5", "handbook soil mechanics, 0.3 to 0.6", ge=0,
        usual=Usual(0.1, 0.8, "0.3 to 0.6 between keels and beds", off=True), trial=0.4,
    )  # fmt: skip
    shear_strength: float | None = quantity(
        None, "Pa", "undrained shear strength, which limits friction: 2e4 clay, others none", "5 to 50 kPa", gt=0,
        usual=Usual(2e3, 2e5, "5 to 50 kPa of marine clay"), trial=1e3,
    )  # fmt: skip
    adhesion: float = quantity(
        1.0, "1", "part of the shear strength that holds the keel", "Riftberg", gt=0, le=1, trial=0.05
    )
    anchor_way: float = quantity(0.1, "m", "way after which a keel slides over the bed", "Riftberg", gt=0, trial=0.2)
    bending: bool = quantity(
        True, "", "the ice bends where the bed lifts it; off: a rigid berg", "Riftberg", trial=False
    )
    ice_modulus: float = quantity(
        9e9, "Pa", "Young's modulus of that bending; 1e9 for warm, crevassed ice", "glacier ice, small strains", gt=0,
        usual=Usual(5e8, 1e10, "1 GPa of warm, crevassed ice, 9 GPa in laboratories"), trial=1e8,
    )  # fmt: skip
    start: DeepKeel = quantity(
        "aground", "", "a keel that starts below the bed: aground, lifted with its load, or refuse, if more than 1 m",
        "Riftberg", trial="refuse",
    )  # fmt: skip


class Crushing(Contact):
    """Repulsion between bergs and between the pieces of a broken berg: faces bear a limited pressure and rub."""

    crushing_strength: float = quantity(
        1.5e6, "Pa", "p_c, largest mean pressure on a face (quasi_static)", "Riftberg; small impacts: 25 to 41 MPa", gt=0,
        usual=Usual(1e5, 5e7, "1.5 MPa for faces of kilometres; 25 to 41 MPa in small impacts"), trial=1e6,
    )  # fmt: skip
    crushing_depth: float = quantity(
        20.0, "m", "a, depth of crushing over which that pressure is reached", "Riftberg", gt=0,
        usual=Usual(0.1, 200.0, "20 m for faces of kilometres"), trial=10.0,
    )  # fmt: skip
    unloading_ratio: float = quantity(
        100.0, "1", "stiffness of unloading over that of loading; faces rebound at one over its root", "Riftberg", ge=1,
        usual=Usual(4.0, 1e4, "100, a restitution of 0.1"), trial=4.0,
    )  # fmt: skip
    friction: float = quantity(
        0.2, "1", "Coulomb friction between faces (quasi_static)", "Riftberg", ge=0,
        usual=Usual(0.01, 1.0, "0.2 by default, a choice", off=True), trial=0.5,
    )  # fmt: skip


class CellBonds(BondParameters):
    """Lattice of a berg, whose ice is elastic, alike in all directions."""

    _instead: ClassVar[dict[str, str]] = {
        "law = 'spring'": "write bonds.law = 'dem' (or 'none'), which holds against shear and bending",
        "no_shear": "leave it out; ice holds against shear",
    }

    law: Literal["dem", "none"] = quantity(
        "dem", "", "dem: elements hold together; none: each is a berg by itself", "equations 5"
    )


def _no_stress_of_bonds(criterion: Any) -> Any:
    if criterion == "bond":
        raise UnfitError(
            "the criterion 'bond' is gone",
            "Leave it out: each bond breaks by its own stress with stepping.scheme = 'mts', the ice by its own with "
            "'quasi_static'",
        )
    return criterion


Criterion = Annotated[Literal["ice", "toughness"], BeforeValidator(_no_stress_of_bonds)]


class IceFracture(Fracture):
    """When the ice breaks along a bond."""

    crevasse_strength: float | None = quantity(
        None, "Pa",
        "tension at the tips of crevasses at which they go on; with it a bond in quasi_static bears the reserve that its "
        "thickness leaves, in place of normal_strength", "Riftberg; Vaughan 1993: 90 to 320 kPa where crevasses are seen", gt=0,
        usual=Usual(2e4, 1e6, "90 to 320 kPa where crevasses are seen (Vaughan 1993); 79 kPa for A68a"), trial=100.0,
    )  # fmt: skip
    flexural_strength: float | None = quantity(
        None, "Pa",
        "largest bending stress of ice that a bed of sediment lifts (grounding.law seabed); none: bending breaks nothing",
        "Vaughan 1993: 90 to 320 kPa of glacier ice in tension; Aly et al. 2019: 84 kPa by volume for a plate of 200 m", gt=0,
        usual=Usual(5e4, 3e6, "90 to 320 kPa of glaciers (Vaughan 1993), 1 to 2 MPa in laboratories"), trial=1.0,
    )  # fmt: skip
    criterion: Criterion | None = quantity(
        None, "",
        "what the strengths are compared with; ice: the largest tension and shear of the ice. toughness: the same, and the "
        "toughness at the tips of cracks and rifts of three elements and more. none means ice", "Riftberg", trial="toughness",
    )  # fmt: skip
    toughness: float = quantity(
        0.0, "Pa m1/2", "with 'toughness': fracture toughness K_Ic of the ice, 5e4 to 1.5e5 in laboratories", "Petrovic 2003",
        ge=0, usual=Usual(3e4, 5e5, "5e4 to 1.5e5 in laboratories (Petrovic 2003)", off=True), trial=0.0,
    )  # fmt: skip

    @model_validator(mode="after")
    def _one_tensile_strength(self) -> IceFracture:
        if self.crevasse_strength is not None and "normal_strength" not in self.model_fields_set:
            self.__dict__["normal_strength"] = None  # its default; in files it stands as none
        if (self.crevasse_strength is None) == (self.normal_strength is None):
            raise ValueError(
                "the ice has one tensile strength: give either normal_strength, or crevasse_strength, from which it follows"
            )
        return self


class Damage(Group):
    """Strength that bonds lose by the history of their stress; not calibrated for icebergs."""

    enabled: bool = quantity(False, "", "stress takes from the strength of the bonds", "Riftberg")
    threshold: float = quantity(
        0.3, "1", "stress over remaining strength below which nothing happens", "Riftberg", ge=0, lt=1, trial=0.5,
        kernel="damage_threshold",
    )  # fmt: skip
    time_scale: float = quantity(
        constants.SECONDS_PER_DAY, "s", "time in which a stress at the strength takes all of it", "Riftberg", gt=0,
        usual=Usual(60.0, 3.2e7, "from a minute to a year"), trial=900.0, kernel="damage_time",
    )  # fmt: skip
    exponent: float = quantity(
        2.0, "1", "power of the stress in the rate of damage", "Riftberg", gt=0,
        usual=Usual(0.5, 10.0, "laws of creep and fatigue have 1 to 4"), trial=1.0, kernel="damage_exponent",
    )  # fmt: skip


class QuasiStaticStepping(Stepping):
    """Time steps at whose ends the ice is in equilibrium with its loads."""

    _instead: ClassVar[dict[str, str]] = {"frozen": "write fixed_velocity: [0, 0]"}

    in_equilibrium: ClassVar[bool] = True

    scheme: Literal["quasi_static"] = quantity(
        "quasi_static", "", "of quasi_static, mts, verlet and runge_kutta; the last three are of the other engine", "Riftberg",
    )  # fmt: skip
