"""Certificates as content of a file, changes of their entries, and what is decided about them."""

from __future__ import annotations

import copy
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import pytest

from hfa_prove.certificate import SCHEMA
from hfa_support.errors import NoSolutionError

Content = dict[str, Any]


def certificate(kind: str, statement: Any, witness: Content) -> Content:
    """Return the content of the file of a certificate."""
    closing = dict.fromkeys(("toolchain", "digest", "provenance", "checksum"), "")
    claims = {"statement": statement.content(), "witness": witness}
    return {**closing, "schema": SCHEMA, "kind": kind, **claims}


def put(value: Any, *path: Any) -> Callable[[Content], None]:
    """Return a change that replaces an entry by a value, or by a function of the old value."""

    def change(content: Content) -> None:
        holder: Any = content
        for key in path[:-1]:
            holder = holder[key]
        holder[path[-1]] = value(holder[path[-1]]) if callable(value) else value

    return change


def changed(content: Content, **changes: Any) -> Content:
    """Return a copy of a certificate with other entries.

    changes: keys of an entry, joined by two underscores -> its value, or a function of the old value
    """
    made = copy.deepcopy(content)
    for name, value in changes.items():
        keys = (int(key) if key.isdigit() else key for key in name.split("__"))
        put(value, *keys)(made)
    return made


def decided(
    is_proved: bool, words: str = "", error: type[Exception] = NoSolutionError
) -> AbstractContextManager[Any]:
    """Return a context in which a claim is proved, or refused with these words."""
    return nullcontext() if is_proved else pytest.raises(error, match=words or None)
