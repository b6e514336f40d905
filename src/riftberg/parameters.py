"""All parameters of a run together: how they are checked against each other, and what compiled code reads of them.

`Parameters` makes `QuasiStaticParameters` or `ExplicitParameters`, as ``stepping.scheme`` says: each holds what its engine has.
`Parameters.kernel_values` flattens them into the named tuple of scalars that compiled code reads. The sets of the published run
stand at the end.
"""

from __future__ import annotations

import html
import math
from collections import namedtuple
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Final, Self, get_args

from pydantic import Field, model_validator
from pydantic.fields import FieldInfo

from riftberg.config.explicit_groups import (
    Beams,
    BondFracture,
    Compatibility,
    ElementDrag,
    ExplicitStepping,
    GroundDrag,
    Springs,
)
from riftberg.config.parameter_groups import (
    BondLaw,
    BondParameters,
    Calving,
    Contact,
    Drag,
    Earth,
    Footloose,
    Fracture,
    Grounding,
    Group,
    Ice,
    Melt,
    Packing,
    Rolling,
    Scheme,
    Stepping,
    quantity,
)
from riftberg.config.quasi_static_groups import (
    Capture,
    CellBonds,
    Crushing,
    Damage,
    IceFracture,
    PackIce,
    QuasiStaticStepping,
    Seabed,
)
from riftberg.config.values import allowed, field_extra, field_unit, value_kinds, words_for_nothing
from riftberg.constants import AIR_DRAG_SIDE, AIR_DRAG_TOP, OCEAN_DRAG_BASE, OCEAN_DRAG_SIDE, SEA_ICE_DRAG_SIDE
from riftberg.errors import InputError
from riftberg.physics.sea_ice import LIMITED, LOCKED, NO_CAPTURE, OF_REFERENCE

__all__ = [
    "A68A_2022",
    "A68A_2022_KID",
    "A68A_2022_MTS",
    "GROUPS",
    "PUBLISHED_DRAG",
    "PUBLISHED_SPRINGS",
    "BondLaw",
    "BondParameters",
    "Calving",
    "Compatibility",
    "Contact",
    "Drag",
    "Earth",
    "ExplicitParameters",
    "Footloose",
    "Fracture",
    "Grounding",
    "Group",
    "Ice",
    "KernelParameters",
    "Melt",
    "Packing",
    "Parameters",
    "QuasiStaticParameters",
    "Rolling",
    "Scheme",
    "Seabed",
    "Stepping",
    "element_radius",
    "fields_by_path",
    "from_file",
    "kid_quirks",
    "quantity",
]


FROM_ELEMENTS: Final = -1.0
"""Stiffness of a pair law that follows from the two elements (`riftberg.physics.contact.pair_stiffness`)."""

USUAL_STEP: Final = 1800.0
"""Time step (s) for bergs of any size."""

CONTACT_PHASE: Final = 0.5
"""Frequency of a contact times the long step, where contact acts in it and its stiffness follows from the elements."""

CAPTURES: Final[dict[Capture, int]] = {"none": NO_CAPTURE, "limited": LIMITED, "locked": LOCKED}
"""Captures by a pack of sea ice as compiled code knows them."""

NO_QUIRKS: Final = Compatibility()


