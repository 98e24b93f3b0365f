"""Section 5.2: against integral reinforcement learning, at 5 degrees."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hfa_model.vectors import LINEAR_STATES
from verification.experiments import graphs
from verification.experiments.claims import TRACKING, Claim, Evidence
from verification.experiments.experiment import CASE_II, Experiment
from verification.experiments.experiment_flights import FlightPlan, FlightRecord
from verification.experiments.flown_laws import CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF, INTEGRAL, MODIFIED, PRINTED
from verification.experiments.measures import Measure, gain_error, ratio, smallest, worst
from verification.experiments.metrics import TRACKED
from verification.experiments.panels import PaperFigure
from verification.experiments.setting import Setting

_SECTION = "5.2"
_FLOWN = (PRINTED, MODIFIED, CERTIFIED, CERTIFIED_FF, INTEGRAL, EXACT, EXACT_FF)
_FLEXIBLE = ("alpha", "dihedral")


def flights(setting: Setting) -> tuple[FlightPlan, ...]:
    """Every law at 5 degrees."""
    return tuple(FlightPlan(CASE_II, law) for law in _FLOWN)


def _own(setting: Setting, law: str) -> tuple[FlightPlan, ...]:
    return (FlightPlan(CASE_II, law),)


def _integral(setting: Setting, law: str) -> tuple[FlightPlan, ...]:
    return _own(setting, INTEGRAL)


def _over_integral(measure: Measure) -> Measure:
    return lambda evidence, law: measure(evidence, law) / measure(evidence, INTEGRAL)


def _final_abscissa(evidence: Evidence, law: str) -> float:
    """Largest real part of the eigenvalues of A - B K with the gain learned last, 1/s."""
    record, game = evidence.record(*_own(evidence.setting, law)), evidence.setting.case(CASE_II).game
    assert record.critic is not None
    K = game.gain(record.critic.basis.matrix(record.critic.weights[-1]))
    return float(np.linalg.eigvals(game.A - game.B @ K).real.max())


CLAIMS = (
    *(
        Claim(
            f"5.2-{index + 1}",
            f"Fig. 11: {state} converges to its reference within approximately 4 s",
            f"time at which the {state} error enters its band for good, s",
            worst(_own, lambda metrics: metrics.settling, of=(state,)),
            "<=",
            "short_adjustment",
            laws=(*TRACKING, INTEGRAL),
        )
        for index, state in enumerate(_FLEXIBLE)
    ),
    Claim(
        "5.2-3",
        "Fig. 11: the transient is markedly faster than that of integral RL",
        "cost of the error during the adjustment over that of integral RL",
        ratio(_own, _integral, lambda metrics: metrics.early_cost),
        "<=",
        "faster",
        why="integral RL still uses the gain it started from",
    ),
    Claim(
        "5.2-4",
        "Fig. 11: integral RL has not reached the target in alpha and dihedral after 20 s",
        "earlier of the times at which its errors of alpha and dihedral enter their bands for good, s",
        smallest(_own, lambda metrics: metrics.settling, of=_FLEXIBLE),
        ">",
        20.0,
        laws=(INTEGRAL, MODIFIED, CERTIFIED, EXACT_FF),
        subject=INTEGRAL,
        why="an error that no law of this game brings to zero tells nothing about the learning",
    ),
    *(
        Claim(
            f"5.2-{index + 5}",
            f"Fig. 12: z{LINEAR_STATES.index(state) + 1} ({state}) is driven to zero with high precision "
            "and stays flat",
            f"rms of the {state} error over the late window, as a fraction of the command",
            worst(_own, lambda metrics: metrics.relative_error, of=(state,)),
            "<=",
            "close",
            laws=(*TRACKING, INTEGRAL),
        )
        for index, state in enumerate(TRACKED)
    ),
    Claim(
        "5.2-8",
        "Fig. 12: integral RL keeps steady-state errors that are not negligible",
        "its largest relative late rms error",
        worst(_own, lambda metrics: metrics.relative_error),
        ">",
        "close",
        laws=(INTEGRAL, MODIFIED, CERTIFIED, EXACT, EXACT_FF),
        subject=INTEGRAL,
        why="so do all laws of this game: it is the weights Q and R, not the learning",
    ),
    Claim(
        "5.2-9",
        "Fig. 12: disturbances are rejected better than by integral RL",
        "largest late rms error of a tracked state over that of integral RL",
        ratio(_own, _integral, lambda metrics: metrics.rms_error, of=TRACKED),
        "<=",
        "faster",
    ),
    Claim(
        "5.2-10",
        "Fig. 12: parameters are estimated more accurately than by integral RL",
        "|K - K*| / |K*| at the end of the flight over that of integral RL",
        _over_integral(gain_error(_own, at_end_of_flight=True)),
        "<",
        1.0,
        laws=(PRINTED, MODIFIED, CERTIFIED),
    ),
    Claim(
        "5.2-11",
        "Fig. 13: more control authority is used at first than by integral RL",
        "largest (u'Ru)^1/2 over that of integral RL",
        ratio(_own, _integral, lambda metrics: metrics.peak_effort),
        ">",
        1.0,
    ),
    Claim(
        "5.2-12",
        "Fig. 13: the inputs settle to an equilibrium within 5 s",
        "largest range of an input after the adjustment over its peak",
        worst(_own, lambda metrics: metrics.remaining_range),
        "<=",
        "close",
        laws=(*TRACKING, INTEGRAL),
        why="the command of the speed and the disturbance go on, and so must the inputs",
    ),
    Claim(
        "5.2-13",
        "Fig. 13: integral RL does not stabilize the system",
        "abscissa of A - B K with the gain it ends with, 1/s",
        _final_abscissa,
        ">=",
        0.0,
        laws=(INTEGRAL, MODIFIED, CERTIFIED),
        subject=INTEGRAL,
    ),
    Claim(
        "5.2-14",
        "Convergence within a time of the user's choice does not depend on initial conditions",
        "time at which the speed error enters its band for good, s",
        worst(_own, lambda metrics: metrics.settling, of=("speed",)),
        "<=",
        "short_adjustment",
        missing="flights from more than one initial state",
    ),
)


def pictures(setting: Setting, flown: Mapping[FlightPlan, FlightRecord]) -> tuple[PaperFigure, ...]:
    """Figures 11 to 13."""
    T_w = setting.configuration.predefined_time(_SECTION)
    shown = [flown[FlightPlan(CASE_II, law)] for law in (MODIFIED, CERTIFIED, CERTIFIED_FF, INTEGRAL)]
    states = tuple(graphs.state_panel(state, state, shown, "law", T_w) for state in TRACKED)
    errors = tuple(graphs.error_panel(state, state, shown, "law", T_w) for state in TRACKED)
    return (
        PaperFigure(11, "State comparison, 5 deg", 1, states),
        PaperFigure(12, "Error comparison, 5 deg", 1, errors),
        PaperFigure(13, "Control comparison, 5 deg", 1, graphs.input_panels(("5 deg",), (shown,), "law", T_w)),
    )


EXPERIMENT = Experiment(_SECTION, "Comparison with integral reinforcement learning", flights, CLAIMS, pictures)
