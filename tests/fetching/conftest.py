"""A server of files on this machine, and a system that refuses large files."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from fetching.serving import Shelf, serving


@pytest.fixture
def shelf() -> Shelf:
    return Shelf()


@pytest.fixture
def base(shelf: Shelf, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Address of a server of the shelf; nothing waits between attempts."""
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    with serving(shelf) as address:
        yield address


@pytest.fixture
def little_room() -> Iterator[None]:
    """Let no file of this process grow beyond 300 kB: writes that the system itself refuses."""
    resource = pytest.importorskip("resource", reason="needs limits of the system")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
