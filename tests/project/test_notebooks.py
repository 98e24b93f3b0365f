"""The notebooks in examples/ run, and their stored outputs are current."""

import ast
import contextlib
import io
import json
import os
import re

import pytest
from matplotlib.figure import Figure
from project import ROOT

NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))


def code_cells(path):
    """Return (source, stored outputs) of each code cell, without lines that begin with %."""
    cells = [
        cell
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]
        if cell["cell_type"] == "code"
    ]
    return [
        ("".join(line for line in cell["source"] if not line.startswith("%")), cell["outputs"])
        for cell in cells
    ]


def ran(source, names):
    """Run the source of a cell and return (printed text, value of its last expression).

    names: namespace of the notebook
    """
    tree = ast.parse(source)
    printed = io.StringIO()
    value = None
    with contextlib.redirect_stdout(printed):
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, "cell", "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    return printed.getvalue(), value


def stored(outputs, kind):
    """Return the stored text of a cell.

    kind: "stream" for printed text, or a MIME type
    """
    printed = [output["text"] for output in outputs if output["output_type"] == "stream"]
    values = [
        output["data"].get(kind, []) for output in outputs if output["output_type"] != "stream"
    ]
    return "".join("".join(text) for text in (printed if kind == "stream" else values))


def words(text):
    """Return a text in which numbers, whose rounding differs between processors, are replaced by #."""
    return " ".join(re.sub(r"(?<![\w.])[-+]?\d[\w.+-]*", "#", text).split())


def complaints(cells):
    """Run the cells of a notebook and return a message for each changed text."""
    names = {"__name__": "__main__"}
    problems = []
    for number, (source, outputs) in enumerate(cells, start=1):
        printed, value = ran(source, names)
        if printed != stored(outputs, "stream"):
            problems.append(f"cell {number} prints {printed!r}")
        if value is not None and not isinstance(value, Figure):
            shown = repr(value)
            if words(shown) != words(stored(outputs, "text/plain")):
                problems.append(f"cell {number} says {shown.partition(chr(10))[0]}")
    return problems


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_cells_reproduce_their_stored_output(path):
    """The cells of a notebook reproduce their stored output, which has no path of a machine, no
    error and no times.
    """
    assert complaints(code_cells(path)) == [], "run `make notebooks`"
    text = path.read_text(encoding="utf-8")
    assert not any(
        word in text
        for word in (os.sep + "tmp" + os.sep, os.sep + "home" + os.sep, "Traceback", "iopub")
    )
