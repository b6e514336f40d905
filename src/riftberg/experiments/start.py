"""The berg of a model at its start, moved, turned or changed: for built-in experiments, which have no file to change it in."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from riftberg.bergs.bonding import Metric, separations
from riftberg.bergs.iceberg import Iceberg
from riftberg.bergs.regions import turned
from riftberg.errors import InputError
from riftberg.plane import EqualAreaPlane
from riftberg.state import copy_state

if TYPE_CHECKING:
    from riftberg.runs.model import Model


def started(
    model: Model, *, east: float = 0.0, north: float = 0.0, turn: float = 0.0, size: float = 1.0, thickness: float = 1.0,
    strength: float = 1.0, to: tuple[float, float] | None = None,
) -> Model:  # fmt: skip
    """Return a model anew with its berg moved (m), turned (degrees), and with factors on size, thickness and strength.

    ``to``: where its centre comes to lie (degrees or m), in place of ``east`` and ``north``.
    """
    p = model.parameters
    e, bonds = copy_state(model.elements, model.bonds)
    metric = Metric(p.earth.latlon, p.earth.radius, p.earth.period)
    first, second = bonds.first, bonds.second

    def lengths() -> Any:
        return np.hypot(*separations(metric, e.lon[first], e.lat[first], e.lon[second], e.lat[second]))

    before, share = lengths(), e.mass / e.mass.sum()
    lon0, lat0 = float(share @ e.lon), float(share @ e.lat)
    here = EqualAreaPlane(lon0, lat0, p.earth.radius, p.earth.latlon)
    # A step of some kilometres on the plane of the old place gives the new point of contact.
    lon1, lat1 = to or tuple(float(a[0]) for a in here.inverse(np.array([east]), np.array([north])))
    there = replace(here, lon0=lon1, lat0=lat1)

    def moved(lon: Any, lat: Any) -> tuple[Any, Any]:
        x, y = turned(*here.forward(lon, lat), turn)
        return there.inverse(size * x, size * y)

    e.lon[:], e.lat[:] = moved(e.lon, e.lat)
    e.lon_pair[:], e.lat_pair[:] = e.lon, e.lat
    if bonds.bond_length.size:
        # Strains stay as they were: rest lengths follow the distances.
        bonds.bond_length[:] *= lengths() / before
    e.length[:] *= size
    e.width[:] *= size
    e.thickness[:] *= thickness
    e.mass[:] *= thickness * size**2
    bonds.strength[:] *= strength
    return _again(model, e, bonds, moved)


def _again(model: Model, e: Any, bonds: Any, moved: Callable[[Any, Any], tuple[Any, Any]]) -> Model:
    """Return a model of changed elements and bonds; ``moved`` is where points of the outlines went."""
    p = model.parameters

    def along(points: Any) -> Any:
        return np.column_stack(moved(points[:, 0], points[:, 1]))

    berg = Iceberg(
        e, bonds, p.bonds.packing, math.sqrt(float(e.length[0] * e.width[0])) / 2.0, latlon=p.earth.latlon,
        earth_radius=p.earth.radius, bergs=model.fragments.bergs,
        outlines=tuple(shapely.transform(polygon, along) for polygon in model.outlines),
    )  # fmt: skip
    again = type(model)(berg, model.forcing, p, model.start)
    again.after_step = model.after_step
    return again


def with_berg(model: Model, keys: Mapping[str, Any]) -> Model:
    """Return a model with another thickness, placement, rotation, shift, velocity or spin of its berg, as files give them.

    ``rotation`` turns it from where the experiment has it; ``velocity`` and ``spin`` take the place of those that it has.
    """
    p = model.parameters
    thickness = keys.get("thickness")
    if isinstance(thickness, str):
        raise InputError("a built-in experiment takes no map", where="berg.thickness", remedy="Give a thickness in m")
    e = model.elements
    share = e.mass / e.mass.sum()
    lon, lat = float(share @ e.lon), float(share @ e.lat)
    to, shift = keys.get("placement") or (lon, lat), keys.get("shift", (0.0, 0.0))
    changed = started(model, to=(to[0] + shift[0], to[1] + shift[1]), turn=keys.get("rotation", 0.0))
    e, bonds = copy_state(changed.elements, changed.bonds)
    if thickness is not None:
        e.mass[:] *= thickness / e.thickness
        e.thickness[:] = thickness
    if "velocity" in keys:
        for names, new in (
            (("u", "u_pair", "u_sync"), keys["velocity"][0]),
            (("v", "v_pair", "v_sync"), keys["velocity"][1]),
        ):
            mean = float(share @ getattr(e, names[0]))
            for name in names:
                getattr(e, name)[:] += new - mean
    if "spin" in keys:
        plane = EqualAreaPlane(float(share @ e.lon), float(share @ e.lat), p.earth.radius, p.earth.latlon)
        x, y = plane.forward(e.lon, e.lat)
        rate = keys["spin"] - e.spin
        for names, more in ((("u", "u_pair", "u_sync"), -rate * y), (("v", "v_pair", "v_sync"), rate * x)):
            for name in names:
                getattr(e, name)[:] += more
        e.spin[:] = keys["spin"]
    return _again(changed, e, bonds, lambda x, y: (x, y))
