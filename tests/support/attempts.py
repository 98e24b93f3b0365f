"""One hostile input to `hfa` in this process, and whether what came of it is allowed."""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from cli import Result, unchecked_hfa
from ways_in import WAYS, Case

from hfa_cli.entry import INTERRUPTED, TERMINATED

#: Seconds of the processor that a command may take, unless it says that it takes long.
LONGEST = 10.0
#: The same by the clock, for what waits.
_WAITED = 60.0
#: Bytes that an input of some kilobytes may take beyond what is held before.
_MOST_MEMORY = 2**30
_ALLOWED = (0, 1, 2)
_LONGEST_LINE = 1200
_ANNOUNCED = "Ctrl-C ends it"
#: Command lines that take longer when they are asked for nothing special.
_LONG = (("servo",), ("map",), ("lpv",), ("prove", "schedule"))
#: A folder in memory, where there is one: on a disk, making and removing it takes longer than most commands.
_MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None


class Hanging(BaseException):
    """No command catches it."""


class Taken(BaseException):
    """The command has read its input, and begins to work. No command catches it."""


def attempt(way: str, content: bytes, *, whole: bool = True) -> str | None:
    """What is wrong with how `hfa` took these bytes by that way in; None where nothing is.

    whole: the command works with what it accepts; else it ends there, which most inputs never reach.
    """
    chosen = WAYS[way]
    return fault_of(chosen.case(content), chosen.file, () if whole else chosen.work)


def fault_of(case: Case, file: str = "", work: Sequence[str] = ()) -> str | None:
    """What is wrong with how `hfa` takes a case; it runs in a folder of its own, below one that must stay empty.

    It ends where it would call one of the functions `work`.
    """
    with tempfile.TemporaryDirectory(dir=_MEMORY) as name, _within(Path(name) / "inside"):
        for path, content in case.files.items():
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            Path(path).write_bytes(content)
        before = _held(reset=True)
        rung, err = list[float](), io.StringIO()
        try:
            with _alarm(rung), ending_at(work):
                result = unchecked_hfa(*(file if word == "{}" else word for word in case.words), err=err)
        except Taken:
            result = Result(0, "", err.getvalue())
        except BaseException as error:
            if not rung:
                return f"{type(error).__name__}: {str(error)[:300]}{_where(error)}"
        if rung:
            long = any(tuple(case.words[: len(each)]) == each for each in _LONG)
            return None if long or _ANNOUNCED in err.getvalue() else f"no end after {LONGEST:g} s"
        if result.code in (INTERRUPTED, TERMINATED):  # who runs this wants it to end
            raise KeyboardInterrupt
        grown = _held() - before
        if grown > _MOST_MEMORY:
            return f"took {grown >> 20} MiB"
        return said_wrongly(result) or _left_wrongly(Path(name), case, result)


def said_wrongly(result: Result) -> str | None:
    """Exit code 0, 1 or 2; a result with notes, or one line that a terminal can show."""
    lines = result.err.splitlines()
    others = [line for line in lines if not line.startswith("hfa: note: ")]
    if result.code not in _ALLOWED:
        return f"exit code {result.code}"
    if "Traceback" in result.err or "Error:" in result.out.partition("\n")[0]:
        return f"a traceback: {result.err[-300:]}"
    if len(others) > 1 or any(not line.startswith("hfa: ") for line in lines):
        return f"more than one line: {lines[:5]}"
    if result.code == 2 and (result.out or len(others) != 1):
        return f"exit code 2, and not one line alone: {result.out[:100]!r}, {lines[:5]}"
    if result.code == 1 and not (result.out or others):
        return "exit code 1, and not a word"
    for line in lines:
        if len(line) > _LONGEST_LINE or not line.isprintable():
            return f"a line that is too long or not printable: {line[:200]!r}"
    return None


def _left_wrongly(folder: Path, case: Case, result: Result) -> str | None:
    """Nothing outside, nothing unasked, nothing half written."""
    outside = [path.name for path in folder.iterdir() if path.name != "inside"]
    if outside:
        return f"left outside: {outside}"
    tops = {Path(path).parts[0] for path in case.files}
    for path in Path().iterdir():
        if path.name in tops:
            continue
        asked = path.name.removesuffix(".record")  # of a search, beside what it writes
        if not any(asked in word for word in case.words) or path.name.startswith("."):
            return f"left, and nobody asked: {path}"
        if result.code == 2:
            return f"refused, and left: {path}"
        if path.suffix == ".json" and path.is_file():
            try:
                json.loads(path.read_bytes())
            except ValueError:
                return f"not whole: {path}"
    return None


@contextlib.contextmanager
def ending_at(work: Sequence[str]) -> Iterator[None]:
    """Raises `Taken` where one of these functions, each with its module, would be called."""

    def taken(*_: object, **__: object) -> None:
        raise Taken

    with pytest.MonkeyPatch.context() as patch:
        for function in work:
            patch.setattr(function, taken)
        yield


@contextlib.contextmanager
def _within(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    folder.mkdir()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


@contextlib.contextmanager
def _alarm(rung: list[float]) -> Iterator[None]:
    """Raises `Hanging` in the block, each second once the time is over; says so in `rung`: it may be caught."""

    def end(*_: object) -> None:
        rung.append(time.monotonic())
        raise Hanging

    before = {number: signal.signal(number, end) for number in (signal.SIGPROF, signal.SIGALRM)}
    signal.setitimer(signal.ITIMER_PROF, LONGEST, 1.0)  # of this processor: others may share the machine
    signal.setitimer(signal.ITIMER_REAL, _WAITED, 1.0)
    try:
        yield
    finally:
        for timer in (signal.ITIMER_PROF, signal.ITIMER_REAL):
            signal.setitimer(timer, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)


def _where(error: BaseException) -> str:
    """File and line of this project that an error came through last."""
    found, step = "", error.__traceback__
    while step is not None:
        name = Path(step.tb_frame.f_code.co_filename)
        if any(part in name.parts for part in ("hfa_cli", "hfa_model", "trim", "controller", "verification")):
            found = f" in {name.name}:{step.tb_lineno}"
        step = step.tb_next
    return found


def _held(*, reset: bool = False) -> int:
    """The most memory held since the last reset, bytes; 0 where the system does not tell."""
    with contextlib.suppress(OSError):
        if reset:
            Path("/proc/self/clear_refs").write_text("5")
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) << 10
    return 0
