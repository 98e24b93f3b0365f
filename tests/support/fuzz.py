"""`make fuzz`: hostile inputs in great number by every way in, counted, continued where they were left, and listed.

Inputs are strings of bytes (`hostile.Choices`). Where atheris is installed it makes them, guided by which lines of the
project they reach, and keeps those that reach new ones; else input number k of a way is always the same random bytes.
Each way runs in a fork of this process, which has loaded everything and written the seeds once, so that a crash is a
case like any other.

    python tests/support/fuzz.py [--inputs N] [--seconds S] [--folder FOLDER] [WAY ...]
    python tests/support/fuzz.py --again WAY HEX
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import json
import multiprocessing
import os
import random
import sys
import time
import zlib
from importlib.util import find_spec
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).parents[2]), str(Path(__file__).parent)]

_PACKAGES = ["hfa_model", "trim", "controller", "verification", "hfa_cli"]
_LONGEST_INPUT = 64
#: Inputs between two writes of the count.
_OFTEN = 20
#: One input of so many is followed to the end of its command; the others to where the command has read it.
_WHOLE = 20
#: Random inputs that atheris begins with.
_FIRST = 50
#: Seconds after which a call that no signal interrupts ends the process; what signals interrupt is ended before.
_DEAD = 120.0


class Record:
    """What is kept of a way in: how many inputs it has had, and the cases found, one of each kind."""

    def __init__(self, folder: Path, way: str) -> None:
        self.way, self.folder = way, folder / way.replace(" ", "-")
        self.corpus = self.folder / "corpus"
        self.corpus.mkdir(parents=True, exist_ok=True)
        self.running = self.folder / "running"
        self._file = self.folder / "progress.json"
        self.done, self.found = 0, {}
        with contextlib.suppress(OSError, ValueError):
            known = json.loads(self._file.read_bytes())
            self.done, self.found = int(known["done"]), dict(known["found"])

    def save(self) -> None:
        """Write what is known."""
        self._file.write_text(json.dumps({"done": self.done, "found": self.found}, indent=1), encoding="utf-8")

    def add(self, content: bytes, fault: str) -> None:
        """A case; the first of its kind is kept, with the number of all."""
        kind = fault.rpartition(" in ")[2] if " in " in fault else fault[:60]
        known = self.found.setdefault(kind, {"fault": fault, "again": content.hex(), "count": 0})
        known["count"] += 1
        self.save()

    def attempt(self, content: bytes) -> None:
        """Try one input; what is running is on the disk, in case that this process does not survive it."""
        from attempts import attempt

        self.running.write_bytes(content)
        faulthandler.dump_traceback_later(_DEAD, exit=True)
        try:
            fault = attempt(self.way, content, whole=_whole(content))
        finally:
            faulthandler.cancel_dump_traceback_later()
        self.done += 1
        if fault is not None:
            self.add(content, fault)
        elif self.done % _OFTEN == 0:
            self.save()


def _whole(content: bytes) -> bool:
    return zlib.crc32(content) % _WHOLE == 0


def _random(record: Record, inputs: int, end: float) -> None:
    while record.done < inputs and time.monotonic() < end:
        record.attempt(_random_input(record.way, record.done))


def _random_input(way: str, number: int) -> bytes:
    return random.Random(f"{way} {number}").randbytes(_LONGEST_INPUT)


def _guided(record: Record, inputs: int, end: float) -> None:
    import atheris

    def one(content: bytes) -> None:
        if record.done < inputs and time.monotonic() < end:
            record.attempt(content)

    if not any(record.corpus.iterdir()):
        for number in range(_FIRST):
            (record.corpus / f"first-{number}").write_bytes(_random_input(record.way, number))
    limits = [f"-runs={inputs - record.done}", f"-max_total_time={max(1, round(end - time.monotonic()))}"]
    quiet = ["-timeout=0", "-len_control=0", "-verbosity=0", "-print_final_stats=0", f"-max_len={_LONGEST_INPUT}"]
    atheris.Setup([sys.argv[0], str(record.corpus), *limits, *quiet, "-rss_limit_mb=0"], one)
    atheris.Fuzz()


def _child(way: str, options: argparse.Namespace, end: float) -> None:
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    record = Record(options.folder, way)
    (_guided if options.guided else _random)(record, options.inputs, end)
    record.save()


def _ways(options: argparse.Namespace) -> list[str]:
    """The ways in that are asked for; from here on everything is loaded, for atheris with its marks, and written."""
    with contextlib.ExitStack() as around:
        if options.guided:
            import atheris

            around.enter_context(atheris.instrument_imports(include=_PACKAGES))
        from attempts import WAYS
        from ways_in import seeds

        seeds()
    return options.ways or list(WAYS)


def _parent(options: argparse.Namespace) -> int:
    faults = 0
    for way in _ways(options):
        end = time.monotonic() + options.seconds
        while True:
            child = multiprocessing.get_context("fork").Process(target=_child, args=(way, options, end))
            child.start()
            child.join()
            record = Record(options.folder, way)
            if child.exitcode == 0:
                break
            if not record.running.exists():
                raise RuntimeError(f"{way}: nothing was tried")
            record.done += 1
            record.add(record.running.read_bytes(), f"the process ended with code {child.exitcode}")
            if record.done >= options.inputs or time.monotonic() >= end:
                break
        faults += len(record.found)
        print(f"{way}: {record.done} inputs, {sum(each['count'] for each in record.found.values())} faults", flush=True)
        for each in record.found.values():
            print(f"  {each['count']} x {each['fault']}\n    again: python {__file__} --again '{way}' {each['again']}")
    return int(faults > 0)


def _again(way: str, text: str) -> int:
    from attempts import attempt
    from ways_in import WAYS

    content = bytes.fromhex(text)
    case: Any = WAYS[way].case(content)
    print(ascii(["hfa", *case.words]))
    fault = attempt(way, content, whole=_whole(content))
    print(fault or "nothing is wrong")
    return int(fault is not None)


def main() -> int:
    """Run all ways in, or one, or one case again."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("ways", nargs="*", metavar="WAY")
    parser.add_argument("--inputs", type=int, default=100_000, help="of each way, with those of earlier runs")
    parser.add_argument("--seconds", type=float, default=3600.0, help="for each way")
    parser.add_argument("--folder", type=Path, default=Path("out/fuzz"), help="counts, seeds and cases")
    parser.add_argument("--random", action="store_true", help="random bytes, also where atheris is installed")
    parser.add_argument("--again", nargs=2, metavar=("WAY", "HEX"), help="run one case again")
    options = parser.parse_args()
    if options.again:
        return _again(*options.again)
    options.guided = find_spec("atheris") is not None and not options.random
    return _parent(options)


if __name__ == "__main__":
    sys.exit(main())
