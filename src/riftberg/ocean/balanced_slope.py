"""The slope of the sea surface where no sea level is taken: in geostrophic balance with the currents of a product."""

from __future__ import annotations

from typing import Final

from riftberg.errors import ForcingError
from riftberg.ocean.balance import balancing_slope, wind_drift
from riftberg.ocean.mean_currents import MeanCurrents
from riftberg.ocean.product_part import Part, averaged_product
from riftberg.products.mesh import Places
from riftberg.products.records import named
from riftberg.state import Elements, Floats

WITHOUT_WIND_DRIFT: Final = ("ugos", "uo_mean_over_berg_depth")
"""Variables of currents without levels that hold no drift of the uppermost metres."""


def check_layer(wind: Part | None, currents: Part | None) -> None:
    """Refuse a share of the wind in currents that hold no such layer, or without a wind."""
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


class BalancedSlope:
    """The slope that balances a current; its drift of the uppermost metres, a share of the ``wind``, has none.

    ``currents``: their means over 25 hours, taken twice, where they have such records; ``layer``: the share.
    """

    def __init__(self, currents: Part, wind: Part | None, layer: float) -> None:
        self.currents, self._layer = currents, layer
        # Of currents over the draft nothing is taken out.
        takes_out = layer and wind is not None and not currents.records.has_levels
        self._slow_wind = averaged_product(wind, ("ua", "va")) if takes_out and wind is not None else None

    def fill(self, elements: Elements, time: float, draft: Floats, located: Places | None) -> None:
        """Fill the slope at the elements, 0 where it is unknown; ``located``: in the cells of the currents, if known."""
        e, lon, lat = elements.environment, elements.lon, elements.lat
        u, v = self.currents.vector(("uo", "vo"), located or self.currents.mesh.locate(lon, lat), time, draft)
        if self._slow_wind is not None:
            wind = self._slow_wind
            ua, va = wind.vector(("ua", "va"), wind.mesh.locate(lon, lat), time, draft)
            east, north = wind_drift(lat, ua, va, self._layer)
            u, v = u - east, v - north
        e.slope_x[:], e.slope_y[:] = balancing_slope(lat, u, v)

    def reach(self, draft: float) -> None:
        """Keep the levels down to a draft (m)."""
        for product in (self.currents, self._slow_wind):
            if product is not None:
                product.records.reach(draft)

    def check(self, start: float, end: float, sampled: Part | None) -> None:
        """Refuse times (s) that the records do not cover; ``sampled``: the currents that act on the ice."""
        if sampled is None or self.currents.records is not sampled.records:
            self.currents.records.check(start, end)
        if self._slow_wind is not None:
            self._slow_wind.records.check(start, end)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What should be known of it: at the ends of the records, near the surface."""
        remarks, currents = [], self.currents
        if isinstance(currents.records, MeanCurrents):
            remarks.append(
                "the current is its mean over 25 hours, taken twice: in the first and last 25 hours of the records, of those "
                "that are there"
            )
        if not currents.records.has_levels and currents.original("uo") not in WITHOUT_WIND_DRIFT and not self._layer:
            remarks.append(
                f"{named(currents.records.ds) or currents.source} gives currents near the surface, whose wind drift has no "
                "slope: in ORAS5 this errs by 0.04 m/s, with means over the draft by 0.012 m/s"
            )
        return tuple(remarks)

    def describe(self, *, assumed: bool) -> str:
        """Return with which current the slope is in balance; ``assumed``: it was not asked for."""
        over = ["the draft"] * self.currents.records.has_levels
        over += ["25 hours, taken twice"] * isinstance(self.currents.records, MeanCurrents)
        mean = f"the mean current over {' and '.join(over)}" if over else "the current"
        why = ", for no sea level is given" if assumed else ""
        return f"slope of the sea surface: in geostrophic balance with {mean}{why}"
