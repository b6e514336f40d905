"""Two bergs that meet: how near they come, when they touch, and how fast they close and part."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from riftberg.config.places import duration_text
from riftberg.runs.scene import Scene
from riftberg.state import Floats


@dataclass(frozen=True)
class Approach:
    """Distance of two bergs over a Cartesian run."""

    seconds: Floats  # Times of the records, s since the start
    apart: Floats  # Smallest distance of the centres of two elements, one of each berg, m
    closing: Floats  # Rate at which the distance of the centroids falls, m s-1; negative where they part
    # Distance (m) of centres below which elements press on each other: the sum of their radii, or `contact.distance`
    reach: float

    @property
    def touching(self) -> Any:
        """Whether the bergs press on each other, by record."""
        return self.apart < self.reach

    def facts(self) -> dict[str, Any]:
        """Return the figures for a summary."""
        first = int(np.argmax(self.touching)) if self.touching.any() else None
        return {
            "contact_reach_m": self.reach,
            "first_contact_s": None if first is None else float(self.seconds[first]),
            "closing_before_m_s": None if first is None else float(self.closing[max(first - 1, 0)]),
            "smallest_distance_m": float(self.apart.min()),
            "fastest_parting_m_s": float(max(0.0, -self.closing.min())),
            "contact_records": int(self.touching.sum()),
        }


def approach(run: xr.Dataset) -> Approach:
    """Follow the two bergs of a run in metres."""
    scene = Scene(run)
    one, other = scene.berg[0] == 1, scene.berg[0] == 2
    dx = scene.x[:, one][:, :, None] - scene.x[:, other][:, None, :]
    dy = scene.y[:, one][:, :, None] - scene.y[:, other][:, None, :]
    middle = np.hypot(dx.mean(axis=(1, 2)), dy.mean(axis=(1, 2)))
    seconds = scene.seconds - scene.seconds[0]
    radius = math.sqrt(float(scene.area[0]) / (2.0 * math.sqrt(3.0)))  # inscribed in a hexagon
    reach = max(2.0 * radius, scene.parameters.contact.distance)
    closing: Floats = -np.gradient(middle, seconds) if len(seconds) > 1 else np.zeros(1)
    return Approach(seconds, np.hypot(dx, dy).min(axis=(1, 2)), closing, reach)


def words(meeting: Approach) -> list[str]:
    """Return in plain words how the bergs met."""
    facts = meeting.facts()
    if facts["first_contact_s"] is None:
        return [f"  the bergs do not meet: they come as near as {facts['smallest_distance_m']:.0f} m between elements"]
    return [
        f"  the bergs close at {facts['closing_before_m_s']:.2f} m/s and press on each other from "
        f"{duration_text(facts['first_contact_s'] / 86_400.0)} on (elements nearer than {meeting.reach:.0f} m)",
        f"  nearest elements {facts['smallest_distance_m']:.0f} m apart; then the bergs part at up to "
        f"{facts['fastest_parting_m_s']:.2f} m/s",
    ]
