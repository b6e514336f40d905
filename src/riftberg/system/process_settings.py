"""Settings that all threads of a process share, changed for a block by one thread at a time.

Python's filters of warnings and the settings of dask are put back at the end of a block to what they were at its
beginning. Where two blocks overlap, the second one puts back what the first one had set, for ever.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, cast

SETTINGS: Final = threading.RLock()
"""Held by whoever changes such a setting for a while."""


@contextmanager
def own_filters() -> Iterator[None]:
    """Let a block set filters of warnings, which end with it.

    Other libraries' `warnings.catch_warnings` may begin or end in other threads meanwhile and put another list in place of
    the one that the block began with; its own filters are then taken out of both.
    """
    with SETTINGS:
        begun, before = cast("list[Any]", warnings.filters), list(warnings.filters)
        try:
            yield
        finally:
            own = [entry for entry in begun if all(entry is not kept for kept in before)]
            if warnings.filters is begun:
                begun[:] = before
            else:
                for filters in (begun, cast("list[Any]", warnings.filters)):
                    filters[:] = [entry for entry in filters if entry not in own]
            # Python remembers which warnings it has shown, until it is said that the filters have changed.
            getattr(warnings, "_filters_mutated", lambda: None)()
