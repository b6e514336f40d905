"""Which records of a run a picture shows."""

from __future__ import annotations

import numpy as np

from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import InputError
from riftberg.runs.scene import Scene


def even_records(scene: Scene, count: int) -> list[int]:
    """Return records from the first to the last, evenly spaced, on whole days where the run is long enough."""
    seconds = scene.seconds - scene.seconds[0]
    moments = np.linspace(0.0, seconds[-1], min(count, len(seconds)))
    day = SECONDS_PER_DAY
    if seconds[-1] >= count * day:
        moments[1:-1] = day * np.round(moments[1:-1] / day)
    return sorted({int(np.argmin(np.abs(seconds - moment))) for moment in moments})


def telling_records(scene: Scene, count: int) -> list[int]:
    """Return the first and the last record, those 6 h after large break-ups, and evenly spaced ones between."""
    births = [birth[0] + np.timedelta64(6, "h") for n in scene.numbers if (birth := scene.birth(n)) is not None]
    after = [int(np.argmin(np.abs(scene.times - birth))) for birth in births]
    records = {0, len(scene.times) - 1, *after[: count - 2]}
    spacing = len(scene.times) / (2.5 * count)
    for record in even_records(scene, count):
        if len(records) < count and all(abs(record - other) >= spacing for other in records):
            records.add(record)
    return sorted(records)


def nearest_record(scene: Scene, moment: np.datetime64) -> int:
    """Return the record nearest to a date; refuses one more than an hour, or half a step of the records, outside of the run."""
    gaps = np.abs(scene.times - moment)
    nearest = int(np.argmin(gaps))
    steps = np.diff(scene.times)
    if gaps[nearest] > max(np.timedelta64(1, "h"), 0.51 * steps.max() if len(steps) else np.timedelta64(0, "h")):
        first, last = (scene.times[k].astype("datetime64[m]") for k in (0, -1))
        raise InputError(
            f"{moment.astype('datetime64[m]')} is not in the run", where="--date",
            remedy=f"The run goes from {first} to {last}",
        )  # fmt: skip
    return nearest
