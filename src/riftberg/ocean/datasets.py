"""Forcing from datasets: each product on its own points and at its own times, sampled at the elements themselves.

A field is interpolated once in time and once in space (`riftberg.ocean.product_records`), whatever the grid of its product.
"""

from __future__ import annotations

import copy
import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import date, datetime
from pathlib import PurePath
from typing import Any, Final, NamedTuple, TypedDict

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.config.values import check_names, duration, given, moment, number, required
from riftberg.constants import EARTH_RADIUS_KID
from riftberg.errors import ForcingError
from riftberg.ocean import formulas, needs
from riftberg.ocean.balance import (
    SeaLevel,
    balancing_slope,
    checked_wind_layer,
    decided,
    layer_text,
    wind_drift,
)
from riftberg.ocean.forcing import Forcing as BaseForcing
from riftberg.ocean.grid import Grid
from riftberg.ocean.mean_currents import MeanCurrents, mean_currents
from riftberg.ocean.product_records import (
    NO_CORNERS,
    NO_RINGS,
    RINGS,
    Blend,
    ProductRecords,
    Wanted,
    add_shore_drift,
    fill_slopes,
    fill_vorticity,
    values_at,
)
from riftberg.ocean.series import Series
from riftberg.parameters import Ice
from riftberg.physics.floating import draft_of
from riftberg.products.mesh import Mesh, NodeMesh, Places, build_mesh
from riftberg.products.place import nominal_axes
from riftberg.products.quantities import QUANTITIES
from riftberg.products.reading import COORDINATES
from riftberg.products.records import WAVES, check_pairs, doubtful_units, have_waves, in_python, named, named_remarks
from riftberg.products.registry import in_memory
from riftberg.state import Elements, Floats, Ints

_LOG = logging.getLogger(__name__)

WITHOUT_WIND_DRIFT: Final = ("ugos", "uo_mean_over_berg_depth")
"""Variables of currents without levels that hold no drift of the uppermost metres."""

NOT_VALUES: Final = ("vorticity", "slope_x", "slope_y")
"""Variables that follow from how a field changes from place to place."""

MOST_SHOWN: Final = 20_000
"""Points of a sea level that are looked at for gaps; of more some are left out."""

NO_NAMES: Final = ("cf", "")
"""Products that are known by their conventions alone, which do not say whose fields they are."""


class Part(NamedTuple):
    """One product: its points, its records, and the fields (keys of `needs.BY_FIELD`) that it gives."""

    mesh: Mesh
    records: ProductRecords
    gives: tuple[str, ...]

    @property
    def source(self) -> str:
        """Name of the product."""
        attributes = self.records.ds.attrs
        return str(attributes.get("product") or attributes.get("source", "data"))

    def original(self, name: str) -> str:
        """Name of a field in its file."""
        field = self.records.ds.get(name)
        return str(name if field is None else field.attrs.get("original_name", name))

    @property
    def shown(self) -> str:
        """Name for titles: the product, or the files where nothing but their conventions is known."""
        if self.source not in NO_NAMES:
            return self.source
        source = str(self.records.ds.attrs.get("source", "")) or self.source
        return ", ".join(dict.fromkeys(PurePath(name).name for name in source.split(", ")))


def describe_idle_fields(datasets: Sequence[xr.Dataset]) -> list[str]:
    """Return in words which fields act on nothing because another one is not given."""
    sentences = [
        f"{named(ds)}: {', '.join(waves)} not used, for waves need height and direction on one grid; they follow from the wind"
        for ds in datasets
        if (waves := [name for name in WAVES if name in ds.data_vars]) and not have_waves(ds)
    ]
    holders = {str(name): ds for ds in datasets for name in ds.data_vars}
    of_ice = (needs.ICE_CONCENTRATION, needs.ICE_THICKNESS, needs.ICE_VELOCITY)
    ice = [need.fields[0] for need in of_ice if need.fields[0] in holders]
    lacking = [
        f"{need.quantity.removesuffix(' of sea ice')} ({need.fields[0]})"
        for need in of_ice
        if need.fields[0] not in holders
    ]
    if ice and lacking:
        words = " and ".join(lacking)
        sentences.append(f"{named(holders[ice[0]])}: sea ice without its {words} exerts no force in the default scheme")
    return sentences


def product_part(ds: xr.Dataset, start: datetime, *, keel: float = np.inf) -> Part:
    """Return a canonical dataset on its own points and at its own times.

    ``keel``: deepest draft (m).
    """
    return Part(build_mesh(ds), records := ProductRecords(ds, start, keel=keel), provided_fields(records))


