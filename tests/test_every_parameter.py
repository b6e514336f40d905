"""Every parameter changes something: a small run for each in which another value gives another result.

Or the other value is refused, or the parameter stands among those that must not change results. A parameter that is taken,
documented and read by nobody fails here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import pytest

from keys import extra
from riftberg import Exchange, Forcing, Grid, GriddedForcing, Iceberg, Model, OceanForcing, Parameters, ocean_grid
from riftberg.errors import RiftbergError
from riftberg.parameters import fields_by_path, kid_quirks

Groups = dict[str, dict[str, Any]]

OPEN: Final[Groups] = {
    "bonds": {"youngs_modulus": 1e6}, "fracture": {"enabled": False}, "stepping": {"scheme": "mts", "time_step": 300.0},
    "earth": {"latlon": False, "reference_latitude": -60.0},
}  # fmt: skip


def with_(base: Groups, **groups: dict[str, Any]) -> Groups:
    """Return groups with some values changed."""
    return {name: {**base.get(name, {}), **groups.get(name, {})} for name in {**base, **groups}}


def bergs(packing: str = "square", latlon: bool = False, latitude: float = -55.0, **shape: Any) -> Iceberg:
    """A lattice of 4 x 3 elements of two thicknesses, and a larger one beside it that comes nearer."""
    radius = 300.0
    unit = 1.0 / 111e3 if latlon else 1.0
    options: dict[str, Any] = {"latlon": latlon, "packing": packing}
    if packing == "square":
        x, y = (a.ravel() for a in np.meshgrid(600.0 * np.arange(4), 600.0 * np.arange(3)))
        east = x.max() + radius + 450.0 + 5.0
    else:
        y, x = (a.ravel() for a in np.meshgrid(600.0 * np.arange(4), 3.0**0.5 * radius * np.arange(3)))
        y = y + radius * (np.round(x / (3.0**0.5 * radius)) % 2)
        east = x.max() + 2.0 * radius + 450.0 + 5.0
    x0, y0 = (-40.0, latitude) if latlon else (0.0, 0.0)
    squeeze = 1.0 / np.cos(np.radians(latitude)) if latlon else 1.0
    thick = np.where(x < 700.0, 200.0, 180.0)
    lattice = Iceberg.from_points(
        x0 + unit * squeeze * x,
        y0 + unit * y,
        thickness=thick,
        radius=radius,
        velocity=(0.3, 0.05),
        spin=2e-5,
        **options,
    )
    single = Iceberg.from_points(
        [x0 + unit * squeeze * east],
        [y0 + unit * 300.0],
        thickness=150.0,
        radius=450.0,
        velocity=(-0.4, 0.0),
        spin=5e-5,
        **options,
    )
    joined = Iceberg.join([lattice, single])
    el = joined.elements
    rng = np.random.default_rng(2)
    for name in ("u", "v"):
        values = getattr(el, name) + 0.02 * rng.standard_normal(el.size)
        for copy in (name, f"{name}_sync", f"{name}_pair"):
            getattr(el, copy)[:] = values
    el.life.mass_of_bits[:] = 1e6
    for name, value in shape.items():
        getattr(el, name)[-1] = value
    body = el.body
    body.mass[:] = 850.0 * body.thickness * body.length * body.width
    el.life.start_mass[:] = body.mass
    return joined


SEA: Final[dict[str, Any]] = {
    "current": (0.3, -0.1), "wind": (10.0, -4.0), "slope": (1e-6, 2e-6), "sea_ice": (0.1, 0.05, 1.0), "depth": 1e4,
    "temperature": 2.0, "salinity": 30.0, "ice_fraction": 0.3,
}  # fmt: skip


class Ebb(Forcing.uniform):
    """A sea whose surface sinks by 2 cm/s, so that elements touch down."""

    def sample(self, elements: Any, time: float) -> None:
        """Fill the environment."""
        super().sample(elements, time)
        elements.depth[:] -= 0.02 * time


def state(model: Model) -> dict[str, np.ndarray]:
    """Return all that a model holds, with its ledgers."""
    found = {f"element {name}": values.copy() for name, values in model.elements.arrays().items()}
    found |= {f"bond {name}": np.array(values) for name, values in zip(model.bonds._fields, model.bonds, strict=True)}
    found |= {f"remembered {name}": np.array(values) for name, values in model.remembered.items()}
    return {**found, "fragments": np.array([model.fragment_count])}


def drift(
    groups: Groups, *, steps: int = 3, sea: dict[str, Any] | None = None, prepare: Any = None,
    kind: type[Any] = Forcing.uniform, **berg: Any,
) -> Any:  # fmt: skip
    """Run the bergs in a steady sea, or one that sinks."""
    made = bergs(**berg)
    if prepare is not None:
        prepare(made)
    model = Model(made, kind(**{**SEA, **(sea or {})}), Parameters(**groups))
    model.advance(steps=steps)
    return state(model)


def shore(
    groups: Groups, *, steps: int = 6, latlon: bool = False, cell: float = 1000.0, edge: bool = False, **berg: Any
) -> Any:
    """Run the bergs on a grid with land, or its edge, to the east, towards which a current that grows carries them."""
    made = bergs(latlon=latlon, **berg)
    if latlon:
        # Sea ends a little beyond the single element, in the east and in the south.
        lon, lat = np.meshgrid(-40.0372 + 0.02 * np.arange(8), -55.0 + 0.02 * np.arange(-2, 6))
        mask = np.ones(lon.shape)
        mask[:, 5:] = mask[:3] = 0.0
        grid = Grid.from_corners(lon, lat, mask=mask)
    else:
        across, sea = round((6e3 if edge else 12e3) / cell), round(6e3 / cell)
        mask = np.ones((across, across))
        mask[:, sea:] = 0.0
        if edge:  # sea beyond the domain too: where there is none, the edge is a coast
            mask = np.ones((across + 2, across + 2))
        grid = Grid.cartesian(across, across, cell, offset=-3000.0, mask=mask)
    fields = [grid.fields(uo=uo, vo=-0.1, sst=2.0, sss=34.0, depth=500.0) for uo in (1.0, 2.0)]
    model = Model(made, GriddedForcing(grid, fields, [0.0, 3600.0]), Parameters(**groups))
    model.advance(steps=steps)
    return state(model)


def calve(groups: Groups, *, steps: int = 3, **_: Any) -> Any:
    """Run bergs beside an ocean into which land ice calves, on both sides of the equator."""
    lon, lat = np.meshgrid(np.linspace(-40.0, -39.0, 9), np.linspace(-0.4, 0.4, 7))
    grid = ocean_grid(lon, lat)
    berg = Iceberg.from_points([-39.6], [0.1], thickness=150.0, radius=400.0)
    shape = grid.arrays.nj, grid.arrays.ni
    model = Model(berg, OceanForcing(grid, grid.fields(depth=500.0)), Parameters(**groups))
    exchange = Exchange(model)
    flux = np.zeros(shape)
    flux[1:5, 3] = 0.002  # some dozens of bergs a step
    for step in range(steps):
        exchange.step({
            "eastward_sea_water_velocity": 0.3, "northward_sea_water_velocity": -0.1, "eastward_wind": 5.0,
            "northward_wind": 3.0, "sea_surface_temperature": 2.0, "sea_surface_salinity": 34.0,
            "land_ice_specific_mass_flux_due_to_calving": flux * (1.0 + step),
            "heat_flux_of_calved_ice": np.where(flux > 0, -50.0, 0.0),
        })  # fmt: skip
    return state(model)


def unequal(berg: Iceberg) -> None:
    """One element of the lattice is narrower than the others."""
    body = berg.elements.body
    body.width[0] = 500.0
    body.mass[0] = 850.0 * body.thickness[0] * body.length[0] * 500.0


def anchored(berg: Iceberg) -> None:
    """The lattice stands still and does not calve; the single element is lighter ice."""
    berg.elements.static[:-1] = 1.0
    berg.elements.mass[-1] *= 0.98


@dataclass(frozen=True)
class Trial:
    """Another value of a parameter, the scene in which it matters, or words of the refusal."""

    value: Any = None
    base: Groups = field(default_factory=lambda: OPEN)
    run: Callable[..., Any] = drift
    refused: str = ""
    more: dict[str, Any] = field(default_factory=dict)


QUASI = with_(OPEN, stepping={"scheme": "quasi_static"})
VERLET = with_(OPEN, stepping={"scheme": "verlet"}, bonds={"law": "spring", "spring": 1e-7})
RUNGE = with_(OPEN, stepping={"scheme": "runge_kutta"}, bonds={"law": "spring", "spring": 1e-7})
SPRING = with_(OPEN, bonds={"law": "spring"})
KID = with_(
    OPEN,
    **kid_quirks(),
    contact={"on_substeps": False, "spring": 1e-6},
    grounding={"implicit": False},
    drag={"rotational": False},
    bonds={"objective_damping": False},
)
# A landing is followed in parts of two seconds, each dear: a step of twenty seconds has all that one of minutes has.
BED = with_(OPEN, grounding={"law": "seabed"}, stepping={"scheme": "quasi_static", "time_step": 20.0})
ICY: Final = {"sea": {"sea_ice": (0.1, 0.05, 2.0), "ice_fraction": 0.95}}
SHALLOW: Final = {"sea": {"depth": 150.0}}
AGROUND: Final = {"sea": {"depth": 165.6}, "steps": 1}
BURIED: Final = {"sea": {"depth": 157.0}, "steps": 1}
NEAR: Final = {"sea": {"depth": 185.0}}
WEAK = with_(OPEN, fracture={"enabled": True, "normal_strength": 10.0, "shear_strength": 1e7})
WEAK_QUASI = with_(WEAK, stepping={"scheme": "quasi_static"})
CREVASSED = with_(WEAK_QUASI, fracture={"crevasse_strength": 1e6, "normal_strength": None})
WEARS = with_(
    OPEN,
    fracture={"enabled": True, "normal_strength": 1e3, "shear_strength": 1e7},
    damage={"enabled": True, "time_scale": 3600.0, "threshold": 0.0},
    stepping={"scheme": "quasi_static"},
)
MELT = with_(OPEN, melt={"enabled": True})
SHELF = with_(MELT, melt={"mode": "shelf"})
TURBULENT = with_(MELT, melt={"mode": "berg", "base": "turbulent"})
ROLLS = with_(MELT, rolling={"enabled": True})
TALL: Final = {"thickness": 900.0, "width": 500.0}
FOOT = with_(
    MELT, footloose={"enabled": True, "youngs": 1e6, "strength": 3e4, "style": "bergs"}, rolling={"enabled": True}
)
BITS = with_(FOOT, footloose={"style": "bits", "berg_mass": 1e9})
KID_FOOT = with_(BITS, **kid_quirks())
CUT: Final = {"fl_k": 1e5}
SMALL_CLASS = {"mass": (4e7, 8e7), "fraction": (0.5, 0.4), "scaling": (1.0, 1.0), "thickness": (40.0, 50.0)}
NORTH_CLASS = {"mass": (5e7, 8e7), "fraction": (0.5, 0.4), "scaling": (1.0, 1.0), "thickness": (40.0, 50.0)}
CALVES: Final[Groups] = {
    "stepping": {"scheme": "mts", "time_step": 1800.0}, "melt": {"enabled": True},
    "calving": {"south": SMALL_CLASS, "north": NORTH_CLASS},
}  # fmt: skip


def _class(hemisphere: str, **changed: Any) -> Trial:
    table = {**(SMALL_CLASS if hemisphere == "south" else NORTH_CLASS), **changed}
    return Trial(table, CALVES, calve)


def _quirk(base: Groups = KID, **more: Any) -> Trial:
    return Trial(None, base, **more)


TRIALS: Final[dict[str, Trial]] = {
    "drag.ice_side": Trial(more=ICY),
    "compatibility.radius_based": Trial(
        base=with_(OPEN, compatibility={"forces_by_element": True}), more={"packing": "hexagonal"}
    ),
    "sea_ice.capture": Trial(base=QUASI, more=ICY),
    "sea_ice.strength": Trial(base=QUASI, more=ICY),
    "sea_ice.decay": Trial(base=QUASI, more=ICY),
    "sea_ice.least_concentration": Trial(base=QUASI, more=ICY),
    "sea_ice.locked_concentration": Trial(base=with_(QUASI, sea_ice={"capture": "locked"}), more=ICY),
    "sea_ice.locked_strength": Trial(base=with_(QUASI, sea_ice={"capture": "locked"}), more=ICY),
    "grounding.law": Trial(
        "quadratic", with_(OPEN, grounding={"law": "linear", "quadratic_coefficient": 10.0}), more=SHALLOW
    ),
    "grounding.coefficient": Trial(more=SHALLOW),
    "grounding.quadratic_coefficient": Trial(
        base=with_(OPEN, grounding={"law": "quadratic", "quadratic_coefficient": 10.0}), more=SHALLOW
    ),
    "grounding.ramp_height": Trial(more=NEAR),
    "grounding.on_substeps": Trial(more=SHALLOW),
    "grounding.implicit": Trial(base=with_(OPEN, grounding={"coefficient": 10.0}), more=SHALLOW),
    "grounding.torque": Trial(more=SHALLOW),
    "grounding.sediment": Trial(base=BED, more=AGROUND),
    "grounding.stiffness": Trial(base=BED, more=AGROUND),
    "grounding.bearing_strength": Trial(base=BED, more=AGROUND),
    "grounding.friction": Trial(base=BED, more=AGROUND),
    "grounding.shear_strength": Trial(base=BED, more=AGROUND),
    "grounding.adhesion": Trial(base=with_(BED, grounding={"shear_strength": 2e3}), more=AGROUND),
    "grounding.anchor_way": Trial(base=BED, more=AGROUND),
    "grounding.bending": Trial(base=with_(BED, grounding={"ice_modulus": 1e8}), more=AGROUND),
    "grounding.ice_modulus": Trial(base=with_(BED, grounding={"ice_modulus": 3e8}), more=AGROUND),
    "grounding.start": Trial(base=BED, more=BURIED, refused="8.* m below the sea floor"),
    "contact.crushing_strength": Trial(base=QUASI),
    "contact.crushing_depth": Trial(base=QUASI),
    "contact.unloading_ratio": Trial(base=QUASI),
    "contact.friction": Trial(base=QUASI),
    "contact.radial_damping": Trial(base=with_(OPEN, contact={"critical_damping": False})),
    "contact.iterate": Trial(base=KID),
    "contact.tolerance": Trial(base=with_(KID, contact={"tolerance": 1e-10})),
    "contact.max_iterations": Trial(base=with_(KID, contact={"tolerance": 1e-10}), refused="iteration"),
    "bonds.law": Trial("spring"),
    "bonds.packing": Trial(refused="the berg has square elements"),
    "bonds.spring": Trial(base=SPRING),
    "bonds.linear_bending": Trial(base=with_(OPEN, stepping={"time_step": 3000.0})),
    "bonds.max_bonds": Trial(base=SPRING),
    "bonds.constant_size": Trial(base=with_(OPEN, bonds={"constant_length": 590.0, "constant_width": 590.0})),
    "bonds.constant_length": Trial(base=with_(OPEN, bonds={"constant_size": True, "constant_width": 600.0})),
    "bonds.constant_width": Trial(base=with_(OPEN, bonds={"constant_size": True, "constant_length": 600.0})),
    "fracture.enabled": Trial(base=WEAK),
    "fracture.normal_strength": Trial(base=WEAK),
    "fracture.crevasse_strength": Trial(base=CREVASSED),
    "fracture.shear_strength": Trial(base=WEAK),
    "fracture.flexural_strength": Trial(
        base=with_(
            BED,
            grounding={"ice_modulus": 1e8},
            fracture={"enabled": True, "normal_strength": 1e9, "shear_strength": 1e9, "flexural_strength": 1e9},
        ),
        more=AGROUND,
    ),
    "fracture.criterion": Trial(base=WEAK_QUASI, refused="toughness"),
    "fracture.toughness": Trial(
        base=with_(WEAK_QUASI, fracture={"criterion": "toughness", "toughness": 1e5}), refused="toughness"
    ),
    "fracture.on_substeps": Trial(base=WEAK),
    "fracture.broken_as_contact": Trial(base=with_(WEAK, fracture={"normal_strength": 80.0, "shear_strength": 80.0})),
    "fracture.not_in_first_step": Trial(base=WEAK, more={"steps": 1}),
    "damage.enabled": Trial(base=WEARS),
    "damage.threshold": Trial(base=WEARS),
    "damage.time_scale": Trial(base=WEARS),
    "damage.exponent": Trial(base=WEARS),
    "stepping.scheme": Trial("quasi_static"),
    "stepping.explicit_substeps": Trial(base=SPRING),
    "stepping.predictor_corrector": Trial(base=RUNGE),
    "stepping.fixed_velocity": Trial(base=VERLET),
    "stepping.speed_limit": Trial(refused="No ice is faster than 0.1 m/s"),
    "earth.latlon": Trial(refused="latlon"),
    "earth.radius": Trial(base=with_(OPEN, earth={"latlon": True}), more={"latlon": True}),
    "earth.period": Trial(base=with_(OPEN, contact={"distance": 900.0})),
    "earth.f_plane": Trial(base=with_(OPEN, earth={"latlon": True}), more={"latlon": True}),
    "melt.mode": Trial(base=MELT),
    "melt.base": Trial(base=SHELF),
    "melt.temperature": Trial(base=MELT),
    "melt.salinity": Trial(base=SHELF),
    "melt.salinity_from_ocean": Trial(base=SHELF),
    "melt.split": Trial(base=with_(MELT, melt={"bits_fraction": 0.5})),
    "melt.sea_ice_shift": Trial(base=MELT),
    "melt.bits_fraction": Trial(base=MELT),
    "melt.zero_rates": Trial(base=MELT),
    "melt.keep_shape": Trial(base=MELT),
    "melt.const_gamma": Trial(base=SHELF),
    "melt.gamma_t": Trial(base=SHELF),
    "melt.friction_drag": Trial(base=SHELF),
    "melt.least_friction": Trial(base=SHELF),
    "melt.tide": Trial(base=SHELF),
    "melt.least_gap": Trial(base=SHELF, more=NEAR),
    "rolling.enabled": Trial(base=ROLLS, more=TALL),
    "rolling.scheme": Trial(base=ROLLS, more={"thickness": 900.0, "width": 800.0}),
    "rolling.tip": Trial(base=ROLLS, more=TALL),
    "footloose.enabled": Trial(base=FOOT, more=CUT),
    "footloose.youngs": Trial(base=FOOT, more=CUT),
    "footloose.strength": Trial(base=FOOT, more=CUT),
    "footloose.modulus": Trial(base=FOOT, more=CUT),
    "footloose.viscosity": Trial(base=with_(FOOT, footloose={"modulus": "relaxed"}), more=CUT),
    "footloose.style": Trial(base=FOOT, more=CUT),
    "footloose.displace": Trial(base=FOOT, more=CUT),
    "footloose.one_draw": Trial(base=BITS, more={**CUT, "steps": 6}),
    "footloose.berg_mass": Trial(base=BITS, more=CUT),
    "footloose.seed": Trial(base=FOOT, more=CUT),
    "calving.south": _class("south", thickness=(42.0, 52.0)),
    "calving.north": _class("north", thickness=(45.0, 55.0)),
    "calving.fractions": Trial(base=CALVES, run=calve),
    "calving.length_over_width": Trial(base=CALVES, run=calve),
    "calving.smoothing_time": Trial(base=CALVES, run=calve),
    "calving.south.mass": _class("south", mass=(4e7, 7e7)),
    "calving.south.fraction": _class("south", fraction=(0.6, 0.3)),
    "calving.south.scaling": _class("south", scaling=(2.0, 1.0)),
    "calving.south.thickness": _class("south", thickness=(40.0, 55.0)),
    "compatibility.inline_break_in_first_step": _quirk(
        with_(WEAK, fracture={"not_in_first_step": True}), more={"steps": 1}
    ),
    "compatibility.flat_relative_velocity": _quirk(
        with_(KID, earth={"latlon": True}), more={"latlon": True, "latitude": -80.0}
    ),
    # Without it births at the centre need elements that do not act on each other.
    "compatibility.zero_start": _quirk(with_(KID, compatibility={"births_at_centre": False})),
    "compatibility.sticky_collision_flags": _quirk(with_(KID, contact={"spring": 3e-5}), more={"steps": 10}),
    "compatibility.shared_shear_lever": _quirk(more={"prepare": unequal}),
    "compatibility.bond_thickness_of_second": _quirk(),
    "compatibility.swapped_implicit_velocity": _quirk(
        with_(KID, bonds={"law": "spring", "spring": 1e-5}, stepping={"explicit_substeps": False})
    ),
    "compatibility.uncentred_half_kicks": _quirk(),
    "compatibility.explicit_contact_damping": _quirk(with_(WEAK, fracture={"broken_as_contact": True})),
    "compatibility.forces_by_element": _quirk(),
    "compatibility.frozen_sea_ice_drag": _quirk(more={"sea": {"sea_ice": (0.0, 0.0, 1.0)}}),
    "compatibility.rest_length_from_sizes": _quirk(with_(MELT, stepping={"time_step": 3600.0})),
    "compatibility.bergs_coupled": _quirk(),
    "compatibility.plain_kid_branch": _quirk(VERLET),
    "melt.bits_melt_at_zero_rates": _quirk(with_(MELT, melt={"bits_fraction": 0.5, "zero_rates": True})),
    "melt.plain_basal_search": _quirk(with_(SHELF, melt={"const_gamma": False})),
    "melt.scaled_laminar_layer": _quirk(with_(SHELF, melt={"base": "two_equation"})),
    "rolling.rolls_on": _quirk(with_(ROLLS, ice={"density": 700.0}), more={"thickness": 500.0, "width": 505.0}),
    "melt.element_length_in_base_law": _quirk(TURBULENT),
    "footloose.half_west_rim": _quirk(BITS, more={**CUT, "steps": 6}),
    "footloose.bits_always_roll": _quirk(with_(BITS, rolling={"enabled": False}), more=CUT),
    "melt.drop_orphan_bits": _quirk(
        with_(BITS, melt={"bits_fraction": 0.5}), more={"mass_of_fl_bits": 0.0, "mass_of_fl_bergy_bits": 1e6}
    ),
    "footloose.footloose_sets_density": _quirk(BITS, more={**CUT, "prepare": anchored}),
    "calving.heat_of_one_class": _quirk(CALVES, run=calve),
    "compatibility.births_at_centre": _quirk(with_(CALVES, stepping={"interactions": False}), run=calve),
    "calving.hemisphere_by_corner": _quirk(CALVES, run=calve),
    "compatibility.elements_stopped_alone": _quirk(run=shore, more={"steps": 8}),
    "compatibility.forcing_lag": _quirk(run=shore),
    "compatibility.stages_from_start": _quirk(RUNGE),
    "compatibility.contact_by_cells": _quirk(with_(VERLET, contact={"spring": 1e-6}), run=shore, more={"cell": 200.0}),
    "compatibility.lost_over_edge": _quirk(run=shore, more={"edge": True, "steps": 9}),
    "compatibility.imposed_velocity_late": _quirk(with_(RUNGE, stepping={"fixed_velocity": (0.2, 0.1)})),
    "compatibility.grid_position_round_trip": _quirk(VERLET, run=shore),
    "footloose.unplaced_child_in_metres": _quirk(
        with_(
            FOOT,
            earth={"latlon": True},
            melt={"temperature": 2.0, "salinity": 33.0},
            footloose={"seed": 3},
            stepping={"interactions": False},
        ),
        run=shore,
        more={**CUT, "latlon": True, "steps": 2},
    ),  # this seed draws a place on land; with contact a child goes beside its parent
    # Between the speeds of the lattice and of the single element.
    "compatibility.flung_debris": Trial(
        base=with_(KID, stepping={"speed_limit": 0.35}), refused="element 13 .* begins with a speed of 0.4"
    ),
}


def trials() -> dict[str, Trial]:
    """Return the trial of each parameter: that of the table, else in open water, as its field has it or switched over."""
    return {**{path: Trial() for path in fields_by_path()}, **TRIALS}


def value_of(groups: Groups, name: str) -> Any:
    group, leaf = name.split(".")[:2]
    return getattr(getattr(Parameters(**groups), group), leaf)


def differences(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> list[str]:
    def same(a: np.ndarray, b: np.ndarray) -> bool:
        return a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")

    return [name for name, values in one.items() if name not in other or not same(values, other[name])]


def changed(name: str, trial: Trial) -> Groups:
    """Return the groups of a trial with its other value."""
    group, leaf = name.split(".")[:2]
    value = trial.value
    if value is None:
        value = extra(fields_by_path()[f"{group}.{leaf}"], "trial")
    value = not value_of(trial.base, name) if value is None else value
    return with_(trial.base, **{group: {leaf: value}})


def test_every_trial_is_of_a_parameter() -> None:
    assert {".".join(name.split(".")[:2]) for name in TRIALS} <= set(fields_by_path())


_BEFORE: Final[dict[str, Any]] = {}


def before_change(trial: Trial) -> Any:
    """Return the state that the unchanged parameters give; many trials share their scene."""
    scene = f"{trial.run.__name__} {trial.base} {trial.more}"
    if scene not in _BEFORE:
        _BEFORE[scene] = trial.run(trial.base, **trial.more)
    return _BEFORE[scene]


@pytest.mark.parametrize("name", trials())
def test_another_value_gives_another_result(name: str) -> None:
    trial = trials()[name]
    before = before_change(trial)
    if trial.refused:
        with pytest.raises(RiftbergError, match=trial.refused):
            trial.run(changed(name, trial), **trial.more)
        return
    assert differences(before, trial.run(changed(name, trial), **trial.more))
