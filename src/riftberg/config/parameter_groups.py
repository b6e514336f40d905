"""Groups of parameters that both engines have, and what the groups of each engine have in common.

A field carries all that is said of a parameter: default, unit, meaning, source, limits, usual range, its name in compiled code,
and another value with which a test sees that it acts. Each group is a frozen pydantic model that refuses unknown keys and
impossible values; `riftberg.parameters` gathers them.
"""

from __future__ import annotations

from typing import Any, ClassVar, Final, Literal

from pydantic import BaseModel, ValidationError, model_validator

from riftberg import constants
from riftberg.config.values import Section, UnfitError, Usual, explained, key, nested_sections, section_fields
from riftberg.errors import InputError, nearest
from riftberg.system.input_files import value_shown

Scheme = Literal["mts", "verlet", "runge_kutta", "quasi_static"]
BondLaw = Literal["none", "spring", "dem"]
GroundingLaw = Literal["seabed", "none", "linear", "quadratic"]
Packing = Literal["square", "hexagonal"]
MeltMode = Literal["exposed", "berg", "shelf", "mixed"]
BaseLaw = Literal["turbulent", "two_equation", "three_equation"]
RollingScheme = Literal["updated", "weeks_mellor", "legacy"]
FootlooseStyle = Literal["bits", "bergs"]
FootlooseModulus = Literal["constant", "relaxed"]


def quantity(default: Any, unit: str, meaning: str, source: str, **options: Any) -> Any:
    """Describe one parameter: default, unit, meaning, source and the limits that pydantic checks.

    ``usual``: its `Usual` range. ``kernel``: its name in compiled code. ``trial``: another value, which changes a run.
    ``hidden``: `riftberg kid` alone sets it.
    """
    return key(default, unit, meaning, source=source, **options)


def quirk(meaning: str, source: str, **options: Any) -> Any:
    """Describe a quirk of the reference: off here, on where parity needs it; options as of `quantity`."""
    return quantity(False, "", meaning, source, quirk=True, **options)


class Group(Section):
    """Base of all parameter groups: immutable, unknown keys refused, numbers finite.

    Values may be texts with units (``"18 kPa"``) and numbers of NumPy; mistakes get the words of an experiment file.
    """

    _unknown_key: ClassVar[tuple[str, str]] = ("there is no such parameter", "{} has ")

    # What stands in the place of keys of earlier versions, a sentence each
    _gone: ClassVar[dict[str, str]] = {}

    # Of parameters and choices that the other engine alone has: whose they are, and what to write
    _foreign: ClassVar[dict[str, str]] = {}

    # What to write in place of some of them
    _instead: ClassVar[dict[str, str]] = {}

    def __init__(self, /, **given: Any) -> None:
        try:
            super().__init__(**given)
        except ValidationError as error:
            group = type(self)
            outer = any(nested_sections(field.annotation) for field in section_fields(group).values())
            raise explained(error, group, name="" if outer else group.__name__) from error

    # Tells pydantic not to call it for groups within groups: the first mistake there would end the search for more.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def _no_section(cls, value: Any) -> UnfitError:
        """Return the refusal of a value that is no group."""
        remedy = f"Give {cls.__name__}(...) or a dict with {', '.join(section_fields(cls))}"
        return UnfitError(f"{value_shown(value)} is no group of parameters", remedy)

    def __setattr__(self, name: str, value: Any) -> None:
        raise InputError(
            "parameters are not changed in place", where=f"{type(self).__name__}.{name}",
            remedy="Make new ones, such as parameters.changed(fracture={'normal_strength': '20 kPa'})",
        )  # fmt: skip

    def __getattr__(self, name: str) -> Any:
        """Name the parameters, with the nearest, for one that is not known."""
        if name.startswith("_"):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        names = type(self).model_fields
        noun = "group" if type(self).__name__ in ("QuasiStaticParameters", "ExplicitParameters") else "parameter"
        raise AttributeError(
            f"{type(self).__name__} has no {noun} {name!r}. {nearest(name, names)}It has {', '.join(names)}"
        )

    def __dir__(self) -> list[str]:
        """List the names of this package for the tab key, not the dozens of names of pydantic; these can be used all the same."""
        foreign = set(dir(BaseModel))
        return sorted(name for name in super().__dir__() if name.startswith("__") or name not in foreign)

    def describe(self) -> str:
        """Return one line per parameter: name, value, unit and meaning."""
        lines = [f"{type(self).__name__}"]
        for name, field in type(self).model_fields.items():
            extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
            unit = str(extra.get("unit", ""))
            lines.append(f"  {name} = {getattr(self, name)} {unit}  {field.description or ''}".rstrip())
        return "\n".join(lines)


