"""Options that are numbers, or two of something with a comma between them: a box, a span of dates."""

from __future__ import annotations

import math

from riftberg.errors import InputError
from riftberg.system.input_files import value_shown


def positive(value: float | None, option: str, unit: str, most: float = math.inf) -> None:
    """Refuse an option that is no finite number above 0."""
    if value is not None and not (0.0 < value <= most and math.isfinite(value)):
        to = f", at most {most:g}" if math.isfinite(most) else ""
        raise InputError(f"{value:g} {unit}", where=option, remedy=f"Give a number above 0{to or ', not infinity'}")


def within(value: float | None, option: str, low: float, high: float) -> None:
    """Refuse an option outside its limits; NaN is outside of all."""
    if value is not None and not low <= value <= high:
        raise InputError(f"{value:g} is not possible", where=option, remedy=f"Give a number from {low:g} to {high:g}")


def pair(text: str | None, where: str) -> tuple[float, float] | None:
    """Read two numbers with a comma between them."""
    if text is None:
        return None
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(
            f"{value_shown(text)} is not two numbers", where=where, remedy=f"For example {where} -43,-33"
        ) from error
    most = 90.0 if where == "--lat" else 540.0
    if not (abs(first) <= most and abs(second) <= most):
        raise InputError(
            f"{value_shown(text)} are no degrees", where=where, remedy=f"Give two numbers from {-most:g} to {most:g}"
        )
    if first >= second:
        raise InputError(
            f"{first:g} is not below {second:g}", where=where,
            remedy="The smaller number stands first; across the date line count on beyond 180",
        )  # fmt: skip
    return first, second


def dates(text: str | None, where: str = "--time") -> tuple[str, str] | None:
    """Read two dates with a comma between them."""
    if text is None:
        return None
    from riftberg.diagnostics.dates import parse_date

    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 2:
        raise InputError(
            f"{value_shown(text)} is not two dates", where=where, remedy=f"For example {where} 2020-12-09,2020-12-25"
        )
    first, last = (parse_date(part, where=where)[0] for part in parts)
    if first > last:
        raise InputError(f"{parts[0]} is later than {parts[1]}", where=where, remedy="The earlier date stands first")
    return first.isoformat(), last.isoformat()
