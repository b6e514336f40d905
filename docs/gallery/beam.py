"""
Bending of a beam against theory
================================

Twenty-nine elements in a row, simply supported at both ends, with a load in the middle.
"""

import numpy as np
from matplotlib.figure import Figure

from riftberg.experiments import build

model, info = build("supported-beam")
x0, y0 = model.elements.lon.copy(), model.elements.lat.copy()
model.advance(info.days)
sag = model.elements.lat - y0

length, load, bending = 14.0, 1.5e5, 1e9 * 0.5**3 / 12
x = x0 - x0.min()
near = np.minimum(x, length - x)
theory = -load * near * (3 * length**2 - 4 * near**2) / (48 * bending)

figure = Figure(figsize=(6, 3.6), layout="constrained")
axes = figure.subplots()
axes.plot(x, theory, color="black", label="theory")
axes.plot(x, sag, "o", color="#ee6677", label="Riftberg")
axes.set(xlabel="x (m)", ylabel="deflection (m)", title="Simply supported beam")
axes.legend(frameon=False)
figure.savefig("beam.png", dpi=120)

# %%
error = sag.min() / theory.min() - 1
print(f"{100 * error:.2f} % at the middle")
assert abs(error) < 0.05
