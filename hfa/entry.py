"""Entry point of the process `hfa`, and its end on Ctrl-C, SIGTERM or SIGHUP."""

from __future__ import annotations

import gc
import os
import signal
import sys

from hfa.exit_codes import INTERRUPTED, TERMINATED

_ENDING = {"SIGINT": INTERRUPTED, "SIGTERM": TERMINATED, "SIGHUP": TERMINATED}


def main() -> int:
    """Run `hfa` in this process and return its exit code.

    The exit code is 2 if the package cannot be imported.
    """
    for name in _ENDING:
        number = getattr(signal, name, None)  # not every system has every signal
        # A signal ignored by the parent process (nohup) stays ignored.
        if number is not None and signal.getsignal(number) in (
            signal.SIG_DFL,
            signal.default_int_handler,
        ):
            signal.signal(number, _end)
    try:
        from hfa.main import main as run
    except ImportError as error:
        print(
            f"hfa: {error} (a file in this folder may hide the package; rename the file)",
            file=sys.stderr,
        )
        return 2
    code = run()
    for name in _ENDING:  # the run is finished: ignore signals
        number = getattr(signal, name, None)
        if number is not None:
            signal.signal(number, signal.SIG_IGN)
    gc.freeze()  # Python then skips the final garbage collection
    return code


def _end(number: int, _: object) -> None:
    """Handle a signal: print one line, remove temporary files and end the process."""
    # The process ends without an exception. Libraries that call Python may suppress or replace
    # exceptions.
    code = _ENDING[signal.Signals(number).name]
    try:
        if sys.stderr is not None:
            os.write(
                sys.stderr.fileno(),
                b"hfa: interrupted\n" if code == INTERRUPTED else b"hfa: terminated\n",
            )
    finally:
        try:
            # While that module is being loaded, this function does not exist and no file was
            # created.
            files = sys.modules.get("hfa_support.files")
            remove_unfinished = getattr(files, "remove_unfinished", None)
            if remove_unfinished is not None:
                remove_unfinished()
        finally:
            os._exit(code)
