"""Numbers with units."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riftberg.units import parse_unit, to_unit


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("18 kPa", "Pa", 18_000.0),
        ("18kPa", "Pa", 18_000.0),
        ("1.5 km", "m", 1500.0),
        ("30 min", "s", 1800.0),
        ("5e6", "Pa", 5e6),
        ("-2", "m s-1", -2.0),
        ("36 km/h", "m s-1", 10.0),
        ("0.22 m/s", "m s-1", 0.22),
        ("0.22 m s-1", "m s-1", 0.22),
        ("0.22 m s^-1", "m s-1", 0.22),
        ("850 kg/m3", "kg m-3", 850.0),
        ("0.85 t m-3", "kg m-3", 850.0),
        ("5 mm", "m", 0.005),
        ("1 N/m2", "Pa", 1.0),
        ("50 %", "1", 0.5),
        ("0.5", "", 0.5),
        ("12 deg", "degree", 12.0),
        ("1 kn", "m s-1", 1852.0 / 3600.0),
        ("1e4 kg m-2 s-1", "kg m-2 s-1", 1e4),
    ],
)
def test_quantities(text: str, unit: str, value: float) -> None:
    assert to_unit(text, unit) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "unit", "message"),
    [
        ("18 km", "Pa", "measured in Pa"),
        ("18 Pa", "", "no unit"),
        ("18 parsec", "m", "not a unit"),
        ("many", "m", "not a number"),
        ("3 m s-2", "m s-1", "measured in m s-1"),
        ("", "m", "not a number"),
    ],
)
def test_wrong_units_are_refused(text: str, unit: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        to_unit(text, unit)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_plain_numbers_stay_as_they_are(value: float) -> None:
    assert to_unit(repr(value), "Pa") == value


def test_a_unit_divided_by_itself_has_no_dimension() -> None:
    assert parse_unit("m/m").powers == {}
