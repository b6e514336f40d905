"""The registry: every variable of an element and of a bond, declared once, with its group, units and meaning.

The classes below *are* the registry. A field is one line: its name, whether it is a real or a whole number, its units
and what it means. Restart files, run files, the documentation and new states take all of that from `ELEMENT_VARIABLES`
and `BOND_VARIABLES`, which are read off the classes; nothing is listed a second time anywhere.

Compiled code takes the groups that it needs: ``motion = el.motion``, then ``motion.u[e]``.
"""

from __future__ import annotations

import mmap
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Annotated, Any, NamedTuple, cast, get_type_hints

import numpy as np
from numpy.typing import NDArray

from riftberg.system.input_files import MOST_SUBSTEPS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

GONE = 2
"""Status of a bond that is no more: neither intact nor a contact pair."""

LARGEST = 1e30
"""Numbers at least this large are fill values."""

LARGEST_WHOLE = 2**62
"""Identifiers and counters stay below it, so that no sum of two of them wraps."""

MOST_COLUMNS = 1_000_000
"""Rows or columns of a model grid: 40 m around the equator."""

ABOVE_0 = 5e-324
"""The least number above 0."""

THICKEST = 5000.0
"""Thickness (m) that no ice on Earth has; what is above it is a fill value or a slip of units."""

LONGEST = 1e6
"""Metres of an element or a bond; the longest berg ever seen had 300 km."""

HEAVIEST = 1e18
"""Kilograms of an element: a twentieth of all ice of Antarctica (2.4e19 kg)."""


@dataclass(frozen=True)
class Variable:
    """One variable of the state."""

    name: str  # Field of a group of `Elements`, or of `Bonds`
    units: str  # CF units
    long_name: str  # Meaning in plain words
    standard_name: str = ""  # CF standard name where one exists, else empty
    dtype: str = "f8"  # ``"f8"`` or ``"i8"``
    restart: bool = True  # Whether a restart file must hold it
    output: bool = False  # Whether a run file holds it by default
    default: float = 0.0  # Value in a new state
    group: str = ""  # Field of `Elements` that holds it; empty for a variable of a bond
    stepped: bool = True  # Whether a long step may change it; others change by melt, calving and births alone
    # No state of a run lies outside these. Many whole numbers index other arrays: a name is the size of a table.
    limits: tuple[float, float | str] = (-LARGEST, LARGEST)


def _is(units: str, long_name: str, **extra: Any) -> Variable:
    """Describe the field that it annotates; name, kind of number and group come from where it stands."""
    return Variable("", units, long_name, **extra)


class Place(NamedTuple):
    """Where the elements are: positions, and the cells of the grid that hold them."""

    lon: Annotated[
        Floats, _is("degrees_east", "longitude (x in m on a Cartesian grid)", standard_name="longitude", output=True)
    ]
    lat: Annotated[
        Floats, _is("degrees_north", "latitude (y in m on a Cartesian grid)", standard_name="latitude", output=True)
    ]
    cell_i: Annotated[Ints, _is("1", "array column of the grid cell", limits=(-1, MOST_COLUMNS))]
    cell_j: Annotated[Ints, _is("1", "array row of the grid cell", limits=(-1, MOST_COLUMNS))]
    xi: Annotated[Floats, _is("1", "position in the cell, west to east")]
    eta: Annotated[Floats, _is("1", "position in the cell, south to north")]
    entered: Annotated[
        Ints, _is("1", "how late the element came into its cell, among all elements", limits=(-1, LARGEST_WHOLE))
    ]


class Shown(NamedTuple):
    """What the elements show to each other; inside a step that may be older than what they have themselves."""

    u_pair: Annotated[Floats, _is("m s-1", "eastward velocity that other elements see")]
    v_pair: Annotated[Floats, _is("m s-1", "northward velocity that other elements see")]
    lon_pair: Annotated[Floats, _is("degrees_east", "longitude that other elements see")]
    lat_pair: Annotated[Floats, _is("degrees_north", "latitude that other elements see")]


class Motion(NamedTuple):
    """Velocities and turning of the elements."""

    u: Annotated[
        Floats, _is("m s-1", "eastward velocity, with the fast kicks and the first slow half kick of the step")
    ]
    v: Annotated[
        Floats, _is("m s-1", "northward velocity, with the fast kicks and the first slow half kick of the step")
    ]
    u_sync: Annotated[Floats, _is("m s-1", "eastward velocity at the time of the position", output=True)]
    v_sync: Annotated[Floats, _is("m s-1", "northward velocity at the time of the position", output=True)]
    spin: Annotated[Floats, _is("rad s-1", "angular velocity, counter-clockwise", output=True)]
    rotation: Annotated[Floats, _is("rad", "rotation since the start, counter-clockwise", output=True)]


