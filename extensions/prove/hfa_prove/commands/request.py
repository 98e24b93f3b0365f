"""Requests of the commands `hfa prove`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hfa.inherited import OutputOptions, PlantOptions, ReadingOptions
from hfa.learning import setting_option
from hfa.options.argument_types import input_file, one_of, positive, quantity
from hfa.options.critics import READING_SETTINGS, critic_path
from hfa.options.output import picture_option
from hfa.options.part import OfModel, option
from hfa.options.trim import scheduled
from hfa_aircraft.model import Model
from hfa_design.options import design_option
from hfa_prove.commands.options import interval_of
from hfa_support.errors import refuse_unknown


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckRequest(PlantOptions, ReadingOptions, OutputOptions):
    """Options of `hfa prove --check`: a certificate, and data with which it must agree."""

    check: Path | None = option("certificate to verify", "FILE", input_file(".json"))
    at: Any = scheduled(
        interval_of, "DEG|LOW:HIGH", "value or interval that the certificate must contain"
    )
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
    set: Mapping[str, Any] = setting_option(
        "setting of the network in --weights, as in the proof: scale=a,b,..., activation=NAME",
        READING_SETTINGS,
    )
    design: Any = design_option("design that defines the actuators of the controller in --weights")

    def origin(self) -> Mapping[str, Any]:
        """Return the provenance of the user's aircraft file, or {} if no file is given."""
        return self._origin_of_file({}) if self.own else {}


def _size(model: Model, name: str, text: str) -> float:
    """Return the largest absolute value of a disturbance, in the unit of the model.

    name: name of the disturbance
    text: the value of the option, with or without a unit

    Raises BadInputError if the model has no such disturbance or the value is not positive.
    """
    refuse_unknown(f"{model.name} declares no disturbance", name, tuple(model.disturbances))
    positive(text)
    return quantity(model, name, text)


@dataclass(frozen=True, kw_only=True, eq=False)
class RegionRequest(PlantOptions, ReadingOptions, OutputOptions):
    """Options of `hfa prove region`."""

    weights: Path | None = option(
        "file with a policy: K, P, W, or a network (the region is proved with boxes); default: "
        "policy of the exact game",
        "FILE",
        critic_path,
    )
    policy: Path | None = option(
        "deployment file of a policy, which is evaluated in continuous time; the region is proved "
        "with boxes",
        "DEPLOYMENT.toml",
        input_file(".toml"),
    )
    set: Mapping[str, Any] = setting_option(
        "setting of a critic: scale=a,b,... (network: factor on each state), "
        "activation=HIDDEN[,OUTPUT] (state dict)",
        READING_SETTINGS,
    )
    check: Path | None = option(
        "verify this certificate instead of proving a region", "FILE", input_file(".json")
    )
    degree: int = option(
        "highest degree of V: 2, 4 or 6; default 4", "N", lambda text: _degree(text), default=4
    )
    seconds: float = option(
        "limit of processor time for the search, s; default 60",
        "S",
        positive,
        default=60.0,
    )
    prover: str | None = option(
        "method of proof: squares (sums of squares) or boxes (branch and bound); default: both, "
        "each in half of the time",
        "NAME",
        lambda text: one_of("squares", "boxes")(text),
    )
    disturbance: Mapping[str, float] = option(
        "instead of a region of attraction, prove a set that is invariant under every "
        "disturbance NAME up to SIZE; repeatable",
        "NAME=SIZE",
        OfModel(_size),
        named=True,
    )
    resume: bool = option(
        "resume from the Lyapunov function V in the certificate given by -o", rare=True
    )
    picture: Path | None = picture_option(
        "sections of the proved set, and initial conditions that do not converge"
    )


def _degree(text: str) -> int:
    return int(one_of("2", "4", "6")(text))
