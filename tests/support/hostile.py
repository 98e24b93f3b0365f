"""Hostile inputs to `hfa`, and checks of the reaction of the command.

An input is a command line with replaced words, or a file that `strategies` has changed.
"""

import contextlib
import io
import json
import re
import signal
import tempfile
from contextlib import chdir
from functools import cache
from pathlib import Path

import numpy as np
from cli import hfa, unchecked_hfa
from game_files import small
from hypothesis import strategies as st
from sealed_certificate import sealed
from strategies import TEXTS, changed_entry, changed_file

from hfa.entry_points import commands, found_in

#: Largest processor time of a command in s, unless it announces a long run.
LONGEST = 10.0
_LONGEST_LINE = 1200

#: Words of the HFA at 15 deg, and of a proof that takes a second.
_AT = ("--dihedral", "15")
_PROVED = ("prove", "schedule", "--dihedral", "15:15.001")
CONDITION = """description = "slow"
free = ["speed"]
[impose]
alpha_deg = [[0, 5.0], [20, 6.0]]
altitude = 1000.0
[limits]
elevator_center_deg = [-30, 30]
"""
#: Command lines that run quickly.
LINES = (
    "trim --dihedral 15 --free speed --hold throttle=40 --limit alpha=-5:15 -o a.json",
    "linearize --dihedral 5 --states alpha,pitch --outputs speed --json",
    "sweep --dihedral 0:20:10 --hold alpha=1:2:0.5 -o a.csv",
    "sweep --dihedral 0:20:10 --hold panel_mass=0.5:2:0.5 -o a.zarr",
    "solve --dihedral 15 --delta 300 --Q 1,1,1,1,1,1 --R 1,1,1,1,1",
    "solve --dihedral 10,15 -o a.mat",
    "learn --dihedral 15 --law published --seed 3 -o a.npz",
    (
        "fly --dihedral 15 --duration 0.02 --initial speed=1 --gust 25:3:0 --turbulence own:1:500"
        " --noise alpha=0.1"
    ),
    "fly --dihedral 15 --duration 0.02 --servo 0.1:60:2 --error panel_mass=1.1",
    (
        "fly --dihedral 15 --samples 3 --duration 0.02 --error panel_mass=0.1 --noise alpha=0.1 -o"
        " a.zarr"
    ),
    "prove schedule --dihedral 15:15.25 --decay 0.2 --rate 1",
    "prove --check a.json",
    "export --dihedral 15 -o folder",
    "regenerate --dynamics newton --parameters identified --json",
    "regenerate",
    "report --dihedral 5",
)
SUFFIXES = (".json", ".npz", ".mat")
#: Kind of input -> command. "{}" is replaced by the corrupted file of this name.
WAYS = {
    "command line": (),
    "parameters.toml": ("trim", *_AT, "--parameters", "{}"),
    "condition.toml": ("sweep", "--dihedral", "10,15", "--condition", "{}"),
    **{f"plant{each}": ("solve", "--model", "{}") for each in SUFFIXES},
    "A.csv": ("solve", "--model", "{}", "--Q", "1,1", "--R", "1", "--delta", "inf"),
    "critic.npz": ("verify", "--model", "plant.json", "--weights", "{}"),
    "table.json": (*_PROVED, "--weights", "{}"),
    "sealed certificate.json": ("prove", "--check", "{}"),
    "network.pt": (
        *("verify", "--model", "plant.json", "--weights", "{}", "--network", "V="),
        *("--set", "activation=tanh"),
    ),
    "glider.xml": ("trim", "--aircraft", "{}", "--hold", "speed=120"),
}


class Hanging(BaseException):
    """Raised in a run that exceeds its time limit. Commands do not catch it."""


@cache
def options_of(command):
    """Return the options that the help of a command names."""
    return tuple(
        sorted({*re.findall(r"(?<![\w-])--?[a-zA-Z][\w-]*", hfa(*command.split(), "--help").out)})
    )


@st.composite
def hostile_words(draw):
    """Return a command line in which one to three words are replaced, removed or added."""
    command, words = found_in(draw(st.sampled_from(LINES)).split())
    options = [name for name in options_of(command) if name != "--workers"]
    word = st.sampled_from(options) | TEXTS | st.sampled_from(list(commands()))
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(words)))
        words[at : at + draw(st.integers(0, 1))] = draw(st.lists(word, max_size=2))
    return [*command.split(), *words]


@st.composite
def hostile_case(draw, way):
    """Return the words of a command line and the content of its input files.

    way: kind of input, a key of `WAYS`
    """
    if not WAYS[way]:
        return draw(hostile_words()), {}
    every_seed = seeds()
    files = {name: every_seed[name] for name in ("plant.json", "B.csv")}
    if way.startswith("sealed "):
        files[way] = sealed(draw(changed_entry(json.loads(every_seed[way])))).encode()
    else:
        files[way] = draw(changed_file(way, every_seed[way]))
    return [way if word == "{}" else word for word in WAYS[way]], files


