"""Where the command `hfa` begins: Ctrl-C and SIGTERM are answered before anything that takes time is imported."""

from __future__ import annotations

# Compiled into Python, where `signal` makes three enumerations first: a millisecond in which Ctrl-C is a traceback.
import _signal as signal  # type: ignore[import-not-found]
import os
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

_SAID = {signal.SIGINT: b"hfa: interrupted\n", signal.SIGTERM: b"hfa: terminated\n"}
_BAD_INPUT = 2
#: s: how long a run that a signal has ended waits for threads of libraries.
_PATIENCE = 5.0


def main() -> int:
    """`hfa` as a process of its own; the exit code.

    Until the command runs nothing needs cleaning up: a signal is one line and the end. While it runs, `hfa_cli.main`
    answers. Once it has run, what it made is there: a first signal changes nothing, a second does not wait for threads.
    After a signal threads have `_PATIENCE`: that of a pool may wait for ever for the rest of what a worker was sending.
    """
    _open_closed_streams()
    # Who began us with a signal ignored (nohup) wants it ignored.
    defaults = (signal.SIG_DFL, signal.default_int_handler)
    before = {number: signal.getsignal(number) for number in _SAID if signal.getsignal(number) in defaults}
    code = 128 + signal.SIGINT
    _answer(before, _end)
    try:
        from hfa_cli.main import main as run
    except ImportError as error:
        print(f"hfa: {error} (a file here with the name of one of our packages hides it)", file=sys.stderr)
        return _BAD_INPUT
    try:
        for number, handler in before.items():
            signal.signal(number, handler)
        code = run()
        _answer(before, _end_next)
        if code > 128:
            _end_within(_PATIENCE, code)
    except KeyboardInterrupt:  # between two handlers
        _end(signal.SIGINT)
    return code


def _open_closed_streams() -> None:
    """What whoever began us closed leads nowhere; else the next file that is opened is standard output, or error."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest number that is free: this one
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)


def _answer(numbers: Iterable[int], handler: Callable[[int, object], None]) -> None:
    for number in numbers:
        signal.signal(number, handler)


def _end_within(seconds: float, code: int) -> None:
    import threading

    timer = threading.Timer(seconds, os._exit, (code,))
    timer.daemon = True
    timer.start()


def _end_next(number: int, _: object) -> None:
    signal.signal(number, _end)


def _end(number: int, _: object = None) -> None:
    try:
        os.write(2, _SAID[number])
    finally:
        os._exit(128 + number)