class Kicks(NamedTuple):
    """Accelerations that the next step or sub-step goes on with."""

    ax: Annotated[Floats, _is("m s-2", "explicit eastward acceleration of the long step")]
    ay: Annotated[Floats, _is("m s-2", "explicit northward acceleration of the long step")]
    bx: Annotated[Floats, _is("m s-2", "implicit eastward acceleration of the long step")]
    by: Annotated[Floats, _is("m s-2", "implicit northward acceleration of the long step")]
    ax_fast: Annotated[Floats, _is("m s-2", "explicit eastward acceleration of the sub-step")]
    ay_fast: Annotated[Floats, _is("m s-2", "explicit northward acceleration of the sub-step")]
    bx_fast: Annotated[Floats, _is("m s-2", "implicit eastward acceleration of the sub-step")]
    by_fast: Annotated[Floats, _is("m s-2", "implicit northward acceleration of the sub-step")]
    spin_rate: Annotated[Floats, _is("rad s-2", "angular acceleration, counter-clockwise")]


class Body(NamedTuple):
    """What the elements are: identity, ice, supports and loads, and what they hang together with."""

    id: Annotated[Ints, _is("1", "identifier of the element", output=True, stepped=False, limits=(0, LARGEST_WHOLE))]
    mass: Annotated[Floats, _is("kg", "mass of the element", stepped=False, limits=(ABOVE_0, HEAVIEST))]
    thickness: Annotated[
        Floats,
        _is(
            "m",
            "ice thickness",
            standard_name="land_ice_thickness",
            output=True,
            stepped=False,
            limits=(ABOVE_0, THICKEST),
        ),
    ]
    length: Annotated[Floats, _is("m", "length of the element", stepped=False, limits=(ABOVE_0, LONGEST))]
    width: Annotated[Floats, _is("m", "width of the element", stepped=False, limits=(ABOVE_0, LONGEST))]
    static: Annotated[Floats, _is("1", "1 where the element never moves", stepped=False)]
    in_contact: Annotated[Floats, _is("1", "1 where the element takes part in the contact iteration (quirk Q2)")]
    load_x: Annotated[Floats, _is("N", "steady eastward load added to the bond forces", stepped=False)]
    load_y: Annotated[Floats, _is("N", "steady northward load added to the bond forces", stepped=False)]
    free_y: Annotated[
        Floats, _is("1", "0 where a roller support takes the northward bond force, else 1", default=1.0, stepped=False)
    ]
    berg: Annotated[
        Ints,
        _is(
            "1",
            "number of the conglomerate (fragment) that the element belongs to",
            output=True,
            limits=(0, "fragments"),
        ),
    ]
    bond_count: Annotated[Ints, _is("1", "unbroken bonds of the element", output=True, limits=(0, "bonds"))]
    side_share: Annotated[Floats, _is("1", "part of the sides of its berg that the element bears")]
    berg_length: Annotated[Floats, _is("m", "length of the rectangle with the area and second moments of the berg")]
    berg_width: Annotated[Floats, _is("m", "width of that rectangle")]
    bond_area: Annotated[
        Floats, _is("m2", "constant plan area by which bonds know the element; 0 while not yet known", stepped=False)
    ]
    sides: Annotated[
        Ints,
        _is("1", "sides of the element: 4 square, 6 hexagonal; 0 while not yet known", stepped=False, limits=(0, 6)),
    ]
    substeps: Annotated[
        Ints,
        _is(
            "1",
            "sub-steps in a long step of the berg of the element; 0 while not yet known",
            stepped=False,
            limits=(0, MOST_SUBSTEPS),
        ),
    ]


