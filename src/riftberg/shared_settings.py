"""Settings that all threads of a process share, changed for a block by one thread at a time.

Python's filters of warnings and the settings of dask are put back at the end of a block to what they were at its
beginning. Where two blocks overlap, the second one puts back what the first one had set, for ever.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

SETTINGS: Final = threading.RLock()
"""Held by whoever changes such a setting for a while."""


@contextmanager
def own_filters() -> Iterator[None]:
    """Let a block set filters of warnings, which end with it."""
    with SETTINGS, warnings.catch_warnings():
        yield
