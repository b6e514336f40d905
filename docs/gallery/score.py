"""
A run against observations
==========================

The built-in A68a beside the daily positions of the outlines of Huth et al. (2022): distance, long axis and area by day. The currents were fitted to this drift, so a good
score is no skill.
"""

from pathlib import Path

from riftberg import build, draw_score, read_observed, score_run
from riftberg.experiments.a68a import A68A_OBSERVED

lines = ["date,lat,lon,area_km2,azimuth"]
lines += [f"2020-12-{day.day:02d} 13:00,{day.lat},{day.lon},{day.area},{day.azimuth}" for day in A68A_OBSERVED]
Path("observed.csv").write_text("\n".join(lines))

model, info = build("a68a")
run = model.run(info.days, every_hours=6)
score = score_run(run, read_observed("observed.csv"))
draw_score(score, "score.png", title="A68a, model and observations", dpi=100)

# %%
off = {day.time: day.berg.distance_km for day in score.days if day.berg is not None}
before = max(off[day] for day in off if day < "2020-12-21")
print(f"centroid off by {before:.1f} km at most until 20 December")
print(f"{max(off.values()):.1f} km while the finger, which breaks off a day early in the run, was still seen on the berg")
assert before < 7.0