class Life(NamedTuple):
    """What melt, footloose calving and births know of the elements; masses are those of one of the bergs it stands for."""

    mass_scaling: Annotated[
        Floats, _is("1", "number of equal bergs that the element stands for", default=1.0, stepped=False)
    ]
    mass_of_bits: Annotated[Floats, _is("kg", "mass of bergy bits", stepped=False, limits=(0.0, HEAVIEST))]
    mass_of_fl_bits: Annotated[Floats, _is("kg", "mass of footloose bits", stepped=False, limits=(0.0, HEAVIEST))]
    mass_of_fl_bergy_bits: Annotated[
        Floats, _is("kg", "mass of bergy bits of the footloose bits", stepped=False, limits=(0.0, HEAVIEST))
    ]
    fl_k: Annotated[
        Floats,
        _is(
            "m2", "area of the submerged foot; -1 child of footloose calving, -2 child that may collide", stepped=False
        ),
    ]
    front: Annotated[
        Floats,
        _is(
            "m", "length of the outline of the berg along which the element melts; -1 where it melts on all its own sides",
            default=-1.0, stepped=False,
        ),
    ]  # fmt: skip
    retreat: Annotated[
        Floats, _is("m", "how far sides have melted back here since the outline was drawn", stepped=False)
    ]
    heat_density: Annotated[Floats, _is("J kg-1", "heat that the ice brings with it", stepped=False)]
    start_lon: Annotated[Floats, _is("degrees_east", "longitude of calving", stepped=False)]
    start_lat: Annotated[Floats, _is("degrees_north", "latitude of calving", stepped=False)]
    start_year: Annotated[Ints, _is("1", "year of calving", stepped=False, limits=(-(10**6), 10**6))]
    start_day: Annotated[Floats, _is("d", "day of the year of calving", stepped=False)]
    start_mass: Annotated[Floats, _is("kg", "mass at calving", stepped=False, limits=(0.0, HEAVIEST))]


class Environment(NamedTuple):
    """What the forcing says at the places of the elements."""

    uo: Annotated[
        Floats, _is("m s-1", "eastward ocean current", standard_name="eastward_sea_water_velocity", output=True)
    ]
    vo: Annotated[
        Floats, _is("m s-1", "northward ocean current", standard_name="northward_sea_water_velocity", output=True)
    ]
    ui: Annotated[
        Floats, _is("m s-1", "eastward sea-ice velocity", standard_name="eastward_sea_ice_velocity", output=True)
    ]
    vi: Annotated[
        Floats, _is("m s-1", "northward sea-ice velocity", standard_name="northward_sea_ice_velocity", output=True)
    ]
    ua: Annotated[Floats, _is("m s-1", "eastward wind", standard_name="eastward_wind", output=True)]
    va: Annotated[Floats, _is("m s-1", "northward wind", standard_name="northward_wind", output=True)]
    slope_x: Annotated[Floats, _is("1", "eastward slope of the sea surface", output=True)]
    slope_y: Annotated[Floats, _is("1", "northward slope of the sea surface", output=True)]
    depth: Annotated[
        Floats,
        _is(
            "m", "depth of water under the element", standard_name="sea_floor_depth_below_sea_surface", output=True,
            default=1e4,
        ),
    ]  # fmt: skip
    sst: Annotated[Floats, _is("degree_Celsius", "sea-surface temperature", standard_name="sea_surface_temperature")]
    sss: Annotated[Floats, _is("1e-3", "sea-surface salinity", standard_name="sea_surface_salinity", default=-1.0)]
    keel_temperature: Annotated[
        Floats,
        _is("degree_Celsius", "temperature of the sea, mean over the draft; NaN where that of the surface holds",
            default=np.nan),
    ]  # fmt: skip
    keel_salinity: Annotated[
        Floats,
        _is("1e-3", "salinity of the sea, mean over the draft; NaN where that of the surface holds", default=np.nan),
    ]
    ice_fraction: Annotated[
        Floats, _is("1", "sea-ice area fraction", standard_name="sea_ice_area_fraction", output=True)
    ]
    ice_thickness: Annotated[Floats, _is("m", "sea-ice thickness", standard_name="sea_ice_thickness", output=True)]
    vorticity: Annotated[Floats, _is("s-1", "relative vorticity of the ocean current")]
    wave_height: Annotated[
        Floats,
        _is("m", "significant height of given waves; negative where waves follow from the wind",
            standard_name="sea_surface_wave_significant_height", default=-1.0),
    ]  # fmt: skip
    wave_period: Annotated[Floats, _is("s", "mean period of given waves; 0 where it is not known")]
    wave_x: Annotated[Floats, _is("1", "eastward part of the direction in which given waves travel")]
    wave_y: Annotated[Floats, _is("1", "northward part of the direction in which given waves travel")]
    own_x: Annotated[Floats, _is("N", "eastward force by a law of the user")]
    own_y: Annotated[Floats, _is("N", "northward force by a law of the user")]
    own_rate: Annotated[Floats, _is("kg s-1", "what that force falls by with the velocity of the element")]
    own_water_drag: Annotated[
        Floats, _is("kg m-1", "drag of the water by a law of the user; negative: the built-in one", default=-1.0)
    ]
    own_air_drag: Annotated[
        Floats, _is("kg m-1", "drag of the air by a law of the user; negative: the built-in one", default=-1.0)
    ]
    own_ice_drag: Annotated[
        Floats, _is("kg m-1", "drag of sea ice by a law of the user; negative: the built-in one", default=-1.0)
    ]


