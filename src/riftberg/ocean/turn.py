"""The lock under which a forcing that several runs share in threads reads its records."""

from __future__ import annotations

import threading


class Turn:
    """Lock that its holder may take again; a copy, also one in another process, is a lock of its own."""

    def __init__(self) -> None:
        self._lock = threading.RLock()

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *error: object) -> None:
        self._lock.release()

    def __reduce__(self) -> tuple[type[Turn], tuple[()]]:
        return Turn, ()
