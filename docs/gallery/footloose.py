"""
Footloose calving
=================

Waves cut a notch at the waterline; the foot of ice below it is buoyant, bends the edge upwards and breaks it off (Wagner et al. 2014). The children start on the rim of
their parent and drift away on their own.
"""

from riftberg import Forcing, Iceberg, Model, Parameters, draw_map

berg = Iceberg.rectangle("12 km", "8 km", thickness="250 m", radius="1 km", placement=(-40.0, -54.0))
sea = Forcing.uniform((0.15, 0.05), wind=(14.0, 4.0))
parameters = Parameters(
    stepping={"time_step": "1 h"},
    melt={"enabled": True, "temperature": 4.0, "salinity": 34.0},
    footloose={"enabled": True, "style": "bergs"},
)
model = Model(berg, sea, parameters, start="2020-01-01")
before = model.elements.size
run = model.run(days=20, every_hours=12)
draw_map(run, "footloose.png", title="A berg sheds its rim")

# %%
children = model.elements.size - before
print(f"{children} children")
assert children > 0
