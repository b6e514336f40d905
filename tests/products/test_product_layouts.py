"""The small files of these tests have the headers that the products publish."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from products import product_files as files

LAYOUTS = {
    "oscar_v2_final": files.oscar_v2,
    "oscar_v1_thirddeg": files.oscar_v1,
    "era5_cds_new": files.era5_new,
    "ncep_r1_uwnd10m": files.ncep_r1,
    "osisaf_ice_conc": files.osisaf,
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_file_has_the_published_header(layout: str, tmp_path: Path, shared: Path) -> None:
    made: Callable[[Path], Path] = LAYOUTS[layout]
    published = files.header_of((shared / "data" / "layouts" / f"{layout}.cdl").read_text())
    variables, attributes = files.header_in(made(tmp_path))
    assert variables == published[0]
    assert attributes >= published[1]
