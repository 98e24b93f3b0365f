"""Run `hfa` in this process, which is fast, or in a child process, and keep its output."""

from __future__ import annotations

import contextlib
import io
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from project import COMMANDS_OF_EXTENSIONS

from hfa import BadInputError
from hfa.entry_points import commands
from hfa.main import BAD_INPUT, DONE, main

try:
    from hfa_formats.formats import formats
except ModuleNotFoundError:  # the core alone publishes no schema
    formats = None

#: The console script beside the interpreter that runs the tests.
SCRIPT = Path(sys.executable).with_name("hfa")


class Result(NamedTuple):
    """The exit code, standard output and standard error of a run."""

    code: int
    out: str
    err: str


class Terminal(io.StringIO):
    """A stream that reports to be a terminal."""

    def isatty(self) -> bool:
        return True


def hfa(*words: str, err: io.StringIO | None = None, out: io.StringIO | None = None) -> Result:
    """Run `hfa words...` in this process and return its result.

    Its output goes to `out` and `err`, by default no terminals. JSON that it prints, or writes with
    -o, must have the published format.
    """
    result = unchecked_hfa(*words, err=err, out=out)
    if "--json" in words and result.out:
        assert_published(result.out)
    for path in written_json(words) if result.code != BAD_INPUT else []:
        assert_published(path.read_text(encoding="utf-8"))
    return result


def unchecked_hfa(
    *words: str, err: io.StringIO | None = None, out: io.StringIO | None = None
) -> Result:
    """Return the result of a run without a check of its JSON.

    The test is skipped if the command's extension is not installed.
    """
    if words[:1] and words[0] in COMMANDS_OF_EXTENSIONS and words[0] not in commands():
        pytest.skip(f"hfa {words[0]} is not installed")
    out = io.StringIO() if out is None else out
    err = io.StringIO() if err is None else err
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(words)
    return Result(code, out.getvalue(), err.getvalue())


def answer(*words: str, code: int = DONE) -> dict[str, Any]:
    """Return the one JSON object that `hfa words... --json` prints.

    Standard error must contain nothing but its warnings. Those of `trim` and `linearize` are in
    their report.
    """
    result = hfa(*words, "--json")
    assert result.code == code, result.err
    data = json.loads(result.out, parse_constant=pytest.fail)
    assert isinstance(data, dict)
    notes = [] if words[0] in ("trim", "linearize") else data.get("warnings", [])
    said = [line for line in result.err.splitlines() if not line.startswith("wrote ")]
    assert said == [f"hfa: note: {note}" for note in notes]
    return data


def leaves(data: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Return every text, number and null of nested JSON data with its path of names and indices."""
    if isinstance(data, (dict, list)):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from leaves(value, f"{path}.{key}")
    else:
        yield path, data


def written_json(words: tuple[str, ...]) -> list[Path]:
    """Return the .json files given by -o, or that are in the folder that it names."""
    targets = [Path(path) for option, path in pairwise(words) if option in ("-o", "--output")]
    inside = [
        path
        for folder in targets
        if folder.suffix == "" and folder.is_dir()
        for path in folder.rglob("*.json")
    ]
    return [path for path in targets if path.suffix == ".json" and path.is_file()] + inside


def hfa_process(*words: str, folder: Path, **environment: str) -> Result:
    """Run `hfa words...` as a child process in a folder."""
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


def assert_refused(result: Result, code: int, *named: str) -> None:
    """Assert a failure with this exit code, no standard output, and one line with the given
    words.
    """
    assert (result.code, result.out) == (code, "")
    assert result.err.startswith("hfa: ")
    assert result.err.endswith("\n")
    assert result.err.count("\n") == 1, result.err
    for word in named:
        assert word in result.err


#: What was validated in this process: the format and the keys. Numbers alone make no new shape.
_SEEN: set[tuple[str, ...]] = set()


def assert_published(text: str) -> None:
    """Assert that every key of the JSON is published and has its type, once for each set of
    keys.
    """
    data = json.loads(text)
    shape = (str(data.get("schema")), *data)
    if shape not in _SEEN:
        found = complaints_about(data)
        assert found == [], f"{found}: declare it with the result"
        _SEEN.add(shape)


def complaints_about(data: dict[str, Any]) -> list[str]:
    """Return the faults of an output: errors of the schema, and keys that it does not list."""
    name = str(data.get("schema")).removeprefix("hfa.").partition("/")[0]
    if formats is None:
        return []
    definitions = formats()["$defs"]
    if name not in definitions:
        return [f"{data.get('schema')} is not published"]
    unknown = [
        f"{key} is not published" for key in data if key not in definitions[name]["properties"]
    ]
    return unknown + [
        f"{error.json_path}: {error.message[:200]}" for error in _validator(name).iter_errors(data)
    ]


@cache
def _validator(name: str) -> Any:
    from jsonschema import Draft202012Validator

    definitions = formats()["$defs"]
    return Draft202012Validator({**definitions[name], "$defs": definitions})


def refusal(load: Callable[[str], object], path: Path) -> str:
    """Return the message with which a file is refused: one line that names the file."""
    with pytest.raises(BadInputError) as caught:
        load(str(path))
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    return message
