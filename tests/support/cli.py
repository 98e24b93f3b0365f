"""Helpers that run `hfa` in this process or in a child process and return its output."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import shlex
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pytest

from hfa import BadInputError
from hfa.entry_points import COMMANDS, commands
from hfa.main import BAD_INPUT, DONE, main

#: Console script of the Python environment that runs the tests.
SCRIPT = Path(sys.executable).with_name("hfa")


class Result(NamedTuple):
    """Exit code, standard output and standard error of a run."""

    code: int
    out: str
    err: str


class Terminal(io.StringIO):
    """Text stream that claims to be a terminal."""

    def isatty(self):
        return True


def hfa(*words, err=None, out=None):
    """Run `hfa words...` in this process and return its result.

    JSON that the command prints, or writes with -o, must be an object that names its format.

    out, err: streams for the output, or None for new streams that are not terminals
    """
    result = unchecked_hfa(*words, err=err, out=out)
    if "--json" in words and result.out:
        assert_named(result.out)
    for path in written_json(words) if result.code != BAD_INPUT else []:
        assert_named(path.read_text("utf-8"))
    return result


def unchecked_hfa(*words, err=None, out=None):
    """Run `hfa words...` in this process and return its result without checking JSON output.

    The test is skipped if the command belongs to an extension that is not installed.
    """
    if words[:1] and words[0] in COMMANDS and words[0] not in commands():
        pytest.skip(f"hfa {words[0]} is not installed")
    out, err = out or io.StringIO(), err or io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(words)
    return Result(code, out.getvalue(), err.getvalue())


def answer(*words, code=DONE):
    """Run `hfa words... --json` and return the printed JSON object.

    The function asserts the exit code, and that standard error contains only the warnings listed in
    the JSON and names of written files; of `trim` and `linearize`, whose reports contain the
    warnings, only these names.
    """
    result = hfa(*words, "--json")
    assert result.code == code, result.err
    data = json.loads(result.out, parse_constant=pytest.fail)
    assert isinstance(data, dict)
    notes = [] if words[0] in ("trim", "linearize") else data.get("warnings", [])
    said = [line for line in result.err.splitlines() if not line.startswith("wrote ")]
    assert said == [f"hfa: note: {note}" for note in notes]
    return data


def written_json(words):
    """Return the paths of the .json files that -o names, including those in a folder named by
    -o.
    """
    targets = [Path(path) for option, path in pairwise(words) if option in ("-o", "--output")]
    inside = [
        path
        for folder in targets
        if folder.suffix == "" and folder.is_dir()
        for path in folder.rglob("*.json")
    ]
    return [path for path in targets if path.suffix == ".json" and path.is_file()] + inside


def hfa_process(*words, folder, **environment):
    """Run `hfa words...` as a child process in a folder and return its result.

    environment: additional environment variables
    """
    done = subprocess.run(
        [SCRIPT, *words],
        cwd=folder,
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=120,
    )
    return Result(done.returncode, done.stdout, done.stderr)


#: Program that runs commands one after the other: importing the packages takes most of the time.
_IN_TURN = """
import contextlib, io, json, sys
from hfa.main import main
results = []
for words in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(words)
    results.append((code, out.getvalue(), err.getvalue()))
print(json.dumps(results))
"""


def results_in_turn(commands, folder, python=sys.executable, **environment):
    """Run commands "hfa WORDS" one after the other in one child process, and return their results.

    folder: working folder of the process
    environment: additional environment variables
    """
    words = [shlex.split(command)[1:] for command in commands]
    done = subprocess.run(
        [python, "-c", _IN_TURN, json.dumps(words)],
        cwd=folder,
        env={**os.environ, **environment},
        check=True,
        capture_output=True,
        text=True,
        timeout=120,
    )
    return [Result(*each) for each in json.loads(done.stdout.splitlines()[-1])]


def assert_refused(result, code, *named):
    """Assert that a run failed with this exit code and printed only one line, on standard error.

    named: texts that the line must contain
    """
    assert (result.code, result.out) == (code, "")
    assert result.err.startswith("hfa: ")
    assert result.err.endswith("\n")
    assert result.err.count("\n") == 1, result.err
    for word in named:
        assert word in result.err
    assert_advice_leads_on(result.err)


def assert_advice_leads_on(message):
    """Assert that each command that a refusal proposes to type is not refused."""
    for proposed in re.findall(r"[;,] type (hfa (?:[^,]|,(?! ))+)$", message.rstrip()):
        advised = unchecked_hfa(*shlex.split(proposed)[1:])
        assert advised.code != BAD_INPUT, f"{message}advises {proposed}, refused: {advised.err}"


def assert_named(text):
    """Assert that JSON output is an object without nan that names its format and version."""
    data = json.loads(text, parse_constant=pytest.fail)
    assert re.fullmatch(r"hfa\.[a-z-]+/\d+", data["schema"])


def refused(call, *arguments, **named):
    """Return the message of the BadInputError that a call raises, which must be one line."""
    with pytest.raises(BadInputError) as caught:
        call(*arguments, **named)
    message = str(caught.value)
    assert "\n" not in message
    return message


def refusal(load, path):
    """Return the message with which a file is refused, which must contain its path."""
    message = refused(load, str(path))
    assert str(path) in message
    return message