def averaged_product(product: Part, pair: tuple[str, str] = ("uo", "vo")) -> Part:
    """Return a product with its vectors as means over 25 hours, taken twice: the sea surface balances such currents."""
    return Part(product.mesh, mean_currents(product.records, pair), ())


def balance_remarks(balance: Part, wind_layer: float) -> list[str]:
    """Return remarks on a slope that balances these currents: at the ends of their records, near the surface."""
    remarks = []
    if isinstance(balance.records, MeanCurrents):
        remarks.append(
            "the current is its mean over 25 hours, taken twice: in the first and last 25 hours of the records, of those that "
            "are there"
        )
    if not balance.records.has_levels and balance.original("uo") not in WITHOUT_WIND_DRIFT and not wind_layer:
        remarks.append(
            f"{named(balance.records.ds) or balance.source} gives currents near the surface, whose wind drift has no slope: in "
            "ORAS5 this errs by 0.04 m/s, with means over the draft by 0.012 m/s"
        )
    return remarks


def provided_fields(records: ProductRecords) -> tuple[str, ...]:
    """Return the fields (keys of `needs.BY_FIELD`) that records hold."""
    return tuple(
        name for name in needs.BY_FIELD if name in records.names and (name not in WAVES or "wave_x" in records.names)
    )


class DatasetOptions(TypedDict, total=False):
    """Options of a forcing from datasets, as `DatasetForcing` and `DatasetForcing.from_xarray` document them."""

    ice_density: float
    draft: float
    coastal_drift: float
    grid: Grid | None
    notices: Sequence[str]
    max_gap: Any
    hold: Any
    sea_level: SeaLevel
    wind_layer: float
    names: Mapping[str, str] | None


