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
