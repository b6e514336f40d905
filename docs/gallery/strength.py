"""
Ensemble: sensitivity to ice strength
=====================================

The built-in A68a with three strengths of the ice, around the 11 kPa that are tuned to it. The tip breaks when it touches the sea
floor, within two minutes in all three. The finger, which the current bends, breaks later in stronger ice.
"""

import numpy as np

from riftberg import draw_sweep, sweep

result = sweep("a68a", {"fracture.normal_strength": "10, 11, 12 kPa"}, days=12, workers=0)
draw_sweep(result, "strength.png")

# %%
print(result["first_breakup"].values)
assert (result["status"] == 0).all()
first = result["first_breakup"].values
assert np.ptp(first) < np.timedelta64(2, "m")
