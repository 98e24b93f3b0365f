"""The browser Chromium for tests of HTML pages."""

import shutil
import tempfile
from contextlib import contextmanager

import pytest

#: No window, no network and no data from earlier runs.
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *(
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--disable-dev-shm-usage",
    ),
)


@contextmanager
def browser():
    """Yield a selenium driver of Chromium.

    If the browser or selenium is missing, the test is skipped with the command that installs it.
    """
    selenium = pytest.importorskip(
        "selenium.webdriver", reason="needs selenium: pip install '.[dev]'"
    )
    program = shutil.which("chromium")
    driver = shutil.which("chromedriver")
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


def set_page_width(driver, width):
    """Set the width of the page in pixels."""
    metrics = {"width": width, "height": 1000, "deviceScaleFactor": 1, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
