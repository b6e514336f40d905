"""
Bending of a beam against theory
================================

Twenty-nine elements in a row, simply supported at both ends, with a load in the middle. A beam of elements bends as the elastic
beam of the same section does, which tests normal force, shear and bending of the bonds together.
"""

import numpy as np
from matplotlib.figure import Figure

from riftberg import Forcing, Iceberg, Model, Parameters

radius, columns, load, youngs_modulus = 0.25, 29, 1.5e5, 1e9
x0 = 2 * radius * np.arange(columns)
beam = Iceberg.from_points(x0, 0 * x0, radius=radius, thickness=1.0, density=800.0, latlon=False)
beam.elements.free_y[[0, -1]] = 0.0
beam.elements.load_y[columns // 2] = -load

# The drag of a sea floor above the keel brings the beam to rest: bonds alone would damp its bending over a long time.
parameters = Parameters(
    ice={"density": 800.0},
    drag={"rotational": False},
    grounding={"coefficient": 13e3},
    contact={"spring": 1e-8, "distance": 0.0},
    bonds={"youngs_modulus": youngs_modulus, "damping": 0.1, "linear_bending": False},
    fracture={"enabled": False},
    stepping={"scheme": "mts", "time_step": 1.0, "only_interactions": True, "speed_limit": 100.0},
    earth={"latlon": False, "period": 0.0},
)
model = Model(beam, Forcing.uniform(depth=0.0), parameters)
model.advance(steps=10)
sag = model.elements.lat

length, bending = x0[-1], youngs_modulus * 1.0 * (2 * radius) ** 3 / 12
near = np.minimum(x0, length - x0)
theory = -load * near * (3 * length**2 - 4 * near**2) / (48 * bending)

figure = Figure(figsize=(6, 3.6), layout="constrained")
axes = figure.subplots()
axes.plot(x0, theory, color="black", label="theory")
axes.plot(x0, sag, "o", color="#ee6677", label="Riftberg")
axes.plot(x0[[0, -1]], [-0.03, -0.03], "^", ms=12, mfc="white", mec="black", zorder=1, label="support")
lowest = theory.min()
axes.annotate("load", (length / 2, lowest), (length / 2, 0.7 * lowest), ha="center", arrowprops={"arrowstyle": "->"})
axes.set(xlabel="x (m)", ylabel="deflection (m)", title="Beam on two supports, loaded at its middle")
axes.legend(frameon=False)
figure.savefig("beam.png", dpi=120)

# %%
error = sag.min() / theory.min() - 1
print(f"{100 * error:.2f} % at the middle")
assert abs(error) < 0.05
