"""Section 5.4: measurement noise, at 5 degrees."""

from __future__ import annotations

from collections.abc import Mapping

from hfa_model.vectors import LINEAR_STATES
from verification.experiments import graphs
from verification.experiments.claims import LEARNING, Claim
from verification.experiments.experiment import CASE_II, Experiment
from verification.experiments.experiment_flights import FlightPlan, FlightRecord
from verification.experiments.flown_laws import CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF, MODIFIED, PRINTED
from verification.experiments.measures import of_learning, ratio, worst
from verification.experiments.metrics import TRACKED
from verification.experiments.panels import PaperFigure
from verification.experiments.setting import Setting

_SECTION = "5.4"
_FLOWN = (PRINTED, MODIFIED, CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF)


def flights(setting: Setting) -> tuple[FlightPlan, ...]:
    """Every law with the noise and without."""
    return tuple(plan for law in _FLOWN for plan in (*_noisy(setting, law), *_quiet(setting, law)))


def _noisy(setting: Setting, law: str) -> tuple[FlightPlan, ...]:
    return (FlightPlan(CASE_II, law, noise=True),)


def _quiet(setting: Setting, law: str) -> tuple[FlightPlan, ...]:
    return (FlightPlan(CASE_II, law),)


CLAIMS = (
    Claim(
        "5.4-1",
        "Fig. 22: the tracking errors remain bounded under noise",
        "largest tracking error after the adjustment over the largest before",
        worst(_noisy, lambda metrics: metrics.growth),
        "<=",
        "bounded",
    ),
    *(
        Claim(
            f"5.4-{index + 2}",
            f"Fig. 22: z{LINEAR_STATES.index(state) + 1} ({state}) decreases to a small neighborhood of zero",
            f"rms of the {state} error over the late window, as a fraction of the command",
            worst(_noisy, lambda metrics: metrics.relative_error, of=(state,)),
            "<=",
            "close",
        )
        for index, state in enumerate(TRACKED)
    ),
    Claim(
        "5.4-5",
        "Fig. 23: the weights approach steady values before the end of the learning time",
        "change of the weights over the last tenth of the learning time, over their size",
        worst(_noisy, of_learning(lambda learning: learning.end_change)),
        "<=",
        "steady",
        laws=LEARNING,
    ),
    Claim(
        "5.4-6",
        "Fig. 23: the learning responses of the weights are bounded",
        "largest change of the weights after the learning time over their size",
        worst(_noisy, of_learning(lambda learning: learning.late_change)),
        "<=",
        "bounded",
        laws=LEARNING,
    ),
    Claim(
        "5.4-7",
        "The noise does not significantly degrade tracking",
        "largest late rms error of a tracked state over that without noise",
        ratio(_noisy, _quiet, lambda metrics: metrics.rms_error, of=TRACKED),
        "<=",
        "degraded",
    ),
)


def pictures(setting: Setting, flown: Mapping[FlightPlan, FlightRecord]) -> tuple[PaperFigure, ...]:
    """Figures 22 and 23."""
    T_w = setting.configuration.predefined_time(_SECTION)
    shown = [flown[FlightPlan(CASE_II, law, noise=True)] for law in (MODIFIED, CERTIFIED, CERTIFIED_FF)]
    errors = tuple(graphs.error_panel(state, state, shown, "law", T_w) for state in TRACKED)
    weights = tuple(graphs.weights_panel(record.plan.law, record, T_w) for record in shown[:2])
    return (
        PaperFigure(22, "Tracking errors under measurement noise, 5 deg", 1, errors),
        PaperFigure(23, "Critic weights under measurement noise, 5 deg", 2, weights),
    )


EXPERIMENT = Experiment(_SECTION, "Measurement noise", flights, CLAIMS, pictures)