_SEA: Final = Usual(-2.0, 15.0, "freezing point of sea water, and where the last bergs melt", "degree_Celsius")
_SALT: Final = Usual(20.0, 37.0, "from fjords to the open Atlantic", "1e-3")


class Ice(Group):
    """Properties of the ice."""

    density: float = quantity(
        850.0, "kg m-3", "ice density, sets draft and freeboard", "KID's rho_bergs", gt=0, lt=constants.RHO_SEAWATER,
        usual=Usual(800.0, 920.0, "from firn-covered shelves (850, Silva et al. 2006) to solid ice (917)"), trial=880.0,
        kernel="rho_ice",
    )  # fmt: skip


class Drag(Group):
    """Drag of water, air and sea ice on an element."""

    _instead: ClassVar[dict[str, str]] = {
        "sides_by_bonds": "leave it out; water drags on the outline of a berg, where no bond covers the ice"
    }

    water_side: float = quantity(
        0.9, "1", "form drag of the water on the sides, on 0.5 rho u^2", "Bigg et al. 1997", ge=0, le=10,
        usual=Usual(0.2, 2.0, "0.25 in OpenDrift's OpenBerg, 0.85 in FESOM, 0.9 in Bigg et al. 1997", off=True), trial=1.8,
        kernel="water_side_drag",
    )  # fmt: skip
    water_base: float = quantity(
        0.0025, "1", "skin drag of the water on the base, on rho u^2",
        "Asay-Davis et al. 2016, base of ice shelves; KID 0.0012", ge=0, le=1,
        usual=Usual(5e-4, 0.035, "0.0012 in KID, 0.001 to 0.035 reported under sea ice (Steiner 2001)", off=True),
        trial=0.01, kernel="water_base_drag",
    )  # fmt: skip
    air_side: float = quantity(
        1.3, "1", "form drag of the air on the sail, on 0.5 rho u^2", "Bigg et al. 1997", ge=0, le=10,
        usual=Usual(0.2, 2.6, "0.4 in FESOM, 0.7 in OpenDrift's OpenBerg, 1.3 in Bigg et al. 1997", off=True), trial=2.6,
        kernel="air_side_drag",
    )  # fmt: skip
    air_top: float = quantity(
        0.0015, "1", "skin drag of the 10-m wind on the top, on rho u^2",
        "Amory et al. 2017, Antarctic snow, 0.0015 to 0.002; Andreas & Claffey 1995, 0.0013 to 0.0025; KID 0.0055", ge=0, le=1,
        usual=Usual(5e-4, 0.006, "0.0013 over smooth snow to 0.0055 in KID", off=True), trial=0.003,
        kernel="air_top_drag",
    )  # fmt: skip
    ice_side: float = quantity(
        0.9, "1", "drag of sea ice on the sides, on 0.5 rho u^2 of its thickness", "KID", ge=0, le=10,
        usual=Usual(0.1, 10.0, "0.9 in KID, 1 in FESOM", off=True), trial=1.8, kernel="ice_side_drag",
    )  # fmt: skip
    ocean_scale: float = quantity(
        1.0, "1", "multiplies both ocean drag coefficients", "KID's ocean_drag_scale", ge=0,
        usual=Usual(0.05, 20.0, "A68a was fitted with 17.8 (Huth et al. 2022)", off=True), trial=2.0, kernel="ocean_scale",
    )  # fmt: skip
    rotational: bool = quantity(
        True, "", "skin drag of the water on a spinning element, so that loose elements come to rest",
        "Riftberg; reference has none", kernel="rotational_drag",
    )  # fmt: skip


