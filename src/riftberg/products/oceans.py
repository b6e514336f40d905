"""Products of ocean, sea ice and sea floor: OSCAR, GlobCurrent, DUACS, GLORYS12, ORAS5, OSI SAF; GEBCO, IBCSO, SRTM15+."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

from riftberg.constants import SECONDS_PER_DAY
from riftberg.products.dates import in_mid_month
from riftberg.products.place import projected
from riftberg.products.product import DAY, Evidence, Heading, Product, Source, noted, stamp_noon, without_single
from riftberg.products.quantities import QUANTITIES, labelled
from riftberg.products.records import usual_interval

# OSCAR surface currents, mean over the top 30 m: third-degree v1 (retired), v2.0 (quarter degree, daily).
#
# Checked against published headers (no real file was to be had).

_OSCAR_CURRENTS = (Source("uo", ("u",), "m s-1"), Source("vo", ("v",), "m s-1"))


def _is_oscar_v1(heading: Heading) -> bool:
    return {"u", "um"} <= heading.names and "depth" in heading.sizes and "year" in heading.names


def _is_oscar_v2(heading: Heading) -> bool:
    return {"u", "v", "ug"} <= heading.names and {"latitude", "longitude"} <= set(heading.sizes)


def _drop_year_axis(ds: xr.Dataset) -> xr.Dataset:
    """Drop the decimal year, a second name of the time axis with a dimension of its own, and the single level at 15 m.

    OSCAR is a mean over the top 30 m.
    """
    ds = ds.drop_vars("year", errors="ignore")
    return without_single(ds, "depth", "year", remedy="OSCAR v1 has one level at 15 m; give the original file")


def _by_coordinate(ds: xr.Dataset) -> xr.Dataset:
    """Use the coordinate variables ``lat`` and ``lon`` as axes: dimensions are called otherwise, in changing order."""
    pairs = {"latitude": "lat", "longitude": "lon"}
    return ds.swap_dims({dim: name for dim, name in pairs.items() if name in ds.variables and dim in ds.dims})


_OSCAR_NOTES = (
    "total current (geostrophic + Ekman + thermal wind), mean over the top 30 m",
    "not accurate within about 100 km of coasts",
)

OSCAR_V1 = Product(
    name="oscar-v1",
    title="OSCAR third-degree surface currents, 5-day (v1, retired)",
    citation="ESR 2009, OSCAR third deg., PO.DAAC, doi:10.5067/OSCAR-03D01; Bonjean and Lagerloef 2002",
    evidence="layout",
    matches=_is_oscar_v1,
    sources=_OSCAR_CURRENTS,
    reshape=_drop_year_axis,
    longest_step=6 * SECONDS_PER_DAY,
    notes=(*_OSCAR_NOTES, "one record about every five days", "longitudes 20..420: the repeated part is dropped"),
)
OSCAR_V2 = Product(
    name="oscar-v2",
    title="OSCAR L4 surface currents v2.0, 0.25 degree daily (final, interim or nrt)",
    citation="Dohan, K. 2021, OSCAR L4 v2.0, PO.DAAC, doi:10.5067/OSCAR-25F20",
    evidence="layout",
    matches=_is_oscar_v2,
    sources=_OSCAR_CURRENTS,
    reshape=_by_coordinate,
    finish=stamp_noon,
    averaging=DAY,
    notes=(*_OSCAR_NOTES, "daily means: stamps put at 12:00 UTC", "file order is (time, longitude, latitude)"),
)


# GlobCurrent surface currents, whose files say ``Unit`` where CF says ``units`` (checked against a real file).


_GLOBCURRENT_EAST = "eastward_eulerian_current_velocity"
_GLOBCURRENT_NORTH = "northward_eulerian_current_velocity"


def _is_globcurrent(heading: Heading) -> bool:
    return _GLOBCURRENT_EAST in heading.names or _GLOBCURRENT_NORTH in heading.names


def _with_cf_units(ds: xr.Dataset) -> xr.Dataset:
    """Call ``Unit`` by its CF name, so that xarray reads the dates; degrees get a direction."""
    degrees = {"lon": "degrees_east", "lat": "degrees_north"}
    for name, variable in ds.variables.items():
        unit = variable.attrs.pop("Unit", None)
        if unit is not None and "units" not in variable.attrs:
            variable.attrs["units"] = degrees.get(str(name), unit)
    return ds


GLOBCURRENT = Product(
    name="globcurrent",
    title="GlobCurrent L4 surface current",
    citation="Rio, Mulet and Picot 2014, Geophys. Res. Lett. 41, 8918, doi:10.1002/2014GL061773",
    evidence="sample",
    matches=_is_globcurrent,
    sources=(Source("uo", (_GLOBCURRENT_EAST,), "m s-1"), Source("vo", (_GLOBCURRENT_NORTH,), "m s-1")),
    mend=_with_cf_units,
    variants=(("15 m files", "documentation"),),
    notes=("geostrophic + Ekman current; the hs files are at the surface, those of 15 m at that depth",),
)


# DUACS level-4 sea level (SSALTO/DUACS, Copernicus Marine): absolute dynamic topography, 1/4 and 1/8 degree.
#
# Checked against a real global 1/4 degree file (longitudes 0.125..359.875); the 1/8 degree layout (-179.9375..179.9375)
# follows the documentation. ``adt`` is taken as sea surface height: the slope force needs the height above the geoid, and
# ``sla`` (the anomaly from a long-time mean) lacks the mean currents.


def _is_duacs(heading: Heading) -> bool:
    words = "duacs" in heading.says("title", "summary", "source", "comment") or "allsat" in heading.says("title")
    return "adt" in heading.names or ("sla" in heading.names and words)


_DUACS_VARIANTS: tuple[tuple[str, Evidence], ...] = (("1/8 degree", "documentation"),)

DUACS = Product(
    name="duacs",
    title="SSALTO/DUACS level-4 absolute dynamic topography, daily",
    citation="E.U. Copernicus Marine Service, SEALEVEL_GLO_PHY_L4_MY_008_047, doi:10.48670/moi-00148",
    evidence="sample",
    matches=_is_duacs,
    sources=(Source("ssh", ("adt",), "m"),),
    variants=_DUACS_VARIANTS,
    left_out=("ugos", "vgos"),
    notes=(
        "ssh is the absolute dynamic topography adt (height above the geoid), not the anomaly sla",
        "one map a day, stamped 00:00 UTC",
        "geostrophic velocities (ugos, vgos) are not taken as currents: they lack the wind-driven part",
    ),
)

DUACS_GEOSTROPHIC = Product(
    name="duacs-geostrophic",
    title="SSALTO/DUACS level-4 sea level with its geostrophic currents, daily",
    citation=DUACS.citation,
    evidence="sample",
    matches=lambda heading: False,
    sources=(*DUACS.sources, Source("uo", ("ugos",), "m s-1"), Source("vo", ("vgos",), "m s-1")),
    variants=_DUACS_VARIANTS,
    cautions=("uo, vo are geostrophic only: they lack the wind-driven part",),
    notes=DUACS.notes[:2],
)


# GLORYS12V1 ocean reanalysis (Copernicus Marine), 1/12 degree with depth: native packed files and toolbox subsets.
#
# Checked against a real native file (int16 packed, hours since 1950). Toolbox subsets (float32, other epochs, sometimes a
# scalar time) follow the documentation. The sample has a depth axis of five levels; files have up to fifty.


_GLORYS_NAMES = {"uo", "vo", "zos", "siconc", "sithick", "usi", "vsi", "thetao", "so"}


def _is_glorys(heading: Heading) -> bool:
    words = heading.says("title", "source", "institution", "references", "product", "id", "credit")
    mercator = any(
        word in words for word in ("mercator", "glorys", "global_multiyear_phy", "global_analysisforecast_phy")
    )
    return mercator and bool(_GLORYS_NAMES & heading.names)


_FORECASTS = ("analysisforecast", "analysis_forecast", "_anfc", "001_024", "psy4", "forecast", "near real time", "nrt")
_PAST = ("multiyear", "reanalysis", "001_030", "glorys")


def _is_mercator_forecast(heading: Heading) -> bool:
    words = heading.says("title", "source", "product", "id", "comment", "field_type") + heading.source.lower()
    return (
        _is_glorys(heading) and any(word in words for word in _FORECASTS) and not any(word in words for word in _PAST)
    )


def _with_dimension_of_time(ds: xr.Dataset) -> xr.Dataset:
    """Give a scalar time a dimension."""
    if "time" in ds.variables and "time" not in ds.dims:
        ds = ds.set_coords("time").expand_dims("time")
    return ds


def _in_mid_day_or_month(ds: xr.Dataset) -> xr.Dataset:
    """Stamp daily means at noon and monthly means in the middle of the month, whatever the file wrote.

    Which of them these are stands in the file, or else follows from the time between the records of all files.
    """
    if "time" not in ds.dims:
        return ds
    stated = float(ds.attrs.get("stated_seconds", 0.0))
    step = min((s for s in (stated, usual_interval(ds["time"].values)) if s > 0.0), default=0.0)
    if step == 0.0:
        doubt = (
            "one record, and nothing in the file tells whether it is the mean of a day or of a month: taken as a day"
        )
        return noted(stamp_noon(ds), doubt=doubt)
    if step < SECONDS_PER_DAY:  # hourly products are instants at their stamp
        return ds.assign_attrs(averaging_seconds=0.0)
    if step < 20 * SECONDS_PER_DAY:
        return stamp_noon(ds)
    return in_mid_month(ds)


GLORYS = Product(
    name="glorys",
    title="GLORYS12V1 global ocean reanalysis, 1/12 degree",
    citation="E.U. Copernicus Marine Service, GLOBAL_MULTIYEAR_PHY_001_030, doi:10.48670/moi-00021",
    evidence="sample",
    matches=_is_glorys,
    sources=(
        Source("uo", ("uo",), "m s-1"),
        Source("vo", ("vo",), "m s-1"),
        Source("ssh", ("zos",), "m"),
        Source("sst", ("thetao",), "degrees_C"),
        Source("sss", ("so",), "1e-3"),
        Source("ice_fraction", ("siconc",), "1", "documentation"),
        Source("ice_thickness", ("sithick",), "m", "documentation"),
        Source("ui", ("usi",), "m s-1", "documentation"),
        Source("vi", ("vsi",), "m s-1", "documentation"),
    ),
    reshape=_with_dimension_of_time,
    variants=(("toolbox subset", "documentation"), ("monthly means", "documentation")),
    settle=_in_mid_day_or_month,
    averaging=DAY,
    notes=(
        "daily means: stamps put at 12:00 UTC (native files write 12:00, toolbox subsets 00:00); monthly means in mid-month",
        "currents keep their levels: runs take the mean over the draft of each element",
        "sst is the potential temperature of the first level",
    ),
)
MERCATOR_FORECAST = replace(
    GLORYS,
    name="mercator-forecast",
    title="Mercator global ocean analysis and forecast, 1/12 degree (near real time, no reanalysis)",
    citation="E.U. Copernicus Marine Service, GLOBAL_ANALYSISFORECAST_PHY_001_024, doi:10.48670/moi-00016",
    evidence="documentation",
    matches=_is_mercator_forecast,
    kind_matters=False,
)


# ORAS5 ocean reanalysis (ECMWF, Climate Data Store), monthly, on the quarter-degree NEMO grid.
#
# Written from documentation only: no native file was to be had. Native files have dims ``(time_counter, [deptht,] y,
# x)`` with two-dimensional ``nav_lat`` and ``nav_lon``. South of about 20 N that grid is a Mercator grid, so that a
# window there gets ordinary axes (see `riftberg.products.mesh`). The monthly ORAS5 fields of the A68a
# experiment are another layout, see `riftberg.products.models`.


_ORAS5_NAMES = {
    "vozocrte",
    "vomecrtn",
    "vozocrtx",
    "vomecrty",
    "sossheig",
    "sozotaux",
    "sometauy",
    "ileadfra",
    "sosstsst",
}
_ORAS5_AXES = {"nav_lat": "lat", "nav_lon": "lon", "time_counter": "time"}
_ORAS5_LEVELS = ("deptht", "depthu", "depthv")


def _is_oras5(heading: Heading) -> bool:
    """Tell ORAS5 from other output of NEMO by heading or name: its records are months, where others may have hours."""
    words = heading.says("title", "source", "summary", "product", "id", "references") + heading.source.lower()
    is_named = "oras5" in words or "oras-5" in words or "_monthly_highres_" in words
    return is_named and bool(_ORAS5_NAMES & heading.names) and {"nav_lat", "nav_lon"} <= heading.names


def _with_nemo_axes_named(ds: xr.Dataset) -> xr.Dataset:
    """Name the axes, and keep the two-dimensional positions as coordinates."""
    names = {**_ORAS5_AXES, **{name: "depth" for name in _ORAS5_LEVELS}}
    ds = ds.rename({old: new for old, new in names.items() if old in ds.variables or old in ds.dims})
    return ds.set_coords(["lat", "lon"])


ORAS5 = Product(
    name="oras5",
    title="ORAS5 global ocean reanalysis, monthly, 1/4 degree",
    citation="Zuo et al. 2019, Ocean Sci. 15, 779; Copernicus Climate Change Service, doi:10.24381/cds.67e8eeb7",
    evidence="documentation",
    matches=_is_oras5,
    sources=(
        Source("uo", ("vozocrte", "vozocrtx"), "m s-1"),
        Source("vo", ("vomecrtn", "vomecrty"), "m s-1"),
        Source("ssh", ("sossheig",), "m"),
        Source("sst", ("sosstsst",), "degC"),
        Source("taux", ("sozotaux",), "Pa"),
        Source("tauy", ("sometauy",), "Pa"),
        Source("ice_fraction", ("ileadfra",), "1"),
    ),
    reshape=_with_nemo_axes_named,
    finish=lambda ds: in_mid_month(ds) if "time" in ds.dims else ds,
    averaging=np.timedelta64(int(30.4 * 86400), "s"),
    notes=(
        "monthly means: stamps put in mid-month; they smooth the eddies that break bergs",
        "vozocrte, vomecrtn are rotated to true east and north; vozocrtx, vomecrty follow the grid, "
        "which is the same south of 20 N but half a cell aside",
    ),
)


# OSI SAF sea ice concentration: 10 km polar stereographic (daily) and 25 km EASE2 (climate data record).
#
# The polar stereographic layout was checked against a published header; EASE2 follows the documentation. The projection
# is read from the file's grid mapping; where that is missing the standard one of the product is taken, and either is
# checked against the file's two-dimensional latitudes and longitudes.


_STEREOGRAPHIC = "+proj=stere +a=6378273 +b=6356889.44891 +lat_0={pole} +lat_ts={true} +lon_0={lon}"
_EASE2 = "+proj=laea +ellps=WGS84 +datum=WGS84 +lat_0={pole} +lon_0=0"


def _is_osisaf(heading: Heading) -> bool:
    return "ice_conc" in heading.names and {"xc", "yc"} <= set(heading.sizes)


def _standard_projection(ds: xr.Dataset) -> str:
    """Return the standard projection of the product for the hemisphere of the file."""
    south = float(ds["lat"].mean()) < 0 if "lat" in ds.variables else True
    spacing = abs(float(ds["xc"][1] - ds["xc"][0]))
    if "Lambert_Azimuthal_Grid" in ds.variables or spacing > 20.0:
        return _EASE2.format(pole=-90 if south else 90)
    return _STEREOGRAPHIC.format(pole=-90 if south else 90, true=-70 if south else 70, lon=0 if south else -45)


OSISAF = Product(
    name="osisaf-ice",
    title="OSI SAF sea ice concentration",
    citation="OSI SAF global sea ice concentration OSI-401 / OSI-450-a, EUMETSAT Ocean and Sea Ice SAF, https://osi-saf.eumetsat.int",
    evidence="layout",
    matches=_is_osisaf,
    sources=(Source("ice_fraction", ("ice_conc",), "%"),),
    reshape=lambda ds: projected(ds, _standard_projection(ds)),
    variants=(("EASE2, 25 km", "documentation"),),
    finish=stamp_noon,
    averaging=DAY,
    notes=("daily, stamped 12:00 UTC", "percent in the file, fraction here"),
)


_FLOOR_NOTES = ("elevations are turned into depths, positive down; land is missing (NaN)",)


def depth_from_elevation(ds: xr.Dataset) -> xr.Dataset:
    """Return the dataset with ``depth_below_surface`` made from the elevation that it holds under that name so far.

    ``ds``: canonical dataset in which ``depth_below_surface`` still holds the elevation (m, positive up).
    """
    if "depth_below_surface" not in ds.data_vars:
        return ds
    elevation = ds["depth_below_surface"]
    depth = labelled((-elevation).where(elevation < 0.0), QUANTITIES["depth_below_surface"])
    depth.attrs |= {key: elevation.attrs[key] for key in ("original_name", "original_units") if key in elevation.attrs}
    return ds.assign(depth_below_surface=depth)


# GEBCO grids (15 arc seconds): elevation of the sea floor or of the ice surface.
#
# Checked against a real subset of GEBCO_2021. Cells are pixel centred. Of the two versions the one with the elevation
# under the ice ("sub ice topo") is right south of ice fronts; elsewhere they agree.


def _is_gebco(heading: Heading) -> bool:
    return "elevation" in heading.names and "gebco" in heading.says("title", "summary", "source", "id", "history")


GEBCO = Product(
    name="gebco",
    title="GEBCO grid, 15 arc seconds",
    citation="GEBCO Compilation Group, GEBCO Grid, https://www.gebco.net (public domain; state the year of the grid)",
    evidence="sample",
    matches=_is_gebco,
    sources=(Source("depth_below_surface", ("elevation",), "m"),),
    finish=depth_from_elevation,
    notes=_FLOOR_NOTES,
)


# IBCSO v2 sea floor south of 50 S: 500 m polar stereographic (EPSG:9354), or the WGS84 longitude-latitude version.
#
# Written from documentation only: no file was to be had.


_IBCSO_MAP = "EPSG:9354"


def _is_ibcso(heading: Heading) -> bool:
    words = heading.says("title", "summary", "source", "history", "project", "references", "comment", "id")
    return "z" in heading.names and (
        "ibcso" in words or ({"x", "y"} <= set(heading.sizes) and "ibcso" in heading.source.lower())
    )


IBCSO = Product(
    name="ibcso",
    title="International Bathymetric Chart of the Southern Ocean, version 2",
    citation="Dorschel et al. 2022, Scientific Data 9, 275; doi:10.1594/PANGAEA.937574 (CC-BY 4.0)",
    evidence="documentation",
    matches=_is_ibcso,
    sources=(Source("depth_below_surface", ("z",), "m"),),
    reshape=lambda ds: projected(ds, _IBCSO_MAP) if {"x", "y"} <= set(ds.dims) else ds,
    finish=depth_from_elevation,
    notes=(*_FLOOR_NOTES, "polar stereographic, true scale at 65 S"),
)


# SRTM15+ and ETOPO5 style elevation grids (GMT): ``z(lat, lon)`` or ``topo(topo_lat, topo_lon)``.
#
# The SRTM15+ style was checked against a real (coarsened) file; the ETOPO5 style follows the documentation.


def _is_srtm15(heading: Heading) -> bool:
    gmt = "GMT_version" in heading.attributes or any(
        word in heading.says("title", "history") for word in ("srtm15", "etopo")
    )
    return ("topo" in heading.names and "topo_lat" in heading.names) or (
        "z" in heading.names and gmt and "lat" in heading.sizes
    )


def _with_etopo_axes_named(ds: xr.Dataset) -> xr.Dataset:
    """Name the axes of the ETOPO5 style."""
    return ds.rename({old: new for old, new in (("topo_lat", "lat"), ("topo_lon", "lon")) if old in ds.variables})


SRTM15 = Product(
    name="srtm15",
    title="SRTM15+ or ETOPO5 style elevation grid",
    citation="Tozer et al. 2019, Earth and Space Science 6, 1847, doi:10.1029/2019EA000658",
    evidence="sample",
    matches=_is_srtm15,
    sources=(Source("depth_below_surface", ("z", "topo"), "m"),),
    reshape=_with_etopo_axes_named,
    variants=(("ETOPO5 style", "documentation"),),
    finish=depth_from_elevation,
    notes=_FLOOR_NOTES,
)
