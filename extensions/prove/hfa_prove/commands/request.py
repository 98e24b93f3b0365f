"""Requests of the commands `hfa prove`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from hfa.options.argument_types import each_of, input_file, one_of, positive, quantity
from hfa.options.command import Request
from hfa.options.critic_files import ReadingOptions, critic_path
from hfa.options.games import WeightOptions
from hfa.options.option import option
from hfa.options.trims import TrimOptions, at_option, dihedral_option
from hfa_aircraft.model import Model
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
class LoopOptions(TrimOptions, WeightOptions, ReadingOptions):
    """The closed loop of a region: an aircraft at a trim, with a policy and disturbances."""

    units: None = None
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
    disturbance: Mapping[str, str] = option(
        "instead of a region of attraction, prove a set that is invariant under every "
        "disturbance NAME up to SIZE; repeatable",
        "NAME=SIZE",
        named=True,
    )


def disturbances_of(request: LoopOptions, model: Model) -> dict[str, float]:
    """Return disturbance -> its largest absolute value, in the unit of the model."""
    return each_of("--disturbance", model, request.disturbance, disturbance_size)


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckRequest(Request, LoopOptions):
    """Options of `hfa prove --check`: a certificate, and data with which it must agree."""

    at: str | None = at_option("value or interval that the certificate must contain", "LOW:HIGH")
    dihedral: str | None = dihedral_option(
        "value or interval of the dihedral angle that the certificate must contain", "DEG|LOW:HIGH"
    )
    limit: Mapping[str, str] = option(
        "limits of a signal that the certificate must be about, degrees for angles; repeatable",
        "NAME=LOW:HIGH",
        named=True,
    )
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
    disturbance: Mapping[str, str] = option(
        "largest disturbance that the certificate must be about; repeatable",
        "NAME=SIZE",
        named=True,
    )


def _degree(text: str) -> int:
    return int(one_of("2", "4", "6")(text))


@dataclass(frozen=True, kw_only=True, eq=False)
class RegionRequest(Request, LoopOptions):
    """Options of `hfa prove region`."""

    limit: Mapping[str, str] = option(
        "limits of a state, input or output, within the model's: of the trim, and of the loop, "
        "where inputs are saturated, degrees for angles; repeatable",
        "NAME=LOW:HIGH",
        named=True,
    )
    degree: int | None = option("highest degree of V: 2, 4 or 6; default 4", "N", _degree)
    seconds: float = option(
        "limit of processor time for the search, s; default 60",
        "S",
        positive,
        default=60.0,
    )