class Keel(NamedTuple):
    """What a bed of sediment does to the keels of the elements (``grounding.law: seabed``); 0 afloat."""

    floor_load: Annotated[
        Floats, _is("N", "weight of the element that the sea floor carries; in run files with a seabed", output=True)
    ]
    floor_x: Annotated[Floats, _is("N", "eastward force of the sea floor: friction and slope")]
    floor_y: Annotated[Floats, _is("N", "northward force of the sea floor: friction and slope")]
    floor_arm_x: Annotated[
        Floats, _is("m", "eastward way from the centre of the element to where the sea floor carries it")
    ]
    floor_arm_y: Annotated[
        Floats, _is("m", "northward way from the centre of the element to where the sea floor carries it")
    ]
    anchor_x: Annotated[Floats, _is("N", "eastward friction that anchors the keel")]
    anchor_y: Annotated[Floats, _is("N", "northward friction that anchors the keel")]
    anchor_torque: Annotated[Floats, _is("N m", "torque of the friction that anchors the keel")]
    anchor_capacity: Annotated[
        Floats, _is("N", "largest friction that could hold the keel since it touched the floor last")
    ]
    floor_hold: Annotated[Floats, _is("N", "largest friction that can hold the keel now")]
    base_xx: Annotated[Floats, _is("m2", "variance eastward of the area by which the floor holds the keel")]
    base_xy: Annotated[Floats, _is("m2", "its covariance eastward and northward")]
    base_yy: Annotated[Floats, _is("m2", "its variance northward")]
    floor_lift: Annotated[Floats, _is("m", "largest rise of the keel above its floating draft")]
    floor_stress: Annotated[Floats, _is("Pa", "largest bending stress of the ice that the floor lifts")]
    floor_yield: Annotated[
        Floats,
        _is("m", "how deep the keel has pressed a bed that yields, at most; in run files with a seabed", output=True),
    ]
    floor_substep: Annotated[Floats, _is("s", "length of the next sub-step of the fragment on the floor")]


