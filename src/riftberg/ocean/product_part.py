"""One product of a forcing: its points, its records, the fields that it gives, and their values at places."""

from __future__ import annotations

from datetime import datetime
from pathlib import PurePath
from typing import Final, NamedTuple

import numpy as np
import xarray as xr

from riftberg.constants import EARTH_RADIUS_KID
from riftberg.ocean import needs
from riftberg.ocean.mean_currents import mean_currents
from riftberg.ocean.product_records import RINGS, ProductRecords, Wanted, values_at
from riftberg.products.mesh import Mesh, NodeMesh, Places, build_mesh
from riftberg.products.records import WAVES
from riftberg.state import Floats, Ints

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

    def values(
        self, name: str, located: Places, time: float, draft: Floats | None = None, rings: Ints = RINGS,
        unknown: float = np.nan,
    ) -> Floats:  # fmt: skip
        """Return a field at places."""
        wanted = Wanted.of((0, draft is not None, unknown))
        blend, columns = self.records.field(name, time), self.mesh.points.columns
        values: Floats = values_at(blend, located, columns, wanted, draft=draft, rings=rings)[0]
        return values

    def vector(self, pair: tuple[str, str], located: Places, time: float, draft: Floats) -> Floats:
        """Return both components of a vector over the draft at places, 0 where it is unknown."""
        wanted = Wanted.of(*((self.records.names.index(name), True, 0.0) for name in pair))
        return values_at(self.records.blend(time), located, self.mesh.points.columns, wanted, draft=draft)

    def point_values(self, name: str, time: float) -> Floats:
        """Return a field at all points of an unstructured product (its uppermost level)."""
        blend = self.records.field(name, time)
        return np.asarray((1.0 - blend.weight) * blend.before[0, 0] + blend.weight * blend.after[0, 0])

    def spacing(self) -> float:
        """Return the usual distance (m) between neighbouring points."""
        if isinstance(self.mesh, NodeMesh):
            return float(np.radians(np.median(self.mesh.spacing())) * EARTH_RADIUS_KID)
        lon, lat = self.mesh.points.lon, self.mesh.points.lat
        east = (np.diff(lon, axis=0) + 180.0) % 360.0 - 180.0
        distances = np.hypot(east * np.cos(np.radians(lat[1:])), np.diff(lat, axis=0))
        return float(np.radians(np.nanmedian(distances)) * EARTH_RADIUS_KID)

    def describe(self) -> str:
        """Return the fields of the product in a few lines."""
        records, points = self.records, self.mesh.points
        dates = [str(date.astype("datetime64[m]")) for date in records.dates]
        when = f"{len(dates)} records from {dates[0]} to {dates[-1]}" if dates else "constant in time"
        rows, columns = points.lon.shape
        lines = [f"{', '.join(self.gives)}: gridded fields from {self.source}, {when}, {rows} x {columns} points"]
        if "uo" in self.gives and records.has_levels:
            lines.append(
                f"currents: mean over the draft of each element, from {records.limits.size - 1} layers to "
                f"{records.limits[-1]:g} m"
            )
        lines += [
            f"{name}: at the surface for waves, mean over the draft of each element for sides and base"
            for name in needs.OVER_DRAFT if name in self.gives and records.on_levels(name)
        ]  # fmt: skip
        return "\n".join(lines)


def product_part(ds: xr.Dataset, start: datetime, *, keel: float = np.inf) -> Part:
    """Return a canonical dataset on its own points and at its own times.

    ``keel``: deepest draft (m).
    """
    return Part(build_mesh(ds), records := ProductRecords(ds, start, keel=keel), provided_fields(records))


def averaged_product(product: Part, pair: tuple[str, str] = ("uo", "vo")) -> Part:
    """Return a product with its vectors as means over 25 hours, taken twice: the sea surface balances such currents."""
    return Part(product.mesh, mean_currents(product.records, pair), ())


def provided_fields(records: ProductRecords) -> tuple[str, ...]:
    """Return the fields (keys of `needs.BY_FIELD`) that records hold."""
    return tuple(
        name for name in needs.BY_FIELD if name in records.names and (name not in WAVES or "wave_x" in records.names)
    )
