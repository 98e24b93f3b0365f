"""What an experiment is: the flights it needs, the claims it tests, the pictures it draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from verification.experiments.claims import Claim, Judgement
from verification.experiments.experiment_flights import FlightPlan, FlightRecord
from verification.experiments.panels import Picture
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
    pictures: Callable[[Setting, Mapping[FlightPlan, FlightRecord]], tuple[Picture, ...]]


@dataclass(frozen=True, eq=False)
class Outcome:
    """An experiment that was flown."""

    experiment: Experiment
    setting: Setting
    flown: Mapping[FlightPlan, FlightRecord]
    judgements: tuple[Judgement, ...]
