"""
Custom process: basal melt
==========================

A function that is called after each time step may change thickness and mass.
"""

import numpy as np
from matplotlib.figure import Figure

from riftberg import Forcing, Iceberg, Model

RATE = 2.0 / 86400  # m s-1: two metres a day

berg = Iceberg.rectangle("12 km", "6 km", thickness="200 m", placement=(-37.0, -56.0))
model = Model(berg, Forcing.uniform(current=(0.1, 0.0)))


def melt(now):
    """Take a layer from the base of every element."""
    body, layer = now.elements.body, RATE * now.parameters.stepping.time_step
    body.mass[:] *= 1 - layer / body.thickness
    body.thickness[:] -= layer


model.after_step.append(melt)
run = model.run(days=2)

figure = Figure(figsize=(5.5, 3.4), layout="constrained")
axes = figure.subplots()
days = (run["time"] - run["time"][0]) / np.timedelta64(1, "D")
axes.plot(days, run["thickness"].mean("trajectory"), color="#4477aa")
axes.set(xlabel="days since the start", ylabel="thickness (m)", title="Two metres a day")
figure.savefig("melting.png", dpi=120)

# %%
print(f"{model.elements.thickness[0]:.3f} m")
assert abs(model.elements.thickness[0] - 196.0) < 1e-9
