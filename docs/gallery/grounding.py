"""
Running aground
===============

A berg whose keel is deeper than the water is slowed by the sea floor, and stops where the current cannot push it on.
"""

import numpy as np

from riftberg import A68A_2022, Iceberg, Model, Steady, draw_map

berg = Iceberg.rectangle("12 km", "9 km", thickness="200 m", placement=(-37.0, -56.0), velocity=(0.3, 0.0))
shallow = Steady(current=(0.3, 0.0), depth="150 m")
model = Model(berg, shallow, A68A_2022.changed(grounding={"coefficient": 1e5}))
run = model.run(days=1)
draw_map(run, "grounding.png", forcing=shallow, title="Aground")

# %%
# Over deep water the berg goes with the current; here it creeps.
speed = float(np.hypot(model.elements.u.mean(), model.elements.v.mean()))
print(f"{100 * speed:.2f} cm/s")
assert speed < 0.1
