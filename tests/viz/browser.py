"""The replay page as a browser sees it: its arrays, and a headless Chromium where there is one."""

from __future__ import annotations

import base64
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")


def missing(reason: str) -> None:
    """Skip, or fail where the run demands a browser."""
    if os.environ.get("RIFTBERG_REQUIRE_BROWSER") == "1":
        pytest.fail(reason)
    pytest.skip(reason)


@contextmanager
def opened(page: Path, width: int = 1300, height: int = 850) -> Iterator[Any]:
    """Open a page; the network is cut off by the page's own policy and by the browser's."""
    binary = next((path for name in NAMES if (path := shutil.which(name))), None)
    driver = shutil.which("chromedriver")
    if binary is None or driver is None:
        missing("no chromium and chromedriver on the path")
    try:
        from selenium import webdriver
    except ImportError:
        missing("selenium is not installed")
    options = webdriver.ChromeOptions()
    options.binary_location = str(binary)
    flags = ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", f"--window-size={width},{height}",
             "--host-resolver-rules=MAP * 127.0.0.1:9")  # fmt: skip
    for flag in flags:
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    browser = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    try:
        browser.get(page.resolve().as_uri())
        yield browser
    finally:
        browser.quit()


def until(browser: Any, condition: str, *, seconds: float = 120.0) -> None:
    """Wait until an expression of the page is true; a busy machine draws late."""
    from selenium.webdriver.support.ui import WebDriverWait

    WebDriverWait(browser, seconds, poll_frequency=0.05).until(
        lambda b: b.execute_script(f"return Boolean({condition})"), f"never true: {condition}"
    )


def drawn(browser: Any) -> None:
    """Wait until the page has drawn what it was told."""
    until(browser, "!replay.state.dirty")


def unpack(packed: dict[str, Any]) -> np.ndarray:
    """Return the values of a packed array, as the page sees them."""
    raw = np.frombuffer(base64.b64decode(packed["data"]), np.dtype(packed["kind"]).newbyteorder("<"))
    values = packed["offset"] + packed["scale"] * raw.astype(np.float64)
    return np.where(raw == packed["missing"], np.nan, values).reshape(packed["shape"])
