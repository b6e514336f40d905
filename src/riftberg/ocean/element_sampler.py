"""Fields of one product at the elements of a run: over the draft, with vorticity, slope of the sea surface and shore drift."""

from __future__ import annotations

import numpy as np

from riftberg.ocean import needs
from riftberg.ocean.product_part import Part
from riftberg.ocean.product_records import (
    NO_CORNERS,
    Wanted,
    add_shore_drift,
    fill_slopes,
    fill_vorticity,
    values_at,
)
from riftberg.products.mesh import NodeMesh, Places
from riftberg.state import Elements, Floats


class ElementSampler:
    """Fills the environment of elements with the fields of a product.

    ``coastal_drift``: current away from land (m s-1), added in cells of currents with land at a corner.
    """

    def __init__(self, product: Part, coastal_drift: float) -> None:
        self.product, self._coastal_drift = product, coastal_drift
        self.variables, self._wanted = sampled_fields(product)

    def fill(self, elements: Elements, located: Places, time: float, draft: Floats) -> Floats | float:
        """Fill the environment of elements in some cells, and return the sea level (m), 0 where the product has none."""
        e, lon, lat, product = elements.environment, elements.lon, elements.lat, self.product
        blend, points = product.records.blend(time), product.mesh.points
        corners = np.empty((2, 4, lon.size)) if "uo" in product.gives else NO_CORNERS
        rows = values_at(blend, located, points.columns, self._wanted, draft=draft, corners=corners)
        values = dict(zip(self.variables, rows, strict=True))
        level: Floats | float = values.pop("ssh", 0.0)
        for variable, value in values.items():
            getattr(e, variable)[:] = value
        if isinstance(product.mesh, NodeMesh):
            self._fill_from_nodes(product.mesh, elements, time)
            return level
        if "uo" in product.gives:
            fill_vorticity(corners, located, points, lon, lat, e.vorticity)
            if self._coastal_drift > 0.0:
                add_shore_drift(corners[0], located, points, lon, lat, self._coastal_drift, e.uo, e.vo)
        if "ssh" in product.gives:
            number = product.records.names.index("ssh")
            fill_slopes(blend, number, located, points, lon, lat, e.slope_x, e.slope_y)
        return level

    def _fill_from_nodes(self, mesh: NodeMesh, elements: Elements, time: float) -> None:
        """Fill slope of the sea surface and vorticity from scattered points: those of planes through the points near by."""
        e, lon, lat = elements.environment, elements.lon, elements.lat
        if "uo" in self.product.gives:
            e.vorticity[:] = mesh.slopes(self.product.point_values("vo", time), lon, lat)[0]
            e.vorticity[:] -= mesh.slopes(self.product.point_values("uo", time), lon, lat)[1]
        if "ssh" in self.product.gives:
            e.slope_x[:], e.slope_y[:] = mesh.slopes(self.product.point_values("ssh", time), lon, lat)


def sampled_fields(product: Part) -> tuple[tuple[str, ...], Wanted]:
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
