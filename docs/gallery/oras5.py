"""
A68a in a reanalysis
====================

The same berg in currents and sea level of ORAS5 and the wind of JRA-55, means of December 2020, to which nothing was fitted. The files (8 MB) are fetched on the first
call, or read from the folder that ``RIFTBERG_DATA`` names. Monthly means have no eddies, so the berg goes another way: this is what a forecast from such data is worth.
"""

from riftberg import Options, build, draw_map

model, info = build("a68a-oras5", Options(fetch=True))
run = model.run(5, every_hours=6)
draw_map(run, "oras5.png", title=info.title)

# %%
tracks = run.riftberg.tracks
lon, lat = (float(tracks[name].values[tracks["rowsize"].values[0] - 1]) for name in ("lon", "lat"))
print(f"after five days at {-lat:.2f} S, {(-lon) % 360:.2f} W; observed 55.24 S, 37.85 W")
assert abs(lat + 55.24) < 1.0
