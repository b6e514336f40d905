"""Grids of invented layouts: where the points of a field lie, and what the file says about that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from fuzz.oceans import Ocean, axes

Points = tuple[tuple[str, ...], Any, Any]
DEGREE = 111.2
"""Kilometres in a degree of latitude."""


@dataclass
class Placed:
    """A grid laid around a centre.

    Attributes
    ----------
    coordinates : xarray.Dataset
        What the file says of positions, raw.
    points : callable
        Returns dimensions, longitudes and latitudes (of these dimensions) of a field.
    angle : callable, optional
        Returns the angle (radians, counter-clockwise from east) along which the first component of a vector points.
    rename, attributes : dict
        Names in the file, and attributes of single fields or (``""``) of all.
    time, level : str
        Names of these dimensions; ``levels`` are the numbers of levels of a model, on which currents stand.
    apart : list
        Files of their own: label, fields and coordinates left out.
    beside : list
        Files that lie beside and are not named.
    rank : int
        Dimensions of place.
    """

    coordinates: xr.Dataset
    points: Callable[[str], Points]
    angle: Callable[[str], Any] | None = None
    rename: dict[str, str] = field(default_factory=dict)
    attributes: dict[str, dict[str, Any]] = field(default_factory=dict)
    time: str = "time"
    level: str = ""
    levels: Any = None
    apart: list[tuple[str, list[str], list[str]]] = field(default_factory=list)
    beside: list[tuple[str, xr.Dataset]] = field(default_factory=list)
    rank: int = 2


@dataclass(frozen=True)
class Grid:
    """A way to make a grid; `own` are choices that it makes itself."""

    make: Callable[[Ocean], Placed]
    choice: Any
    own: tuple[str, ...] = ()
    wind: bool = True
    slopes: bool = True
    slack: float = 1.0


NORTH = {"units": "degrees_north", "standard_name": "latitude"}
EAST = {"units": "degrees_east", "standard_name": "longitude"}


def _onto(lon: Any) -> Any:
    return (lon + 180.0) % 360.0 - 180.0


def on_axes(
    ocean: Ocean,
    lon: Any = None,
    lat: Any = None,
    *,
    names: tuple[str, str] = ("lat", "lon"),
    dims: tuple[str, str] | None = None,
    bare: bool = False,
    two: bool = False,
) -> Placed:
    """Return a grid of rows and columns."""
    own = axes(ocean)
    lon, lat = own[0] if lon is None else lon, own[1] if lat is None else lat
    dims = dims or names
    north, east = (dict(NORTH), dict(EAST)) if not bare else ({"units": "degrees_north"}, {"units": "degrees_east"})
    rows, columns = np.meshgrid(lat, lon, indexing="ij")
    if two:
        coordinates = {names[0]: (dims, rows, north), names[1]: (dims, columns, east)}
    else:
        coordinates = {names[0]: (dims[0], lat, north), names[1]: (dims[1], lon, east)}
    attributes = {"": {"coordinates": f"{names[0]} {names[1]}"}} if dims != names else {}
    return Placed(xr.Dataset(coords=coordinates), lambda name: (dims, columns, rows), attributes=attributes)


def turned_positions(ocean: Ocean, degrees: float, i: Any, j: Any, step: float = 20.0) -> tuple[Any, Any]:
    """Return positions of a grid of cells of `step` km that is turned, at fractional columns i and rows j."""
    a = np.deg2rad(degrees)
    x, y = np.asarray(i) * step, np.asarray(j) * step
    lat = ocean.lat + (x * np.sin(a) + y * np.cos(a)) / DEGREE
    lon = ocean.lon + (x * np.cos(a) - y * np.sin(a)) / (DEGREE * np.cos(np.deg2rad(lat)))
    return lon, lat


def direction(position: Callable[[Any, Any], tuple[Any, Any]], i: Any, j: Any) -> Any:
    """Return the direction in which columns rise, radians counter-clockwise from east."""
    west, east = position(i - 0.5, j), position(i + 0.5, j)
    across = ((east[0] - west[0] + 180.0) % 360.0 - 180.0) * np.cos(np.deg2rad(0.5 * (west[1] + east[1])))
    return np.arctan2(east[1] - west[1], across)


def curved(
    ocean: Ocean,
    degrees: float,
    *,
    along: bool = False,
    names: tuple[str, str] = ("latitude", "longitude"),
    transposed: bool = False,
) -> Placed:
    """Return a turned grid with positions in two dimensions."""
    i, j = np.meshgrid(np.arange(-10.0, 11.0), np.arange(-10.0, 11.0))
    lon, lat = turned_positions(ocean, degrees, i, j)
    dims = ("nj", "ni")
    coordinates = xr.Dataset(coords={names[0]: (dims, lat, dict(NORTH)), names[1]: (dims, _onto(lon), dict(EAST))})
    attributes: dict[str, dict[str, Any]] = {"": {"coordinates": f"{names[0]} {names[1]}"}}
    if along:
        attributes |= {
            "uo": {"standard_name": "sea_water_x_velocity"}, "vo": {"standard_name": "sea_water_y_velocity"}, "ua": {"standard_name": "x_wind"}, "va": {"standard_name": "y_wind"},
        }  # fmt: skip
    angle = direction(lambda p, q: turned_positions(ocean, degrees, p, q), i, j)
    return Placed(
        coordinates, lambda name: (dims, lon, lat), (lambda name: angle) if along else None, attributes=attributes
    )


def projected(
    ocean: Ocean,
    mapping: dict[str, Any],
    *,
    km: bool = False,
    stated: bool = True,
    positions: bool = False,
    truth: str = "",
    mapping_name: str = "crs",
    flip: bool = False,
    along: bool = False,
) -> Placed:
    """Return a grid on the axes of a map projection.

    Parameters
    ----------
    mapping : dict
        Attributes of the grid mapping as the file has them.
    truth : str
        PROJ text of what is meant; by default what the mapping says.
    """
    from pyproj import CRS, Transformer

    crs = CRS.from_user_input(truth) if truth else CRS.from_cf(mapping)
    to_map = Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True)
    x0, y0 = to_map.transform(ocean.lon, ocean.lat)
    step = 20e3
    x, y = (np.round(c / step) * step + step * np.arange(-10, 11) for c in (x0, y0))
    y = y[::-1] if flip else y
    columns, rows = np.meshgrid(x, y)
    lon, lat = to_map.transform(columns, rows, direction="INVERSE")
    unit, factor = ("km", 1e-3) if km else ("m", 1.0)
    dims = ("y", "x")
    coordinates = xr.Dataset(
        coords={
            "x": ("x", x * factor, {"units": unit, "standard_name": "projection_x_coordinate"}),
            "y": ("y", y * factor, {"units": unit, "standard_name": "projection_y_coordinate"}),
        }
    )
    attributes: dict[str, dict[str, Any]] = {"": {"grid_mapping": mapping_name} if stated else {}}
    if positions:
        coordinates = coordinates.assign_coords(lat=(dims, lat, dict(NORTH)), lon=(dims, lon, dict(EAST)))
        attributes[""]["coordinates"] = "lat lon"
    coordinates[mapping_name] = ((), np.int32(0), dict(mapping))
    angle = None
    if along:
        east = to_map.transform(columns + 500.0, rows, direction="INVERSE")
        west = to_map.transform(columns - 500.0, rows, direction="INVERSE")
        across = ((east[0] - west[0] + 180.0) % 360.0 - 180.0) * np.cos(np.deg2rad(lat))
        turn = np.arctan2(east[1] - west[1], across)
        angle = lambda name: turn  # noqa: E731
        attributes |= {
            "uo": {"standard_name": "sea_water_x_velocity"}, "vo": {"standard_name": "sea_water_y_velocity"}, "ua": {"standard_name": "x_wind"}, "va": {"standard_name": "y_wind"},
        }  # fmt: skip
    return Placed(coordinates, lambda name: (dims, lon, lat), angle, attributes=attributes)


def polar(ocean: Ocean, **radius: Any) -> dict[str, Any]:
    """Return a polar stereographic mapping of the hemisphere of the berg."""
    pole = 90.0 if ocean.lat > 0 else -90.0
    return {
        "grid_mapping_name": "polar_stereographic", "latitude_of_projection_origin": pole, "straight_vertical_longitude_from_pole": 0.0,
        "standard_parallel": pole / 90.0 * 71.0, "false_easting": 0.0, "false_northing": 0.0, **radius,
    }  # fmt: skip


WGS = {"semi_major_axis": 6378137.0, "inverse_flattening": 298.257223563}


def _spherical(ocean: Ocean) -> str:
    pole = 90 if ocean.lat > 0 else -90
    return f"+proj=stere +lat_0={pole} +lat_ts={pole / 90 * 71:g} +lon_0=0 +R=6371000 +units=m"


def rotated(ocean: Ocean, *, along: bool = False, positions: bool = True) -> Placed:
    """Return a grid on a rotated pole."""
    from pyproj import CRS, Transformer

    mapping = {
        "grid_mapping_name": "rotated_latitude_longitude",
        "grid_north_pole_latitude": 30.0,
        "grid_north_pole_longitude": _onto(ocean.lon + 140.0),
    }
    crs = CRS.from_cf({**mapping, "earth_radius": 6371229.0})
    to_map = Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True)
    x0, y0 = to_map.transform(ocean.lon, ocean.lat)
    x, y = (np.round(c / 0.2) * 0.2 + 0.2 * np.arange(-10, 11) for c in (x0, y0))
    columns, rows = np.meshgrid(x, y)
    lon, lat = to_map.transform(columns, rows, direction="INVERSE")
    dims = ("rlat", "rlon")
    coordinates = xr.Dataset(
        coords={
            "rlon": ("rlon", x, {"units": "degrees", "standard_name": "grid_longitude"}),
            "rlat": ("rlat", y, {"units": "degrees", "standard_name": "grid_latitude"}),
        }
    )
    attributes: dict[str, dict[str, Any]] = {"": {"grid_mapping": "rotated_pole"}}
    if positions:
        coordinates = coordinates.assign_coords(lat=(dims, lat, dict(NORTH)), lon=(dims, lon, dict(EAST)))
        attributes[""]["coordinates"] = "lon lat"
    coordinates["rotated_pole"] = ((), np.int32(0), {**mapping, "earth_radius": 6371229.0})
    if not along:
        return Placed(coordinates, lambda name: (dims, lon, lat), attributes=attributes)
    east, west = (to_map.transform(columns + d, rows, direction="INVERSE") for d in (0.01, -0.01))
    turn = np.arctan2(east[1] - west[1], ((east[0] - west[0] + 180.0) % 360.0 - 180.0) * np.cos(np.deg2rad(lat)))
    attributes |= {
        "uo": {"standard_name": "sea_water_x_velocity"}, "vo": {"standard_name": "sea_water_y_velocity"}, "ua": {"standard_name": "grid_eastward_wind"}, "va": {"standard_name": "grid_northward_wind"},
    }  # fmt: skip
    return Placed(coordinates, lambda name: (dims, lon, lat), lambda name: turn, attributes=attributes)


def nemo(ocean: Ocean, *, degrees: float = 20.0, together: bool = False, levels: bool = False) -> Placed:
    """Return NEMO's grid: U and V on points of their own, in files of their own."""
    i, j = np.meshgrid(np.arange(-10.0, 11.0), np.arange(-10.0, 11.0))
    shift = {"uo": (0.5, 0.0), "vo": (0.0, 0.5), "ssh": (0.0, 0.0)}
    position = lambda p, q: turned_positions(ocean, degrees, p, q)  # noqa: E731
    placed = {n: position(i + a, j + b) for n, (a, b) in shift.items()}
    turn = {n: direction(position, i + a, j + b) for n, (a, b) in shift.items()}
    dims = ("y", "x")
    rename = {"uo": "vozocrtx", "vo": "vomecrty", "ssh": "sossheig"}
    names = {"uo": "U", "vo": "V", "ssh": "T"}
    coords: dict[str, Any] = {}
    attributes: dict[str, dict[str, Any]] = {}
    for name, letter in names.items():
        lat, lon = f"nav_lat_{letter}", f"nav_lon_{letter}"
        coords[lat], coords[lon] = (dims, placed[name][1], dict(NORTH)), (dims, _onto(placed[name][0]), dict(EAST))
        attributes[name] = {"coordinates": f"{lat} {lon}"}
    attributes["uo"]["standard_name"], attributes["vo"]["standard_name"] = (
        "sea_water_x_velocity",
        "sea_water_y_velocity",
    )
    grid = Placed(
        xr.Dataset(coords=coords),
        lambda name: (dims, *placed[name]),
        lambda name: turn[name],
        rename,
        attributes,
        time="time_counter",
    )
    grid.apart = [
        (
            f"grid_{letter}",
            [rename[n]],
            [f"nav_{c}_{other}" for other in "UVT" if other != letter for c in ("lat", "lon")],
        )
        for n, letter in names.items()
    ]
    return grid


