"""Reference answers: what commands print and draw, stored beside the tests of a room.

`python tests/support/references.py FOLDER` stores those of tests/FOLDER/references.json anew.
"""

import contextlib
import csv
import json
import math
import os
import re
import shlex
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np
import pytest
from cli import hfa
from matplotlib.figure import Figure
from project import ROOT

#: A number in a text, and one that is only a rounding.
_NUMBER, _ROUNDING = re.compile(r"-?\d+(?:\.\d+)?"), re.compile(r"-?\d(?:\.\d+)?e-\d+")
#: Version and date of an output, digest of a file, and what made a table.
_MADE = re.compile(
    r"hfa \d\S+ \d{4}-\d\d-\d\d|SHA-256 \w+|\b(?=\w*\d)[0-9a-f]{12}\b|.*\"command\".*", re.DOTALL
)
_UNSTORED = {"provenance", "made_by", "toolchain"}
#: Most numbers that are stored one by one; of more, the sum and a weighted sum are.
_LONGEST = 40


def drawn(figure):
    """Return what a figure shows: its size, and titles, texts, lines and bars of its panels."""
    shown = [[*figure.get_size_inches()], [str(each.get_text()) for each in figure.texts]]
    for axes in [*figure.axes, *figure.legends]:
        shown.append([each.get_text() for each in axes.texts])
        if axes in figure.legends:
            continue
        shown.append([axes.get_title(), axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()])
        shown += [[*axes.get_xlim()], [*axes.get_ylim()]]
        shown += [[*map(str, (each.xy, each.xyann, each.get_va(), each.get_fontsize()))]
                  for each in axes.texts if hasattr(each, "xyann")]  # fmt: skip
        shown += [[line.get_color(), line.get_linestyle(), line.get_marker(),
                   line.get_linewidth(), line.get_alpha(), line.get_xydata().tolist()]
                  for line in axes.lines]  # fmt: skip
        shown += [[*patch.get_extents().bounds] for patch in axes.patches]
    return shown


def answer_of(line, folder):
    """Return exit code, output, JSON and pictures of a command; `examples/` is the project's.

    Its path is relative, so that lines of outputs do not depend on where the project lies.
    """
    words, pictures = shlex.split(line), []
    (folder / "examples").symlink_to(ROOT / "examples")

    def record(figure, *_, **__):
        pictures.append(drawn(figure))

    os.chdir(folder)
    with patch.object(Figure, "savefig", record), patch.object(sys, "argv", ["hfa", *words]):
        done = hfa(*words)
    said = [text.splitlines() for text in (done.out, done.err)]
    content = {"code": done.code, "said": said, "drawn": pictures}
    if not pictures and "-o" not in words:
        content["data"] = json.loads(hfa(*words, "--json").out or "{}")
    for path in folder.glob("*.csv"):
        rows = csv.reader(path.read_text("utf-8").splitlines())
        content[path.name] = [list(map(_cell, row)) for row in rows if row[0][:1] != "#"]
    for path in folder.glob("*.md"):
        content[path.name] = path.read_text("utf-8").splitlines()
    for path in folder.glob("*.zarr"):
        import xarray

        with xarray.open_zarr(path, consolidated=False) as dataset:
            content[path.name] = dataset.to_dict()
    return content


def _cell(text):
    """Return the number in a cell of a table, or its text."""
    with contextlib.suppress(ValueError):
        return float(text)
    return text


def rounded(value):
    """Return a part of an answer as it is stored: numbers of 10 digits, long arrays as two sums."""
    if isinstance(value, dict):
        return {key: rounded(value[key]) for key in sorted(value, key=str) if key not in _UNSTORED}
    if isinstance(value, list | tuple):
        with contextlib.suppress(TypeError, ValueError):
            array = np.asarray(value, dtype=float)
            if array.size > _LONGEST:
                weights = 1.0 + np.cos(np.arange(float(array.size)))
                return [
                    str(array.shape),
                    *map(float, np.nansum([array.ravel(), array.ravel() * weights], 1)),
                ]
        return [rounded(each) for each in value]
    if isinstance(value, complex):
        return [rounded(value.real), rounded(value.imag)]
    if isinstance(value, str):
        return _MADE.sub("", value.replace(f"{ROOT}/", ""))
    return float(f"{value:.9e}") if isinstance(value, float) else value


def differences(now, before, path=""):
    """Return where two answers differ: numbers by 1e-6, or by the last digit in a text."""
    if str(now) == str(before):
        return []
    if isinstance(before, dict) and isinstance(now, dict):
        now, before = ([*map(list, each.items())] for each in (now, before))
    if isinstance(before, list) and isinstance(now, list) and len(now) == len(before):
        pairs = enumerate(zip(now, before, strict=True))
        return [line for i, pair in pairs for line in differences(*pair, f"{path}/{i}")]
    if isinstance(before, str) and isinstance(now, str):
        now, before = (_ROUNDING.sub("0", each) for each in (now, before))
        numbers, others = (_NUMBER.findall(each) for each in (now, before))
        if _NUMBER.split(now) == _NUMBER.split(before):
            digits = [len(each.partition(".")[2]) for each in others]
            pairs = zip(numbers, others, digits, strict=True)
            if all(abs(float(a) - float(b)) <= 1.01 * (0.1**n if n else 0.0) for a, b, n in pairs):
                return []
    elif isinstance(before, float) and isinstance(now, int | float):
        is_equal = math.isclose(now, before, rel_tol=1e-6, abs_tol=1e-9)
        return [] if is_equal else [f"{path}: {now} instead of {before}"]
    return [f"{path}: {now!r} instead of {before!r}"]


def stored(folder):
    """Return command -> stored answer of the tests in a folder, and their file."""
    path = ROOT / "tests" / folder / "references.json"
    return json.loads(path.read_text("utf-8")), path


def comparison(room):
    """Return the test that compares the stored answers of a room, which its folder has."""
    answers, _ = stored(room)

    @pytest.mark.parametrize("line", answers)
    def test_an_answer_is_the_stored_one(line, folder):
        """Exit code, words, numbers and drawings of a command are those of `references.json`."""
        found = differences(rounded(answer_of(line, folder)), answers[line])
        assert found == [], "\n".join(found)

    return test_an_answer_is_the_stored_one


def _lines(answers):
    """Return the text of a file of answers, one line each."""
    lines = (f"{json.dumps(line)}: {json.dumps(each)}" for line, each in answers.items())
    return "{" + ",\n".join(lines) + "}\n"


if __name__ == "__main__":
    os.environ["SOURCE_DATE_EPOCH"] = "1790000000"  # as in conftest.py
    for folder in sys.argv[1:]:
        answers, path = stored(folder)
        for line in answers:
            with TemporaryDirectory() as name:
                answers[line] = rounded(answer_of(line, Path(name)))
        path.write_text(_lines(answers), "utf-8")