class DatasetForcing(BaseForcing):
    """Several products as one forcing; implements `riftberg.ocean.forcing.Forcing`.

    Parameters
    ----------
    parts : sequence of Part
        Each field is provided by one part.
    ice_density : float
        kg m-3; gives the draft of an element, over which currents on levels are averaged.
    draft : float
        Draft (m) that such currents are shown for on maps.
    coastal_drift : float
        Current away from land (m s-1) that is added in cells of the currents with land at a corner.
    grid : Grid, optional
        Grid that stops elements at land; the fields do not need one.
    balance : Part, optional
        Currents (means over 25 hours, twice) with which the slope of the sea surface is in geostrophic balance, instead of a
        sea level.
    assumes_slope : bool
        Whether that balance was not asked for, but is taken because no sea level is given.
    notices : sequence of str
        What should be known of it before a run.
    wind_layer : float, optional
        Share of the wind (at 10 m) that is taken out of currents at the surface, 45 degrees to its left in the south and to its
        right in the north, and out of the slope that balances them: the drift of the uppermost metres, which no keel feels
        (`riftberg.ocean.balance.wind_drift`). 0.005 made hindcasts of giant bergs better; 0 leaves currents as they are.

    Raises
    ------
    ForcingError
        If two parts give the same field, or ``wind_layer`` is asked of currents on levels or without a wind.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        *,
        ice_density: float = 850.0,
        draft: float = 165.0,
        coastal_drift: float = 0.0,
        grid: Grid | None = None,
        balance: Part | None = None,
        assumes_slope: bool = False,
        notices: Sequence[str] = (),
        wind_layer: float = 0.0,
    ) -> None:
        expected = "a list of parts, or take DatasetForcing.from_xarray"
        required(parts, (list, tuple), expected, where="parts", kind=ForcingError)
        self.parts, self.grid, self.notices = tuple(parts), grid, tuple(notices)
        self._balance, self.assumes_slope = balance, assumes_slope
        self._gaps: float | None = None  # Share of the sea level that is unknown, at start and end of a run
        self._wind_layer = checked_wind_layer(wind_layer)
        self._slow_wind = self._find_slow_wind() if self._wind_layer else None
        self.slope_remarks = () if balance is None else tuple(balance_remarks(balance, self._wind_layer))
        if self._wind_layer:
            self.notices = (*self.notices, layer_text(self._wind_layer))
        self.coastal_drift = number(coastal_drift, "m s-1", where="coastal_drift", kind=ForcingError)
        self.draft = number(draft, "m", where="draft", kind=ForcingError)
        self._density: float = given(ice_density, Ice, "density", where="ice_density", kind=ForcingError)
        provided = [name for product in self.parts for name in product.gives]
        for name in provided:
            if provided.count(name) > 1:
                raise ForcingError(f"{name} comes from two products", where="forcing", remedy="Name one of them")
        if balance is not None:
            provided.append("ssh")
            if self.slope_remarks and not assumes_slope:  # else a model says it, with a figure for its berg
                self.notices = (*self.notices, f"sea_level: geostrophic: {'; '.join(self.slope_remarks)}")
        self.provides = frozenset(variable for name in provided for variable in needs.BY_FIELD[name].variables)
        self._sampled = tuple(map(_sampled_fields, self.parts))
        sampled = {variable for variables, _ in self._sampled for variable in variables}
        self._missing = tuple(
            v
            for need in needs.NEEDS
            for v in need.variables
            if v not in sampled | self.provides.intersection(NOT_VALUES)
        )
        # A pack that only seems to stand still would hold bergs.
        self.ice_drift_known = not {"ice_thickness", "ice_fraction"} & self.provides or "ui" in self.provides
        self.title = ", ".join(dict.fromkeys(product.shown for product in self.parts))

    def _find_slow_wind(self) -> Part | None:
        """Return the wind whose layer is taken out of the slope too; refuse currents that hold no such layer."""
        wind, currents = self._find_product("ua"), self._find_product("uo")
        if currents is None or wind is None or "ua" not in wind.records.names:
            raise ForcingError(
                "a share of the wind is taken out of the current, and there is no wind (ua, va) or no current",
                where="wind_layer", remedy="Add data of the wind at 10 m, or leave wind_layer out",
            )  # fmt: skip
        if currents.records.has_levels or currents.original("uo") in WITHOUT_WIND_DRIFT:
            raise ForcingError(
                f"currents of {currents.source} are no currents at the surface: they hold no layer of the wind's own",
                where="wind_layer", remedy="Leave it out: it is for products with one level within 15 m of the surface",
            )  # fmt: skip
        if self._balance is None or self._balance.records.has_levels:
            return None
        return averaged_product(wind, ("ua", "va"))

    def without_assumed_slope(self) -> DatasetForcing:
        """Return the same forcing without a slope of the sea surface that was not asked for: a sum has another one."""
        if not self.assumes_slope:
            return self
        other = copy.copy(self)
        other._balance, other.assumes_slope, other.slope_remarks = None, False, ()
        other._missing = (*self._missing, *needs.SEA_LEVEL.variables)
        return other

    @classmethod
    def from_xarray(
        cls,
        datasets: xr.Dataset | Sequence[xr.Dataset],
        start: datetime | date | str | np.datetime64 | None = None,
        *,
        max_gap: Any = None,
        hold: Any = None,
        sea_level: SeaLevel = "auto",
        names: Mapping[str, str] | None = None,
        **options: Any,
    ) -> DatasetForcing:
        """Return the forcing that datasets in memory, or opened by xarray, give.

        Parameters
        ----------
        datasets : xarray.Dataset or sequence of them
            Currents and, where available, sea level, wind, sea ice and sea floor; with CF standard names and units, each on
            its own grid and at its own times.
        start : date, optional
            Date of the model's time 0 (UTC), as `riftberg.Model` takes it; by default the first at which all of them have
            records. A model with this forcing starts then.
        max_gap : float or str, optional
            Longest gap between records that is interpolated across (s, or text with a unit: ``"3 d"``), else 2.5 intervals of
            the records.
        hold : float or str, optional
            How long the first and last record are held (s), else half the time that a mean stands for.
        sea_level : str, optional
            ``"files"``: that of the datasets. ``"geostrophic"``: at each place the slope that balances the current there (f/g
            times the current, turned by a right angle): its mean over the draft and 25 hours, taken twice. ``"none"``: no slope.
            ``"auto"``: that of the datasets if one gives it, else the slope that balances the current, with a notice.
        names : mapping, optional
            Variables by the quantity or coordinate that they hold, where the datasets do not say it: ``{"uo": "u", "vo": "v"}``.
        **options
            As for the class.

        Raises
        ------
        ForcingError
            If a dataset does not name its fields and positions, or two give the same field.

        Examples
        --------
        >>> import numpy as np, xarray as xr
        >>> axes = {"lat": [-58.0, -56.0, -54.0], "lon": [-40.0, -37.0, -34.0]}
        >>> current = xr.Dataset(coords={name: (name, values, {"units": f"degrees_{way}"}) for (name, values), way
        ...                              in zip(axes.items(), ("north", "east"))})
        >>> for name, way in (("uo", "eastward"), ("vo", "northward")):
        ...     attributes = {"standard_name": f"{way}_sea_water_velocity", "units": "m s-1"}
        ...     current[name] = ("lat", "lon"), np.full((3, 3), 0.1), attributes
        >>> forcing = DatasetForcing.from_xarray(current, "2020-12-09 13:00")
        >>> forcing.currents(np.array([-37.0]), np.array([-56.5]), 0.0)
        (array([0.1]), array([0.1]))
        """
        check_names(options, DatasetOptions)
        listed = as_dataset_list(datasets)
        begin = None if start is None else moment(start, where="start")
        limits = {"max_gap_seconds": (max_gap, "max_gap"), "hold_seconds": (hold, "hold")}
        rules = {
            key: duration(value, where=name, kind=ForcingError)
            for key, (value, name) in limits.items()
            if value is not None
        }
        prepared = [ds.assign_attrs(in_python=1, **rules) for ds in in_memory(listed, names)]
        slope = decided(
            sea_level, {str(name) for ds in prepared for name in ds.data_vars}, where="sea_level",
            level_wanted="Add a dataset of it, or leave sea_level away: then the slope balances the current",
            currents_wanted="Add a dataset of currents, or leave sea_level away",
        )  # fmt: skip
        if slope != "files":
            prepared = [rest for ds in prepared if (rest := ds.drop_vars("ssh", errors="ignore")).data_vars]
        check_pairs(prepared)
        if begin is None:  # the first date at which all have begun
            first = [ds["time"].values.min() for ds in prepared if "time" in ds and ds["time"].size]
            if not first:
                raise ForcingError(
                    "no dataset has dates", where="Forcing.from_xarray",
                    remedy="Give start, the date of the model's time 0",
                )  # fmt: skip
            begin = moment(max(first), where="start")
        for ds in prepared:
            if "unread" in ds.attrs:
                _LOG.warning("%s: %s", named(ds), ds.attrs["unread"])
        notices = [*named_remarks(prepared), *describe_idle_fields(prepared), *doubtful_units(prepared)]
        products = [product_part(ds, begin) for ds in prepared]
        if slope == "geostrophic":
            currents = next(product for product in products if "uo" in product.gives)
            options = {"balance": averaged_product(currents), "assumes_slope": sea_level == "auto", **options}
        forcing = cls(products, **{"notices": notices, **options})
        forcing.start = begin
        return forcing

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements at ``time`` (s since the start of the run)."""
        if elements.lon.size == 0:
            return
        e, lon, lat = elements.environment, elements.lon, elements.lat
        draft = np.asarray(draft_of(elements.body.thickness, self._density))
        for name in self._missing:
            getattr(e, name)[:] = needs.DEFAULTS.get(name, 0.0)
        level: Floats | float = 0.0
        balanced: Places | None = None
        for (product, located), (variables, wanted) in zip(self._placed(elements), self._sampled, strict=True):
            blend, points = product.records.blend(time), product.mesh.points
            corners = np.empty((2, 4, lon.size)) if "uo" in product.gives else NO_CORNERS
            rows = values_at(blend, located, points.columns, wanted, draft=draft, corners=corners)
            values = dict(zip(variables, rows, strict=True))
            level = values.pop("ssh", level)
            for variable, value in values.items():
                getattr(e, variable)[:] = value
            if isinstance(product.mesh, NodeMesh):
                _fill_on_nodes(product, product.mesh, elements, time)
            else:
                if "uo" in product.gives:
                    fill_vorticity(corners, located, points, lon, lat, e.vorticity)
                    if self.coastal_drift > 0.0:
                        add_shore_drift(corners[0], located, points, lon, lat, self.coastal_drift, e.uo, e.vo)
                if "ssh" in product.gives:
                    number = product.records.names.index("ssh")
                    fill_slopes(blend, number, located, points, lon, lat, e.slope_x, e.slope_y)
            if self._balance is not None and product.mesh is self._balance.mesh:
                balanced = located
        if "depth" in self.provides:  # products give it below mean sea level
            e.depth[:] += level
        if self._wind_layer:
            east, north = wind_drift(lat, e.ua, e.va, self._wind_layer)
            e.uo[:] -= east
            e.vo[:] -= north
        if self._balance is not None:
            # Fill the slope of the sea surface that is in geostrophic balance with a current; 0 where this is unknown.
            u, v = _vector(self._balance, ("uo", "vo"), balanced or self._balance.mesh.locate(lon, lat), time, draft)
            if self._slow_wind is not None:
                ua, va = _vector(self._slow_wind, ("ua", "va"), self._slow_wind.mesh.locate(lon, lat), time, draft)
                east, north = wind_drift(lat, ua, va, self._wind_layer)
                u, v = u - east, v - north
            e.slope_x[:], e.slope_y[:] = balancing_slope(lat, u, v)

    def _placed(self, elements: Elements) -> Iterator[tuple[Part, Places]]:
        """Give each product with the cells of its points that hold the elements.

        Raises
        ------
        ForcingError
            If an element lies outside of a product.
        """
        for product in self.parts:
            located = product.mesh.locate(elements.lon, elements.lat)
            outside = np.flatnonzero(located.row < 0)
            if outside.size:
                raise ForcingError(
                    f"{_named(elements, int(outside[0]))} is outside of the data of {', '.join(product.gives)}"
                    f"{nominal_axes(product.records.ds)}",
                    where=product.source,
                    remedy="Give data that cover it, or fewer days"
                    if in_python(product.records.ds)
                    else "Take a larger box (forcing.longitude, forcing.latitude), files that cover it, or fewer days",
                )
            yield product, located

    def check(self, elements: Elements, start: float, end: float) -> None:
        """Raise `ForcingError` unless every part covers these elements from ``start`` to ``end`` (s).

        Refused are data without currents, elements outside of the data or on land, keels below the levels, times that no
        record covers, and values that cannot be.
        """
        if self._find_product("uo") is None:
            raise ForcingError(
                f"nothing gives currents, only {', '.join(name for product in self.parts for name in product.gives)}",
                where=self.title, remedy="Add data of them, or say what they are: + Forcing.uniform(current=(0.0, 0.0))",
            )  # fmt: skip
        self.check_fields(elements, start, end)

    def check_fields(self, elements: Elements, start: float, end: float) -> None:
        """Raise `ForcingError` unless every part covers these elements; currents may come from elsewhere."""
        row = int(elements.thickness.argmax())
        draft = draft_of(float(elements.thickness[row]), self._density)
        for product in (*self.parts, *(product for product in (self._balance, self._slow_wind) if product is not None)):
            product.records.reach(draft)
        if self._balance is not None and self._balance.records is not getattr(
            self._find_product("uo"), "records", None
        ):
            self._balance.records.check(start, end)  # first, for it reads the currents once and more of them
        if self._slow_wind is not None:
            self._slow_wind.records.check(start, end)
        for product, located in self._placed(elements):
            product.records.check(start, end)
            for name in product.gives:
                for component in needs.BY_FIELD[name].fields:
                    if component in (*needs.EXPECTED, *needs.DEPTH.fields):
                        self._check_known(product, component, located, elements, start)
            if "uo" in product.gives and product.records.has_levels:
                _check_keel(product, draft, f"element {elements.id[row]}")
        self._gaps = max(
            self._gap_share(time) for time in (end, start)
        )  # the start last: a run begins with its records

    def _check_known(self, product: Part, name: str, located: Places, elements: Elements, time: float) -> None:
        """Refuse elements where a field is unknown, or the sea floor above the water."""
        values = _values(product, name, located, time)
        dry = values <= 0.0 if name == "depth_below_surface" else np.isnan(values)
        if dry.any():
            row = int(np.flatnonzero(dry)[0])
            fault, remedy = f"is on land: no {name} is known there", "Move the berg, or give data that know it"
            if values[row] < 0.0:
                fault = (
                    f"is on land: no {name} but {values[row]:.4g} m is known there, or these are heights, positive up"
                )
                remedy = f"Move the berg; of heights change the sign, or write positive: up on {product.original(name)}"
            raise ForcingError(
                f"{_named(elements, row)} {fault}", where=named(product.records.ds) or product.source, remedy=remedy
            )

    def depth_spacing(self) -> float | None:
        """Return the usual distance (m) between neighbouring points of the chart of the sea floor; None where there is none."""
        product = self._find_product("depth_below_surface")
        if product is None:
            return None
        if isinstance(product.mesh, NodeMesh):
            return float(np.radians(np.median(product.mesh.spacing())) * EARTH_RADIUS_KID)
        lon, lat = product.mesh.points.lon, product.mesh.points.lat
        east = (np.diff(lon, axis=0) + 180.0) % 360.0 - 180.0
        distances = np.hypot(east * np.cos(np.radians(lat[1:])), np.diff(lat, axis=0))
        return float(np.radians(np.nanmedian(distances)) * EARTH_RADIUS_KID)

    @property
    def level_gaps(self) -> str:
        """Gaps of a given sea level at the start, and at the end of a run that was checked; empty if there are none."""
        unknown_share = self._gaps
        if unknown_share is None:
            try:
                unknown_share = self._gap_share(0.0)
            except ForcingError:  # whatever it is, the check before the first step says it
                return ""
        product = self._find_product("ssh")
        if product is None or unknown_share == 0.0:
            return ""
        return (
            f"{named(product.records.ds) or product.source}: the sea level is unknown at "
            f"{max(100.0 * unknown_share, 0.1):.2g} % of the points whose current is known; there its slope is 0. "
            "With sea_level: geostrophic the slope balances the current everywhere"
        )

    def _gap_share(self, time: float) -> float:
        """Return the share of points with water all around at which the sea level is unknown."""
        level, current = self._find_product("ssh"), self._find_product("uo")
        if level is None or current is None or isinstance(level.mesh, NodeMesh) or isinstance(current.mesh, NodeMesh):
            return 0.0
        blend = level.records.field("ssh", time)
        unknown = np.isnan(blend.before[0]) & np.isnan(blend.after[0])
        every = math.ceil(math.sqrt(unknown.size / MOST_SHOWN))
        at = level.mesh.points
        lon, lat, unknown = (_flat(values[::every, ::every]) for values in (at.lon, at.lat, unknown))
        wet = np.where(np.isnan(current.records.field("uo", time).before[:1]), 0.0, 1.0)
        places, columns = current.mesh.locate(lon, lat), current.mesh.points.columns
        water_weights = values_at(Blend.of(wet, wet), places, columns, rings=NO_RINGS)[0]
        water_around = water_weights > 1.0 - 1e-9
        return float((water_around & (unknown > 0.0)).sum() / max(1, water_around.sum()))

    def _find_product(self, name: str) -> Part | None:
        return next((product for product in self.parts if name in product.gives), None)

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the ocean current (m s-1) at arrays of points, for maps; NaN outside and on land."""
        product = self._find_product("uo")
        if product is None:  # the currents of a sum come from its formulas
            return np.zeros(np.shape(lon)), np.zeros(np.shape(lon))
        x, y = _flat(lon), _flat(lat)
        draft = (
            np.full(x.size, min(self.draft, float(product.records.limits[-1]))) if product.records.has_levels else None
        )
        located = product.mesh.locate(x, y)
        u, v = (_values(product, name, located, time, draft, NO_RINGS) for name in ("uo", "vo"))
        return u.reshape(np.shape(lon)), v.reshape(np.shape(lon))

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) below mean sea level at arrays of points; NaN outside and on land."""
        product = self._find_product("depth_below_surface")
        if product is None:
            return np.full(np.shape(lon), needs.DEPTH.default)
        located = product.mesh.locate(_flat(lon), _flat(lat))
        depth = _values(product, "depth_below_surface", located, 0.0, None, NO_RINGS)
        return np.where(depth > 0.0, depth, np.nan).reshape(np.shape(lon))

    def sea_level(self, lon: Floats, lat: Floats, time: float) -> Floats:
        """Return the sea level (m) above the datum of the depth at arrays of points; 0 where no product gives both."""
        product = self._find_product("ssh")
        if product is None or self._find_product("depth_below_surface") is None:
            return np.zeros(np.shape(lon))
        located = product.mesh.locate(_flat(lon), _flat(lat))
        return _values(product, "ssh", located, time, unknown=0.0).reshape(np.shape(lon))

    def land(self, lon: Floats, lat: Floats) -> NDArray[np.bool_]:
        """Return which points of the products are land: no current is known there, or no depth above 0."""
        x, y, is_land = _flat(lon), _flat(lat), np.zeros(np.size(lon), bool)
        for name in ("uo", "depth_below_surface"):
            if (product := self._find_product(name)) is not None:
                values = self.currents(x, y, 0.0)[0] if name == "uo" else self.depth(x, y)
                is_land |= np.isnan(values) & (product.mesh.locate(x, y).row >= 0)
        return is_land.reshape(np.shape(lon))

    @property
    def has_own_level_datum(self) -> bool:
        """Whether the sea level of a product counts in the depth of a chart."""
        return self._find_product("ssh") is not None and self._find_product("depth_below_surface") is not None

    def components(self) -> tuple[Part, ...]:
        """Return the products."""
        return self.parts

    def describe(self) -> str:
        """Return the fields of each product, its points and its dates, in words."""
        texts = [_described(product) for product in self.parts]
        drift = [f"coastal drift {self.coastal_drift:g} m/s"] if self.coastal_drift > 0.0 else []
        if self._balance is not None:
            over = ["the draft"] * self._balance.records.has_levels
            over += ["25 hours, taken twice"] * isinstance(self._balance.records, MeanCurrents)
            mean = f"the mean current over {' and '.join(over)}" if over else "the current"
            why = ", for no sea level is given" if self.assumes_slope else ""
            texts.append(f"slope of the sea surface: in geostrophic balance with {mean}{why}")
        grid = [f"elements are stopped by the land of a grid of {self.grid.describe()}"] if self.grid else []
        text = "\n".join(["each product on its own points", *texts, *drift, *grid, *self.notices])
        return text.replace("\n", "\n    ")