def roms(
    ocean: Ocean,
    *,
    degrees: float = 25.0,
    surface: bool = False,
    straight: bool = False,
    apart: bool = False,
    unstaggered: bool = False,
) -> Placed:
    """Return ROMS's grid: rho, u and v points, levels that follow the sea floor."""
    ni, nj = 22, 20
    i, j = np.meshgrid(np.arange(ni) - ni / 2, np.arange(nj) - nj / 2)
    position = lambda p, q: turned_positions(ocean, degrees, p, q)  # noqa: E731
    if straight:
        position = lambda p, q: (ocean.lon + 0.2 * np.asarray(p), ocean.lat + 0.2 * np.asarray(q))  # noqa: E731
    at = {"rho": (i, j), "u": (i[:, 1:] - 0.5, j[:, 1:]), "v": (i[1:], j[1:] - 0.5)}
    placed = {k: position(*v) for k, v in at.items()}
    turn = {k: direction(position, *v) for k, v in at.items()}
    dims = {k: (f"eta_{k}", f"xi_{k}") for k in at}
    coords: dict[str, Any] = {}
    for k, (lon, lat) in placed.items():
        coords[f"lon_{k}"] = (dims[k], _onto(lon), {"units": "degree_east", "standard_name": "longitude"})
        coords[f"lat_{k}"] = (dims[k], lat, {"units": "degree_north", "standard_name": "latitude"})
    made = xr.Dataset(coords=coords)
    made["angle"] = (dims["rho"], turn["rho"], {"units": "radians", "long_name": "angle between XI-axis and EAST"})
    made["h"] = (
        dims["rho"],
        1500.0 + 0.0 * placed["rho"][0],
        {"units": "meter", "long_name": "bathymetry at RHO-points"},
    )
    made["mask_rho"] = (dims["rho"], np.ones_like(placed["rho"][0]), {"long_name": "mask on RHO-points"})
    own = {"uo": "u", "vo": "v", "ssh": "rho"}
    attributes = {
        n: {"coordinates": f"lon_{k} lat_{k}" + ("" if surface or n == "ssh" else " s_rho") + " ocean_time"}
        for n, k in own.items()
    }
    attributes["uo"]["standard_name"], attributes["vo"]["standard_name"] = (
        "sea_water_x_velocity",
        "sea_water_y_velocity",
    )
    grid = Placed(
        made,
        lambda name: (dims[own[name]], *placed[own[name]]),
        lambda name: turn[own[name]],
        {"uo": "u", "vo": "v", "ssh": "zeta"},
        attributes,
        time="ocean_time",
    )
    if not surface:
        count = 12
        s = (np.arange(count) + 0.5) / count - 1.0
        grid.level, grid.levels = "s_rho", s
        made = made.assign_coords(
            s_rho=(
                "s_rho",
                s,
                {
                    "standard_name": "ocean_s_coordinate_g2",
                    "positive": "up",
                    "formula_terms": "s: s_rho C: Cs_r eta: zeta depth: h depth_c: hc",
                },
            )
        )
        made["Cs_r"] = ("s_rho", s, {"long_name": "S-coordinate stretching curves at RHO-points"})
        made["hc"], made["Vtransform"] = ((), 20.0, {"units": "meter"}), ((), np.int32(2), {})
        grid.coordinates = made
    if apart:
        positions = [n for n in made.variables if n.startswith(("lat_", "lon_")) or n in ("angle", "h", "mask_rho")]
        grid.beside = [("domain_grd.nc", made[positions])]
        grid.coordinates = made.drop_vars(positions)
    return grid


