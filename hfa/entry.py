"""Entry point of the process `hfa`."""

from __future__ import annotations

import gc
import signal
import sys

from hfa.exit_codes import BAD_INPUT


def main() -> int:
    """Run `hfa` in this process and return its exit code.

    SIGTERM and SIGHUP end the run as Ctrl-C does: temporary files and workers are removed. The exit
    code is 2 if the package cannot be imported.
    """
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
    code = run()
    gc.freeze()  # Python then skips the final garbage collection
    return code


def _end(number: int, _: object) -> None:
    """Handle a signal that ends the process."""
    raise KeyboardInterrupt("terminated")
