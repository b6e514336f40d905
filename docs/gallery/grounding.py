"""
Grounding
=========

A current carries a berg up a slope. Where the keel meets the sea floor, a bed of sand, the berg is held.
"""

import numpy as np

from riftberg import A68A_2022, Forcing, Iceberg, Model, draw_map

berg = Iceberg.rectangle("12 km", "9 km", thickness="200 m", placement=(-37.0, -56.0), velocity=(0.2, 0.0))
shelf = Forcing.uniform(current=(0.2, 0.0)) + Forcing.slope((-37.0, -56.0), towards=270.0, gradient=0.01, depth=400.0)
model = Model(berg, shelf, A68A_2022.changed(fracture={"enabled": False}))
run = model.run(days=3)
draw_map(run, "grounding.png", title="Aground on a slope")

# %%
# At first it drifted with the current. Now it stands, with its eastern edge where the water is as deep as its keel. How far it
# slid, and what holds it:
stay = model.groundings.rows[0]
print(f"slid {stay.way:.0f} m, lifted by {stay.lift:.2f} m, holds {stay.capacity:.1e} N against {stay.pressing:.1e} N")
speed = float(np.hypot(model.elements.u_sync.mean(), model.elements.v_sync.mean()))
draft = float(model.elements.thickness[0]) * 850.0 / 1025.0
edge = float(model.elements.depth.min()) - 0.01 * 1500.0  # from the middle of an element of 3 km to its eastern side
print(f"{100 * speed:.2f} cm/s over {edge:.0f} m at its eastern edge, with a draft of {draft:.0f} m")
assert speed < 0.05
assert abs(edge - draft) < 3.0