def arakawa(ocean: Ocean, model: str) -> Placed:
    """Return a C-grid on straight axes, as MITgcm and MOM6 write it."""
    lon, lat = axes(ocean)
    half = 0.125
    x, y, xc, yc = {"mitgcm": ("XG", "YG", "XC", "YC"), "mom6": ("xq", "yq", "xh", "yh")}[model]
    sign = -1.0 if model == "mitgcm" else 1.0
    lines = {xc: lon, yc: lat, x: lon + sign * half, y: lat + sign * half}
    coords = {n: (n, _onto(v) if n in (x, xc) else v, dict(EAST if n in (x, xc) else NORTH)) for n, v in lines.items()}
    if model == "mom6":
        for n, letter in ((x, "X"), (xc, "X"), (y, "Y"), (yc, "Y")):
            coords[n] = (n, coords[n][1], {"units": coords[n][2]["units"], "axis": letter})
    own = {"uo": (yc, x), "vo": (y, xc), "ssh": (yc, xc)}
    rename = {"uo": "UVEL", "vo": "VVEL", "ssh": "ETAN"} if model == "mitgcm" else {"ssh": "zos"}
    attributes = {"uo": {"standard_name": "sea_water_x_velocity"}, "vo": {"standard_name": "sea_water_y_velocity"}}

    def points(name: str) -> Points:
        rows, columns = np.meshgrid(lines[own[name][0]], lines[own[name][1]], indexing="ij")
        return own[name], columns, rows

    return Placed(xr.Dataset(coords=coords), points, rename=rename, attributes=attributes)


