"""
Break-up along a rift
=====================

Bonds along a line are weakened. In a divergent current that pulls the two halves apart, the berg breaks there.
"""

import numpy as np
import xarray as xr

from riftberg import A68A_2022, DatasetForcing, Iceberg, Model, draw_map

lon, lat = np.linspace(-38.5, -35.5, 61), np.linspace(-56.8, -55.2, 33)
x = (lon[None, :] + 37) * 111.2e3 * np.cos(np.radians(56)) + 0 * lat[:, None]
names = {"uo": "eastward_sea_water_velocity", "vo": "northward_sea_water_velocity"}
values = {"uo": 0.3 * np.tanh(x / 15e3), "vo": 0 * x}
sea = xr.Dataset(
    {n: (("lat", "lon"), values[n], {"standard_name": names[n], "units": "m s-1"}) for n in names},
    {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})},
    {"title": "current that diverges at 37 W"},
)
berg = Iceberg.rectangle("60 km", "15 km", thickness="200 m", placement=(-37.0, -56.0), offset=(0.0, 0.0))
rifted = berg.with_rifts([[-37.01, -56.2], [-37.01, -55.8]], strength=0.02)

model = Model(rifted, DatasetForcing.from_xarray(sea, "2020-12-09"), A68A_2022, "2020-12-09")
run = model.run(days=1)
draw_map(run, "rift.png", title="A berg breaks along its rift")

# %%
print(rifted.report["rifts"], model.fragment_count, "pieces")
assert rifted.report["rifts"][0]["crossed"] >= 4
assert model.fragment_count == 2
