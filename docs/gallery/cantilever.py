"""
A cantilever that bends far
===========================

Three rows of thirty elements, clamped at one end, with a load on the other: it bends by a third of its length, as the elastica
does.
"""

import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from riftberg import Forcing, Iceberg, Model, Parameters

radius, columns, rows, load, youngs_modulus = 2500.0, 30, 3, 1.5e10, 1e9
column, row = np.divmod(np.arange(columns * rows), rows)
x0, y0 = 2 * radius * column, 2 * radius * (row - 1)
beam = Iceberg.from_points(
    x0, y0, radius=radius, thickness=1.0, density=900.0, static=column == 0, latlon=False
)
beam.elements.load_y[column == columns - 1] = -load / rows

# Under its whole load at once the tip swings at 15 m/s; the drag of a sea floor above the keel brings it to rest.
parameters = Parameters(
    ice={"density": 900.0},
    drag={"rotational": False},
    grounding={"coefficient": 1.37},
    contact={"spring": 1e-8, "distance": 0.0},
    bonds={"youngs_modulus": youngs_modulus, "damping": 0.1, "linear_bending": True},
    fracture={"enabled": False},
    stepping={"scheme": "mts", "time_step": 100.0, "only_interactions": True, "speed_limit": 100.0},
    earth={"latlon": False, "period": 0.0},
)
model = Model(beam, Forcing.uniform(depth=0.0), parameters)
model.advance(steps=300)
x, y = model.elements.lon, model.elements.lat

# %%
# The elastica: slope, moment, x and y along the middle of the beam; the moment at the clamp is the one that leaves none at the
# free end.
length, bending = x0[-1], youngs_modulus * 1.0 * (2 * radius * rows) ** 3 / 12


def elastica(moment: float) -> np.ndarray:
    """Return slope, moment, x and y along the beam for a moment at its clamp."""

    def along(_: float, state: np.ndarray) -> list[float]:
        cosine, sine = np.cos(state[0]), np.sin(state[0])
        return [-state[1] / bending, -load * cosine, cosine, sine]

    return solve_ivp(along, (0, length), [0, moment, 0, 0], t_eval=np.linspace(0, length, 101), rtol=1e-8).y


line = elastica(brentq(lambda moment: elastica(moment)[1, -1], 0, load * length))
figure = Figure(figsize=(6, 3.6), layout="constrained")
axes = figure.subplots()
axes.plot(line[2] / 1e3, line[3] / 1e3, color="black", label="elastica")
axes.plot(x / 1e3, y / 1e3, "o", ms=4, color="#ee6677", label="Riftberg")
axes.plot([0, 0], [-10, 10], color="black", lw=5, zorder=0, label="clamp")
tip_x, tip_y = line[2:, -1] / 1e3
axes.annotate("", (tip_x, tip_y - 14), (tip_x, tip_y), arrowprops={"arrowstyle": "->"}, zorder=0)
axes.text(tip_x - 3, tip_y - 12, "load", ha="right")
axes.set(xlabel="x (km)", ylabel="y (km)", ylim=(-63, 15), title="Cantilever under a load at its tip")
axes.set_aspect("equal")
axes.legend(frameon=False)
figure.savefig("cantilever.png", dpi=120)

# %%
tip = y[(column == columns - 1) & (row == 1)][0]
error = tip / line[3, -1] - 1
print(f"{100 * error:.2f} % at the tip, which bends by {-tip / 1e3:.1f} km")
assert abs(error) < 0.02
