"""The four experiments of Section 5: the flights that each needs, the claims it tests, the figures it draws."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from studies.section5 import graphs
from studies.section5.claim_table import claims_of
from studies.section5.claims import TRACKING, CheckedClaim, Claim
from studies.section5.experiment_flights import FlightPlan, FlightRecord
from studies.section5.flown_laws import (
    CERTIFIED,
    CERTIFIED_FF,
    EXACT,
    EXACT_FF,
    INTEGRAL,
    MODIFIED,
    PRINTED,
    REWEIGHTED,
)
from studies.section5.measures import FLIGHTS
from studies.section5.metrics import TRACKED
from studies.section5.panels import PaperFigure, PlotPanel
from studies.section5.setting import CASE_I, CASE_II, Setting

Flights = Mapping[FlightPlan, FlightRecord]
#: What a figure shows, how many columns it has, and its panels.
Drawn = tuple[str, int, tuple[PlotPanel, ...]]

_TITLES = ("Case I, 15 deg", "Case II, 5 deg")
#: Whose learning is drawn.
_LEARNED = (MODIFIED, CERTIFIED)
_WORDS = dict(zip(TRACKED, ("speed", "angle of attack", "dihedral"), strict=True))


@dataclass(frozen=True)
class Experiment:
    """One part of Section 5. flights: of a setting. figures: of a setting, its flights and T_w, s.

    first: the number in the paper of the first figure.
    """

    section: str
    title: str
    first: int
    flights: Callable[[Setting], tuple[FlightPlan, ...]]
    figures: Callable[[Setting, Flights, float], Iterable[Drawn]]

    @cached_property
    def claims(self) -> tuple[Claim, ...]:
        """What the paper says in this section."""
        return claims_of(self.section)

    def pictures(self, setting: Setting, flown: Flights) -> tuple[PaperFigure, ...]:
        """The paper's figures of the section."""
        drawn = self.figures(setting, flown, setting.configuration.predefined_time(self.section))
        return tuple(PaperFigure(number, *each) for number, each in enumerate(drawn, self.first))


@dataclass(frozen=True, eq=False)
class Outcome:
    """An experiment whose flights were simulated and whose claims were checked."""

    experiment: Experiment
    setting: Setting
    flown: Flights
    claims: tuple[CheckedClaim, ...]


def _trim_points(setting: Setting) -> tuple[FlightPlan, ...]:
    """Every law in both cases, and from rest under the disturbance alone."""
    flown = [FlightPlan(angle, law) for angle in (CASE_I, CASE_II) for law in (*TRACKING, REWEIGHTED)]
    return (*flown, *_of("disturbance alone", setting, (PRINTED, MODIFIED, CERTIFIED, EXACT)))


def _of(group: str, setting: Setting, laws: Iterable[str]) -> list[FlightPlan]:
    return [plan for law in laws for plan in FLIGHTS[group](setting, law)]


def _figures_of_trim_points(setting: Setting, flown: Flights, T_w: float) -> Iterable[Drawn]:
    """Figures 3 to 10."""

    def by_case(laws: Sequence[str]) -> list[list[FlightRecord]]:
        return [[flown[FlightPlan(angle, law)] for law in laws] for angle in (CASE_I, CASE_II)]

    tracking, steering = by_case((PRINTED, MODIFIED, CERTIFIED, CERTIFIED_FF, EXACT_FF)), (MODIFIED, CERTIFIED, EXACT)
    for state in TRACKED:
        panels = graphs.beside(graphs.state_panel, _TITLES, tracking, "law", T_w, state)
        yield f"{_WORDS[state].capitalize()} tracking", 2, panels
    yield "Control inputs", 2, graphs.input_panels(_TITLES, by_case(steering), "law", T_w)
    learning = by_case(_LEARNED)
    each = [
        (f"{record.plan.law}, {title}", record)
        for records in zip(*learning, strict=True)
        for title, record in zip(_TITLES, records, strict=True)
    ]
    yield "Critic weights", 2, tuple(graphs.weights_panel(*pair, T_w) for pair in each)
    yield "Critic-weight increments", 2, tuple(graphs.increments_panel(*pair, T_w) for pair in each)
    yield "Bellman residuals", 2, graphs.beside(graphs.residual_panel, _TITLES, learning, "law", T_w)
    yield "Critic weight-update norms", 2, graphs.beside(graphs.update_panel, _TITLES, learning, "law", T_w)