class Elements(NamedTuple):
    """The elements: groups of arrays of shape (number of elements,).

    Outside of compiled code a variable may be had without its group: ``elements.lon`` is ``elements.place.lon``.
    """

    place: Place
    shown: Shown
    motion: Motion
    kicks: Kicks
    body: Body
    life: Life
    environment: Environment
    keel: Keel

    def __getattr__(self, name: str) -> NDArray[Any]:
        """Refuse a name that is no variable; the variables of the registry are properties, set below it."""
        raise AttributeError(f"elements have no variable {name!r}")

    @property
    def size(self) -> int:
        """Number of elements."""
        return int(self.body.id.size)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all arrays by name, in the order of the registry."""
        return {v.name: getattr(self, v.name) for v in ELEMENT_VARIABLES}

    def replaced(self, **arrays: NDArray[Any]) -> Elements:
        """Return elements with some arrays exchanged for others; the rest is shared."""
        return build_elements({**self.arrays(), **arrays})

    def copy(self) -> Elements:
        """Return elements that share no memory with these; once a long step, so by group and not by name."""
        return Elements(*(kind(*[a.copy() for a in group]) for kind, group in zip(GROUPS.values(), self, strict=True)))

    def copy_stepped(self) -> Elements:
        """Return elements with copies of the variables that a long step may change; the rest is shared."""
        return Elements._make([
            _with_copies(group, columns) for group, columns in zip(self, _STEPPED, strict=True)
        ])  # fmt: skip

    def view_rows(self, block: slice) -> Elements:
        """Return some rows that follow one another, in the memory of these elements."""
        return Elements(*(kind(*[a[block] for a in group]) for kind, group in zip(GROUPS.values(), self, strict=True)))

    def taken(self, rows: Any) -> Elements:
        """Return a copy of some rows (numbers or a mask)."""
        if isinstance(rows, slice):
            return build_elements({name: a[rows].copy() for name, a in self.arrays().items()})
        chosen = np.asarray(rows)
        # A mask is counted out once, not for each of the arrays.
        chosen = np.flatnonzero(chosen) if chosen.dtype == bool else chosen.astype(np.int64)
        return build_elements({name: a.take(chosen, axis=0) for name, a in self.arrays().items()})


class Bonds(NamedTuple):
    """The bonds: arrays of shape (number of bonds,); each physical bond is stored once."""

    first: Annotated[Ints, _is("1", "row of the first element", stepped=False, limits=(0, "elements - 1"))]
    second: Annotated[Ints, _is("1", "row of the second element", stepped=False, limits=(0, "elements - 1"))]
    shear_x: Annotated[Floats, _is("m", "accumulated eastward tangential displacement of the first element")]
    shear_y: Annotated[Floats, _is("m", "accumulated northward tangential displacement of the first element")]
    normal_stress: Annotated[
        Floats, _is("Pa", "largest tensile stress across the bond, negative in compression", output=True)
    ]
    shear_stress: Annotated[Floats, _is("Pa", "shear stress across the bond", output=True)]
    peak_stress: Annotated[Floats, _is("Pa", "largest normal_stress of the last long step", output=True)]
    bond_length: Annotated[Floats, _is("m", "distance between the centres", limits=(ABOVE_0, LONGEST))]
    relative_rotation: Annotated[Floats, _is("rad", "accumulated relative rotation")]
    status: Annotated[Ints, _is("1", "0 unbroken, 1 broken but still a contact pair, 2 gone", limits=(0, 2))]
    strength: Annotated[
        Floats, _is("1", "strength of the bond relative to the fracture thresholds", default=1.0, stepped=False)
    ]
    damage: Annotated[
        Floats,
        _is("1", "part of the strength that the stress history has taken; in run files with damage", output=True),
    ]
    break_time: Annotated[
        Floats, _is("s", "time of breaking since the start, NaN while unbroken", output=True, default=np.nan)
    ]
    break_grounded: Annotated[Ints, _is("1", "1 where an end was aground when the bond broke", limits=(0, 1))]
    break_strength: Annotated[
        Ints,
        _is(
            "1",
            "strength that the bond exceeded when it broke: 1 normal, 2 shear, 3 flexural; 0 while unbroken",
            output=True,
            limits=(0, 3),
        ),
    ]
    flexural_stress: Annotated[
        Floats, _is("Pa", "bending stress of ice that the sea floor lifts; where fracture.flexural_strength is given")
    ]
    id: Annotated[Ints, _is("1", "identifier of the bond", stepped=False, limits=(0, LARGEST_WHOLE))]
    rest_length: Annotated[
        Floats,
        _is(
            "m",
            "distance of the centres without strain; NaN while not yet known",
            default=np.nan,
            stepped=False,
            limits=(ABOVE_0, LONGEST),
        ),
    ]
    released_energy: Annotated[
        Floats,
        _is("J", "energy released by the crack that began with this bond (Griffith); of the quasi-static scheme"),
    ]
    cracked_area: Annotated[
        Floats, _is("m2", "area of the crack that began with this bond; of the quasi-static scheme")
    ]
    crack: Annotated[
        Ints, _is("1", "number of the crack line that crosses this bond; 0 for none", limits=(0, LARGEST_WHOLE))
    ]
    crack_order: Annotated[
        Ints,
        _is(
            "1", "place of this bond along its crack line, which began at the bond of place 0",
            limits=(-(10**6), 10**6),
        ),
    ]  # fmt: skip
    crack_part: Annotated[
        Floats,
        _is(
            "1", "where the crack line crosses the bond: part of the way from its first end to its second",
            limits=(0.0, 1.0),
        ),
    ]  # fmt: skip

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all arrays by name, in the order of the registry."""
        return dict(zip(self._fields, self, strict=True))

    def copy(self) -> Bonds:
        """Return bonds that share no memory with these."""
        return Bonds._make(array.copy() for array in self)

    def copy_stepped(self) -> Bonds:
        """Return bonds with copies of the variables that a long step may change; the rest is shared."""
        return cast("Bonds", _with_copies(self, _BONDS_STEPPED))

    def taken(self, rows: Any) -> Bonds:
        """Return a copy of some rows (numbers or a mask); the rows of their ends do not change."""
        return Bonds(**{name: array[rows].copy() for name, array in self.arrays().items()})


