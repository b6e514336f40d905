"""The picture of a berg in a notebook."""

from __future__ import annotations

import re

import numpy as np
import pytest

from riftberg import Iceberg


def corners(berg):
    """Return the corners (pixels) of the elements in the picture of a berg."""
    texts = re.findall(r'points="([^"]+)"', berg._repr_html_())
    return np.array([[[float(n) for n in pair.split(",")] for pair in text.split()] for text in texts])


@pytest.mark.parametrize("lon", [180.0, -179.9, 0.0, 359.95])
def test_a_berg_across_the_date_line_looks_as_anywhere(lon):
    here, there = (Iceberg.rectangle(30e3, 15e3, thickness=200.0, placement=(x, -60.0)) for x in (-30.0, lon))
    np.testing.assert_allclose(corners(there), corners(here), atol=0.11)


def test_the_picture_has_true_proportions_with_north_up_and_east_on_the_right():
    berg = Iceberg.rectangle(30e3, 15e3, thickness=200.0, placement=(-30.0, -60.0))
    middle = corners(berg).mean(axis=1)
    wide, high = np.ptp(middle, axis=0)
    assert wide / high == pytest.approx(27.0 / 12.0, rel=0.01)
    assert np.corrcoef(middle[:, 0], berg.elements.lon)[0, 1] > 0.999
    assert np.corrcoef(middle[:, 1], berg.elements.lat)[0, 1] < -0.999
