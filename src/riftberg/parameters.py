"""All parameters of a run together: how they are checked against each other, and what compiled code reads of them.

`Parameters` gathers the groups of `riftberg.config.parameter_groups`; `Parameters.kernel_values` flattens them into the named
tuple of scalars that compiled code reads. The sets of the published run stand at the end.
"""

from __future__ import annotations

import html
import math
from collections.abc import Mapping
from operator import attrgetter
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Final, NamedTuple, get_type_hints

from pydantic import Field, model_validator

from riftberg.config.parameter_groups import (
    QUIRKS_OF_MOTION,
    BondLaw,
    BondParameters,
    Calving,
    Capture,
    Compatibility,
    Contact,
    Damage,
    Drag,
    Earth,
    Footloose,
    Fracture,
    Grounding,
    GroundingLaw,
    Group,
    Ice,
    Melt,
    PackIce,
    Packing,
    Rolling,
    Scheme,
    Stepping,
    quantity,
)
from riftberg.config.usual_ranges import PUBLISHED_SPRINGS
from riftberg.config.values import unit_of, words_for_nothing
from riftberg.constants import AIR_DRAG_SIDE, AIR_DRAG_TOP, OCEAN_DRAG_BASE, OCEAN_DRAG_SIDE, SEA_ICE_DRAG_SIDE
from riftberg.physics.sea_ice import LIMITED, LOCKED, NO_CAPTURE, OF_REFERENCE

__all__ = [
    "A68A_2022",
    "A68A_2022_KID",
    "BondLaw",
    "BondParameters",
    "Calving",
    "Compatibility",
    "Contact",
    "Damage",
    "Drag",
    "Earth",
    "Footloose",
    "Fracture",
    "Grounding",
    "Group",
    "Ice",
    "KernelParameters",
    "Melt",
    "PackIce",
    "Packing",
    "Parameters",
    "Rolling",
    "Scheme",
    "Stepping",
    "element_radius",
    "quantity",
]


FROM_ELEMENTS: Final = -1.0
"""Stiffness of a pair law that follows from the two elements (`riftberg.physics.contact.pair_stiffness`)."""

CONTACT_PHASE: Final = 0.5
"""Frequency of a contact times the long step, where contact acts in it and its stiffness follows from the elements."""


SEABED_INSTEAD: Final = "leave it out; grounding.sediment, friction and shear_strength say what a bed of sediment holds"

DRAG_KEYS: Final = {
    "coefficient": "leave it out, or write grounding.law: none in place of coefficient: 0; grounding.sediment, friction and "
    "shear_strength say what a bed of sediment holds",
    "quadratic_coefficient": SEABED_INSTEAD,
    "ramp_height": "leave it out; a bed of sediment carries the keel where it touches",
    "torque": "leave it out; friction on a bed of sediment brakes rotation too",
    "on_substeps": "leave it out; a bed of sediment takes the sub-steps that it needs",
    "implicit": "leave it out; a bed of sediment takes the sub-steps that it needs",
}
"""Keys of the drag laws, and what to write in their place with the scheme that has a bed of sediment."""


class EngineChoice(NamedTuple):
    """What one of the two engines has, and the other has not."""

    group: str
    name: str
    values: tuple[Any, ...]  # Those that it alone has; empty where it alone has the parameter
    instead: str  # What to write with the other engine

    @property
    def path(self) -> str:
        """Group and name."""
        return f"{self.group}.{self.name}"

    def asked_of(self, parameters: Parameters) -> bool:
        """Whether parameters ask for it."""
        group = getattr(parameters, self.group)
        value = getattr(group, self.name)
        return value in self.values if self.values else value is not None and self.name in group.model_fields_set

    def refusal(self, parameters: Parameters) -> str:
        """Return why parameters with the other engine cannot ask for it, and what to write."""
        rigid = parameters.stepping.scheme == "quasi_static"
        owner, scheme = ("the explicit schemes", "mts") if rigid else ("quasi_static", "quasi_static")
        value = getattr(getattr(parameters, self.group), self.name)
        return f"{self.path} = {value!r} is of {owner}: {self.instead}, or set stepping.scheme = {scheme!r}"


