"""TOML files by name, those of a package and the user's own; what is wrong in one is said with its name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from hfa_model.support.echo import shown
from hfa_model.support.errors import BadInputError
from hfa_model.support.input_files import read_toml


def read_named(what: str, name: str, packaged: Mapping[str, str], folder: str, keys: tuple[str, ...]) -> dict[str, Any]:
    """The entries of a file of the package `folder`, by its name in `packaged` (name -> file), or of the user's file.

    what: what the file describes, for messages. keys: the entries it may have. BadInputError where there is no such
    name and file, and for any other entry.
    """
    try:
        data = read_toml(str(files(folder).joinpath(packaged[name])) if name in packaged else name)
    except OSError as error:
        raise BadInputError(
            f"{name}: no {what} of that name and no readable file; the names are {', '.join(packaged)}"
        ) from error
    unknown = sorted(set(data) - set(keys))
    if unknown:
        raise BadInputError(f"{name}: unknown entry {shown(unknown[0])}; a {what} has {', '.join(keys)}")
    return data


def table_of(where: str, data: Mapping[str, Any], key: str) -> dict[str, Any]:
    """The table [key]; empty where there is none. where: the file, for the message of BadInputError."""
    table = data.get(key, {})
    if not isinstance(table, dict):
        raise BadInputError(f"{where}: {key} is {shown(table)}; make it the table [{key}]")
    return table


def names_of(where: str, data: Mapping[str, Any], key: str, default: tuple[str, ...] = ()) -> tuple[str, ...]:
    """The list of names under a key."""
    value = data.get(key, list(default))
    if not isinstance(value, list) or not all(isinstance(each, str) for each in value):
        raise BadInputError(f"{where}: {key} is {shown(value)}; give a list of names in quotes")
    return tuple(value)


def finite_number(where: str, entry: str, value: Any) -> float:
    """A value as a float. BadInputError where it is no number, or no finite one."""
    try:
        number = math.nan if isinstance(value, bool) or not isinstance(value, (int, float)) else float(value)
    except OverflowError:  # TOML's integers have no limit, Python's floats do
        number = math.inf
    if not math.isfinite(number):
        raise BadInputError(f"{where}: {entry} is {shown(value)}; give a finite number")
    return number