class Grounding(Group):
    """The sea floor on which keels run aground."""

    law: GroundingLaw = quantity(
        "none", "", "law of the sea floor", "equations 4.1",
    )  # fmt: skip


class Contact(Group):
    """Repulsion between bergs and between the pieces of a broken berg."""

    _gone: ClassVar[dict[str, str]] = {
        "law": "Leave it out: faces crush with stepping.scheme = 'quasi_static', springs act with the other schemes"
    }


class BondParameters(Group):
    """Bonds between the elements of a berg."""

    _gone: ClassVar[dict[str, str]] = {
        "elasticity": "Leave it out: with stepping.scheme = 'quasi_static' the ice is elastic, alike in all directions; with "
        "stepping.scheme = 'mts' its bonds are, as published"
    }

    law: BondLaw = quantity("dem", "", "dem (normal, shear, bending) or spring (KID) or none", "equations 5")
    packing: Packing = quantity("square", "", "square or hexagonal elements", "equations 1.4", trial="hexagonal")
    youngs_modulus: float = quantity(
        5e6, "Pa", "Young's modulus E of DEM bonds", "KID's dem_spring_coef", ge=0, le=1e12,
        usual=Usual(1e6, 1e10, "5 MPa in Huth et al. 2022, 9 GPa in laboratories"), trial=2e6, kernel="youngs_modulus",
    )  # fmt: skip
    poisson: float = quantity(
        0.3, "1", "Poisson's ratio of DEM bonds", "equations 0.2", gt=-1, lt=0.5,
        usual=Usual(0.2, 0.4, "0.3 of ice in laboratories"), trial=0.2, kernel="poisson",
    )  # fmt: skip
    constant_size: bool = quantity(
        False, "", "use one length and width for all interactions", "equations 1.4, KID's constant_interaction_LW",
        kernel="constant_size",
    )  # fmt: skip


class Fracture(Group):
    """When a bond breaks."""

    enabled: bool = quantity(True, "", "bonds can break", "equations 7, KID's fracture_criterion", kernel="fracture")
    normal_strength: float | None = quantity(
        18e3, "Pa", "largest tensile stress a bond bears; none where crevasse_strength is given", "paper; equations 10.5",
        usual=Usual(1e3, 2e6, "18 kPa for A68a (Huth et al. 2022), 1 MPa in laboratories (Petrovic 2003)"), trial=1e6,
    )  # fmt: skip
    shear_strength: float = quantity(
        100e3, "Pa", "largest shear stress a bond bears", "equations 10.5",
        usual=Usual(1e3, 5e6, "100 kPa for A68a (Huth et al. 2022), 1 MPa in laboratories"), trial=1.0, kernel="shear_strength",
    )  # fmt: skip


