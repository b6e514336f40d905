"""Files find their product, and files that are no forcing say what they are."""

from __future__ import annotations

import gzip
import zipfile
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from products import product_files as files
from riftberg import open_product
from riftberg.errors import ForcingError
from riftberg.products import PRODUCTS, product_named, recognise
from riftberg.products.product import Heading
from riftberg.products.quantities import QUANTITIES, conversion
from riftberg.products.reading import open_raw

SAMPLES = {
    "samples/20030101000000-GLOBCURRENT-L4-CUReul_hs-ALT_SUM-v02.0-fv01.0.nc": "globcurrent",
    "samples/ERA5_NA_2012.nc": "era5",
    "samples/GLORYS_NA_20120101.nc": "glorys",
    "samples/nrt_global_allsat_phy_l4_20190223_20190226.nc": "duacs",
    "samples/r1_v2014_air.2m.gauss.1960.nc": "ncep-r1",
    "samples/srtm15_coarsened.nc": "srtm15",
    "observed/gebco_for_plots.nc": "gebco",
    "a68a/a68_experiment_gebco_ll_p125.nc": "a68a",
    "a68a/a68_experiment_ssh_oras5_dec2020_ll_p125.nc": "a68a",
    "a68a/a68_experiment_wind_vel_jra55_dec2020_ll_p125.nc": "a68a",
}


@pytest.mark.parametrize("name", SAMPLES)
def test_real_sample_matches_one_product_only(name: str, shared: Path) -> None:
    path = shared / "data" / name
    assert recognise(path).name == SAMPLES[name]
    raw = open_raw(str(path))
    matching = [product.name for product in PRODUCTS if product.matches(Heading.of(raw))]
    assert matching == [SAMPLES[name]]


@pytest.mark.parametrize("how", ["title", "level", "title and level", "neither"])
def test_the_second_reanalysis_of_ncep_is_told_by_its_title_or_its_level(how: str, tmp_path: Path) -> None:
    """Its files have winds and axes of the names of the first."""
    path = files.ncep_r1(tmp_path)
    with xr.open_dataset(path, decode_cf=False) as ds:
        ds = ds.load()
    if "level" in how:
        ds["uwnd"] = ds["uwnd"].expand_dims(level=[10.0], axis=1)
        ds["level"].attrs["units"] = "m"
    ds.attrs["title"] = "4x daily NCEP/DOE Reanalysis 2" if "title" in how else "winds"
    ds.to_netcdf(tmp_path / "other.nc")
    assert recognise(tmp_path / "other.nc").name == ("ncep-r1" if how == "neither" else "ncep-r2")


def test_every_product_states_origin_and_known_quantities() -> None:
    assert len({product.name for product in PRODUCTS}) == len(PRODUCTS)
    for product in PRODUCTS:
        assert product.evidence in {"sample", "layout", "documentation"}
        assert product.citation
        for source in product.sources:
            units = source.units or QUANTITIES[source.quantity].units
            assert conversion(QUANTITIES[source.quantity], units, where=product.name)


