"""
Two bergs collide
=================

A current of one's own, as a class with ``add_to``, brings two bergs together in a periodic channel. They repel each other and are
not bonded.
"""

import numpy as np

from riftberg import Forcing, Iceberg, Model, Parameters, draw_map

period, line, radius = 20e3, 10e3, 450.0 * np.sqrt(3) / 2
column, row = np.array([0, 0, 0, 1, 1, 2, 2, 2]), np.array([0, 1, 2, 0, 1, 0, 1, 2])
x = 5.2e3 + np.sqrt(3) * radius * column
y = 4.3e3 + radius * (column % 2) + 2 * radius * row
bergs = Iceberg.from_points(
    np.concatenate([x, x]), np.concatenate([y, 2 * line - y]), radius=radius, thickness=300.0, packing="hexagonal",
    density=850.0, latlon=False, period=period,
)  # fmt: skip


class Converging(Forcing):
    """A current along x that converges on a line in the first half of the channel."""

    title = "a current that converges on the middle of the channel"

    def currents(self, lon, lat, time):
        """Return the current (m/s) at arrays of points (m)."""
        along = np.asarray(lon) % period
        window = np.clip(along / 1e3, 0, 1) * np.clip((line + 1e3 - along) / 1e3, 0, 1)
        return np.full(np.shape(lon), 0.2), 0.2 * np.clip((line - np.asarray(lat)) / 1e3, -1, 1) * window

    def add_to(self, elements, time):
        """Add it to the environment of the elements."""
        u, v = self.currents(elements.place.lon, elements.place.lat, time)
        elements.environment.uo[:] += u
        elements.environment.vo[:] += v


model = Model(bergs, Converging(), Parameters(earth={"latlon": False, "period": period}))
run = model.run("30 h")
draw_map(run, "collision.png", title="Two bergs collide")

# %%
# The centres of the two bergs stay more than one element diameter apart.
half = run.sizes["trajectory"] // 2
y = run["y"].values
gap = np.abs(y[:half].mean(0) - y[half:].mean(0))
print(f"nearest: {gap.min():.0f} m, at the start {gap[0]:.0f} m")
assert 700 < gap.min() < gap[0]
