"""
A berg runs aground and breaks
==============================

A current of 0.3 m/s carries a weak berg of 15 km by 35 km onto a seamount, whose summit lies 16 m above its keel.
"""

from riftberg import Forcing, Iceberg, Model, Parameters, draw_map

berg = Iceberg.rectangle(
    "15 km", "35 km", thickness="200 m", radius="1500 m", packing="hexagonal", placement=(50e3, 50e3), velocity=(0.2, 0.0),
    latlon=False,
)  # fmt: skip
sea = Forcing.uniform(current=(0.2, 0.2), slope=(0.0, 0.0)) + Forcing.seamount(
    (63e3, 60e3), height=850.0, width=5e3, depth=1000.0, latlon=False, latitude=0.0
)
parameters = Parameters(
    bonds={"packing": "hexagonal"},
    fracture={"normal_strength": "3 kPa"},
    earth={"latlon": False, "period": 0.0},
)
model = Model(berg, sea, parameters)
run = model.run(days=3)
draw_map(run, "grounding_fracture.png", title="A berg runs aground and breaks")

# %%
aground = sum(row.grounded for row in model.fragments.breakups)
print(f"{model.bonds_broken} bonds broken, {model.fragment_count} pieces, {aground} of them broken off aground")
assert aground > 0
