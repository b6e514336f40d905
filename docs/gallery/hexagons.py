"""
Hexagonal packing
=================

Elements may be squares or hexagons. A hexagon in the interior of the berg has six bonds.
"""

from riftberg import Forcing, Iceberg, Model, Parameters, draw_map

berg = Iceberg.rectangle("30 km", "20 km", thickness="200 m", packing="hexagonal", placement=(-37.0, -56.0))
model = Model(berg, Forcing.uniform(current=(0.1, 0.05)), Parameters(bonds={"packing": "hexagonal"}))
draw_map(model.run("6 h"), "hexagons.png", title="A hexagonal lattice")

# %%
most = int(model.elements.bond_count.max())
print(most, "bonds")
assert most == 6
