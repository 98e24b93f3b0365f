"""Requests of the commands `hfa prove`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hfa.options.argument_types import input_file
from hfa.options.critics import READING_SETTINGS, ReadingOptions, critic_path
from hfa.options.games import PlantOptions, setting_option
from hfa.options.request import option
from hfa.options.trims import OutputOptions, scheduled
from hfa_design.options import design_option
from hfa_prove.commands.options import interval_of


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