def _sampled_fields(product: Part) -> tuple[tuple[str, ...], Wanted]:
    """Return the variables of elements that are values of a product (and ``ssh``), currents first, and how they are asked for.

    Currents push over the whole draft; temperature and salinity at the keel have variables of their own.
    """
    records = product.records
    rows = []
    for name, need in needs.BY_FIELD.items():
        if name not in product.gives:
            continue
        if need is needs.WAVES:
            fields = {variable: variable for variable in need.variables if variable in records.names}
        else:
            variables = need.fields if need is needs.SEA_LEVEL else need.variables
            fields = dict(zip(variables, need.fields, strict=False))
        rows += [(variable, field, name == "uo", 0.0) for variable, field in fields.items()]
        if name in needs.OVER_DRAFT and name in records.levelled:
            rows.append((needs.OVER_DRAFT[name], name, True, np.nan))
    wanted = Wanted.of(*((records.names.index(field), over_draft, unknown) for _, field, over_draft, unknown in rows))
    return tuple(variable for variable, *_ in rows), wanted


def _values(
    product: Part, name: str, located: Places, time: float, draft: Floats | None = None, rings: Ints = RINGS,
    unknown: float = np.nan,
) -> Floats:  # fmt: skip
    """Return a field at places."""
    wanted = Wanted.of((0, draft is not None, unknown))
    blend, columns = product.records.field(name, time), product.mesh.points.columns
    values: Floats = values_at(blend, located, columns, wanted, draft=draft, rings=rings)[0]
    return values