OF_EXPLICIT: Final = (
    EngineChoice("grounding", "law", ("linear", "quadratic"),
                 "leave it out (a bed of sediment, seabed) or write none (no sea floor)"),
    *(EngineChoice("grounding", name, (), instead) for name, instead in DRAG_KEYS.items()),
    EngineChoice("bonds", "law", ("spring",), "write bonds.law = 'dem' (or 'none'), which holds against shear and bending"),
    EngineChoice("bonds", "no_shear", (True,), "leave it out; ice holds against shear"),
)  # fmt: skip
"""What 'mts', 'verlet' and 'runge_kutta' have, and 'quasi_static' refuses."""

OF_QUASI_STATIC: Final = (
    EngineChoice("grounding", "law", ("seabed",), "write 'linear', 'quadratic' or 'none'"),
    EngineChoice("fracture", "criterion", ("ice", "toughness"), "leave it out; each bond breaks by its own stress"),
    EngineChoice("fracture", "flexural_strength", (), "leave it out; nothing bends the ice on the sea floor"),
    EngineChoice("fracture", "crevasse_strength", (), "write fracture.normal_strength"),
    EngineChoice("damage", "enabled", (True,), "write damage.enabled = false"),
)
"""What 'quasi_static' has, and the explicit schemes refuse."""


def choices_without(scheme: Scheme) -> tuple[EngineChoice, ...]:
    """Return what the engine of a scheme has not."""
    return OF_EXPLICIT if scheme == "quasi_static" else OF_QUASI_STATIC


CAPTURES: Final[dict[Capture, int]] = {"none": NO_CAPTURE, "limited": LIMITED, "locked": LOCKED}
"""Captures by a pack of sea ice as compiled code knows them."""


