"""
Random bond strength
====================

Real ice has weak spots. Bond strengths are drawn from a distribution with mean 1; a seed makes them reproducible.
"""

from matplotlib.figure import Figure

from riftberg import Iceberg

berg = Iceberg.rectangle("90 km", "60 km", thickness="200 m", placement=(-37.0, -56.0))
weak = berg.with_strength("weibull", shape=5, seed=1)
again = berg.with_strength("weibull", shape=5, seed=1)

figure = Figure(figsize=(5.5, 3.8), layout="constrained")
axes = figure.subplots()
axes.hist(weak.bonds.strength, bins=40, color="#4477aa")
axes.set(xlabel="strength of a bond (times the threshold)", ylabel="bonds", title="Weibull, modulus 5")
figure.savefig("scatter.png", dpi=120)

# %%
mean = weak.bonds.strength.mean()
print(f"mean {mean:.4f}")
assert abs(mean - 1) < 0.02
assert (weak.bonds.strength == again.bonds.strength).all()