def _figures_of_comparison(setting: Setting, flown: Flights, T_w: float) -> Iterable[Drawn]:
    """Figures 11 to 13."""
    shown = [flown[FlightPlan(CASE_II, law)] for law in (MODIFIED, CERTIFIED, CERTIFIED_FF, INTEGRAL)]
    yield "State comparison, 5 deg", 1, tuple(graphs.state_panel(state, state, shown, "law", T_w) for state in TRACKED)
    yield "Error comparison, 5 deg", 1, tuple(graphs.error_panel(state, state, shown, "law", T_w) for state in TRACKED)
    yield "Control comparison, 5 deg", 1, graphs.input_panels(("",), (shown,), "law", T_w)


def _figures_of_uncertainty(setting: Setting, flown: Flights, T_w: float) -> Iterable[Drawn]:
    """Figures 14 to 21."""
    groups = [[flown[plan] for plan in FLIGHTS["every uncertainty"](setting, law)] for law in _LEARNED]
    each = [
        (f"{law}, {graphs.label_of(record, 'uncertainty')}", record)
        for pair in zip(*groups, strict=True)
        for law, record in zip(_LEARNED, pair, strict=True)
    ]
    shown, all_cases = (_LEARNED, groups, "uncertainty", T_w), "Model uncertainty and"
    for state in TRACKED:
        yield f"{all_cases} {_WORDS[state]} tracking, 5 deg", 2, graphs.beside(graphs.state_panel, *shown, state)
    yield f"{all_cases} control inputs, 5 deg", 2, graphs.input_panels(*shown)
    yield f"{all_cases} critic weights, 5 deg", 2, tuple(graphs.weights_panel(*pair, T_w) for pair in each)
    yield f"{all_cases} critic-weight increments, 5 deg", 2, tuple(graphs.increments_panel(*pair, T_w) for pair in each)
    yield f"{all_cases} Bellman residuals, 5 deg", 2, graphs.beside(graphs.residual_panel, *shown)
    yield f"{all_cases} critic weight-update norms, 5 deg", 2, graphs.beside(graphs.update_panel, *shown)


def _figures_of_noise(setting: Setting, flown: Flights, T_w: float) -> Iterable[Drawn]:
    """Figures 22 and 23."""
    shown = [flown[FlightPlan(CASE_II, law, noise=True)] for law in (*_LEARNED, CERTIFIED_FF)]
    errors = tuple(graphs.error_panel(state, state, shown, "law", T_w) for state in TRACKED)
    yield "Tracking errors under measurement noise, 5 deg", 1, errors
    weights = tuple(graphs.weights_panel(record.plan.law, record, T_w) for record in shown[:2])
    yield "Critic weights under measurement noise, 5 deg", 2, weights


_COMPARED = (PRINTED, MODIFIED, CERTIFIED, CERTIFIED_FF, INTEGRAL, EXACT, EXACT_FF)
EXPERIMENTS = {
    each.section: each
    for each in (
        Experiment("5.1", "Different trim points", 3, _trim_points, _figures_of_trim_points),
        Experiment(
            "5.2",
            "Comparison with integral reinforcement learning",
            11,
            lambda setting: tuple(_of("5 deg", setting, _COMPARED)),
            _figures_of_comparison,
        ),
        Experiment(
            "5.3",
            "Model uncertainty",
            14,
            lambda setting: tuple(_of("every uncertainty", setting, TRACKING)),
            _figures_of_uncertainty,
        ),
        Experiment(
            "5.4",
            "Measurement noise",
            22,
            lambda setting: tuple(
                plan for law in TRACKING for group in ("noise", "5 deg") for plan in _of(group, setting, [law])
            ),
            _figures_of_noise,
        ),
    )
}
