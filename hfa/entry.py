"""Entry point of the process `hfa`."""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import sys
import threading
import time

from hfa.exit_codes import BAD_INPUT, DONE, TERMINATED
from hfa_support.origin import code

#: Time in which Python can end a run after a signal, s.
_GRACE = 5.0


def main() -> int:
    """Run `hfa` in this process and return its exit code.

    SIGTERM and SIGHUP end the run as Ctrl-C does: temporary files and workers are removed. If a
    compiled library does not return to Python, the process ends after `_GRACE`. The exit code is 2
    if the package cannot be imported.
    """
    if sys.argv[1:2] == ["--version"]:  # before anything else is loaded
        version = code()
        with contextlib.suppress(OSError):  # of a closed or full output, reported below
            os.write(1, f"hfa {version}\n".encode())
            return DONE
    if os.name == "posix":
        _watch()
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # not every system has every signal
        # A signal ignored by the parent process (nohup) stays ignored.
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _end)
    try:
        from hfa.main import main as run
    except ImportError as error:
        print(
            f"hfa: {error} (a file in this folder may hide the package; rename the file)",
            file=sys.stderr,
        )
        return BAD_INPUT
    exit_code = run()
    gc.freeze()  # Python then skips the final garbage collection
    return exit_code


def _watch() -> None:
    """Start a thread that ends this process some time after a signal to end it."""
    arrived, written = os.pipe()
    os.set_blocking(written, False)
    signal.set_wakeup_fd(written, warn_on_full_buffer=False)  # written to by C, also in a library

    def end_later() -> None:
        while os.read(arrived, 1)[0] not in (signal.SIGTERM, signal.SIGHUP):
            pass
        time.sleep(_GRACE)
        print("hfa: terminated", file=sys.stderr, flush=True)
        os._exit(TERMINATED)

    threading.Thread(target=end_later, daemon=True).start()


def _end(number: int, _: object) -> None:
    """Handle a signal that ends the process."""
    raise KeyboardInterrupt("terminated")
