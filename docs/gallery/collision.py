"""
Two bergs collide
=================

A current brings two bergs together. They repel each other and are not bonded.
"""

import numpy as np

from riftberg import draw_map
from riftberg.experiments import build

model, info = build("collision")
run = model.run("30 h")
draw_map(run, "collision.png", title=info.title)

# %%
# The centres of the two bergs stay more than one element diameter apart.
half = run.sizes["trajectory"] // 2
y = run["y"].values
gap = np.abs(y[:half].mean(0) - y[half:].mean(0))
print(f"nearest: {gap.min():.0f} m, at the start {gap[0]:.0f} m")
assert 700 < gap.min() < gap[0]