class KernelParameters(NamedTuple):
    """Scalars that compiled code reads; SI units, angles in degrees where the state has degrees.

    One with a path is that parameter as it stands; `Parameters.kernel_values` derives the others.
    """

    multiple_steps: bool
    rigid_bodies: bool
    rho_ice: Annotated[float, "ice.density"]
    water_side_drag: Annotated[float, "drag.water_side"]
    water_base_drag: Annotated[float, "drag.water_base"]
    air_side_drag: Annotated[float, "drag.air_side"]
    air_top_drag: Annotated[float, "drag.air_top"]
    ice_side_drag: Annotated[float, "drag.ice_side"]
    ocean_scale: Annotated[float, "drag.ocean_scale"]
    forces_by_element: bool
    sides_by_bonds: Annotated[bool, "drag.sides_by_bonds"]
    radius_based: Annotated[bool, "compatibility.radius_based"]
    rotational_drag: Annotated[bool, "drag.rotational"]
    max_sides: int
    ice_capture: int  # What a pack of sea ice does beside its drag (`riftberg.physics.sea_ice`)
    ice_drift_known: bool  # Whether the forcing says how sea ice moves; else it exerts no force on rigid fragments
    ice_strength: Annotated[float, "sea_ice.strength"]
    ice_decay: Annotated[float, "sea_ice.decay"]
    least_ice: Annotated[float, "sea_ice.least_concentration"]
    locked_fraction: Annotated[float, "sea_ice.locked_concentration"]
    locked_strength: Annotated[float, "sea_ice.locked_strength"]
    ground_coefficient: float
    ground_quadratic: float
    ground_ramp: Annotated[float, "grounding.ramp_height"]
    ground_on_substeps: bool
    ground_implicit: Annotated[bool, "grounding.implicit"]
    ground_torque: Annotated[bool, "grounding.torque"]
    modulus: float
    contact_spring: float
    contact_stiffest: float
    contact_distance: float
    contact_on_substeps: bool
    critical_damping: Annotated[bool, "contact.critical_damping"]
    tangential_critical_damping: Annotated[bool, "contact.tangential_critical_damping"]
    radial_damping: Annotated[float, "contact.radial_damping"]
    tangential_damping: Annotated[float, "contact.tangential_damping"]
    damping_by_speed: Annotated[bool, "compatibility.damping_by_speed"]
    iterate: Annotated[bool, "contact.iterate"]
    tolerance: Annotated[float, "contact.tolerance"]
    max_iterations: Annotated[int, "contact.max_iterations"]
    dem: bool
    bonds_on: bool
    hexagonal: bool
    spring: float
    youngs_modulus: Annotated[float, "bonds.youngs_modulus"]
    poisson: Annotated[float, "bonds.poisson"]
    bond_damping: Annotated[float, "bonds.damping"]
    objective_damping: Annotated[bool, "bonds.objective_damping"]
    flat_relative_velocity: Annotated[bool, "compatibility.flat_relative_velocity"]
    no_shear: Annotated[bool, "bonds.no_shear"]
    linear_bending: Annotated[bool, "bonds.linear_bending"]
    max_bonds: int
    constant_size: Annotated[bool, "bonds.constant_size"]
    constant_length: Annotated[float, "bonds.constant_length"]
    constant_width: Annotated[float, "bonds.constant_width"]
    fracture: Annotated[bool, "fracture.enabled"]
    normal_strength: float  # 0 where crevasse_strength is above 0
    crevasse_strength: float  # 0 where there is none
    shear_strength: Annotated[float, "fracture.shear_strength"]
    fracture_on_substeps: Annotated[bool, "fracture.on_substeps"]
    broken_as_contact: Annotated[bool, "fracture.broken_as_contact"]
    damage_threshold: Annotated[float, "damage.threshold"]
    damage_time: Annotated[float, "damage.time_scale"]
    damage_exponent: Annotated[float, "damage.exponent"]
    explicit_substeps: Annotated[bool, "stepping.explicit_substeps"]
    only_interactions: Annotated[bool, "stepping.only_interactions"]
    interactions: Annotated[bool, "stepping.interactions"]
    latlon: Annotated[bool, "earth.latlon"]
    earth_radius: Annotated[float, "earth.radius"]
    period: Annotated[float, "earth.period"]
    f_plane: Annotated[bool, "earth.f_plane"]
    reference_latitude: Annotated[float, "earth.reference_latitude"]
    sticky_collision_flags: Annotated[bool, "compatibility.sticky_collision_flags"]
    shared_shear_lever: Annotated[bool, "compatibility.shared_shear_lever"]
    bond_thickness_of_second: Annotated[bool, "compatibility.bond_thickness_of_second"]
    grid_position_round_trip: Annotated[bool, "compatibility.grid_position_round_trip"]
    land_inset: float  # How far inside the water land puts an element back, as part of a cell
    swapped_implicit_velocity: Annotated[bool, "compatibility.swapped_implicit_velocity"]
    uncentred_half_kicks: Annotated[bool, "compatibility.uncentred_half_kicks"]
    explicit_contact_damping: Annotated[bool, "compatibility.explicit_contact_damping"]
    frozen_sea_ice_drag: Annotated[bool, "compatibility.frozen_sea_ice_drag"]
    rest_length_from_sizes: Annotated[bool, "compatibility.rest_length_from_sizes"]
    plain_kid_branch: Annotated[bool, "compatibility.plain_kid_branch"]
    stages_from_start: Annotated[bool, "compatibility.stages_from_start"]


_AS_THEY_STAND: Final = {
    name: attrgetter(hint.__metadata__[0])
    for name, hint in get_type_hints(KernelParameters, include_extras=True).items() if hasattr(hint, "__metadata__")
}  # fmt: skip