def _vector(product: Part, pair: tuple[str, str], located: Places, time: float, draft: Floats) -> Floats:
    """Return both components of a vector over the draft at places, 0 where it is unknown."""
    wanted = Wanted.of(*((product.records.names.index(name), True, 0.0) for name in pair))
    return values_at(product.records.blend(time), located, product.mesh.points.columns, wanted, draft=draft)


def _check_keel(product: Part, draft: float, element: str) -> None:
    """Refuse a draft (m) below the levels of the currents."""
    deepest = float(product.records.limits[-1])
    if draft > deepest * (1.0 + 1e-9):
        raise ForcingError(
            f"{element} has a draft of {draft:.0f} m, the levels of the currents end at {deepest:.0f} m",
            where=product.source,
            remedy="Give deeper levels, or the currents of the surface alone: ds.isel(depth=0)"
            if in_python(product.records.ds)
            else "Fetch deeper levels (--depth), or take the currents of the surface (forcing.currents: surface)",
        )


def _fill_on_nodes(product: Part, mesh: NodeMesh, elements: Elements, time: float) -> None:
    """Fill slope of the sea surface and vorticity from scattered points: those of planes through the points near by."""
    e, lon, lat = elements.environment, elements.lon, elements.lat
    if "uo" in product.gives:
        e.vorticity[:] = mesh.slopes(_nodes(product, "vo", time), lon, lat)[0]
        e.vorticity[:] -= mesh.slopes(_nodes(product, "uo", time), lon, lat)[1]
    if "ssh" in product.gives:
        e.slope_x[:], e.slope_y[:] = mesh.slopes(_nodes(product, "ssh", time), lon, lat)


