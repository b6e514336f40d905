"""Arrays as text for a web page: quantised integers in base64 with scale and offset."""

from __future__ import annotations

import base64
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_MISSING: Final = {"int16": -32768, "uint16": 65535, "uint8": 255}
_LIMITS: Final = {"int16": (-32767, 32767), "uint16": (0, 65534), "uint8": (0, 254)}


def pack(values: NDArray[Any], kind: str = "int16", *, step: float | None = None) -> dict[str, Any]:
    """Quantise an array."""
    low, high = _LIMITS[kind]
    values = np.asarray(values, np.float64)
    there = np.isfinite(values)
    if step is not None:
        scale, offset = step, 0.0
    else:
        least, most = (float(values[there].min()), float(values[there].max())) if there.any() else (0.0, 0.0)
        scale = (most - least) / (high - low) or 1.0
        offset = least - scale * low
    numbers = np.clip(np.rint((np.where(there, values, 0.0) - offset) / scale), low, high)
    stored = np.where(there, numbers, _MISSING[kind]).astype(np.dtype(kind).newbyteorder("<"))
    return {
        "kind": kind,
        "shape": list(values.shape),
        "scale": scale,
        "offset": offset,
        "missing": _MISSING[kind],
        "data": base64.b64encode(stored.tobytes()).decode("ascii"),
    }


def unpack(packed: dict[str, Any]) -> NDArray[np.float64]:
    """Return the values of a packed array, as the page sees them."""
    raw = np.frombuffer(base64.b64decode(packed["data"]), np.dtype(packed["kind"]).newbyteorder("<"))
    values = packed["offset"] + packed["scale"] * raw.astype(np.float64)
    return np.where(raw == packed["missing"], np.nan, values).reshape(packed["shape"])