class Parameters(Group):
    """All parameters of a run: those of the engine that ``stepping.scheme`` names.

    Examples
    --------
    >>> Parameters(fracture={"normal_strength": 20e3}).fracture.normal_strength
    20000.0
    >>> type(Parameters(stepping={"scheme": "mts"})).__name__
    'ExplicitParameters'
    """

    ice: Ice = Field(default_factory=Ice)
    drag: Drag = Field(default_factory=Drag)
    grounding: Grounding = Field(default_factory=Seabed)
    contact: Contact = Field(default_factory=Crushing)
    bonds: BondParameters = Field(default_factory=CellBonds)
    fracture: Fracture = Field(default_factory=IceFracture)
    stepping: Stepping = Field(default_factory=QuasiStaticStepping)
    earth: Earth = Field(default_factory=Earth)
    melt: Melt = Field(default_factory=Melt)
    rolling: Rolling = Field(default_factory=Rolling)
    footloose: Footloose = Field(default_factory=Footloose)
    calving: Calving = Field(default_factory=Calving)

    _unknown_key: ClassVar[tuple[str, str]] = ("there is no such group of parameters", "Groups are ")

    if TYPE_CHECKING:

        def __init__(self, /, **groups: Any) -> None: ...  # fmt: skip

    def __new__(cls, /, **groups: Any) -> Self:
        """Make parameters of the engine that the groups name."""
        return super().__new__(choose_engine(groups) if cls is Parameters else cls)  # type: ignore[return-value]

    @model_validator(mode="before")
    @classmethod
    def _scheme_that_is_asked(cls, values: Any) -> Any:
        return _explicit_if_asked(values) if isinstance(values, dict) else values

    @model_validator(mode="after")
    def _combinations(self) -> Self:
        melt, footloose = self.melt, self.footloose
        if footloose.enabled and not (melt.enabled and melt.split):
            raise ValueError(
                "footloose calving grows from what waves and convection take from the sides one after the other: set "
                "melt.enabled = true and melt.split = true, or footloose.enabled = false"
            )
        if melt.mode in ("shelf", "mixed") and melt.base == "turbulent":
            raise ValueError(
                f"melt.mode = {melt.mode!r} needs melt.base = 'two_equation' or 'three_equation': the base melts as under "
                "an ice shelf"
            )
        return self

    @property
    def quirks(self) -> Compatibility:
        """Quirks of the reference's motion: none but in the explicit engine."""
        return NO_QUIRKS

    @property
    def contact_distance(self) -> float:
        """Distance of centres (m) within which any two elements touch: that of springs; faces meet where they are."""
        return 0.0

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
        return f"{type(self).__name__}({', '.join(changes)})"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """Return a table of what differs from the defaults."""
        rows = []
        for name in type(self).model_fields:
            group = getattr(self, name)
            for key, field in type(group).model_fields.items():
                value = getattr(group, key)
                if value != field.get_default():
                    cells = (f"{name}.{key}", f"{value} {field_unit(field)}", str(field.description or ""))
                    rows.append("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in cells) + "</tr>")
        note = "all others have their defaults; see describe()"
        return f"<table><caption>Parameters ({note})</caption>{''.join(rows)}</table>"

    def describe(self) -> str:
        """Return all groups, one line per parameter."""
        return "\n".join(getattr(self, name).describe() for name in type(self).model_fields)

    @property
    def time_step(self) -> float:
        """Time step, s: the one that was given, or that a model has chosen; half an hour until it has."""
        return USUAL_STEP if self.stepping.time_step is None else self.stepping.time_step

    def changed(self, /, **groups: Any) -> Parameters:
        """Return a copy with some values of some groups changed, and checked again.

        Changes that only the explicit engine has (sub-steps, spring bonds, bonds without shear) select its scheme `mts` unless
        they name a scheme. Values of the other engine that the new one lacks must be left out first (`adapted`).
        """
        parameters, left_out = self.adapted(**groups)
        if left_out:
            raise InputError(
                f"stepping.scheme = {parameters.stepping.scheme!r} has no {', '.join(left_out)}", where="stepping.scheme",
                remedy="Leave them out, or take adapted(...), which returns the parameters and what it left out",
            )  # fmt: skip
        return parameters

    def adapted(self, /, **groups: Any) -> tuple[Parameters, list[str]]:
        """Return `changed`, and the paths of the values left out because the scheme in ``groups`` has none.

        What ``groups`` themselves ask for is refused where the scheme has it not.
        """
        values = {**self.model_dump(), "fracture": self.fracture.model_dump(exclude_none=True)}
        if isinstance(self, QuasiStaticParameters):
            groups = dict(_explicit_if_asked(groups))
        engine = choose_engine(_merged({"stepping": {"scheme": self.stepping.scheme}}, groups))
        left_out: list[str] = []
        if engine is not type(self):
            values, left_out = _carry_values(self, values, engine)
        return engine(**_merged(values, groups)), left_out

    def kernel_values(self) -> KernelParameters:
        """Flatten the groups into the named tuple that compiled code reads."""
        p = self
        hexagonal = p.bonds.packing == "hexagonal"
        values: dict[str, Any] = {
            name: getattr(getattr(p, group), key) if key in _group_fields(type(p), group) else default
            for name, (group, key, default) in _KERNEL_NAMES.items()
        }
        derived: dict[str, Any] = {
            "hexagonal": hexagonal,
            "max_sides": 6 if hexagonal else 4,
            "max_bonds": 6 if hexagonal else 4,
            "ice_drift_known": True,
            # The reference puts an element back by a twentieth of its cell, from where it runs ashore again.
            "land_inset": 0.05 if p.quirks.elements_stopped_alone else 1e-3,
            "modulus": p.bonds.youngs_modulus / p.ice.density,
            "contact_distance": p.contact_distance,
            "normal_strength": p.fracture.normal_strength or 0.0,
            "dem": p.bonds.law == "dem",
            "bonds_on": p.bonds.law != "none",
        }
        return KernelParameters(**values, **{**derived, **self._derive_engine_values()})

    def _derive_engine_values(self) -> dict[str, Any]:
        """Return the values for compiled code that each engine derives for itself."""
        raise NotImplementedError


class QuasiStaticParameters(Parameters):
    """Parameters of the quasi-static engine."""

    sea_ice: PackIce = Field(default_factory=PackIce)
    grounding: Seabed = Field(default_factory=Seabed)
    contact: Crushing = Field(default_factory=Crushing)
    bonds: CellBonds = Field(default_factory=CellBonds)
    fracture: IceFracture = Field(default_factory=IceFracture)
    damage: Damage = Field(default_factory=Damage)
    stepping: QuasiStaticStepping = Field(default_factory=QuasiStaticStepping)

    @model_validator(mode="after")
    def _check_engine_combinations(self) -> Self:
        f, g = self.fracture, self.grounding
        missing = [
            f"grounding.{name}" for name in ("stiffness", "bearing_strength", "friction") if getattr(g, name) is None
        ]
        if g.law == "seabed" and g.sediment == "other" and missing:
            raise ValueError(f"grounding.sediment = 'other' needs {', '.join(missing)}")
        if f.flexural_strength is not None and not (g.law == "seabed" and g.bending):
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
        if self.damage.enabled and not (self.bonds.law == "dem" and f.enabled):
            raise ValueError(
                "damage lowers the strength of bonds that can break: set bonds.law = 'dem' and fracture.enabled = true, or "
                "damage.enabled = false"
            )
        return self

    def _derive_engine_values(self) -> dict[str, Any]:
        return {
            "multiple_steps": True, "rigid_bodies": self.stepping.in_equilibrium, "forces_by_element": False,
            "ice_capture": CAPTURES[self.sea_ice.capture],
            "ground_coefficient": 0.0, "ground_quadratic": 0.0, "ground_on_substeps": True,
            "contact_spring": FROM_ELEMENTS, "contact_stiffest": math.inf, "contact_on_substeps": True,
            "crevasse_strength": self.fracture.crevasse_strength or 0.0, "spring": FROM_ELEMENTS,
        }  # fmt: skip


class ExplicitParameters(Parameters):
    """Parameters of the explicit engine: `mts`, `verlet` and `runge_kutta`."""

    drag: ElementDrag = Field(default_factory=ElementDrag)
    grounding: GroundDrag = Field(default_factory=GroundDrag)
    contact: Springs = Field(default_factory=Springs)
    bonds: Beams = Field(default_factory=Beams)
    fracture: BondFracture = Field(default_factory=BondFracture)
    stepping: ExplicitStepping = Field(default_factory=ExplicitStepping)
    compatibility: Compatibility = Field(default_factory=Compatibility)

    @property
    def quirks(self) -> Compatibility:
        """Quirks of the reference's motion."""
        return self.compatibility

    @property
    def contact_distance(self) -> float:
        """Distance of centres (m) within which any two elements touch."""
        return self.contact.distance

    @model_validator(mode="after")
    def _check_engine_combinations(self) -> Self:
        g, quirks = self.grounding, self.compatibility
        if self.bonds.law == "dem" and not self.stepping.explicit_substeps:
            raise ValueError(
                "bonds.law = 'dem' needs stepping.explicit_substeps = true (equations 6.4: DEM is always explicit)"
            )
        if self.bonds.law == "dem" and not self.stepping.has_substeps and self.fracture.enabled:
            raise ValueError(
                "fracture acts with the schemes 'mts' and 'quasi_static' only: set stepping.scheme = 'mts' "
                "or fracture.enabled = false (equations 7, quirk Q25)"
            )
        if g.law == "quadratic" and not (g.quadratic_coefficient > 0.0 and g.ramp_height == 0.0 and not g.torque):
            raise ValueError(
                "grounding.law = 'quadratic' needs grounding.quadratic_coefficient > 0, and has neither ramp_height nor "
                "torque: they are of the linear law"
            )
        if self.footloose.enabled and self.stepping.scheme == "runge_kutta" and quirks.zero_start:
            raise ValueError(
                "footloose calving needs stepping.scheme = 'verlet' or 'mts' with the reference's numerics (files 2)"
            )
        if quirks.births_at_centre and self.stepping.interactions and not quirks.zero_start:
            raise ValueError(
                "compatibility.births_at_centre lays bergs on top of each other, and contact would never part them: "
                "set stepping.interactions = false with it"
            )
        return self

    def _derive_engine_values(self) -> dict[str, Any]:
        p, g = self, self.grounding
        multiple = p.stepping.has_substeps
        fast_contact = multiple and p.contact.on_substeps and p.stepping.explicit_substeps
        of_packing = 6 if p.bonds.packing == "hexagonal" else 4
        return {
            "multiple_steps": multiple,
            # Elements whose sides no bond covers stand in the water each for itself.
            "forces_by_element": p.quirks.forces_by_element or not p.drag.sides_by_bonds,
            "rigid_bodies": p.stepping.in_equilibrium,
            "ice_capture": OF_REFERENCE,
            "ground_coefficient": g.coefficient if g.law == "linear" else 0.0,
            "ground_quadratic": g.quadratic_coefficient if g.law == "quadratic" else 0.0,
            # Implicit sub-steps solve for the bonds alone; the long step takes the sea floor implicitly too.
            "ground_on_substeps": multiple and g.on_substeps and p.stepping.explicit_substeps,
            "contact_spring": FROM_ELEMENTS if p.contact.spring is None else p.contact.spring,
            # What a long step can resolve, where contact between bergs acts in it.
            "contact_stiffest": math.inf if fast_contact else (CONTACT_PHASE / p.time_step) ** 2,
            "contact_on_substeps": fast_contact,
            "crevasse_strength": 0.0,
            "spring": FROM_ELEMENTS if p.bonds.spring is None else p.bonds.spring,
            "max_bonds": of_packing if p.bonds.max_bonds is None else p.bonds.max_bonds,
        }


ENGINES: Final = (QuasiStaticParameters, ExplicitParameters)

GROUPS: Final = tuple(dict.fromkeys(name for engine in ENGINES for name in engine.model_fields))
"""Names of all groups, of either engine."""


def fields_by_path(*engines: type[Parameters]) -> dict[str, FieldInfo]:
    """Return the field of each parameter of engines, by default both, by group and name."""
    fields: dict[str, FieldInfo] = {}
    for engine in engines or ENGINES:
        for group, group_field in engine.model_fields.items():
            for name, field in _group_class(group_field).model_fields.items():
                fields.setdefault(f"{group}.{name}", field)
    return fields


def group_classes(group: str) -> tuple[type[Group], ...]:
    """Return the classes of a group: one if the engines share it or one alone has it, else the class of each engine."""
    return tuple(dict.fromkeys(_group_class(e.model_fields[group]) for e in ENGINES if group in e.model_fields))


def kid_quirks() -> dict[str, dict[str, bool]]:
    """Return all quirks of the reference by group and name, each switched on."""
    quirks: dict[str, dict[str, bool]] = {}
    for path, field in fields_by_path().items():
        if field_extra(field, "quirk"):
            group, name = path.split(".")
            quirks.setdefault(group, {})[name] = True
    return quirks


def choose_engine(groups: Mapping[str, Any]) -> type[Parameters]:
    """Return the parameters of the engine that values by group name or ask for, by default the quasi-static one."""
    stepping = _explicit_if_asked(groups).get("stepping", {})
    scheme = stepping.get("scheme") if isinstance(stepping, Mapping) else getattr(stepping, "scheme", None)
    explicit = get_args(ExplicitStepping.model_fields["scheme"].annotation)
    return ExplicitParameters if scheme in explicit else QuasiStaticParameters


def _group_class(field: FieldInfo) -> type[Group]:
    """Return the class of a group."""
    kind: type[Group] = field.annotation  # type: ignore[assignment]
    return kind


def _group_fields(engine: type[Parameters], group: str) -> Mapping[str, FieldInfo]:
    """Return the fields of a group, none where an engine has not got it."""
    field = engine.model_fields.get(group)
    return {} if field is None else _group_class(field).model_fields


def _choices(field: FieldInfo) -> list[str]:
    """Return the words among which a field chooses."""
    return [choice for kind in value_kinds(field.annotation) for choice in get_args(kind) if isinstance(choice, str)]


def _explain_other_engine() -> None:
    """Let each group name the engine of parameters and choices that it lacks, and the remedy."""
    for engine, other, whose, scheme in (
        (QuasiStaticParameters, ExplicitParameters, "the explicit schemes", "mts"),
        (ExplicitParameters, QuasiStaticParameters, "quasi_static", "quasi_static"),
    ):
        ending = f", or set stepping.scheme = {scheme!r}"
        engine._foreign = {
            group: f"it is of {whose}: leave it out{ending}" for group in GROUPS if group not in engine.model_fields
        }
        for group, group_field in engine.model_fields.items():
            kind = _group_class(group_field)
            foreign: dict[str, str] = {}
            for name, field in _group_fields(other, group).items():
                if name not in kind.model_fields:
                    foreign[name] = f"it is of {whose}: {kind._instead.get(name, 'leave it out')}{ending}"
                    continue
                own_field = kind.model_fields[name]
                for choice in set(_choices(field)) - set(_choices(own_field)):
                    setting = f"{name} = {choice!r}"
                    foreign[setting] = (
                        f"{choice!r} is of {whose}: {kind._instead.get(setting, allowed(own_field))}{ending}"
                    )
            kind._foreign = foreign


_explain_other_engine()

_KERNEL_NAMES: Final = {
    str(field_extra(field, "kernel")): (*path.split("."), field.get_default())
    for path, field in fields_by_path().items() if field_extra(field, "kernel")
}  # fmt: skip
"""Names in compiled code of parameters that it reads as they stand: group, name, and the value for the engine without it."""

_DERIVED: Final = (
    "multiple_steps", "rigid_bodies", "forces_by_element", "hexagonal", "max_sides",
    "ice_capture",  # what a pack of sea ice does beside its drag (`riftberg.physics.sea_ice`)
    "ice_drift_known",  # whether the forcing says how sea ice moves; else it exerts no force on rigid fragments
    "ground_coefficient", "ground_quadratic", "ground_on_substeps", "modulus",
    "contact_spring", "contact_stiffest", "contact_distance", "contact_on_substeps", "dem", "bonds_on", "spring", "max_bonds",
    "normal_strength",  # 0 where crevasse_strength is above 0
    "crevasse_strength",  # 0 where there is none
    "land_inset",  # how far inside the water land puts an element back, as part of a cell
)  # fmt: skip
"""What `Parameters.kernel_values` derives."""

if TYPE_CHECKING:

    class KernelParameters:
        """Scalars that compiled code reads; SI units, angles in degrees where the state has degrees."""

        def __init__(self, **values: Any) -> None: ...  # fmt: skip
        def __getattr__(self, name: str) -> Any: ...  # fmt: skip
        def _replace(self, **values: Any) -> KernelParameters: ...  # fmt: skip

else:
    KernelParameters = namedtuple("KernelParameters", (*_DERIVED, *_KERNEL_NAMES))
    KernelParameters.__doc__ = (
        "Scalars that compiled code reads; SI units, angles in degrees where the state has degrees."
    )


def _carry_values(
    parameters: Parameters, values: dict[str, Any], engine: type[Parameters]
) -> tuple[dict[str, Any], list[str]]:
    """Return the values that another engine has too, and the paths of the others where they are not as by default.

    What is switched off by the word none is not lost: the other engine has not got it.
    """
    carried: dict[str, Any] = {}
    left_out: list[str] = []
    for group, inner in values.items():
        keys, fields = _group_fields(engine, group), type(getattr(parameters, group)).model_fields
        for name, value in inner.items():
            if f"{group}.{name}" == "stepping.scheme":
                continue
            if name in keys and _may_hold(keys[name], value):
                carried.setdefault(group, {})[name] = value
            elif value != fields[name].get_default() and value != "none":
                left_out.append(f"{group}.{name}")
    return carried, left_out


def _may_hold(field: FieldInfo, value: Any) -> bool:
    """Whether a field has a value among its choices, where it has choices."""
    choices = _choices(field)
    return not (choices and isinstance(value, str)) or value in choices


def from_file(values: Any, *, goes_on: bool) -> Parameters:
    """Return the parameters of a file of Riftberg; a file may hold parameters of the other engine too, which never acted.

    ``goes_on``: a run goes on with them; else they say what it was, and what earlier versions had is left out.
    """
    if not isinstance(values, dict):
        return Parameters(**{"parameters": values})
    engine, left = choose_engine(values), dict[str, Any]()
    for group, inner in values.items():
        if not isinstance(inner, dict):
            left[group] = inner
            continue
        for name, value in inner.items():
            moved = group == "compatibility" and name in _QUIRKS_OF_LIFE
            home = _QUIRKS_OF_LIFE[name] if moved else group
            if not _is_idle(engine, home, name, value, goes_on):
                left.setdefault(home, {})[name] = value
    if goes_on and _had_isotropic_bonds(values):
        left["bonds"] = {**left["bonds"], "elasticity": "isotropic"}
    return engine(**left)


_QUIRKS_OF_LIFE: Final = {
    name: group
    for group in ("melt", "rolling", "footloose", "calving")
    for name in Parameters.model_fields[group].annotation.model_fields  # type: ignore[union-attr]
    if field_extra(fields_by_path()[f"{group}.{name}"], "hidden")
}
"""Group of the quirks of melt and calving, which stood under `compatibility` in earlier versions."""

Compatibility._gone = {
    name: f"It is {group}.{name}, which 'riftberg kid' alone sets" for name, group in _QUIRKS_OF_LIFE.items()
}


def _is_idle(engine: type[Parameters], group: str, name: str, value: Any, goes_on: bool) -> bool:
    """Whether a value of a file changes nothing, or is to be left out because no run goes on with it."""
    rigid = engine is QuasiStaticParameters
    # Keys and choices of earlier versions, with the values that they had by default.
    former: dict[tuple[str, str], tuple[Any, ...]] = {
        ("stepping", "landing_steps"): (8,), ("grounding", "cell"): (50.0,), ("grounding", "law"): (None,),
        ("contact", "law"): (None, "crushing" if rigid else "spring"),
        ("bonds", "elasticity"): (None, "cells" if rigid else "bonds"),
    }  # fmt: skip
    acted: dict[tuple[str, str], tuple[Any, ...]] = {
        ("grounding", "law"): ("linear", "quadratic") if rigid else (),
        ("grounding", "start"): ("settle",), ("fracture", "criterion"): ("bond",) if rigid else (),
        ("damage", "enabled"): () if rigid else (True,),
    }  # fmt: skip
    if value in former.get((group, name), ()) or (not rigid and (name, value) == ("criterion", "bond")):
        return True
    if value in acted.get((group, name), ()):
        return not goes_on
    if (group, name) in former and name not in _group_fields(engine, group):
        return not goes_on
    other = ExplicitParameters if rigid else QuasiStaticParameters
    foreign = _group_fields(other, group).get(name)
    if foreign is None or name in _group_fields(engine, group):
        return False
    refused_before = group in engine.model_fields and name in _group_class(engine.model_fields[group])._instead
    return not refused_before or value == foreign.get_default() or not goes_on


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
    nothing = words_for_nothing(IceFracture.model_fields[names[1]])
    gives = any(changes.get(name) is not None and str(changes[name]).lower() not in nothing for name in names)
    return {name: value for name, value in fracture.items() if not (gives and name in names)}


def _explicit_if_asked(groups: Mapping[str, Any]) -> Mapping[str, Any]:
    """Add ``stepping.scheme = "mts"`` to values by group that name no scheme and ask for features of the explicit one alone."""

    def asked(group: str, name: str) -> Any:
        values = groups.get(group)
        return values.get(name) if isinstance(values, Mapping) else getattr(values, name, None)

    wants = asked("bonds", "law") == "spring" or asked("bonds", "no_shear") is True
    wants = wants or asked("stepping", "substeps") is not None or asked("stepping", "explicit_substeps") is False
    stepping = groups.get("stepping", {})
    if isinstance(stepping, Stepping):
        stepping = {name: getattr(stepping, name) for name in stepping.model_fields_set}
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

A68A_2022 = QuasiStaticParameters(
    drag={**PUBLISHED_DRAG, "ocean_scale": 17.8},
    sea_ice={"capture": "none"},
    bonds={"constant_size": True},
    fracture={"normal_strength": 11e3, "shear_strength": 100e3},
)
"""Physics of the published A68a run (equations 10.5) with Riftberg's numerics; see `A68A_2022_KID` for the reference's.

The published strength, 18 kPa, is one of bonds. 11 kPa is one of the ice: with it tip and finger break off on twenty lattices
(docs/explanation/a68a-story.md).
"""

PUBLISHED_SPRINGS: Final[Mapping[str, Mapping[str, Any]]] = MappingProxyType(
    {
        "contact": {"spring": 1e-7, "distance": 4000.0, "on_substeps": False},
        "bonds": {"linear_bending": False, "spring": 0.00065359477124183},
    }
)
"""Contact and bonds of the published A68a run (equations 10.5)."""

A68A_2022_MTS = A68A_2022.changed(**PUBLISHED_SPRINGS, stepping={"scheme": "mts", "substeps": 90})
"""The same physics in the explicit engine, with the published springs (equations 10.5) and none of the reference's quirks."""

A68A_2022_KID = A68A_2022_MTS.changed(
    **{
        **kid_quirks(),
        "drag": {"rotational": False},
        "grounding": {"implicit": False},
        "bonds": {"objective_damping": False},
        "fracture": {"normal_strength": 18e3},
        "stepping": {"time_step": USUAL_STEP, "skip_first_long_force": True},
    }
)
"""The published A68a run with the numerics and quirks of the reference."""


def choose_a68a_preset(groups: Mapping[str, Any]) -> Parameters:
    """Return the parameters of A68a for the engine that values by group ask for: the explicit one has the published springs."""
    return A68A_2022_MTS if choose_engine(groups) is ExplicitParameters else A68A_2022