def _nodes(product: Part, name: str, time: float) -> Floats:
    """Return a field at all points of an unstructured product (its uppermost level)."""
    blend = product.records.field(name, time)
    return np.asarray((1.0 - blend.weight) * blend.before[0, 0] + blend.weight * blend.after[0, 0])


def _flat(values: Floats) -> Floats:
    return np.ascontiguousarray(values, np.float64).ravel()


def _named(elements: Elements, row: int) -> str:
    return f"element {elements.id[row]} at ({elements.lon[row]:.6g}, {elements.lat[row]:.6g})"


def _described(product: Part) -> str:
    """Return the fields of a product in a few lines."""
    records, points = product.records, product.mesh.points
    dates = [str(date.astype("datetime64[m]")) for date in records.dates]
    when = f"{len(dates)} records from {dates[0]} to {dates[-1]}" if dates else "constant in time"
    rows, columns = points.lon.shape
    lines = [f"{', '.join(product.gives)}: gridded fields from {product.source}, {when}, {rows} x {columns} points"]
    if "uo" in product.gives and records.has_levels:
        lines.append(
            f"currents: mean over the draft of each element, from {records.limits.size - 1} layers to "
            f"{records.limits[-1]:g} m"
        )
    lines += [
        f"{name}: at the surface for waves, mean over the draft of each element for sides and base"
        for name in needs.OVER_DRAFT if name in product.gives and records.on_levels(name)
    ]  # fmt: skip
    return "\n".join(lines)


