"""Numbers with units."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from keys import SECTIONS, TOP, extra, keys
from riftberg.config.units import to_unit
from riftberg.parameters import fields_by_path


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
        ("150 kPa m1/2", "Pa m1/2", 1.5e5),
        ("0.15 MPa m^0.5", "Pa m1/2", 1.5e5),
        ("0.15 MPa m^(1/2)", "Pa m1/2", 1.5e5),
        ("0.15 MPa sqrt(m)", "Pa m1/2", 1.5e5),
        ("0.85 g/cm3", "kg m-3", 850.0),
        ("10 hPa", "Pa", 1000.0),
        ("2 hrs", "s", 7200.0),
        ("1.5 kilometres", "m", 1500.0),
        ("3 °C", "degC", 3.0),
        ("\N{MINUS SIGN}3.5 km", "m", -3500.0),  # as word processors write it
        ("1e\N{MINUS SIGN}3 m", "m", 1e-3),
        ("15 deg/h", "degree h-1", 15.0),
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


@pytest.mark.parametrize(("text", "unit", "value"), [("36 km/h", "m s-1", 10.0), ("0.85 g/cm3", "kg m-3", 850.0),
                                                     ("1.1 km", "m", 1100.0), ("0.1 Gt", "kg", 1e11)])  # fmt: skip
def test_a_quantity_is_the_nearest_number_to_what_is_written(text: str, unit: str, value: float) -> None:
    """Not 10.000000000000002: factors are exact, and the number is read as it is written."""
    assert to_unit(text, unit) == value


def test_every_unit_of_a_parameter_or_a_key_can_be_written_behind_its_value() -> None:
    """That of the toughness, Pa m1/2, could not: its slash was taken for that of m/s."""
    groups = [fields_by_path(), TOP, *(keys(section) for section in SECTIONS)]
    units = {extra(field, "unit") for fields in groups for field in fields.values()} - {None, ""}
    assert "Pa m1/2" in units
    for unit in sorted(units):
        for one in unit.split(" or "):
            assert to_unit(f"2.5 {one}", unit) == 2.5


@pytest.mark.parametrize(
    ("unit", "wanted", "meant"),
    [
        ("dys", "s", "days"), ("kilometrs", "m", "kilometres"), ("kPA", "Pa", "kPa"), ("Km", "m", "km"), ("KPa", "Pa", "kPa"),
        ("KM/H", "m s-1", "km/h"), ("KN", "N", "kN"), ("KN", "m s-1", "kn"), ("KG/M3", "kg m-3", "kg/m3"),
        ("milimetres", "m", "millimetres"), ("HPA", "Pa", "hPa"), ("knotts", "m s-1", "knots"),
    ],
)  # fmt: skip
def test_the_same_word_in_other_case_or_with_a_slip_is_offered(unit: str, wanted: str, meant: str) -> None:
    """Bug: for 9 Km 'm' was offered, for 25 KPa 'Pa', for 9 KM 'K': who followed got a berg of 9 m."""
    with pytest.raises(ValueError, match=rf"did you mean '{meant}'\?"):
        to_unit(f"3 {unit}", wanted)


@pytest.mark.parametrize(
    ("unit", "wanted"),
    [
        ("Mm", "m"), ("mPa", "Pa"), ("MM", "m"), ("nm", "m"), ("dPa", "Pa"), ("micrometre", "m"), ("decametre", "m"),
        ("terapascal", "Pa"), ("dys", "m"), ("KPa", "m"), ("KN", "kg"), ("league", "m"), ("lb", "kg"),
    ],
)  # fmt: skip
def test_no_unit_of_another_dimension_or_magnitude_is_offered(unit: str, wanted: str) -> None:
    with pytest.raises(ValueError, match="is not a unit that Riftberg knows; it knows"):
        to_unit(f"3 {unit}", wanted)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("9 ft", "m", 2.7432), ("9 feet", "m", 2.7432), ("2 mile", "m", 3218.688), ("2 Miles", "m", 3218.688),
        ("2 nmi", "m", 3704.0), ("2 NM", "m", 3704.0), ("2 nautical miles", "m", 3704.0), ("100 fathoms", "m", 182.88),
        ("18 kts", "m s-1", 9.26), ("18 kt", "m s-1", 9.26), ("18 Knots", "m s-1", 9.26), ("36 kph", "m s-1", 10.0),
        ("10 mph", "m s-1", 4.4704), ("3 degrees C", "degC", 3.0), ("3 ℃", "degC", 3.0), ("3 deg_C", "degC", 3.0),
        ("3 Celsius", "degC", 3.0), ("3 C", "degC", 3.0), ("3 Kelvin", "K", 3.0), ("5 kilopascals", "Pa", 5000.0),
        ("3 m s⁻¹", "m s-1", 3.0), ("3 km²", "m2", 3e6), ("2 Days", "s", 172_800.0), ("2 weeks", "s", 1_209_600.0),
        ("2 gigatonnes", "kg", 2e12),
    ],
)  # fmt: skip
def test_units_as_people_at_sea_write_them(text: str, unit: str, value: float) -> None:
    assert to_unit(text, unit) == value


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_plain_numbers_stay_as_they_are(value: float) -> None:
    assert to_unit(repr(value), "Pa") == value


def test_a_unit_divided_by_itself_has_no_dimension() -> None:
    assert to_unit("3 m/m", "1") == 3.0
    with pytest.raises(ValueError, match="measured in m"):
        to_unit("3 m/m", "m")
