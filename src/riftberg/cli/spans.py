"""Options that are two of something with a comma between them: a box, a span of dates."""

from __future__ import annotations

from riftberg.errors import InputError


def pair(text: str | None, where: str) -> tuple[float, float] | None:
    """Read two numbers with a comma between them."""
    if text is None:
        return None
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(f"{text!r} is not two numbers", where=where, remedy=f"For example {where} -43,-33") from error
    return first, second


def dates(text: str | None, where: str = "--time") -> tuple[str, str] | None:
    """Read two dates with a comma between them."""
    if text is None:
        return None
    from riftberg.diagnostics.dates import parse_date

    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 2:
        raise InputError(f"{text!r} is not two dates", where=where, remedy=f"For example {where} 2020-12-09,2020-12-25")
    first, last = (parse_date(part, where=where)[0].isoformat() for part in parts)
    return first, last