def scattered(
    ocean: Ocean, *, dim: str = "node", names: tuple[str, str] = ("lat", "lon"), ugrid: bool = False
) -> Placed:
    """Return points without rows and columns."""
    rng = np.random.default_rng(3)
    lon, lat = np.meshgrid(np.arange(-2.0, 2.01, 0.1), np.arange(-2.0, 2.01, 0.1))
    lon = ocean.lon + (lon + rng.uniform(-0.03, 0.03, lon.shape)).ravel()
    lat = ocean.lat + (lat + rng.uniform(-0.03, 0.03, lat.shape)).ravel()
    coordinates = xr.Dataset(coords={names[0]: (dim, lat, dict(NORTH)), names[1]: (dim, _onto(lon), dict(EAST))})
    attributes: dict[str, dict[str, Any]] = {"": {"coordinates": f"{names[0]} {names[1]}"}}
    if ugrid:
        attributes[""] |= {"mesh": "mesh", "location": "node"}
        coordinates["mesh"] = (
            (),
            np.int32(0),
            {
                "cf_role": "mesh_topology",
                "topology_dimension": 2,
                "node_coordinates": f"{names[1]} {names[0]}",
                "face_node_connectivity": "face_nodes",
            },
        )
        from scipy.spatial import Delaunay

        coordinates["face_nodes"] = (
            ("face", "three"),
            Delaunay(np.stack([lon, lat], 1)).simplices.astype("i4"),
            {"cf_role": "face_node_connectivity", "start_index": 0},
        )
    return Placed(coordinates, lambda name: ((dim,), lon, lat), attributes=attributes, rank=1)


