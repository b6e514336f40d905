"""DUACS level-4 sea level (SSALTO/DUACS, Copernicus Marine): absolute dynamic topography, 1/4 and 1/8 degree.

Checked against a real global 1/4 degree file (longitudes 0.125..359.875); the 1/8 degree layout (-179.9375..179.9375)
follows the documentation. ``adt`` is taken as sea surface height: the slope force needs the height above the geoid, and
``sla`` (the anomaly from a long-time mean) lacks the mean currents.
"""

from __future__ import annotations

import xarray as xr

from riftberg.products.product import Evidence, Product, Source, text_of


def _matches(ds: xr.Dataset) -> bool:
    words = "duacs" in text_of(ds, "title", "summary", "source", "comment") or "allsat" in text_of(ds, "title")
    return "adt" in ds.variables or ("sla" in ds.variables and words)


_VARIANTS: tuple[tuple[str, Evidence], ...] = (("1/8 degree", "documentation"),)

PRODUCT = Product(
    name="duacs",
    title="SSALTO/DUACS level-4 absolute dynamic topography, daily",
    citation="E.U. Copernicus Marine Service, SEALEVEL_GLO_PHY_L4_MY_008_047, doi:10.48670/moi-00148",
    evidence="sample",
    matches=_matches,
    sources=(Source("ssh", ("adt",), "m"),),
    variants=_VARIANTS,
    left_out=("ugos", "vgos"),
    notes=(
        "ssh is the absolute dynamic topography adt (height above the geoid), not the anomaly sla",
        "one map a day, stamped 00:00 UTC",
        "geostrophic velocities (ugos, vgos) are not taken as currents: they lack the wind-driven part",
    ),
)

GEOSTROPHIC = Product(
    name="duacs-geostrophic",
    title="SSALTO/DUACS level-4 sea level with its geostrophic currents, daily",
    citation=PRODUCT.citation,
    evidence="sample",
    matches=lambda ds: False,
    sources=(*PRODUCT.sources, Source("uo", ("ugos",), "m s-1"), Source("vo", ("vgos",), "m s-1")),
    variants=_VARIANTS,
    notes=("uo, vo are geostrophic only: they lack the wind-driven part", *PRODUCT.notes[:2]),
)
