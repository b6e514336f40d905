"""Fields of bergs: sizes from the literature, places without overlap, the same again with the same seed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from riftberg import Iceberg
from riftberg.errors import BergError, RiftbergError

EXPONENT = 1.52
LENGTHS = np.array([60.0, 100.0, 200.0, 350.0, 500.0, 700.0, 900.0, 1200.0, 1600.0, 2200.0])
SHARES = np.array([0.24, 0.12, 0.15, 0.18, 0.12, 0.07, 0.03, 0.03, 0.03, 0.02])

BOX = (-40.0, -36.0, -58.0, -56.0)


def test_the_same_seed_gives_the_same_field() -> None:
    a, b, c = (Iceberg.field(50, BOX, seed=seed).elements for seed in (1, 1, 2))
    np.testing.assert_array_equal(a.lon, b.lon)
    np.testing.assert_array_equal(a.mass, b.mass)
    assert not np.array_equal(a.lon, c.lon)
    drawn = Iceberg.field(5, BOX)
    again = Iceberg.field(5, BOX, seed=drawn.report["seed"])
    np.testing.assert_array_equal(drawn.elements.lat, again.elements.lat)


@pytest.mark.parametrize("sizes", ["gladstone", "tournadre", [4e6, 1e6]])
@pytest.mark.parametrize("latlon", [True, False])
def test_no_two_bergs_overlap_whatever_way_they_turn(sizes: Any, latlon: bool) -> None:
    box = (179.0, 181.5, -70.0, -69.4) if latlon else (0.0, 100e3, 0.0, 60e3)
    field = Iceberg.field(250, box, sizes=sizes, seed=3, gap=50.0, latlon=latlon)
    e = field.elements
    assert field.bonds.first.size == 0
    assert len(field.names) == len(set(field.names)) == 250
    metre = np.pi / 180.0 * 6363827.0
    x = e.lon * (metre * np.cos(np.radians(-69.7)) if latlon else 1.0)
    y = e.lat * (metre if latlon else 1.0)
    apart = np.hypot(x[:, None] - x, y[:, None] - y) + 1e9 * np.eye(250)
    reach = 0.5 * np.hypot(e.length, e.width)
    assert (apart > 0.99 * (reach[:, None] + reach) + 49.0).all()
    assert ((e.lon >= box[0]) & (e.lon <= box[1]) & (e.lat >= box[2]) & (e.lat <= box[3])).all()


def test_sizes_follow_the_classes_of_gladstone() -> None:
    e = Iceberg.field(4000, (0.0, 4e6, 0.0, 4e6), seed=1, latlon=False).elements
    length = np.round(e.length, 6)
    np.testing.assert_allclose(e.length, 1.5 * e.width, rtol=1e-12)
    np.testing.assert_allclose(e.mass, 850.0 * e.thickness * e.length * e.width, rtol=1e-12)
    found = np.array([(length == value).mean() for value in LENGTHS])
    np.testing.assert_allclose(found, SHARES / SHARES.sum(), atol=0.03)
    assert set(e.thickness[length == 100.0]) == {67.0}
    assert set(e.thickness[length == 1600.0]) == {250.0}


def test_sizes_follow_the_power_law_of_tournadre() -> None:
    """The number of bergs above an area falls with its power -0.52, far from the upper end."""
    between = (1e5, 1e9)
    e = Iceberg.field(5000, (0.0, 1e7, 0.0, 1e7), sizes="tournadre", between=between, seed=1, latlon=False).elements
    area = e.length * e.width
    edges = np.geomspace(1e5, 1e7, 5)
    fall = 1.0 - EXPONENT
    expected = (edges**fall - between[1] ** fall) / (between[0] ** fall - between[1] ** fall)
    np.testing.assert_allclose([(area > edge).mean() for edge in edges * (1.0 + 1e-9)], expected, atol=0.015)
    assert (area.min() >= 1e5 * (1.0 - 1e-9), area.max() <= 1e9) == (True, True)
    assert area.max() > 1e8


def test_thickness_rises_with_size_up_to_a_largest() -> None:
    area = np.geomspace(1e3, 1e8, 50)
    e = Iceberg.field(50, (0.0, 1e6, 0.0, 1e6), sizes=area, seed=1, latlon=False).elements
    thickness = e.thickness[np.argsort(e.length * e.width)]
    assert (np.diff(thickness) >= 0.0).all()
    assert (thickness[0], thickness[-1]) == (40.0, 250.0)
    assert set(Iceberg.field(5, BOX, seed=1, thickness=99.0).elements.thickness) == {99.0}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"sizes": "gladston"}, "Use gladstone, tournadre"),
        ({"sizes": [-1.0]}, "no areas"),
        ({"sizes": "tournadre", "between": (2.0, 1.0)}, "smaller one above 0 first"),
        ({"sizes": [1e10], "n": 50}, "no place is left for berg"),
        ({"area": (-36.0, -40.0, -58.0, -56.0)}, "west, east, south and north"),
        ({"n": 0}, "0 is not possible"),
        ({"thickness": -1.0}, "thickness"),
    ],
)
def test_what_cannot_be_a_field_is_refused(options: dict[str, Any], words: str) -> None:
    given = {"n": 5, "area": BOX, "seed": 1, **options}
    with pytest.raises(RiftbergError, match=words):
        Iceberg.field(given.pop("n"), given.pop("area"), **given)
    assert issubclass(BergError, RiftbergError)


def test_options_of_a_field_are_refused_by_name_before_it_is_drawn() -> None:
    with pytest.raises(TypeError, match=r"'densty'\. Did you mean 'density'\?"):
        Iceberg.field(5, BOX, densty=900.0)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="'radius'"):
        Iceberg.field(5, BOX, radius=900.0)  # type: ignore[call-arg]
    with pytest.raises(BergError, match="density"):
        Iceberg.field(5, BOX, density=-1.0)
