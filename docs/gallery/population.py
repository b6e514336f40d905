"""
A population of bergs
=====================

Eighty small bergs with sizes of Gladstone et al. (2001) and one giant berg drift, collide and melt in the Weddell Sea for ten days. The fresh water that they give to the
sea is kept on cells. Beyond 60 degrees of latitude maps are polar stereographic.
"""

from riftberg import Forcing, Iceberg, Model, Parameters, draw_tracks

small = Iceberg.field(80, (-56.0, -50.0, -64.5, -62.0), seed=1)
giant = Iceberg.rectangle("40 km", "20 km", thickness="220 m", radius="2 km", placement=(-52.0, -65.5))
bergs = Iceberg.join({"small": small, "giant": giant})
sea = Forcing.uniform((0.1, 0.05), wind=(8.0, 0.0)) + Forcing.eddy((-53.0, -63.5), 60e3, 0.3)
parameters = Parameters(
    stepping={"time_step": "1 h"},
    rolling={"enabled": True},
    melt={"enabled": True, "temperature": 1.0, "salinity": 34.0, "base": "three_equation"},
)
model = Model(bergs, sea, parameters, start="2020-01-01")
run = model.run(days=10, every_hours=12)
draw_tracks(run, "population.png", title="Eighty bergs and a giant")

# %%
budget = model.life.balance(model)
print("\n".join(budget.lines()))
assert float(abs(run["ledger_error"]).max()) < 1e-12
