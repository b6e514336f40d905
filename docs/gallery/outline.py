"""
A berg from an outline
======================

A polygon in longitude and latitude is filled with elements. The lattice is positioned so that its area is close to that of the outline.
"""

import numpy as np

from riftberg import Forcing, Iceberg, Model, draw_map

angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
reach = 1 + 0.25 * np.cos(2 * angle) + 0.1 * np.sin(3 * angle)
outline = np.column_stack([-37 + 0.35 * reach * np.cos(angle), -56 + 0.2 * reach * np.sin(angle)])

berg = Iceberg.from_outline(outline, thickness="200 m", radius="1 km")
print(berg.describe())
model = Model(berg, Forcing.uniform(current=(0.1, 0.0)))
draw_map(model.run("6 h"), "outline.png", title="From an outline")

# %%
assert abs(berg.report["area_error"]) < 0.01