class Parameters(Group):
    """All parameters of a run.

    Examples
    --------
    >>> Parameters(fracture={"normal_strength": 20e3}).fracture.normal_strength
    20000.0
    """

    ice: Ice = Field(default_factory=Ice)
    drag: Drag = Field(default_factory=Drag)
    sea_ice: PackIce = Field(default_factory=PackIce)
    grounding: Grounding = Field(default_factory=Grounding)
    contact: Contact = Field(default_factory=Contact)
    bonds: BondParameters = Field(default_factory=BondParameters)
    fracture: Fracture = Field(default_factory=Fracture)
    damage: Damage = Field(default_factory=Damage)
    stepping: Stepping = Field(default_factory=Stepping)
    earth: Earth = Field(default_factory=Earth)
    melt: Melt = Field(default_factory=Melt)
    rolling: Rolling = Field(default_factory=Rolling)
    footloose: Footloose = Field(default_factory=Footloose)
    calving: Calving = Field(default_factory=Calving)
    compatibility: Compatibility = Field(default_factory=Compatibility)

    _unknown_key: ClassVar[tuple[str, str]] = ("there is no such group of parameters", "Groups are ")

    @model_validator(mode="before")
    @classmethod
    def _scheme_that_is_asked(cls, values: Any) -> Any:
        return _explicit_if_asked(values) if isinstance(values, dict) else values

    @model_validator(mode="after")
    def _combinations(self) -> Parameters:
        if self.bonds.law == "dem" and not self.stepping.explicit_substeps:
            raise ValueError(
                "bonds.law = 'dem' needs stepping.explicit_substeps = true (equations 6.4: DEM is always explicit)"
            )
        scheme = self.stepping.scheme
        if self.bonds.law == "dem" and scheme not in ("mts", "quasi_static") and self.fracture.enabled:
            raise ValueError(
                "fracture acts with the schemes 'mts' and 'quasi_static' only: set stepping.scheme = 'mts' "
                "or fracture.enabled = false (equations 7, quirk Q25)"
            )
        if foreign := [choice for choice in choices_without(scheme) if choice.asked_of(self)]:
            raise ValueError(foreign[0].refusal(self))
        self._check_criterion()
        self._check_grounding()
        if self.damage.enabled and not (self.bonds.law == "dem" and self.fracture.enabled):
            raise ValueError(
                "damage lowers the strength of bonds that can break: set bonds.law = 'dem' and fracture.enabled = true, or "
                "damage.enabled = false"
            )
        self._check_life()
        quirks = self.compatibility
        if quirks.births_at_centre and self.stepping.interactions and not quirks.zero_start:
            raise ValueError(
                "compatibility.births_at_centre lays bergs on top of each other, and contact would never part them: "
                "set stepping.interactions = false with it"
            )
        return self

    @property
    def grounding_law(self) -> GroundingLaw:
        """Law of the sea floor that acts: a bed of sediment where fragments are rigid, else a drag, unless one is named."""
        return self.grounding.law or ("seabed" if self.stepping.scheme == "quasi_static" else "linear")

    def _check_grounding(self) -> None:
        """Refuse a law of the sea floor without its numbers, and keys of another law."""
        g, law = self.grounding, self.grounding_law
        if law == "quadratic" and not (g.quadratic_coefficient > 0.0 and g.ramp_height == 0.0 and not g.torque):
            raise ValueError(
                "grounding.law = 'quadratic' needs grounding.quadratic_coefficient > 0, and has neither ramp_height nor torque: "
                "they are of the linear law"
            )
        missing = [
            f"grounding.{name}" for name in ("stiffness", "bearing_strength", "friction") if getattr(g, name) is None
        ]
        if law == "seabed" and g.sediment == "other" and missing:
            raise ValueError(f"grounding.sediment = 'other' needs {', '.join(missing)}")

    def _check_criterion(self) -> None:
        """Refuse a strength or toughness without what it is compared with."""
        f = self.fracture
        if f.flexural_strength is not None and not (self.grounding_law == "seabed" and self.grounding.bending):
            raise ValueError(
                "fracture.flexural_strength is compared with the bending of ice on a bed of sediment: set grounding.law = "
                "'seabed' with grounding.bending, or leave it out"
            )
        strength = f.normal_strength or f.crevasse_strength or 0.0
        if f.enabled and f.criterion == "toughness" and not (f.toughness > 0.0 and strength > 0.0):
            raise ValueError(
                "fracture.criterion = 'toughness' needs fracture.toughness in Pa m1/2, and fracture.normal_strength or "
                "crevasse_strength, above 0"
            )

    @property
    def contact_distance(self) -> float:
        """Distance of centres (m) within which any two elements touch: that of springs; faces meet where they are."""
        return 0.0 if self.stepping.scheme == "quasi_static" else self.contact.distance

    def _check_life(self) -> None:
        melt, footloose = self.melt, self.footloose
        if footloose.enabled and not (melt.enabled and melt.split):
            raise ValueError(
                "footloose calving grows from what waves and convection take from the sides one after the other: set "
                "melt.enabled = true and melt.split = true, or footloose.enabled = false"
            )
        if footloose.enabled and self.stepping.scheme == "runge_kutta" and self.compatibility.zero_start:
            raise ValueError(
                "footloose calving needs stepping.scheme = 'verlet' or 'mts' with the reference's numerics (files 2)"
            )
        if melt.mode in ("shelf", "mixed") and melt.base == "turbulent":
            raise ValueError(
                f"melt.mode = {melt.mode!r} needs melt.base = 'two_equation' or 'three_equation': the base melts as under "
                "an ice shelf"
            )

    def __repr__(self) -> str:
        """Return what differs from the defaults; `describe` has all."""
        changes = []
        for name in type(self).model_fields:
            group = getattr(self, name)
            values = {
                key: value for key, field in type(group).model_fields.items()
                if (value := getattr(group, key)) != field.get_default()
            }  # fmt: skip
            if values:
                changes.append(f"{name}={{{', '.join(f'{key!r}: {value!r}' for key, value in values.items())}}}")
        return f"Parameters({', '.join(changes)})"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """Return a table of what differs from the defaults."""
        rows = []
        for name in type(self).model_fields:
            group = getattr(self, name)
            for key, field in type(group).model_fields.items():
                value = getattr(group, key)
                if value != field.get_default():
                    cells = (f"{name}.{key}", f"{value} {unit_of(field)}", str(field.description or ""))
                    rows.append("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in cells) + "</tr>")
        note = "all others have their defaults; see describe()"
        return f"<table><caption>Parameters ({note})</caption>{''.join(rows)}</table>"

    def describe(self) -> str:
        """Return all groups, one line per parameter."""
        return "\n".join(getattr(self, name).describe() for name in type(self).model_fields)

    def changed(self, /, **groups: dict[str, Any]) -> Parameters:
        """Return a copy with some values of some groups changed, and checked again.

        Changes that only the explicit scheme allows (sub-steps, spring bonds, bonds without shear) select that scheme, `mts`,
        in place of the quasi-static one, unless they name a scheme.
        """
        if self.stepping.scheme == "quasi_static":
            groups = _explicit_if_asked(groups)
        return type(self)(**_merged(self._given(), groups))

    def adapted(self, /, **groups: dict[str, Any]) -> tuple[Parameters, list[str]]:
        """Return `changed`, and the paths of what the scheme in ``groups`` has not, which is left out; so are its quirks.

        What ``groups`` themselves ask for is refused where the scheme has it not.
        """
        if self.stepping.scheme == "quasi_static":
            groups = _explicit_if_asked(groups)
        scheme, values, left_out = groups.get("stepping", {}).get("scheme", self.stepping.scheme), self._given(), []
        for choice in choices_without(scheme):
            if choice.asked_of(self):
                default = type(getattr(self, choice.group)).model_fields[choice.name].get_default()
                left_out += [choice.path] if values[choice.group].pop(choice.name) != default else []
        if scheme == "quasi_static" and self.stepping.scheme != scheme:
            quirks = [name for name in QUIRKS_OF_MOTION if values["compatibility"].pop(name)]
            left_out += [f"compatibility.{name}" for name in quirks]
        return type(self)(**_merged(values, groups)), left_out

    def _given(self) -> dict[str, Any]:
        """Return all values by group and name; of the sea floor, for which the schemes have laws of their own, those given."""
        grounding, fracture = self.grounding.model_dump(exclude_unset=True), self.fracture.model_dump(exclude_none=True)
        return {**self.model_dump(), "grounding": grounding, "fracture": fracture}

    def kernel_values(self) -> KernelParameters:
        """Flatten the groups into the named tuple that compiled code reads."""
        p = self
        hexagonal = p.bonds.packing == "hexagonal"
        multiple = p.stepping.scheme in ("mts", "quasi_static")
        law = p.grounding_law
        rigid = p.stepping.scheme == "quasi_static"
        fast_contact = rigid or (multiple and p.contact.on_substeps and p.stepping.explicit_substeps)
        return KernelParameters(
            **{name: read(self) for name, read in _AS_THEY_STAND.items()},
            multiple_steps=multiple,
            rigid_bodies=rigid,
            # Elements whose sides no bond covers stand in the water each for itself.
            forces_by_element=p.compatibility.forces_by_element or not p.drag.sides_by_bonds,
            max_sides=6 if hexagonal else 4,
            ice_capture=CAPTURES[p.sea_ice.capture] if p.stepping.scheme == "quasi_static" else OF_REFERENCE,
            ice_drift_known=True,
            ground_coefficient=p.grounding.coefficient if law == "linear" else 0.0,
            ground_quadratic=p.grounding.quadratic_coefficient if law == "quadratic" else 0.0,
            # Implicit sub-steps solve for the bonds alone; the long step takes the sea floor implicitly too.
            ground_on_substeps=multiple and p.grounding.on_substeps and p.stepping.explicit_substeps,
            # The reference puts an element back by a twentieth of its cell, from where it runs ashore again.
            land_inset=0.05 if p.compatibility.elements_stopped_alone else 1e-3,
            modulus=p.bonds.youngs_modulus / p.ice.density,
            contact_spring=FROM_ELEMENTS if p.contact.spring is None else p.contact.spring,
            contact_distance=p.contact_distance,
            # What a long step can resolve, where contact between bergs acts in it.
            contact_stiffest=math.inf if fast_contact else (CONTACT_PHASE / p.stepping.time_step) ** 2,
            contact_on_substeps=fast_contact,
            normal_strength=p.fracture.normal_strength or 0.0,
            crevasse_strength=p.fracture.crevasse_strength or 0.0,
            dem=p.bonds.law == "dem",
            bonds_on=p.bonds.law != "none",
            hexagonal=hexagonal,
            spring=FROM_ELEMENTS if p.bonds.spring is None else p.bonds.spring,
            max_bonds=(6 if hexagonal else 4) if p.bonds.max_bonds is None else p.bonds.max_bonds,
        )


def without_idle_keys(values: Any, *, all_of_them: bool = False) -> Any:
    """Return parameters as a file of Riftberg has them, without keys that act no more and have their default.

    Files hold all keys, those of the laws of other schemes too. ``all_of_them``: whatever their value, and without laws that
    earlier versions had for the scheme: the parameters say what a run was, and no run goes on with them.
    """
    if not isinstance(values, dict):
        return values
    quasi_static = values.get("stepping", {}).get("scheme") == "quasi_static"
    # Values that change nothing, of keys and choices of earlier versions, and of the drag in the scheme without one.
    idle: dict[tuple[str, str], tuple[Any, ...]] = {
        ("stepping", "landing_steps"): (8,), ("grounding", "cell"): (50.0,),
        ("contact", "law"): (None, "crushing" if quasi_static else "spring"),
        ("bonds", "elasticity"): (None, "cells" if quasi_static else "bonds"),
    }  # fmt: skip
    former = set(idle)
    if quasi_static:
        drag = {("grounding", name): (Grounding.model_fields[name].get_default(),) for name in DRAG_KEYS}
        idle, former = idle | drag, former | set(drag)
        choices: dict[tuple[str, str], Any] = {
            ("grounding", "law"): "linear", ("grounding", "start"): "settle", ("fracture", "criterion"): "bond",
        }  # fmt: skip
    else:
        may_break = values.get("fracture", {}).get("enabled")
        idle["fracture", "criterion"] = ("bond",) if may_break else ("bond", "ice", "toughness")
        choices = {("damage", "enabled"): True}

    def acts(group: str, name: str, value: Any) -> bool:
        key = group, name
        if value in idle.get(key, ()):
            return False
        return not (all_of_them and (key in former or (key in choices and value == choices[key])))

    left = {
        group: {name: value for name, value in inner.items() if acts(group, name, value)} if isinstance(inner, dict) else inner
        for group, inner in values.items()
    }  # fmt: skip
    if not all_of_them and _had_isotropic_bonds(values):
        left["bonds"] = {**left["bonds"], "elasticity": "isotropic"}
    return left


def _had_isotropic_bonds(values: dict[str, Any]) -> bool:
    """Whether a file is of a version, known by `contact.law`, in which its bonds were isotropic although it does not say so."""
    bonds, quirks = values.get("bonds", {}), values.get("compatibility", {})
    if values.get("stepping", {}).get("scheme") == "quasi_static" or "law" not in values.get("contact", {}):
        return False
    beams = bonds.get("law") == "dem" and not bonds.get("no_shear")
    springs = bonds.get("law") == "spring" and bonds.get("spring") is None
    published = quirks.get("zero_start") or quirks.get("rest_length_from_sizes")
    return bonds.get("elasticity") is None and (beams or springs) and not published


def element_radius(area: float, packing: Packing, bonded: bool = True) -> float:
    """Radius of the inscribed circle of an element of the given area (equations 1.4).

    ``area``: plan area, m2.
    """
    if packing == "hexagonal":
        return math.sqrt(area / (2.0 * math.sqrt(3.0)))
    return 0.5 * math.sqrt(area) if bonded else math.sqrt(area / math.pi)


def _merged(values: dict[str, Any], groups: Mapping[str, Any]) -> dict[str, Any]:
    """Return values with some of some groups changed."""
    for group, changes in groups.items():
        merges = isinstance(changes, Mapping) and group in values
        if group == "fracture" and merges:
            values = {**values, group: _without_replaced_strength(values[group], changes)}
        values = {**values, group: {**values[group], **changes} if merges else changes}
    return values


def _without_replaced_strength(fracture: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return values of the group without tensile strengths where changes give one: the two exclude each other."""
    names = ("normal_strength", "crevasse_strength")
    nothing = words_for_nothing(Fracture.model_fields[names[1]])
    gives = any(changes.get(name) is not None and str(changes[name]).lower() not in nothing for name in names)
    return {name: value for name, value in fracture.items() if not (gives and name in names)}


def _explicit_if_asked(groups: dict[str, Any]) -> dict[str, Any]:
    """Add ``stepping.scheme = "mts"`` to values by group that name no scheme and ask for what only the explicit one has."""

    def asked(group: str, name: str) -> Any:
        values = groups.get(group)
        return values.get(name) if isinstance(values, Mapping) else getattr(values, name, None)

    wants = asked("bonds", "law") == "spring" or asked("bonds", "no_shear") is True
    wants = wants or asked("stepping", "substeps") is not None or asked("stepping", "explicit_substeps") is False
    stepping = groups.get("stepping", {})
    if isinstance(stepping, Stepping):
        stepping = stepping.model_dump(exclude_unset=True)
    if not wants or not isinstance(stepping, Mapping) or "scheme" in stepping:
        return groups
    return {**groups, "stepping": {"scheme": "mts", **stepping}}


PUBLISHED_DRAG: Final[Mapping[str, float]] = MappingProxyType(
    {
        "water_side": OCEAN_DRAG_SIDE,
        "water_base": OCEAN_DRAG_BASE,
        "air_side": AIR_DRAG_SIDE,
        "air_top": AIR_DRAG_TOP,
        "ice_side": SEA_ICE_DRAG_SIDE,
    }
)
"""Group ``drag`` with the coefficients of KID, of the paper and of its experiments (equations 0.1)."""

A68A_2022 = Parameters(
    drag=Drag(**PUBLISHED_DRAG, ocean_scale=17.8),
    sea_ice=PackIce(capture="none"),
    contact=Contact(**PUBLISHED_SPRINGS, tolerance=1e-4),
    bonds=BondParameters(constant_size=True, linear_bending=False, spring=0.00065359477124183),
    fracture=Fracture(normal_strength=11e3, shear_strength=100e3),
    stepping=Stepping(scheme="quasi_static", time_step=1800.0, substeps=90),
)
"""Physics of the published A68a run (equations 10.5) with Riftberg's numerics; see `A68A_2022_KID` for the reference's.

The published strength, 18 kPa, is one of bonds. 11 kPa is one of the ice: with it tip and finger break off on twenty lattices
(docs/explanation/a68a-story.md).
"""

A68A_2022_KID = A68A_2022.changed(
    drag={"rotational": False},
    grounding={"implicit": False},
    bonds={"objective_damping": False},
    fracture={"normal_strength": 18e3},
    stepping={"scheme": "mts", "skip_first_long_force": True},
    compatibility=Compatibility.kid().model_dump(),
)
"""The published A68a run with the numerics and quirks of the reference."""