def test_product_by_name_or_a_list_of_names() -> None:
    assert product_named("era5").name == "era5"
    with pytest.raises(ForcingError, match=r"Choose one of: .*oscar-v2"):
        product_named("oscar")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"<!DOCTYPE html><html>login</html>", "a web page"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n", "Git LFS pointer"),
        (b"GRIB\x00\x00\x00\x01", "a GRIB file"),
        (b"nothing known", "not a netCDF file"),
        (b"", "the file is empty"),
    ],
)
def test_file_that_is_no_netcdf_says_what_it_is(content: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "forcing.nc"
    path.write_bytes(content)
    with pytest.raises(ForcingError, match=words):
        recognise(path)


def test_packed_archives_say_how_to_unpack(tmp_path: Path) -> None:
    packed = tmp_path / "oscar_vel2020.nc.gz"
    packed.write_bytes(gzip.compress(b"CDF"))
    archive = tmp_path / "era5.zip"
    with zipfile.ZipFile(archive, "w") as bundle:
        bundle.writestr("data.nc", b"CDF")
    with pytest.raises(ForcingError, match="gunzip"):
        open_product(packed)
    with pytest.raises(ForcingError, match="Unzip"):
        open_product(archive)


def test_file_cut_short_is_reported_with_its_name(tmp_path: Path) -> None:
    path = files.oscar_v2(tmp_path)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(ForcingError, match=r"oscar_currents_final_20201216\.nc: the file is cut short: 3000 of"):
        open_product(path)


def test_absent_file_and_empty_pattern(tmp_path: Path) -> None:
    with pytest.raises(ForcingError, match="does not exist"):
        open_product(tmp_path / "absent.nc")
    with pytest.raises(ForcingError, match="no file matches"):
        open_product(str(tmp_path / "*.nc"))


def test_store_that_is_not_there_says_what_to_check(tmp_path: Path) -> None:
    pytest.importorskip("zarr")
    with pytest.raises(ForcingError, match="the store cannot be opened"):
        open_product(tmp_path / "absent.zarr")


def test_iceberg_restart_is_not_taken_for_forcing(shared: Path) -> None:
    with pytest.raises(ForcingError, match="may be no forcing file"):
        open_product(shared / "data" / "a68a" / "icebergs.res.nc")


@pytest.mark.parametrize("side", [300, 8200])
def test_only_large_files_are_read_in_parts(tmp_path: Path, side: int) -> None:
    """Parts of a small file take longer to keep account of than to read: they were a third of the time of the readers."""
    pytest.importorskip("dask")
    variables = {
        "lat": ("f8", ("lat",), np.linspace(-60.0, -50.0, side), {"units": "degrees_north"}),
        "lon": ("f8", ("lon",), np.linspace(-45.0, -35.0, side), {"units": "degrees_east"}),
        "elevation": ("i2", ("lat", "lon"), np.full((side, side), -1000, dtype=np.int16), {"units": "m"}),
    }
    path = files.write(tmp_path / "gebco.nc", {"lat": side, "lon": side}, variables, title="The GEBCO_2021 Grid")
    with open_product(path) as ds:
        assert bool(ds.chunks) == (side == 8200)


def test_opening_reads_no_field(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Opening and windowing a large file must not read it: only the window's chunks are read, on demand."""
    pytest.importorskip("dask")
    from xarray.backends.netCDF4_ import NetCDF4ArrayWrapper

    side = 8200
    path = files.write(
        tmp_path / "gebco.nc",
        {"lat": side, "lon": side},
        {
            "lat": ("f8", ("lat",), np.linspace(-60.0, -50.0, side), {"units": "degrees_north"}),
            "lon": ("f8", ("lon",), np.linspace(-45.0, -35.0, side), {"units": "degrees_east"}),
            "elevation": ("i2", ("lat", "lon"), np.full((side, side), -1000, dtype=np.int16), {"units": "m"}),
        },
        title="The GEBCO_2021 Grid",
    )
    read: list[int] = []
    fetch = NetCDF4ArrayWrapper._getitem

    def counted(self: NetCDF4ArrayWrapper, key: object) -> np.ndarray:
        values = fetch(self, key)
        read.append(int(np.size(values)))
        return values

    monkeypatch.setattr(NetCDF4ArrayWrapper, "_getitem", counted)

    from riftberg.products import window

    ds = window(open_product(path), (-40.0, -39.9), (-55.0, -54.9))
    assert max(read) <= side
    assert isinstance(ds, xr.Dataset)
    assert float(ds["depth_below_surface"].mean()) == 1000.0


def test_without_dask_files_are_read_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from riftberg.products import reading

    monkeypatch.setattr(reading, "find_spec", lambda name: None)
    ds = open_product(files.oscar_v2(tmp_path))
    assert ds["uo"].values[0, 1, 1] == pytest.approx(0.21)
