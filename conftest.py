"""Pytest configuration: the shared fixtures are loaded only in the processes that run tests."""

import gc
import os
import signal
import sys

import pytest

# Threads do not accelerate operations on matrices of six rows. This must be set before NumPy loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Outputs contain their date. A fixed date makes them equal in every run.
os.environ["SOURCE_DATE_EPOCH"] = "1790000000"
# Otherwise each process would compile all modules and each worker would rewrite the assertions of
# all tests, which takes five seconds each.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Users' streams are buffered. A failed write is then found when the process ends.
os.environ.pop("PYTHONUNBUFFERED", None)

# In the background of a shell, Ctrl-C is ignored, and child processes inherit this. Some tests need
# Ctrl-C.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# So is SIGHUP of `nohup`. A handler that does nothing keeps this here, but is not inherited.
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda *_: None)


sys.dont_write_bytecode = False  # also for this process
gc.set_threshold(500_000, 20, 20)  # objects of the test files are never collected


def pytest_collection_finish():
    gc.freeze()  # thousands of tests, which are never collected


@pytest.hookimpl(trylast=True)  # after pytest-cov, which then counts what these load
def pytest_sessionstart(session):
    """Load the shared fixtures, except in the controller process of pytest-xdist.

    The controller process runs no tests.
    """
    config = session.config
    if hasattr(config, "workerinput") or not config.getoption("numprocesses", None):
        config.pluginmanager.import_plugin("shared_fixtures")
