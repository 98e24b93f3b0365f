"""Building blocks of C source: templates, comments, enumerations, tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.files import written_whole


def filled(file: str, **values: object) -> str:
    """Return a file whose template is FILE.in, with the values of its fields filled in."""
    return files(__package__).joinpath(f"{file}.in").read_text("utf-8").format(**values)


def comment_lines(text: str) -> str:
    """Return a text as the content of a C comment. A comment end within the text is broken up."""
    return "\n   ".join(text.replace("*/", "* /").splitlines())


def enumerators(units: Mapping[str, str], prefix: str = "HFA_") -> str:
    """Return the lines of a C enumeration, such as "HFA_SPEED, /* ft/s */".

    units: name -> unit, or "" without a unit
    prefix: begin of each name
    """
    lines = []
    for name, unit in units.items():
        comment = f" /* {unit} */" if unit else ""
        lines.append(f"    {prefix}{name.upper()},{comment}")
    return "\n".join(lines)


def name_tables(kind: str, units: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the tables of names and of units, as declaration -> list of C strings.

    kind: part of the names of both tables
    units: name -> unit
    """
    return {
        f"const char *const hfa_{kind}_name": [f'"{name}"' for name in units],
        f"const char *const hfa_{kind}_unit": [f'"{unit}"' for unit in units.values()],
    }


def or_unused(units: dict[str, str]) -> dict[str, str]:
    """Return the names and units, or one unused entry, because C permits no empty array."""
    return units or {"unused": ""}


def constant_tables(values_by_declaration: Mapping[str, Any]) -> str:
    """Return C definitions of constant arrays, with matrices row by row.

    values_by_declaration: declaration of the array without its sizes -> values
    """
    lines = []
    for declaration, values in values_by_declaration.items():
        array = np.array(values)
        sizes = "".join(f"[{size}]" for size in array.shape)
        lines.append(f"{declaration}{sizes} = {braced(array.tolist())};")
    return "\n".join(lines)


def braced(values: Any) -> str:
    """Return a number, a text or a nested list as a C initializer."""
    if isinstance(values, list):
        return f"{{{', '.join(map(braced, values))}}}"
    if values == np.inf:
        return "HUGE_VAL"
    if values == -np.inf:
        return "-HUGE_VAL"
    return str(values)


def units_of(model: Model, names: Iterable[str]) -> dict[str, str]:
    """Return the units of signals of a model, by name."""
    return {name: model.unit(name) for name in names}


def displaced_state(model: Model) -> tuple[str, float]:
    """Return a state and its initial deviation, for the example loop.

    The state is the speed, with the deviation 1. Without a state `speed`, the first state of the
    linear model is returned, with 1 % of its nominal size.
    """
    if "speed" in model.states:
        return "speed", 1.0
    name = model.linear[0]
    return name, model.states[name].nominal / 100


def write_texts(folder: Path, texts: Mapping[str, str]) -> list[Path]:
    """Write text files in UTF-8 to a folder, all or none, and return their paths.

    The folder is created if necessary.

    texts: file name -> text
    """
    folder.mkdir(exist_ok=True)
    with ExitStack() as written:  # the files are replaced when all are written
        for name, text in texts.items():
            stream = written.enter_context(written_whole(folder / name))
            stream.write(text.encode("utf-8"))
            stream.flush()
    return [folder / name for name in texts]
