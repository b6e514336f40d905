"""
Geostrophic drift
=================

In a current in geostrophic balance and without wind, a berg drifts with the water.
"""

import numpy as np

from riftberg import Forcing, Iceberg, Model, draw_map

berg = Iceberg.rectangle("30 km", "15 km", thickness="200 m", placement=(-37.0, -56.0), velocity=(0.2, 0.1))
model = Model(berg, Forcing.uniform(current=(0.2, 0.1)))
run = model.run(days=2)
draw_map(run, "drift.png", forcing=model.forcing, title="Drift with the water")

# %%
# After two days it still moves with the current, to within a millimetre per second or two.
speed = np.hypot(model.elements.u.mean() - 0.2, model.elements.v.mean() - 0.1)
print(f"{1e3 * speed:.2f} mm/s")
assert speed < 5e-3
