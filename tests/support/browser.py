"""A real browser for the tests of a page: Chromium without a window, driven by selenium."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

#: No window, no network, nothing kept from another start.
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage"),
)


@contextmanager
def browser() -> Iterator[Any]:
    """A selenium driver; the test is skipped, and says what to install, where there is no browser."""
    selenium = pytest.importorskip("selenium.webdriver", reason="needs selenium: pip install '.[dev]'")
    program, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if program is None or driver is None:
        pytest.skip("needs a browser: apt-get install chromium chromium-driver")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        options = selenium.ChromeOptions()
        options.binary_location = program
        for flag in (*FLAGS, f"--user-data-dir={profile}"):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        found = selenium.Chrome(options=options, service=selenium.ChromeService(driver))
        try:
            yield found
        finally:
            found.quit()


def seen_at(driver: Any, width: int, scheme: str = "light", medium: str = "screen") -> None:
    """Show the page at this width (px), light or dark, on the screen or as printed."""
    driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": 1000, "deviceScaleFactor": 1, "mobile": False},
    )
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": medium, "features": features})


def settles(driver: Any, condition: str, seconds: float = 10.0) -> bool:
    """Whether a JavaScript expression becomes true in this time: drawings follow a new width a moment later."""
    ends = time.monotonic() + seconds
    while not driver.execute_script(f"return {condition}"):
        if time.monotonic() > ends:
            return False
        time.sleep(0.05)
    return True


def screenshot(driver: Any, path: Path) -> bytes:
    """What is seen, as PNG, kept in a file."""
    assert driver.save_screenshot(str(path))
    return path.read_bytes()
