"""Forcing from datasets: each product on its own points and at its own times, sampled at the elements themselves.

A field is interpolated once in time and once in space (`riftberg.ocean.product_records`), whatever the grid of its product.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from datetime import date, datetime
from typing import Any, Final, TypedDict

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.config.values import check_names, given, moment, number, required
from riftberg.errors import ForcingError
from riftberg.ocean import formulas, needs
from riftberg.ocean.balance import checked_wind_layer, layer_text, wind_drift
from riftberg.ocean.balanced_slope import BalancedSlope, check_layer
from riftberg.ocean.coverage import (
    check_keel,
    check_known,
    flattened,
    level_gaps_text,
    locate_elements,
    unknown_level_share,
)
from riftberg.ocean.dataset_preparation import describe_idle_fields, first_common_date, prepare_datasets
from riftberg.ocean.element_sampler import ElementSampler
from riftberg.ocean.forcing import Forcing as BaseForcing
from riftberg.ocean.grid import Grid
from riftberg.ocean.needs import SeaLevel
from riftberg.ocean.product_part import Part, averaged_product, product_part
from riftberg.ocean.product_records import NO_RINGS
from riftberg.ocean.series import Series
from riftberg.parameters import Ice
from riftberg.physics.floating import draft_of
from riftberg.products.mesh import Places
from riftberg.products.quantities import QUANTITIES
from riftberg.products.reading import COORDINATES
from riftberg.products.records import doubtful_units, named_remarks
from riftberg.state import Elements, Floats

NOT_VALUES: Final = ("vorticity", "slope_x", "slope_y")
"""Variables that follow from how a field changes from place to place."""


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
        self.assumes_slope = assumes_slope
        self._gaps: float | None = None  # Share of the sea level that is unknown, at start and end of a run
        self._wind_layer, wind = checked_wind_layer(wind_layer), self._find_product("ua")
        if self._wind_layer:
            check_layer(wind, self._find_product("uo"))
            self.notices = (*self.notices, layer_text(self._wind_layer))
        self._slope = None if balance is None else BalancedSlope(balance, wind, self._wind_layer)
        self.slope_remarks = () if self._slope is None else self._slope.remarks
        self.coastal_drift = number(coastal_drift, "m s-1", where="coastal_drift", kind=ForcingError)
        self.draft = number(draft, "m", where="draft", kind=ForcingError)
        self._density: float = given(ice_density, Ice, "density", where="ice_density", kind=ForcingError)
        provided = [name for product in self.parts for name in product.gives]
        for name in provided:
            if provided.count(name) > 1:
                raise ForcingError(f"{name} comes from two products", where="forcing", remedy="Name one of them")
        if self._slope is not None:
            provided.append("ssh")
            if self.slope_remarks and not assumes_slope:  # else a model says it, with a figure for its berg
                self.notices = (*self.notices, f"sea_level: geostrophic: {'; '.join(self.slope_remarks)}")
        self.provides = frozenset(variable for name in provided for variable in needs.BY_FIELD[name].variables)
        self._samplers = tuple(ElementSampler(product, self.coastal_drift) for product in self.parts)
        sampled = {variable for sampler in self._samplers for variable in sampler.variables}
        self._missing = tuple(
            v
            for need in needs.NEEDS
            for v in need.variables
            if v not in sampled | self.provides.intersection(NOT_VALUES)
        )
        # A pack that only seems to stand still would hold bergs.
        self.ice_drift_known = not {"ice_thickness", "ice_fraction"} & self.provides or "ui" in self.provides
        self.title = ", ".join(dict.fromkeys(product.shown for product in self.parts))

    def without_assumed_slope(self) -> DatasetForcing:
        """Return the same forcing without a slope of the sea surface that was not asked for: a sum has another one."""
        if not self.assumes_slope:
            return self
        other = copy.copy(self)
        other._slope, other.assumes_slope, other.slope_remarks = None, False, ()
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
        begin = None if start is None else moment(start, where="start")
        prepared, slope = prepare_datasets(datasets, names, sea_level, max_gap=max_gap, hold=hold)
        begin = first_common_date(prepared) if begin is None else begin
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
        e = elements.environment
        draft = np.asarray(draft_of(elements.body.thickness, self._density))
        for name in self._missing:
            getattr(e, name)[:] = needs.DEFAULTS.get(name, 0.0)
        level: Floats | float = 0.0
        balanced: Places | None = None
        for sampler in self._samplers:
            located = locate_elements(sampler.product, elements)
            product_level = sampler.fill(elements, located, time, draft)
            level = product_level if "ssh" in sampler.variables else level
            if self._slope is not None and sampler.product.mesh is self._slope.currents.mesh:
                balanced = located
        if "depth" in self.provides:  # products give it below mean sea level
            e.depth[:] += level
        if self._wind_layer:
            east, north = wind_drift(elements.lat, e.ua, e.va, self._wind_layer)
            e.uo[:] -= east
            e.vo[:] -= north
        if self._slope is not None:
            self._slope.fill(elements, time, draft, balanced)

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
        for product in self.parts:
            product.records.reach(draft)
        if self._slope is not None:  # first, for it reads the currents once and more of them
            self._slope.reach(draft)
            self._slope.check(start, end, self._find_product("uo"))
        for product in self.parts:
            located = locate_elements(product, elements)
            product.records.check(start, end)
            for name in product.gives:
                for component in needs.BY_FIELD[name].fields:
                    if component in (*needs.EXPECTED, *needs.DEPTH.fields):
                        check_known(product, component, located, elements, start)
            if "uo" in product.gives and product.records.has_levels:
                check_keel(product, elements, row, draft)
        self._gaps = max(
            self._unknown_level_share(time) for time in (end, start)
        )  # the start last: a run begins with its records

    def depth_spacing(self) -> float | None:
        """Return the usual distance (m) between neighbouring points of the chart of the sea floor; None where there is none."""
        product = self._find_product("depth_below_surface")
        return None if product is None else product.spacing()

    @property
    def level_gaps(self) -> str:
        """Gaps of a given sea level at the start, and at the end of a run that was checked; empty if there are none."""
        unknown_share = self._gaps
        if unknown_share is None:
            try:
                unknown_share = self._unknown_level_share(0.0)
            except ForcingError:  # whatever it is, the check before the first step says it
                return ""
        return level_gaps_text(self._find_product("ssh"), unknown_share)

    def _unknown_level_share(self, time: float) -> float:
        return unknown_level_share(self._find_product("ssh"), self._find_product("uo"), time)

    def _find_product(self, name: str) -> Part | None:
        return next((product for product in self.parts if name in product.gives), None)

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the ocean current (m s-1) at arrays of points, for maps; NaN outside and on land."""
        product = self._find_product("uo")
        if product is None:  # the currents of a sum come from its formulas
            return np.zeros(np.shape(lon)), np.zeros(np.shape(lon))
        x, y = flattened(lon), flattened(lat)
        draft = (
            np.full(x.size, min(self.draft, float(product.records.limits[-1]))) if product.records.has_levels else None
        )
        located = product.mesh.locate(x, y)
        u, v = (product.values(name, located, time, draft, NO_RINGS) for name in ("uo", "vo"))
        return u.reshape(np.shape(lon)), v.reshape(np.shape(lon))

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) below mean sea level at arrays of points; NaN outside and on land."""
        product = self._find_product("depth_below_surface")
        if product is None:
            return np.full(np.shape(lon), needs.DEPTH.default)
        located = product.mesh.locate(flattened(lon), flattened(lat))
        depth = product.values("depth_below_surface", located, 0.0, None, NO_RINGS)
        return np.where(depth > 0.0, depth, np.nan).reshape(np.shape(lon))

    def sea_level(self, lon: Floats, lat: Floats, time: float) -> Floats:
        """Return the sea level (m) above the datum of the depth at arrays of points; 0 where no product gives both."""
        product = self._find_product("ssh")
        if product is None or self._find_product("depth_below_surface") is None:
            return np.zeros(np.shape(lon))
        located = product.mesh.locate(flattened(lon), flattened(lat))
        return product.values("ssh", located, time, unknown=0.0).reshape(np.shape(lon))

    def land(self, lon: Floats, lat: Floats) -> NDArray[np.bool_]:
        """Return which points of the products are land: no current is known there, or no depth above 0."""
        x, y, is_land = flattened(lon), flattened(lat), np.zeros(np.size(lon), bool)
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
        texts = [product.describe() for product in self.parts]
        drift = [f"coastal drift {self.coastal_drift:g} m/s"] if self.coastal_drift > 0.0 else []
        if self._slope is not None:
            texts.append(self._slope.describe(assumed=self.assumes_slope))
        grid = [f"elements are stopped by the land of a grid of {self.grid.describe()}"] if self.grid else []
        text = "\n".join(["each product on its own points", *texts, *drift, *grid, *self.notices])
        return text.replace("\n", "\n    ")


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
