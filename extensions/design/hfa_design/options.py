"""The option --design."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hfa.options.aircraft import is_own
from hfa.options.part import OfModel, option
from hfa_aircraft.model import Model
from hfa_design.design import NAMED, Design, load_design


def about_design(model: Model) -> str:
    """Return the help of --design for a model, with the shipped designs for the HFA."""
    shipped = "" if is_own(model) else f"{', '.join(NAMED)}, or "
    return f"design with actuators and weights: {shipped}a .toml file"


def design_option(about: str | Callable[[Model], str] = about_design) -> Any:
    """Return the request field `design`, with the option --design for a design with actuators and
    weights.

    about: help of the option
    """
    return option(about, "NAME", OfModel(_design))


def _design(model: Model, name: str) -> Design:
    return load_design(name, model)