class Stepping(Group):
    """How the equations are stepped in time."""

    _gone: ClassVar[dict[str, str]] = {
        "landing_steps": "Leave it out: on a bed of sediment a landing takes the sub-steps that it needs"
    }

    in_equilibrium: ClassVar[bool] = False
    """Whether the ice of rigid bodies stands in equilibrium with its loads after each step; otherwise its elements vibrate."""

    @property
    def has_substeps(self) -> bool:
        """Whether forces between elements act in sub-steps of the time step, as with multiple time steps."""
        return self.scheme == "mts"

    scheme: Scheme = quantity(
        "quasi_static", "",
        "quasi_static, mts, verlet or runge_kutta; mts where sub-steps or spring bonds are set and no scheme is named",
        "equations 6; quasi_static: Riftberg", trial="quasi_static",
    )  # fmt: skip
    time_step: float | None = quantity(
        None, "s",
        "time step; with mts the long step, which a notice names where stress rings with it. By default half an hour, in "
        "quasi_static one hour where every berg is 10 km long or more, or a share of it that divides the interval of the records",
        "equations 10.5; its choice: Riftberg", gt=0,
        usual=Usual(0.1, 7200.0, "steps of an hour resolve tides and inertial motion"), trial=250.0,
    )  # fmt: skip
    only_interactions: bool = quantity(
        False, "", "leave out all forces of ocean, air and floor", "equations 4.2", kernel="only_interactions"
    )
    fixed_velocity: tuple[float, float] | None = quantity(
        None, "m s-1", "impose this velocity on all elements", "equations 4.2, KID's override_iceberg_velocities",
        usual=Usual(-3.0, 3.0, "bergs drift at some dm s-1"), trial=(0.2, 0.1),
    )  # fmt: skip
    interactions: bool = quantity(
        True, "", "bergs act on each other", "KID's interactive_icebergs_on", kernel="interactions"
    )
    speed_limit: float = quantity(
        10.0, "m s-1", "speed that no ice reaches: an element beyond it ends the run (not KID's speed_limit)", "Riftberg", gt=0,
        trial=0.1,
    )  # fmt: skip


class Earth(Group):
    """Coordinates."""

    latlon: bool = quantity(
        True, "", "positions in degrees; otherwise metres", "equations 2", trial=True, kernel="latlon"
    )
    radius: float = quantity(
        constants.EARTH_RADIUS_A68, "m", "radius of the sphere", "equations 10.5", gt=0,
        usual=Usual(6.35e6, 6.39e6, "the radius of the Earth"), trial=6.5e6, kernel="earth_radius",
    )  # fmt: skip
    period: float = quantity(
        360.0, "degree or m",
        "zonal period, 0 or less if there is none; the default of 360 means none where positions are metres",
        "equations 2.4, KID's Lx", trial=3310.0, kernel="period",
    )  # fmt: skip
    f_plane: bool = quantity(False, "", "constant Coriolis parameter", "equations 2.6", kernel="f_plane")
    reference_latitude: float = quantity(
        0.0, "degree", "latitude of the f-plane and of Cartesian runs", "equations 2.6", ge=-90, le=90, trial=30.0,
        kernel="reference_latitude",
    )  # fmt: skip

    @model_validator(mode="before")
    @classmethod
    def _degrees_are_no_metres(cls, values: Any) -> Any:
        """Take the default of 360 as no period where positions are metres: nothing is periodic after 360 m."""
        if (
            isinstance(values, dict)
            and values.get("latlon") in (False, 0, "false")
            and values.get("period", 360.0) == 360.0
        ):
            return {**values, "period": 0.0}
        return values