def _with_copies(arrays: Any, columns: list[int]) -> Any:
    """Return a named tuple of arrays with copies of those at some places; once a long step, so without a generator."""
    if not columns:
        return arrays
    copies = list(arrays)
    for k in columns:
        copies[k] = copied(copies[k])
    return arrays._make(copies)


def copied(array: NDArray[Any]) -> NDArray[Any]:
    """Return a copy of a variable that takes no memory where all is 0, as half of the variables are in many runs."""
    # By the bits: -0.0 is no 0.
    return array.copy() if array.view(np.int64).any() else zeros(array.size, array.dtype)


LARGE = 2**18
"""Bytes from which zeros are taken from the system: arrays that come and go in a step stay with NumPy."""


def zeros(count: int, dtype: Any = "f8") -> NDArray[Any]:
    """Return zeros that take no memory until they are written; `numpy.zeros` takes some where it clears used memory."""
    kind = np.dtype(dtype)
    if count * kind.itemsize < LARGE or not hasattr(mmap, "MAP_PRIVATE"):  # as on Windows
        return np.zeros(count, kind)
    pages = mmap.mmap(-1, count * kind.itemsize, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    return np.frombuffer(pages, kind)


def _registered(kind: type, group: str = "") -> tuple[Variable, ...]:
    hints = get_type_hints(kind, include_extras=True)
    return tuple(
        replace(hint.__metadata__[0], name=name, group=group, dtype="i8" if hint.__origin__ == Ints else "f8")
        for name, hint in hints.items()
    )


GROUPS: dict[str, type] = get_type_hints(Elements)
"""Groups of the variables of an element and their classes."""

ELEMENT_VARIABLES: tuple[Variable, ...] = tuple(v for group, kind in GROUPS.items() for v in _registered(kind, group))
"""Registry of the variables of an element, group by group."""

BOND_VARIABLES: tuple[Variable, ...] = _registered(Bonds)
"""Registry of the variables of a bond."""

_STEPPED = tuple(
    [k for k, v in enumerate(v for v in ELEMENT_VARIABLES if v.group == group) if v.stepped] for group in GROUPS
)
_BONDS_STEPPED = [k for k, v in enumerate(BOND_VARIABLES) if v.stepped]
"""Places in each group of the variables that a long step may change."""

# Each variable of an element is a property as well: found without `__getattr__`, which steps in pure Python would feel.
for _variable in ELEMENT_VARIABLES:
    setattr(
        Elements, _variable.name, property(attrgetter(f"{_variable.group}.{_variable.name}"), doc=_variable.long_name)
    )


def build_elements(arrays: dict[str, NDArray[Any]]) -> Elements:
    """Return elements made of arrays by name, one for each variable of the registry."""
    groups = {
        group: kind(*(arrays[v.name] for v in ELEMENT_VARIABLES if v.group == group)) for group, kind in GROUPS.items()
    }
    return Elements(**groups)


def brief(name: str, size: int, things: str, arrays: dict[str, NDArray[Any]]) -> str:
    """Return a few lines on arrays, however long they are: the least and the largest of each, and its unit."""
    units = {v.name: v.units for v in (*ELEMENT_VARIABLES, *BOND_VARIABLES)}
    wide = max(map(len, arrays), default=0)
    lines = []
    for key, array in arrays.items():
        finite = array[np.isfinite(array)]
        values = f"{finite.min():.6g} to {finite.max():.6g}" if finite.size else "nothing known"
        lines.append(f"  {key:{wide}}  {values} {'' if units[key] == '1' else units[key]}".rstrip())
    return "\n".join([f"{name} of {size} {things}", *lines])


def _brief_group(group: Any) -> str:
    arrays = dict(zip(group._fields, group, strict=True))
    return brief(type(group).__name__, len(group[0]), "elements", arrays)


def _brief_elements(elements: Elements) -> str:
    groups = [f"  {name}: {', '.join(kind.__annotations__)}" for name, kind in GROUPS.items()]
    return "\n".join([f"Elements: {elements.size}", *groups])


def _brief_bonds(bonds: Bonds) -> str:
    return brief("Bonds", len(bonds.first), "pairs of elements", bonds.arrays())


# Arrays of thousands of elements would fill many screens.
for _kind in GROUPS.values():
    _kind.__repr__ = _brief_group  # type: ignore[assignment, method-assign]
Elements.__repr__ = _brief_elements  # type: ignore[assignment, method-assign]
Bonds.__repr__ = _brief_bonds  # type: ignore[assignment, method-assign]
