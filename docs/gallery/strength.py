"""
Many runs: weaker ice breaks earlier
====================================

The built-in A68a with three strengths of the ice, side by side.
"""

from riftberg import draw_sweep, sweep

result = sweep("a68a", {"fracture.normal_strength": "16, 18, 20 kPa"}, days=12, workers=0)
draw_sweep(result, "strength.png")

# %%
print(result["first_breakup"].values)
assert (result["status"] == 0).all()
first = result["first_breakup"].values
assert first[0] <= first[1]
