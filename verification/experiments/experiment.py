"""What an experiment is: the flights it needs, the claims it tests, the pictures it draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from verification.experiments.claims import CheckedClaim, Claim
from verification.experiments.experiment_flights import FlightPlan, FlightRecord
from verification.experiments.panels import PaperFigure
from verification.experiments.setting import Setting

#: The two aircraft of Section 5.1, degrees of dihedral.
CASE_I, CASE_II = 15.0, 5.0


@dataclass(frozen=True)
class Experiment:
    """One part of Section 5. flights and pictures follow from the setting; claims are fixed."""

    section: str
    title: str
    flights: Callable[[Setting], tuple[FlightPlan, ...]]
    claims: tuple[Claim, ...]
    pictures: Callable[[Setting, Mapping[FlightPlan, FlightRecord]], tuple[PaperFigure, ...]]


@dataclass(frozen=True, eq=False)
class Outcome:
    """An experiment whose flights were simulated and whose claims were checked."""

    experiment: Experiment
    setting: Setting
    flown: Mapping[FlightPlan, FlightRecord]
    claims: tuple[CheckedClaim, ...]
