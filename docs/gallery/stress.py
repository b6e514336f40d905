"""
Stress in the bonds
===================

Where a berg is stretched, its bonds carry tension, in equilibrium with the loads.
"""

from riftberg import A68A_2022, build, draw_stress

model, info = build("a68a")
run = model.run(days=3, every_hours=6)
draw_stress(run, "stress.png")

# %%
# No bond exceeds its strength.
largest = float(run["normal_stress"].max())
print(f"{largest / 1e3:.1f} kPa")
assert 0 < largest <= A68A_2022.fracture.normal_strength