@cache
def seeds():
    """Return the content of valid input files by name. Most of them are written by commands."""
    from known_models import exact_gain
    from network_files import torch_file
    from small_aircraft import glider

    from hfa.paper import default_parameters
    from hfa_model import save_parameters

    with tempfile.TemporaryDirectory() as name, chdir(name):
        save_parameters(default_parameters(), Path("parameters.toml"), "a copy")
        Path("condition.toml").write_text(CONDITION, "utf-8")
        angles = [14.9, 15.1]
        K = [exact_gain(angle).tolist() for angle in angles]
        Path("table.json").write_text(json.dumps({"dihedral_deg": angles, "K": K}), "utf-8")
        for suffix in SUFFIXES:
            small(Path(f"plant{suffix}"))
        Path("A.csv").write_text("a,b\n-0.2,1.0\n-2.0,-0.3\n", "utf-8")
        Path("B.csv").write_text("u\n0.0\n1.0\n", "utf-8")
        layers = {"0.weight": [[0.5, 0.2]] * 3, "0.bias": [0.0] * 3, "2.weight": [[1.0] * 3]}
        torch_file("network.pt", {name: np.array(values) for name, values in layers.items()})
        Path("glider.xml").write_text(glider(), "utf-8")
        for words in (
            (*_PROVED, "--weights", "table.json", "-o", "sealed certificate.json"),
            ("solve", "--model", "plant.json", "-o", "critic.npz"),
        ):
            result = hfa(*words)
            assert result.code == 0, (words, result.err)
        return {path.name: path.read_bytes() for path in Path().iterdir()}


def attempt(words, given):
    """Run `hfa` with a hostile input and return the fault in its reaction, or None.

    given: name -> content of the input files
    """
    with tempfile.TemporaryDirectory() as name:
        inside = Path(name) / "inside"
        err = io.StringIO()
        inside.mkdir()
        with chdir(inside):
            for path, content in given.items():
                Path(path).write_bytes(content)
            try:
                with _alarm():
                    result = unchecked_hfa(*words, err=err)
            except Hanging:
                # A proof takes longer with default options; other long runs are announced.
                is_long = [*words[:2]] == ["prove", "schedule"] or "Ctrl-C" in err.getvalue()
                return None if is_long else f"no end after {LONGEST:g} s"
            except Exception as error:
                return f"{type(error).__name__}: {str(error)[:300]}"
            return output_fault(result) or _left_wrongly(Path(name), words, given, result)


def output_fault(result):
    """Return the fault in the exit code and output of a run, or None.

    The exit code must be 0, 1 or 2. The run must print a result with notes, or one printable line
    that is not too long.
    """
    lines = [line for line in result.err.splitlines() if not line.startswith("wrote ")]
    others = [line for line in lines if not line.startswith("hfa: note: ")]
    if result.code not in (0, 1, 2):
        return f"exit code {result.code}"
    if len(others) > 1 or any(not line.startswith("hfa: ") for line in lines):
        return f"more than one line: {lines[:5]}"
    if result.code == 2 and (result.out or len(others) != 1):
        return f"exit code 2, and not one line alone: {result.out[:100]!r}, {lines[:5]}"
    if result.code == 1 and not (result.out or others):
        return "exit code 1, and not a word"
    wrong = [line for line in lines if len(line) > _LONGEST_LINE or not line.isprintable()]
    return f"a line that is too long or not printable: {wrong[0][:200]!r}" if wrong else None


def _left_wrongly(folder, words, given, result):
    """Return the fault in the files that a run left, or None.

    A run must leave nothing outside its folder, no file that the command line does not name, no
    file after exit code 2, and no incomplete JSON file.

    given: names of the input files
    """
    if outside := [path.name for path in folder.iterdir() if path.name != "inside"]:
        return f"left outside: {outside}"
    for path in Path().iterdir():
        if path.name in given:
            continue
        is_named = any(path.name in word for word in words) and not path.name.startswith(".")
        if result.code == 2 or not is_named:
            return f"left, and nobody asked: {path}"
        if path.suffix == ".json" and path.is_file():
            try:
                json.loads(path.read_bytes())
            except ValueError:
                return f"not whole: {path}"
    return None


@contextlib.contextmanager
def _alarm():
    """Raise `Hanging` if the block exceeds `LONGEST` seconds of processor time.

    The limit of elapsed time is ten times as long.
    """

    def end(*_):
        raise Hanging

    before = {number: signal.signal(number, end) for number in (signal.SIGPROF, signal.SIGALRM)}
    signal.setitimer(signal.ITIMER_PROF, LONGEST, 1.0)
    signal.setitimer(signal.ITIMER_REAL, 10.0 * LONGEST, 1.0)
    try:
        yield
    finally:
        for timer in (signal.ITIMER_PROF, signal.ITIMER_REAL):
            signal.setitimer(timer, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)
