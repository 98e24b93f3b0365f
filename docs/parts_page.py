"""Generator of the documentation page on command parts, from the entry points of `hfa.parts`."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from hfa_support.entry_points import CRITICS, PARTS, loaded, offered

_HEAD = """# Parts of commands

A part of `hfa.parts` is a function with a signature listed below. Its types belong to the package that
uses the part. `controllers` and `policies` are modules with these functions.
`about.NAME` is the help of the part NAME. `results.NAME` is a tuple of texts, like
`CommandEntry.results`, that declares the results of the part. The entry points `nonlinear` and
`nonlinear.steps` of `hfa.critics` judge a critic that is not a matrix.
"""
#: Part that is a module -> functions in it that the core calls.
MODULES = {
    "controllers": (
        "c_controller_texts",
        "controller_steering",
        "load_controller",
        "load_controller_or_gains",
        "servo_policy",
    ),
    "policies": (
        "flown_card",
        "flown_deployment",
        "sampled_scenario",
    ),
}


def parts_page() -> str:
    """Return a Markdown page with the signature of every installed part, sorted by name."""
    lines = [f"{name}{signature_of(part)}" for name, part in sorted(functions().items())]
    return "\n".join([_HEAD, "```text", *lines, "```", ""])


def functions() -> dict[str, Callable[..., Any]]:
    """Return the functions of all installed parts by name.

    The checks of nonlinear critics are included. If a part is a module, its functions listed in
    `MODULES` are named "part.function".
    """
    parts = {name: loaded(offer) for name, offer in offered(PARTS).items()}
    judges = {name: loaded(offered(CRITICS)[name]) for name in ("nonlinear", "nonlinear.steps")}
    of_modules = {
        f"{module}.{name}": getattr(parts[module], name)
        for module, names in MODULES.items()
        for name in names
    }
    return {name: part for name, part in (parts | judges).items() if callable(part)} | of_modules


def signature_of(function: Callable[..., Any]) -> str:
    """Return the signature of a function, with annotations as written in its source."""
    signature = inspect.signature(function)
    parameters = [
        parameter.replace(annotation=_Written(parameter.annotation))
        for parameter in signature.parameters.values()
    ]
    returned = _Written(signature.return_annotation)
    return str(signature.replace(parameters=parameters, return_annotation=returned))


class _Written(str):
    """Text of an annotation. It is printed without quotes."""

    def __repr__(self) -> str:
        return str(self)
