"""
A68a in December 2020
=====================

The built-in experiment: the berg loses its northern tip aground and its southern finger afloat. The currents are fitted to the observed drift.
"""

from riftberg import build, draw_fragments, draw_map

model, info = build("a68a")
run = model.run(info.days, every_hours=3)
draw_map(run, "a68a.png", forcing=model.forcing, title=info.title)

# %%
# Area, stress and grounding of the fragments:
draw_fragments(run, "timeline.png")

# %%
areas = [row.area / 1e6 for row in model.fragments.breakups]
print([f"{area:.0f} km2" for area in areas])
assert [round(area) for area in areas if area > 100.0] == [261, 657]