class Melt(Group):
    """Melt of sides, base and by waves, and the bergy bits that waves break off."""

    enabled: bool = quantity(False, "", "bergs melt", "files 1")
    mode: MeltMode = quantity(
        "exposed", "",
        "exposed: sides where no bond covers them, base by the law below; berg: all sides of every element; shelf: the base "
        "alone; mixed: blended by the part of the sides that bonds cover", "files 1.2 to 1.4; exposed: Riftberg", trial="shelf",
    )  # fmt: skip
    base: BaseLaw = quantity(
        "three_equation", "",
        "law of the base: turbulent (small bergs), two or three equations of the layer under an ice shelf; shelf and mixed "
        "know the last two only, berg the first", "files 1.2, 1.5", trial="two_equation",
    )  # fmt: skip
    temperature: float | None = quantity(
        None, "degree_Celsius", "of the sea, everywhere; none means that of the forcing", "Riftberg", ge=-3, le=40, usual=_SEA,
        trial=5.0,
    )  # fmt: skip
    salinity: float | None = quantity(
        None, "1e-3", "of the sea, everywhere; none means that of the forcing", "Riftberg", ge=0, le=50, usual=_SALT,
        trial=10.0,
    )  # fmt: skip
    salinity_from_ocean: bool = quantity(
        True, "", "the law of the base takes the salinity of the ocean; otherwise 35",
        "files 1.4 use_mixed_layer_salinity_for_thermo", hidden=True,
    )  # fmt: skip
    split: bool = quantity(
        True, "", "base, sides and waves act one after the other, so that their losses add up", "files 1.6"
    )
    bits_fraction: float = quantity(
        0.0, "1", "part of what waves erode that becomes bergy bits", "files 1.9 bergy_bit_erosion_fraction", ge=0, le=1,
        trial=0.5,
    )  # fmt: skip
    const_gamma: bool = quantity(
        True, "", "constant exchange coefficients in the three equations; otherwise by the boundary layer", "files 1.5"
    )
    gamma_t: float = quantity(
        0.022, "1", "that coefficient for heat; for salt a 35th", "files 1.5 Gamma_T_3EQ", gt=0,
        usual=Usual(1e-3, 0.1, "0.011 to 0.031 under ice shelves (Jenkins et al. 2010)"), trial=0.03, hidden=True,
    )  # fmt: skip
    friction_drag: float = quantity(
        1.5e-3, "1", "drag coefficient of water at the base", "files 1.5", ge=0,
        usual=Usual(5e-4, 0.02, "1e-3 to 1e-2 under ice shelves", off=True), trial=3e-3, hidden=True,
    )  # fmt: skip
    least_friction: float = quantity(
        1e-3, "m s-1", "smallest friction velocity", "files 1.5 ustar_icebergs_bg", ge=0,
        usual=Usual(1e-5, 0.05, "1e-3 in KID", off=True), trial=0.5, hidden=True,
    )  # fmt: skip
    tide: float = quantity(
        0.0, "m s-1", "speed of tides that the current lacks, at the base; not in the turbulent law of mode berg and mixed",
        "files 1.5 utide_icebergs", ge=0, usual=Usual(0.01, 1.0, "speeds of tides on shelves", off=True), trial=0.2,
    )  # fmt: skip
    least_gap: float | None = quantity(
        None, "m", "water under the keel below which the base does not melt; none means no such limit", "files 1.4", ge=0,
        usual=Usual(0.1, 100.0, "some m in ocean models", off=True), trial=100.0, hidden=True,
    )  # fmt: skip

    # Quirks of the reference and options of its namelists.
    bits_melt_at_zero_rates: bool = quirk(
        "T5: bits melt although zero_rates says that nothing does", "files 1.4", hidden=True
    )
    plain_basal_search: bool = quirk(
        "T6, T7: the flux of buoyancy under the base is evaluated once, the salinity at the ice by plain iteration",
        "files 1.5", hidden=True,
    )  # fmt: skip
    scaled_laminar_layer: bool = quirk(
        "T52: the boundary layer under the base divides the term of its laminar part by the constant of von Karman too, "
        "with which the base melts about 14 % slower than in the cited source; without const_gamma only", "files 1.5",
        hidden=True,
    )  # fmt: skip
    element_length_in_base_law: bool = quirk(
        "the turbulent law of the base takes the length of the element, not of its berg", "files 1.2", hidden=True
    )
    drop_orphan_bits: bool = quirk(
        "T44: bits of footloose bits vanish with these, without melt water", "files 1.9", hidden=True
    )
    sea_ice_shift: float = quantity(
        0.0, "1", "added to the sea-ice fraction in the law by which waves erode", "files 1.2 sicn_shift", ge=-1, le=1,
        trial=0.2, hidden=True,
    )  # fmt: skip
    zero_rates: bool = quantity(
        False, "", "all rates of melt are zero, rolling stays", "files 1.4 set_melt_rates_to_zero", hidden=True
    )
    keep_shape: bool = quantity(
        False, "", "the ocean gets the melt, but bergs stay as they are", "files 1.12 Iceberg_melt_without_decay", hidden=True,
    )  # fmt: skip


