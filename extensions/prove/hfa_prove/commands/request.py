"""Requests of the commands `hfa prove`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import (
    breakpoint_value,
    input_file,
    one_of,
    positive,
    quantity,
)
from hfa.options.critics import ReadingGiven, critic_path
from hfa.options.game import GameGiven
from hfa.options.part import OfModel, option, part
from hfa.options.request import Request
from hfa.options.trim import Trim, limits_option, scheduled
from hfa_aircraft.model import Model
from hfa_prove.commands.options import interval_of
from hfa_support.errors import BadInputError, choice_of


def disturbance_size(model: Model, name: str, text: str) -> float:
    """Return the largest absolute value of a disturbance, in the unit of the model.

    name: name of the disturbance
    text: the value of the option, with or without a unit

    Raises BadInputError if the model has no such disturbance or the value is not positive.
    """
    if name not in model.disturbances:
        raise BadInputError(f"is unknown; {choice_of(name, model.disturbances)}")
    positive(text)
    return quantity(model, name, text)


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckRequest(Request):
    """Options of `hfa prove --check`: a certificate, and data with which it must agree."""

    aircraft: Aircraft = part(Aircraft, without=("units",))
    trim: Trim = part(
        Trim,
        at=scheduled(
            interval_of, "DEG|LOW:HIGH", "value or interval that the certificate must contain"
        ),
        limit=limits_option("limits of a signal that the certificate must be about", rare=True),
    )
    game: GameGiven = part(GameGiven, without=("plant",))
    reading: ReadingGiven = part(ReadingGiven)
    check: Path | None = option("certificate to verify", "FILE", input_file(".json"))
    weights: Path | None = option(
        "file with the gains, critic or network that the certificate must be about",
        "FILE",
        critic_path,
    )
    policy: Path | None = option(
        "deployment file of the policy that the certificate must be about",
        "DEPLOYMENT.toml",
        input_file(".toml"),
    )
    disturbance: Mapping[str, float] = option(
        "largest disturbance that the certificate must be about; repeatable",
        "NAME=SIZE",
        OfModel(disturbance_size),
        named=True,
    )

    def origin(self) -> Mapping[str, Any]:
        """Return the provenance of the user's aircraft file, or {} if no file is given."""
        return self.aircraft.origin({}) if self.aircraft.is_given else {}


def _degree(text: str) -> int:
    return int(one_of("2", "4", "6")(text))


@dataclass(frozen=True, kw_only=True, eq=False)
class RegionRequest(Request):
    """Options of `hfa prove region`."""

    aircraft: Aircraft = part(Aircraft, without=("units",))
    trim: Trim = part(
        Trim,
        at=scheduled(breakpoint_value, required=True),
        limit=limits_option(
            "limits of a state, input or output, within the model's: of the trim, and of the loop, "
            "where inputs are saturated",
            rare=True,
        ),
    )
    game: GameGiven = part(GameGiven, without=("plant",))
    reading: ReadingGiven = part(ReadingGiven)
    weights: Path | None = option(
        "file with a policy: K, P, W, or a network; default: policy of the exact game",
        "FILE",
        critic_path,
    )
    policy: Path | None = option(
        "deployment file of a policy, which is evaluated in continuous time",
        "DEPLOYMENT.toml",
        input_file(".toml"),
    )
    degree: int = option("highest degree of V: 2, 4 or 6; default 4", "N", _degree, default=4)
    seconds: float = option(
        "limit of processor time for the search, s; default 60",
        "S",
        positive,
        default=60.0,
    )
    disturbance: Mapping[str, float] = option(
        "instead of a region of attraction, prove a set that is invariant under every "
        "disturbance NAME up to SIZE; repeatable",
        "NAME=SIZE",
        OfModel(disturbance_size),
        named=True,
    )
