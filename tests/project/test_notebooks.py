"""The notebooks in examples/ run, and their stored outputs are current."""

import ast
import base64
import contextlib
import io
import json
import os
import re
from typing import Any

import pytest
from matplotlib.figure import Figure
from pages import looks_like
from project import ROOT

NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))
Output = dict[str, Any]
#: A picture in HTML.
_PICTURE = r'src="data:image/png;base64,([^"]*)"'


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
    """Return a text without pictures, in which numbers are replaced by # and blanks are normalized.

    Numbers are replaced because rounding differs between processors.
    """
    without_pictures = re.sub(_PICTURE, "", text)
    return " ".join(re.sub(r"(?<![\w.])[-+]?\d[\w.+-]*", "#", without_pictures).split())


def outputs_agree(text, old):
    """Return whether two texts have the same words, without numbers, and similar pictures."""
    if words(text) != words(old):
        return False
    pictures = [base64.b64decode(each) for each in re.findall(_PICTURE, text)]
    return all(map(is_drawn_as, pictures, re.findall(_PICTURE, old)))


def is_drawn_as(picture, png):
    """Return whether a PNG picture looks like that of a base64 text, which may be empty."""
    return bool(png) and looks_like(io.BytesIO(picture), io.BytesIO(base64.b64decode(png)))


def png_of(figure):
    """Return a figure as PNG, drawn with the settings of a notebook."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=figure.dpi, bbox_inches="tight")
    return file.getvalue()


def complaints(cells):
    """Run the cells of a notebook and return a message for each changed output."""
    names = {"__name__": "__main__"}
    problems = []
    for number, (source, outputs) in enumerate(cells, start=1):
        printed, value = ran(source, names)
        if printed != stored(outputs, "stream"):
            problems.append(f"cell {number} prints {printed!r}")
        if isinstance(value, Figure):
            problems += (
                []
                if is_drawn_as(png_of(value), stored(outputs, "image/png"))
                else [f"cell {number} draws another picture than the stored one"]
            )
        elif value is not None:
            shown = {"text/plain": repr(value)}
            shown |= {"text/html": value._repr_html_()} if hasattr(value, "_repr_html_") else {}
            problems += [
                f"cell {number} says {text.partition(chr(10))[0]}, {kind} is another"
                for kind, text in shown.items()
                if not outputs_agree(text, stored(outputs, kind))
            ]
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