def fvcom(ocean: Ocean) -> Placed:
    """Return FVCOM's triangles: sea level on nodes, currents on elements."""
    from scipy.spatial import Delaunay

    nodes = scattered(ocean)
    _, lon, lat = nodes.points("ssh")
    faces = Delaunay(np.stack([lon, lat], 1)).simplices
    lonc, latc = lon[faces].mean(1), lat[faces].mean(1)
    made = xr.Dataset()
    for name, dim, values, told in (
        ("lon", "node", _onto(lon), EAST),
        ("lat", "node", lat, NORTH),
        ("lonc", "nele", _onto(lonc), EAST),
        ("latc", "nele", latc, NORTH),
    ):
        made[name] = (dim, values, dict(told))
    made["nv"] = (("three", "nele"), (faces.T + 1).astype("i4"), {"long_name": "nodes surrounding element"})
    made["h"] = ("node", 1500.0 + 0.0 * lon, {"units": "m", "coordinates": "lon lat"})
    made = made.set_coords(["lon", "lat", "lonc", "latc"])
    attributes = {
        "uo": {"coordinates": "lonc latc"},
        "vo": {"coordinates": "lonc latc"},
        "ssh": {"coordinates": "lon lat"},
    }
    return Placed(
        made, lambda name: (("nele",), lonc, latc) if name in ("uo", "vo") else (("node",), lon, lat),
        rename={"uo": "u", "vo": "v", "ssh": "zeta"}, attributes=attributes, rank=1,
    )  # fmt: skip


