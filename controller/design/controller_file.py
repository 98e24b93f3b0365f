"""A scheduled controller as a file: .npz, which is read again, and .mat for other tools."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from controller.design.scheduled_controller import ScheduledController
from controller.game.array_file import read_arrays
from hfa_model.reporting.data_files import save_data
from hfa_model.reporting.text import Table
from hfa_model.support.errors import BadInputError
from hfa_model.support.jsonable import jsonable

SCHEMA = "hfa.controller/1"
#: Formats that a controller is written in.
SUFFIXES = (".npz", ".mat")
_ARRAYS = ("dihedrals", "A", "B", "C", "D", "W", "trim_states", "trim_inputs", "command_filter")
_NAMES = ("states", "measurements", "commands", "inputs")
_TEXTS = ("name", "feedback", "dynamics", "parameters")


def save_controller(path: str | Path, controller: ScheduledController) -> None:
    """Write .npz, stacks (N, rows, columns) as in Python, or .mat, stacks (rows, columns, N); whole or not at all.

    Names are arrays of text (.mat: cells); `about` is JSON text. BadInputError for another suffix or folder.
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise BadInputError(f"{path}: a controller is written as {' or '.join(SUFFIXES)}; choose one of them")
    content: dict[str, Any] = {"schema": SCHEMA, "about": json.dumps(jsonable(controller.about))}
    content |= {key: getattr(controller, key) for key in _TEXTS}
    content |= {key: np.array(getattr(controller, key), dtype=float) for key in _ARRAYS}
    names = {key: list(getattr(controller, key)) for key in _NAMES}
    if target.suffix.lower() == ".mat":
        content |= names
    else:
        content |= {key: np.array(value, dtype=np.str_) for key, value in names.items()}
    save_data(target, content, Table((), ()))


def load_controller(path: str | Path) -> ScheduledController:
    """The controller in a .npz file of `save_controller`. BadInputError names the file and what is wrong with it."""
    if Path(path).suffix.lower() != ".npz":
        raise BadInputError(f"{path}: a controller is read from a .npz file; save it as one")
    content = read_arrays(path)
    if str(content.get("schema", "")) != SCHEMA:
        raise BadInputError(f"{path}: this is no controller file ({SCHEMA}); make one with hfa design -o")
    missing = [each.name for each in fields(ScheduledController) if each.name not in content]
    if missing:
        raise BadInputError(f"{path}: {missing[0]} is missing; make the file anew with hfa design -o")
    try:
        found: dict[str, Any] = {key: str(content[key]) for key in _TEXTS}
        found |= {key: tuple(map(str, content[key].ravel())) for key in _NAMES}
        found |= {key: np.asarray(content[key], dtype=float) for key in _ARRAYS}
        found["command_filter"] = tuple(found["command_filter"].ravel().tolist())
        return ScheduledController(**found, about=json.loads(str(content["about"])))
    except BadInputError as error:
        raise BadInputError(f"{path}: {error}") from error
    except (ValueError, TypeError, RecursionError) as error:
        raise BadInputError(f"{path}: its content is damaged ({error}); make the file anew") from error