class Rolling(Group):
    """When bergs of one element roll over; elements with bonds never do."""

    enabled: bool = quantity(False, "", "narrow bergs roll over", "files 1.11 allow_bergs_to_roll")
    scheme: RollingScheme = quantity(
        "updated", "", "updated (width against thickness), weeks_mellor, or legacy, which is known to be wrong", "files 1.11",
        trial="weeks_mellor",
    )  # fmt: skip
    tip: float = quantity(
        0.0, "1", "with updated: rolls where this times the thickness exceeds the width; 0 means by density", "files 1.11",
        usual=Usual(0.5, 1.5, "0.8 to 1 by the densities of ice and water", off=True), trial=0.3,
    )  # fmt: skip

    # Quirks of the reference and options of its namelists.
    rolls_on: bool = quirk(
        "T53: a berg lighter than 808 kg m-3 rolls although it is wider than thick, at every step", "files 1.11", hidden=True,
    )  # fmt: skip


class Footloose(Group):
    """Pieces that the buoyancy of a submerged foot breaks from the edge; waves make the foot, so melt must be on."""

    enabled: bool = quantity(False, "", "edges calve by the footloose mechanism", "files 2")
    youngs: float = quantity(
        1e7, "Pa", "Young's modulus of the bending edge", "files 2.1 fl_youngs", gt=0,
        usual=Usual(1e6, 1e10, "10 MPa in KID, 9 GPa in laboratories"), trial=2e6,
    )  # fmt: skip
    strength: float = quantity(
        250e3, "Pa", "yield stress of the edge", "files 2.1 fl_strength", gt=0,
        usual=Usual(1e4, 2e6, "250 kPa in KID, 1 MPa in laboratories"), trial=1e4,
    )  # fmt: skip
    modulus: FootlooseModulus = quantity(
        "constant", "", "pieces break by youngs, or relaxed: by that of ice as old as the foot, youngs shapes bits alone",
        "Riftberg", trial="relaxed",
    )  # fmt: skip
    viscosity: float = quantity(
        1e14, "Pa s", "with relaxed: viscosity by which the edge relaxes from 9 GPa", "Glen's law at 100 kPa", gt=0,
        usual=Usual(1e13, 1e15, "3e13 to 4e14 by the stress of the ice"), trial=1e12,
    )  # fmt: skip
    style: FootlooseStyle = quantity(
        "bits", "", "pieces are kept as bits of the parent, or become bergs at once", "files 2.3 fl_style", trial="bits"
    )
    displace: bool = quantity(
        True, "", "children start on the rim of the parent", "files 2.4 displace_fl_bergs", hidden=True
    )
    berg_mass: float = quantity(
        1e12, "kg", "mass of bits from which a berg is made", "files 2.3 new_berg_from_fl_bits_mass_thres", gt=0,
        usual=Usual(1e6, 1e14, "1e12 kg in KID"), trial=2e9,
    )  # fmt: skip
    seed: int = quantity(0, "1", "of the random places on the rim", "Riftberg", ge=0, le=2**63 - 1, trial=7)

    # Quirks of the reference and options of its namelists.
    half_west_rim: bool = quirk(
        "T11: children on the west side start in its middle half only", "files 2.4", hidden=True
    )
    bits_always_roll: bool = quirk("T12: footloose bits roll although rolling is off", "files 2.5", hidden=True)
    unplaced_child_in_metres: bool = quirk(
        "T13: where a child finds no cell, corners are tried in metres, on degrees too", "files 2.6", hidden=True
    )
    footloose_sets_density: bool = quirk(
        "T45: a berg that footloose calving cuts gets the density of the parameters", "files 2.3", hidden=True
    )
    one_draw: bool = quantity(
        False, "", "all footloose children start at the same part of the rim", "files 2.2", hidden=True
    )


