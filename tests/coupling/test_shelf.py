"""A bonded berg from an ice shelf: its mass is that of the shelf, and the ocean meets no jump of pressure on any cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from riftberg import Exchange, Iceberg, IceShelf, Model, OceanForcing, Parameters, ocean_grid
from riftberg.coupling.fluxes import mass_on_cells
from riftberg.errors import BergError, InputError, RiftbergError
from riftberg.life.ledger import scaled_mass

NJ, NI = 30, 36


def grid(west: float = -62.0, mask=None, latlon: bool = True):
    lon, lat = np.meshgrid(np.linspace(west, west + 3.0, NI + 1), np.linspace(-68.0, -66.8, NJ + 1))
    if latlon:
        return ocean_grid(lon, lat, mask=mask)
    return ocean_grid((lon - west) * 4e4, (lat + 68.0) * 1.1e5, mask=mask, latlon=False)


def ellipse(at=(18.0, 15.0), size=(9.0, 8.0)):
    """Mask of an ellipse; cells at its rim are ice in part."""
    j, i = np.mgrid[:NJ, :NI] + 0.5
    return np.clip(4.0 * (1.0 - np.hypot((i - at[0]) / size[0], (j - at[1]) / size[1])), 0.0, 1.0)


def slope():
    return 260.0 + 2.0 * (np.mgrid[:NJ, :NI][1] - 18.0) - 1.5 * (np.mgrid[:NJ, :NI][0] - 15.0)


def relative(berg: Iceberg, shelf: IceShelf) -> float:
    return abs(float(berg.elements.mass.sum() / shelf.mass.sum()) - 1.0)


@pytest.mark.quick(2)
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("radius", [2500.0, 1200.0])
def test_the_berg_has_the_mass_and_the_slope_of_the_shelf(packing, radius: float) -> None:
    shelf = IceShelf.of(grid(), ellipse() > 0.5, slope())
    berg = shelf.berg(radius=radius, packing=packing)
    assert relative(berg, shelf) < 1e-13
    (factor,) = berg.report["thickness_factor"]
    assert factor == pytest.approx(1.0, abs=0.02)
    e = berg.elements
    there = 260.0 + 2.0 * ((e.lon + 62.0) * 12.0 - 18.5) - 1.5 * ((e.lat + 68.0) * 25.0 - 15.5)
    # At the rim an element knows the ice under it alone, whose middle is not its own.
    inside = np.bincount(np.concatenate([berg.bonds.first, berg.bonds.second])) == (6 if packing == "hexagonal" else 4)
    np.testing.assert_allclose(e.thickness[inside] / factor, there[inside], rtol=0.0, atol=1.75)  # half a step
    assert np.unique(e.berg).size == 1
    np.testing.assert_allclose(e.mass, 850.0 * e.thickness * e.length * e.width, rtol=1e-13)


def test_a_cell_that_is_whole_up_to_rounding_is_whole() -> None:
    """Bug: a mask in single precision, whose cells were 0.99999994 ice, had no cell inside, and nothing to weigh there."""
    reports = [
        IceShelf.of(grid(), part * (ellipse() > 0.5), slope()).berg(radius=3000.0).report["misfit_inside"]
        for part in (1.0, 1.0 - 6e-8)
    ]
    assert reports[1] == pytest.approx(reports[0], rel=1e-3)


def test_inside_the_berg_weighs_what_the_shelf_did_and_the_rim_shrinks_with_the_elements() -> None:
    shelf = IceShelf.of(grid(), ellipse() > 0.5, slope())
    area = shelf.grid.arrays.area[shelf.grid.domain]
    rims = []
    for radius in (3000.0, 1000.0, 500.0):
        berg = shelf.berg(radius=radius)
        misfit = shelf.misfit(berg)
        assert 0.0 < berg.report["misfit_inside"] < 0.02
        assert abs(float((misfit * area).sum())) < 1e-12 * float(shelf.mass.sum())
        rims.append(float((np.abs(misfit) * area).sum() / shelf.mass.sum()))
    assert rims[0] > 1.5 * rims[1] > 2.0 * rims[2]
    assert rims[2] < 0.06


def test_cells_that_are_ice_in_part_count_by_their_part() -> None:
    shelf = IceShelf.of(grid(), ellipse(), slope(), 900.0)
    expected = 900.0 * ellipse() * slope() * shelf.grid.arrays.area[shelf.grid.domain]
    np.testing.assert_allclose(shelf.mass, expected, rtol=1e-14)
    assert relative(shelf.berg(radius=1200.0), shelf) < 1e-13


def test_pieces_that_do_not_touch_are_bergs_of_their_own_each_with_its_mass() -> None:
    mask = (ellipse((9.0, 15.0), (6.0, 8.0)) > 0.5) | (ellipse((27.0, 15.0), (5.0, 5.0)) > 0.5)
    shelf = IceShelf.of(grid(), mask, np.where(np.mgrid[:NJ, :NI][1] < 18, 300.0, 150.0))
    berg = shelf.berg(radius=1500.0)
    assert np.unique(berg.elements.berg).size == 2
    west = berg.elements.lon < -60.5
    for there, cells in ((west, np.s_[:, :18]), (~west, np.s_[:, 18:])):
        assert berg.elements.mass[there].sum() == pytest.approx(shelf.mass[cells].sum(), rel=1e-13)


def test_a_shelf_across_the_date_line_and_one_in_metres() -> None:
    here = IceShelf.of(grid(), ellipse() > 0.5, slope()).berg(radius=1500.0)
    across = IceShelf.of(grid(west=178.6), ellipse() > 0.5, slope())
    berg = across.berg(radius=1500.0)
    assert relative(berg, across) < 1e-13
    assert abs(berg.elements.size - here.elements.size) <= 2
    flat = IceShelf.of(grid(latlon=False), ellipse() > 0.5, slope())
    assert relative(flat.berg(radius=1500.0), flat) < 1e-13
    assert not flat.berg(radius=1500.0).latlon


def test_maps_on_longitudes_that_begin_anywhere_and_in_a_map_projection() -> None:
    lon, lat = np.linspace(0.05, 359.95, 3600), np.linspace(-71.95, -69.05, 30)
    away = np.hypot(((lon + 180.0) % 360.0 - 180.0) * 0.34, (lat + 70.5)[:, None])
    height = xr.DataArray(
        np.where(away < 0.5, 300.0 - 100.0 * away, 0.0), [("lat", lat), ("lon", lon)], name="thickness"
    )
    shelf = IceShelf.from_raster(height)
    berg = shelf.berg(radius=2000.0)
    assert relative(berg, shelf) < 1e-13
    assert float(shelf.mass.sum()) == pytest.approx(850.0 * 267.0 * np.pi * 0.25 * 111e3**2, rel=0.02)
    x = np.arange(-40.0, 40.0) * 1e3 + 500.0
    disc = np.hypot(x, x[:, None]) < 30e3
    polar = xr.DataArray(np.full(disc.shape, 250.0), [("y", x + 1.5e6), ("x", x - 9e5)])
    there = xr.DataArray(disc.astype(float), polar.coords)
    shelf = IceShelf.from_raster(polar, there, crs="EPSG:3031", earth_radius=6.371e6)
    berg = shelf.berg(radius=1500.0)
    assert relative(berg, shelf) < 1e-13
    assert np.unique(berg.elements.berg).size == 1
    scale = 0.992**2  # of the projection at 74 S, squared
    assert float(shelf.mass.sum()) == pytest.approx(850.0 * 250.0 * disc.sum() * 1e6 / scale, rel=0.02)


def exchange(melts: bool = False, **options) -> Exchange:
    """An ocean with a small berg far from the shelf."""
    g = grid()
    parameters = Parameters(
        bonds={"youngs_modulus": 1e6}, stepping={"time_step": 1800.0}, melt={"enabled": melts},
        earth={"radius": g.earth_radius},
    )  # fmt: skip
    start = Iceberg.rectangle(6e3, 6e3, thickness=150.0, placement=(-59.3, -66.95))
    return Exchange(Model(start, OceanForcing(g, g.fields(depth=600.0)), parameters), **options)


WARM = {"sea_surface_temperature": 2.0, "sea_surface_salinity": 34.0, "eastward_sea_water_velocity": 0.3,
        "northward_sea_water_velocity": 0.0}  # fmt: skip


@pytest.mark.parametrize("mask", [ellipse(), ellipse() > 0.5], ids=["parts", "whole cells"])
def test_no_cell_of_the_ocean_meets_a_jump_when_a_berg_calves(mask) -> None:
    run = exchange()
    before, area = run.mass_on_water(), run.grid.arrays.area[run.grid.domain]
    shelf = IceShelf.of(run.grid, mask, slope())
    stock = run.stocks()[0]
    ids = run.calve_shelf(mask, slope(), radius=2000.0)
    assert ids.size > 50
    np.testing.assert_allclose(run.mass_on_water(), before + shelf.mass / area, rtol=1e-12, atol=1e-7)
    assert run.stocks()[0] - stock == pytest.approx(float(shelf.mass.sum()), rel=1e-12)
    assert abs(run.balance().error) < 1e-12


def test_the_mass_on_cells_goes_over_into_that_of_the_berg() -> None:
    run = exchange(settling_time=1800.0)
    area = run.grid.arrays.area[run.grid.domain]
    run.calve_shelf(ellipse(), slope(), radius=2000.0)
    was, whole = run.mass_on_water(), float((run.mass_on_water() * area).sum())
    berg = mass_on_cells(run.model, run.grid)[0] / area
    rest = float(np.abs(was - berg).max())
    assert rest > 1e4
    for _ in range(12):
        now = run.step({})["ibmass"].values
        assert now.min() >= 0.0
        assert float((now * area).sum()) == pytest.approx(whole, rel=1e-12)
        # At rest nothing changes but what settles: 63 % of the rest in a settling time.
        assert np.abs(now - was).max() < 0.64 * rest
        was, rest = now, float(np.abs(now - mass_on_cells(run.model, run.grid)[0] / area).max())
    assert rest < 1.0


def test_a_berg_that_leaves_at_once_leaves_no_negative_mass() -> None:
    run = exchange(ocean_step=3600.0, settling_time=1e9)
    area = run.grid.arrays.area[run.grid.domain]
    run.calve_shelf(ellipse(), slope(), radius=2000.0, velocity=(2.0, 0.0))
    whole = float((run.mass_on_water() * area).sum())
    for _ in range(3):  # a fourth takes a piece over the edge of the grid
        now = run.step({"eastward_sea_water_velocity": 2.0, "northward_sea_water_velocity": 0.0})["ibmass"].values
        assert now.min() >= 0.0
        assert float((now * area).sum()) == pytest.approx(whole, rel=1e-12)


def test_ledgers_close_with_melt_and_a_resumed_exchange_goes_on_bit_for_bit(tmp_path: Path) -> None:
    run = exchange(melts=True)
    run.step(WARM)
    run.calve_shelf(ellipse(), slope(), radius=2500.0)
    for _ in range(2):
        run.step(WARM)
    assert run.model.life is not None
    balance = run.model.life.balance(run.model)
    assert balance.gained["calved"] == pytest.approx(IceShelf.of(run.grid, ellipse(), slope()).mass.sum(), rel=1e-13)
    run.model.save(tmp_path / "r.nc")
    on = Exchange(Model.resume(tmp_path / "r.nc", OceanForcing(run.grid, run.forcing.fields_at(0.0))))
    for _ in range(2):
        one, other = run.step(WARM), on.step(WARM)
    xr.testing.assert_identical(one, other)
    for ledger in (run.balance(), run.model.life.balance(run.model)):
        assert abs(ledger.error) < 1e-12
        assert abs(ledger.heat_error) < 1e-10
    e = run.model.elements
    assert scaled_mass(e.life, e.body.mass).sum() < run.balance().taken + run.balance().start


def test_what_cannot_calve_is_refused_by_name_and_leaves_all_as_it_was() -> None:
    run = exchange()
    count, before = run.model.elements.size, run.mass_on_water()
    thin = slope()
    thin[15, 18] = np.nan
    for mask, thickness, said in (
        (ellipse()[:, :-1], slope(), "mask.*cells"),
        (ellipse(), slope()[:-1], "thickness.*cells"),
        (2.0 * (ellipse() > 0.5), slope(), r"mask is 2 in cell"),
        (ellipse(), thin, r"thickness is nan in cell \(19, 16\)"),
        (ellipse(), -slope(), "thickness is -"),
        (ellipse(), 1e6, "Give metres"),
        (ellipse(), "thick", "'thick'"),
        (np.zeros((NJ, NI)), slope(), "no ice"),
        (ellipse((32.0, 26.0), (6.0, 6.0)), slope(), "lies where the ice shelf calves"),
    ):
        with pytest.raises(InputError, match=f"(?s){said}"):
            run.calve_shelf(mask, thickness)
    with pytest.raises(BergError, match="smaller than"):
        run.calve_shelf(ellipse(), slope(), radius=60e3)
    speck = (ellipse() > 0.5).astype(float)
    speck[2, 2] = 1.0
    with pytest.raises(RiftbergError, match=r"piece . of 2 of the ice shelf is smaller than an element"):
        run.calve_shelf(speck, slope(), radius=4500.0)
    assert run.model.elements.size == count
    np.testing.assert_array_equal(run.mass_on_water(), before)
    sea = np.ones((NJ, NI))
    sea[10:20, 10:20] = 0.0
    g = grid(mask=sea)
    start = Iceberg.rectangle(6e3, 6e3, thickness=150.0, placement=(-59.3, -66.95))
    dry = Exchange(Model(start, OceanForcing(g, g.fields(depth=600.0)), run.model.parameters))
    with pytest.raises(InputError, match="land for the ocean"):
        dry.calve_shelf(ellipse(), slope())


def test_maps_that_cannot_be_are_refused() -> None:
    x = np.arange(5.0) * 1e4
    metres = xr.DataArray(np.full((5, 5), 200.0), [("y", x), ("x", x)])
    with pytest.raises(InputError, match="EPSG:3031"):
        IceShelf.from_raster(metres)
    with pytest.raises(InputError, match="another grid"):
        IceShelf.from_raster(metres, metres.isel(x=slice(1, 4)) * 0 + 1, crs="EPSG:3031")
    with pytest.raises(InputError, match="no map"):
        IceShelf.from_raster(200.0)


def shelf_file(folder: Path, **keys) -> Path:
    """An experiment whose berg calves from a shelf in a file."""
    lon, lat = np.linspace(-61.95, -59.05, 30), np.linspace(-67.98, -67.02, 25)
    away = np.hypot((lon + 60.5) * 0.38, (lat + 67.5)[:, None])
    map_ = xr.Dataset(
        {"thickness": (("lat", "lon"), 250.0 + 0.0 * away), "calves": (("lat", "lon"), (away < 0.25) * 1.0)},
        {"lon": lon, "lat": lat},
    )
    map_.to_netcdf(folder / "shelf.nc")
    more = "".join(f", {name}: {value}" for name, value in keys.items())
    path = folder / "e.yaml"
    path.write_text(
        "start: 2020-12-09\ndays: 1\nforcing: {uniform: {}}\n"
        f"berg: {{shelf: {{file: shelf.nc, variable: thickness, mask: calves}}, radius: 1200 m{more}}}\n"
        "parameters: {ice: {density: 880}}\n"
    )
    return path


def test_an_experiment_file_may_name_a_shelf(tmp_path: Path) -> None:
    from riftberg import Options, build

    model, _ = build(str(shelf_file(tmp_path, packing="hexagonal")), Options())
    with xr.open_dataset(tmp_path / "shelf.nc") as map_:
        shelf = IceShelf.from_raster(map_, map_, variable="thickness", mask_variable="calves", density=880.0,
                                     earth_radius=model.parameters.earth.radius)  # fmt: skip
    assert model.elements.mass.sum() == pytest.approx(shelf.mass.sum(), rel=1e-13)
    assert (model.elements.sides == 6).all()
    with pytest.raises(InputError, match="a berg from a shelf has no thickness"):
        build(str(shelf_file(tmp_path, thickness="200 m")), Options())
