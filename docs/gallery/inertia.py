"""
Inertial circles
================

A berg with an initial velocity and without forcing moves in inertial circles of period :math:`2\\pi/f`.
"""

import numpy as np
from matplotlib.figure import Figure

from riftberg import Forcing, Iceberg, Model, Parameters

latitude = -56.0
berg = Iceberg.rectangle("3 km", "3 km", thickness="200 m", placement=(-37.0, latitude), velocity=(0.2, 0.0))
model = Model(berg, Forcing.uniform(), Parameters(drag={"ocean_scale": 0.0}, stepping={"time_step": "10 min"}))
run = model.run(days=2, every_hours="10 min")

# %%
# The heading rotates steadily; its rate gives the period.
u, v = run["u"].values[0], run["v"].values[0]
hours = (run["time"] - run["time"][0]).values / np.timedelta64(1, "h")
turned = np.unwrap(np.arctan2(v, u))
period = 2 * np.pi / np.polyfit(hours, turned, 1)[0]
theory = 2 * np.pi / (2 * 7.292e-5 * abs(np.sin(np.radians(latitude)))) / 3600

figure = Figure(figsize=(5, 4.5), layout="constrained")
axes = figure.subplots()
km = np.radians(1.0) * 6371.0
east = (run["lon"][0] - run["lon"][0, 0]) * km * np.cos(np.radians(latitude))
north = (run["lat"][0] - run["lat"][0, 0]) * km
axes.plot(east, north, color="#4477aa")
axes.plot(0, 0, "o", color="black")
axes.annotate("start", (0, 0), (0, 6), textcoords="offset points", ha="center")
axes.set(xlabel="east of the start (km)", ylabel="north of the start (km)", title="Two days without drag")
axes.set_aspect("equal")
figure.savefig("inertia.png", dpi=120)

print(f"{abs(period):.3f} h, in theory {theory:.3f} h")
assert abs(abs(period) / theory - 1) < 0.01