class ClassTable(Group):
    """Size classes into which the ice that leaves the land is put; lists of one length."""

    mass: tuple[float, ...] = quantity((), "kg", "mass of one berg", "files 3.1")
    fraction: tuple[float, ...] = quantity((), "1", "part of the ice; what no class takes is not calved", "files 3.1")
    scaling: tuple[float, ...] = quantity((), "1", "number of bergs that one element stands for", "files 3.1")
    thickness: tuple[float, ...] = quantity((), "m", "thickness of the bergs", "files 3.1")

    @model_validator(mode="after")
    def _one_length(self) -> ClassTable:
        lengths = {name: len(getattr(self, name)) for name in type(self).model_fields}
        if len(set(lengths.values())) != 1 or not self.mass:
            raise ValueError(f"the lists of size classes must have one length: {lengths}")
        for name in ("mass", "scaling", "thickness"):
            if min(getattr(self, name)) <= 0.0:
                raise ValueError(f"{name} of a size class is {min(getattr(self, name)):g}: give numbers above 0")
        if min(self.fraction) < 0.0 or not 0.0 < sum(self.fraction) <= 1.0 + 1e-9:
            raise ValueError(f"fractions sum to {sum(self.fraction):g}: give parts of 0 or more that sum to at most 1")
        return self


SOUTHERN_CLASSES = ClassTable(
    mass=(8.8e7, 4.1e8, 3.3e9, 1.8e10, 3.8e10, 7.5e10, 1.2e11, 2.2e11, 3.9e11, 7.4e11),
    fraction=(0.24, 0.12, 0.15, 0.18, 0.12, 0.07, 0.03, 0.03, 0.03, 0.02),
    scaling=(2000.0, 200.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 1.0, 1.0),
    thickness=(40.0, 67.0, 133.0, 175.0, 250.0, 250.0, 250.0, 250.0, 250.0, 250.0),
)
"""Size classes of the Southern Ocean (files 3.1)."""

NORTHERN_CLASSES = ClassTable(
    mass=(4.58e8, 3.61e9, 1.22e10, 2.91e10, 5.09e10, 7.34e10, 1.15e11, 1.65e11, 2.94e11, 5.59e11),
    fraction=(0.14, 0.15, 0.20, 0.15, 0.08, 0.07, 0.05, 0.05, 0.05, 0.05),
    scaling=(200.0, 50.0, 25.0, 13.0, 8.0, 5.0, 2.0, 1.0, 1.0, 1.0),
    thickness=(80.4, 159.5, 240.0, 320.0, 360.0, 360.0, 360.0, 360.0, 360.0, 360.0),
)
"""Size classes of the north, where a run is to have its own (files 3.1)."""


class Calving(Group):
    """Bergs from the flux of ice that leaves the land; acts where an ocean model hands one over."""

    south: ClassTable = quantity(SOUTHERN_CLASSES, "", "size classes of the south", "files 3.1")
    north: ClassTable | None = quantity(
        None, "", "size classes of the north; none means those of the south", "files 3.1"
    )
    fractions: Literal["mass", "number"] = quantity(
        "mass", "", "what the fractions of the classes are parts of", "files 3.1 input_freq_distribution", trial="number",
    )  # fmt: skip
    length_over_width: float = quantity(
        1.5, "1", "shape of a new berg", "files 3.1 LoW_ratio", gt=0, usual=Usual(1.0, 4.0, "1.5 in KID"), trial=1.8,
        hidden=True,
    )  # fmt: skip
    smoothing_time: float = quantity(
        0.0, "s", "time over which the flux is averaged; 0 takes it as it comes", "files 3.2 tau_calving", ge=0,
        usual=Usual(3600.0, 3.2e8, "from an hour to ten years", off=True), trial=86400.0,
    )  # fmt: skip

    # Quirks of the reference.
    heat_of_one_class: bool = quirk(
        "T16: a new berg gets the heat of all classes over the ice of its own", "files 3.2", hidden=True
    )
    hemisphere_by_corner: bool = quirk(
        "T43: the north-east corner of a cell says of which hemisphere its size classes are", "files 3.1", hidden=True
    )
