"""Options for reading the file of a critic."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from controller.critic.critic_file import Reading, critic_suffixes
from hfa.options.argument_types import input_file, listed_numbers
from hfa.options.option import option
from hfa_support.errors import BadInputError, choice_of
from hfa_support.files import MATRIX_FILES
from trim.linear.linear_model import LinearModel

#: Setting of --set -> type of its value, for files of --weights.
_SETTINGS: dict[str, Callable[[str], Any]] = {
    "activation": str,
    "scale": listed_numbers,
}


def critic_path(text: str) -> Path:
    """Return the path of a critic file.

    text: path of an existing file with a supported suffix

    Raises BadInputError if the file does not exist, or if its suffix is not supported.
    """
    if Path(text).suffix.lower() in MATRIX_FILES:
        return input_file(*MATRIX_FILES)(text)
    return input_file(*critic_suffixes())(text)


def _setting(name: str, text: str) -> Any:
    """Return the value of --set NAME=TEXT."""
    if name not in _SETTINGS:
        raise BadInputError(f"is not a setting of a critic; {choice_of(name, _SETTINGS)}")
    return _SETTINGS[name](text)


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadingOptions:
    """How the critic file of --weights is read."""

    basis: str | None = option(
        "basis functions of W: a name (default quadratic), or a list 'x1**2, x1*x2, sin(x3)'",
        "BASIS",
        rare=True,
    )
    network: str = option(
        "roles of network parts, such as V=critic,policy=actor; default: by number of outputs",
        "[V=]NAME",
        default="",
        rare=True,
    )

    set: Mapping[str, Any] = option(
        "setting of a network: scale=a,b,... (factor on each state), activation=HIDDEN[,OUTPUT] "
        "(state dict)",
        "NAME=VALUE",
        _setting,
        named=True,
        rare=True,
    )


def reading_of(request: ReadingOptions, linear: LinearModel | None = None) -> Reading:
    """Return the settings for reading a critic file.

    linear: linear model of the game at a trim of an aircraft, or None
    """
    activation, scale = request.set.get("activation"), request.set.get("scale")
    return Reading(request.basis, request.network, activation, scale, linear)
