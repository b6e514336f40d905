"""Sections of files that users write: keys with a default, a unit, a meaning and limits."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

Pair = tuple[float, float]


class Section(BaseModel):
    """Base of all sections: unknown keys refused, numbers finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def key(default: Any, unit: str, meaning: str, **limits: Any) -> Any:
    """Describe one key: default, unit, meaning and limits."""
    return Field(default, description=meaning, json_schema_extra={"unit": unit}, **limits)


def refuse_beyond(section: Section, most: dict[str, float]) -> None:
    """Raise `ValueError` where a value, or one of a pair, is larger than anything in nature."""
    for name, limit in most.items():
        beyond(type(section), name, getattr(section, name), limit)


def beyond(section: type[Section], name: str, value: Any, limit: float) -> None:
    """Raise `ValueError` where one value, or one of a pair, is larger than anything in nature."""
    if any(abs(part) > limit for part in (value if isinstance(value, tuple) else (value,))):
        extra = section.model_fields[name].json_schema_extra
        unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
        named = "" if unit in ("", "1") else f" {unit}"
        raise ValueError(f"{name} = {value} is not possible; the most is {limit:g}{named}")