class Forcing(formulas.Formula):
    """Forcing by formula or from datasets; parts are combined with ``+``.

    A class of one's own needs one method, ``add_to(elements, time)``, which adds to the environment of the elements;
    ``currents`` and ``depth`` let maps show it.

    Examples
    --------
    >>> ocean = Forcing.uniform(current=(0.1, 0.0)) + Forcing.eddy((-37.0, -56.0), radius=40e3, speed=0.5)
    >>> ocean = ocean + Forcing.turning_wind(10.0) + Forcing.seamount((-36.0, -56.0), 400.0, 20e3, depth=500.0)
    >>> class Swirl(Forcing):
    ...     def add_to(self, elements, time):
    ...         elements.environment.uo[:] += 0.1 * np.cos(time / 43200.0)
    >>> ocean = ocean + Swirl()
    """

    uniform = formulas.Uniform
    eddy = formulas.Eddy
    jet = formulas.Jet
    shear = formulas.Shear
    front = formulas.Front
    tide = formulas.Tide
    seamount = formulas.Seamount
    slope = formulas.Slope
    turning_wind = formulas.TurningWind
    along = Series

    @staticmethod
    def from_dataset(dataset: xr.Dataset, start: datetime | None = None, **names_and_options: Any) -> DatasetForcing:
        """Return the forcing that one dataset gives whose variables are named here.

        Parameters
        ----------
        dataset : xarray.Dataset
            In memory, or opened by any engine of xarray (netCDF, Zarr, OPeNDAP, kerchunk, icechunk).
        start : datetime.datetime, optional
            Date of the model's time 0 (UTC), as for `from_xarray`.
        **names_and_options
            Variables by quantity or coordinate (``uo="u", vo="v", lon="x"``), for what the dataset does not say by
            itself, and options of `riftberg.DatasetForcing.from_xarray`.

        Examples
        --------
        >>> import numpy as np, xarray as xr
        >>> axes = {"lat": [-58.0, -56.0, -54.0], "lon": [-40.0, -37.0, -34.0]}
        >>> mine = xr.Dataset({name: (("lat", "lon"), np.full((3, 3), 0.1), {"units": "m/s"}) for name in "ab"}, axes)
        >>> forcing = Forcing.from_dataset(mine, "2020-12-09", uo="a", vo="b", sea_level="geostrophic")
        >>> forcing.currents(np.array([-37.0]), np.array([-56.5]), 0.0)
        (array([0.1]), array([0.1]))
        """
        required(
            dataset, xr.Dataset, "a dataset of xarray, such as xarray.open_dataset(file)", where="Forcing.from_dataset",
            kind=ForcingError,
        )  # fmt: skip
        field_names = (*QUANTITIES, *COORDINATES)
        check_names(names_and_options, DatasetOptions, *field_names)
        names = {key: name for key, name in names_and_options.items() if key in field_names}
        options = {key: value for key, value in names_and_options.items() if key not in names}
        return DatasetForcing.from_xarray(dataset, start, **{"names": names, **options})

    from_xarray = staticmethod(DatasetForcing.from_xarray)


def as_dataset_list(datasets: Any) -> list[xr.Dataset]:
    """Return one dataset or several as a list, or refuse anything else."""
    listed = list(datasets) if isinstance(datasets, list | tuple) else [datasets]
    for dataset in listed or [None]:
        required(
            dataset, xr.Dataset, "a dataset of xarray, or a list of them, such as xarray.open_dataset(file)",
            where="Forcing.from_xarray", kind=ForcingError,
        )  # fmt: skip
    return listed