def _choices() -> dict[str, Grid]:
    """Return all grids by name."""
    from fuzz.layouts import FINE, Choice

    def descending(o: Ocean) -> Placed:
        lon, lat = axes(o)
        return on_axes(o, lon, lat[::-1])

    def uneven(o: Ocean) -> Placed:
        lon, lat = axes(o)
        return on_axes(o, lon, o.lat + np.sinh(np.linspace(-1.2, 1.2, lat.size)) * 1.4)

    def straight2(o: Ocean) -> Placed:
        return on_axes(o, names=("nav_latitude", "nav_longitude"), dims=("j", "i"), two=True)

    def lambert(o: Ocean) -> Placed:
        return projected(
            o,
            {
                "grid_mapping_name": "lambert_azimuthal_equal_area",
                "latitude_of_projection_origin": 90.0 if o.lat > 0 else -90.0,
                "longitude_of_projection_origin": 0.0,
                "false_easting": 0.0,
                "false_northing": 0.0,
                **WGS,
            },
            km=True,
            along=False,
        )

    def conic(o: Ocean) -> Placed:
        mapping = {
            "grid_mapping_name": "lambert_conformal_conic",
            "standard_parallel": o.lat + 3.0,
            "longitude_of_central_meridian": _onto(o.lon + 5.0),
            "latitude_of_projection_origin": o.lat + 3.0,
            "earth_radius": 6371229.0,
        }
        return projected(o, mapping, along=True)

    def mercator(o: Ocean) -> Placed:
        mapping = {
            "grid_mapping_name": "mercator",
            "longitude_of_projection_origin": _onto(o.lon - 5.0),
            "standard_parallel": 0.0,
            "false_easting": 0.0,
            "false_northing": 0.0,
            **WGS,
        }
        return projected(o, mapping)

    def wkt(o: Ocean) -> Placed:
        from pyproj import CRS

        return projected(
            o,
            {"crs_wkt": CRS.from_cf(polar(o, **WGS)).to_wkt(), "spatial_ref": CRS.from_cf(polar(o, **WGS)).to_wkt()},
            mapping_name="spatial_ref",
        )

    def proj4(o: Ocean) -> Placed:
        return projected(o, {**polar(o), "proj4": _spherical(o)}, truth=_spherical(o), positions=True)

    axes_own = ("names",)
    model = ("level", "names", "order", "split", "member", "packing", "speed")
    c_grid = {"own": model, "wind": False}
    projection = Choice(("projection|sphere|radius|ellipsoid",), ("projection|sphere|radius|ellipsoid|positions",))
    return {
        "axes": Grid(on_axes, FINE), "axes, north first": Grid(descending, FINE), "axes, uneven": Grid(uneven, FINE), "latitude(y), longitude(x)": Grid(lambda o: on_axes(o, names=("latitude", "longitude"), dims=("y", "x")), FINE),
        "axes without standard names": Grid(lambda o: on_axes(o, bare=True, names=("latitude", "longitude")), FINE), "straight, two-dimensional": Grid(straight2, FINE), "turned": Grid(lambda o: curved(o, 30.0), FINE, slack=1.5),
        "turned, along the grid": Grid(lambda o: curved(o, -25.0, along=True), FINE, axes_own, slack=2.0), "turned by 100": Grid(lambda o: curved(o, 100.0, along=True, names=("gphi", "glam")), FINE, axes_own, slack=2.0),
        "rotated pole": Grid(rotated, FINE, slack=1.5), "rotated pole, along, axes alone": Grid(lambda o: rotated(o, along=True, positions=False), FINE, axes_own, slack=2.0),
        "polar stereographic": Grid(lambda o: projected(o, polar(o, **WGS)), FINE, slack=1.5), "polar stereographic in km, upside down": Grid(lambda o: projected(o, polar(o, **WGS), km=True, flip=True), FINE, slack=1.5),
        "polar stereographic, sphere": Grid(lambda o: projected(o, polar(o, earth_radius=6371000.0)), FINE, slack=1.5), "polar stereographic, along": Grid(lambda o: projected(o, polar(o, **WGS), along=True, positions=True), FINE, axes_own, slack=2.0),
        "no radius, positions of a sphere": Grid(lambda o: projected(o, polar(o), positions=True, truth=_spherical(o)), projection, slack=1.5), "no radius, proj4 of a sphere": Grid(proj4, projection, slack=1.5),
        "mapping not named": Grid(lambda o: projected(o, polar(o, **WGS), stated=False, positions=True), FINE, slack=1.5), "WKT": Grid(wkt, FINE, slack=1.5), "azimuthal in km": Grid(lambert, FINE, slack=1.5), "conic, along": Grid(conic, FINE, axes_own, slack=2.0),
        "mercator": Grid(mercator, FINE, slack=1.5), "NEMO": Grid(nemo, FINE, **c_grid, slack=2.0), "NEMO, straight": Grid(lambda o: nemo(o, degrees=0.0), FINE, **c_grid, slack=2.0),
        "ROMS": Grid(roms, FINE, **c_grid, slack=2.0), "ROMS, surface": Grid(lambda o: roms(o, surface=True), FINE, **c_grid, slack=2.0), "ROMS, straight axes": Grid(lambda o: roms(o, straight=True), FINE, **c_grid, slack=2.0),
        "ROMS, straight axes, surface": Grid(lambda o: roms(o, straight=True, surface=True), FINE, **c_grid, slack=2.0), "ROMS, grid apart": Grid(lambda o: roms(o, apart=True), Choice((), ("domain_grd",)), (*model, "form"), wind=False, slack=2.0),
        "MITgcm": Grid(lambda o: arakawa(o, "mitgcm"), FINE, **c_grid), "MOM6": Grid(lambda o: arakawa(o, "mom6"), FINE, **c_grid),
        "scattered points": Grid(scattered, FINE, ("order", "level", "packing"), slopes=False, slack=4.0), "mesh of triangles (UGRID)": Grid(lambda o: scattered(o, dim="nodes", ugrid=True), FINE, ("order", "level", "packing"), slopes=False, slack=4.0),
        "FVCOM": Grid(fvcom, FINE, **c_grid, slopes=False, slack=4.0),
    }  # fmt: skip


class _Grids(dict[str, Grid]):
    """The table of grids, made when it is first asked for: its choices stand in the module of the layouts."""

    def _made(self) -> None:
        if not len(self.keys()):
            self.update(_choices())

    def __getitem__(self, name: str) -> Grid:
        self._made()
        return super().__getitem__(name)

    def __iter__(self) -> Any:
        self._made()
        return super().__iter__()


GRIDS: dict[str, Grid] = _Grids()
"""All grids by name."""
