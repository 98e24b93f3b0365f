"""Pytest configuration: load the shared fixtures in the processes that run tests."""

from __future__ import annotations

import gc
import os
import signal
import sys

# Matrices of six rows gain nothing from threads; must be set before NumPy loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Outputs bear the date of their making; with this they are the same in every run.
os.environ["SOURCE_DATE_EPOCH"] = "1790000000"
# Else each process compiles all modules anew, and each worker rewrites the assertions of all tests:
# five seconds each.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# The streams of users are buffered, and what cannot be written is then found when the process ends.
os.environ.pop("PYTHONUNBUFFERED", None)

# In the background of a shell Ctrl-C is ignored, also by what is started there; some tests are
# about it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

import pytest

sys.dont_write_bytecode = False  # as above, for this process
gc.set_threshold(50_000, 20, 20)  # what the test files load and define stays


def pytest_collection_finish() -> None:
    gc.freeze()  # thousands of tests, which are never garbage


def pytest_configure(config: pytest.Config) -> None:
    """Load the shared fixtures, except in the controller process of pytest-xdist.

    The controller runs no tests, and importing the fixtures takes a second.
    """
    if hasattr(config, "workerinput") or not config.getoption("numprocesses", None):
        config.pluginmanager.import_plugin("shared_fixtures")
