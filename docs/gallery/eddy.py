"""
Custom forcing: an eddy rotates a berg
======================================

Any dataset with CF names and units can be used as forcing. Here it is a round eddy in geostrophic balance.
"""

import numpy as np
import xarray as xr

from riftberg import A68A_2022, DatasetForcing, Iceberg, Model, draw_map

lon, lat = np.linspace(-39, -35, 81), np.linspace(-57.2, -54.8, 81)
x = (lon[None, :] + 37) * 111.2e3 * np.cos(np.radians(56))
y = (lat[:, None] + 56) * 111.2e3
f, g, size, height = 2 * 7.292e-5 * np.sin(np.radians(-56)), 9.8, 40e3, 0.25
level = height * np.exp(-(x**2 + y**2) / (2 * size**2))
uo, vo = g / f * y / size**2 * level, -g / f * x / size**2 * level

names = {
    "uo": "eastward_sea_water_velocity",
    "vo": "northward_sea_water_velocity",
    "zos": "sea_surface_height_above_geoid",
}
sea = xr.Dataset(
    {
        n: (("lat", "lon"), v, {"standard_name": names[n], "units": "m" if n == "zos" else "m s-1"})
        for n, v in {"uo": uo, "vo": vo, "zos": level}.items()
    },
    {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})},
    {"title": "a round anticyclonic eddy"},
)

start = "2020-12-09"
berg = Iceberg.rectangle("40 km", "15 km", thickness="200 m", placement=(-37.0, -56.0))
model = Model(berg, DatasetForcing.from_xarray(sea, start), A68A_2022, start)
run = model.run(days=3)
draw_map(run, "eddy.png", title="An anticyclonic eddy rotates a berg")

# %%
# An anticyclone rotates counter-clockwise in the southern hemisphere, and the berg with it.
turn = np.degrees(model.elements.rotation.mean())
print(f"{turn:.1f} degrees in three days")
assert turn > 5
