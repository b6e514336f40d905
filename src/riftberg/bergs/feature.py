"""One outline or line with its attributes, as all readers give it."""

from __future__ import annotations

import importlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely

from riftberg.errors import BergError, RiftbergError

DATE_KEYS = (
    "date", "datetime", "date_time", "when", "timestamp", "begin", "acquired", "acq_date", "acqdate", "img_date",
    "image_date", "obs_date", "sensing", "time_coverage_start", "time",
)  # fmt: skip
"""Attributes that hold the date of an outline, best first; small and capital letters are alike."""


@dataclass(frozen=True)
class Feature:
    """One feature of a file: a shapely geometry in longitude and latitude, and its properties."""

    geometry: Any
    properties: dict[str, Any] = field(default_factory=dict)

    @property
    def date(self) -> str:
        """Date of the feature as text, empty if it has none."""
        for key in DATE_KEYS:
            for name, value in self.properties.items():
                if name.lower() == key and value not in (None, ""):
                    return str(value)
        return ""

    def label(self) -> str:
        """Return date and other short properties, for messages."""
        return ", ".join(f"{k}={v}" for k, v in self.properties.items() if len(str(v)) < 40) or "no properties"


def needed(module: str, why: str = "outlines need it", extra: str = "outline") -> Any:
    """Import an optional package or say which extra holds it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise RiftbergError(
            f"{module.split('.')[0]} is not installed but {why}: pip install 'riftberg[{extra}]'"
        ) from error


def polygon(shell: Any, holes: list[Any], where: str) -> Any:
    """Return a shapely polygon of a shell and holes, or say what is wrong with its vertices."""
    shell = np.asarray(shell, dtype=float)
    if shell.ndim != 2 or shell.shape[1] < 2 or len(shell) < 3:
        raise BergError(
            f"a ring of shape {shell.shape}",
            where=where,
            remedy="A ring needs at least 3 vertices of longitude and latitude",
        )
    if not all(np.isfinite(np.asarray(ring, dtype=float)).all() for ring in (shell, *holes)):
        raise BergError("vertices that are not numbers", where=where, remedy="Remove them")
    return shapely.Polygon(shell[:, :2], [np.asarray(h, dtype=float)[:, :2] for h in holes])
