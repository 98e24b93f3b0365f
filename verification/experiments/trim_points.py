"""Section 5.1: the same controller at dihedral angles of 15 and 5 degrees."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hfa_model.published import published_models
from hfa_model.vectors import LINEAR_STATES
from verification.experiments import graphs
from verification.experiments.claims import LEARNING, PRINT, TRACKING, Claim, Evidence
from verification.experiments.experiment import CASE_I, CASE_II, Experiment
from verification.experiments.experiment_flights import FlightPlan, FlightRecord
from verification.experiments.flown_laws import CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF, MODIFIED, PRINTED, REWEIGHTED
from verification.experiments.measures import gain_error, of_learning, residual_growth, smallest, worst
from verification.experiments.metrics import TRACKED
from verification.experiments.panels import PaperFigure
from verification.experiments.setting import Setting

_SECTION = "5.1"
_FLOWN = (PRINTED, MODIFIED, CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF, REWEIGHTED)
_DISTURBED = (PRINTED, MODIFIED, CERTIFIED, EXACT)
_TITLES = ("Case I, 15 deg", "Case II, 5 deg")
_PITCH_RATE = LINEAR_STATES.index("pitch_rate")
_WORDS = {"speed": "speed", "alpha": "angle of attack", "dihedral": "dihedral"}


def flights(setting: Setting) -> tuple[FlightPlan, ...]:
    """Every law in both cases, and from rest under the disturbance alone."""
    flown = [FlightPlan(angle, law) for angle in (CASE_I, CASE_II) for law in _FLOWN]
    return (*flown, *(plan for law in _DISTURBED for plan in _alone(setting, law)))


def _both(setting: Setting, law: str) -> tuple[FlightPlan, ...]:
    return FlightPlan(CASE_I, law), FlightPlan(CASE_II, law)


def _second(setting: Setting, law: str) -> tuple[FlightPlan, ...]:
    return (FlightPlan(CASE_II, law),)


def _alone(setting: Setting, law: str) -> tuple[FlightPlan, ...]:
    return tuple(FlightPlan(angle, law, commanded=False) for angle in (CASE_I, CASE_II))


def _attenuation(evidence: Evidence, law: str) -> float:
    """Largest ∫ z'Qz + u'Ru over δ² ∫ d'd of the flights under the disturbance alone."""
    records = evidence.records(*_alone(evidence.setting, law))
    return max(record.metrics.attenuation / record.metrics.delta_squared for record in records)


def _coupling(evidence: Evidence, law: str) -> float:
    """The smaller of |pitch-rate row at 5 deg| / |at 15 deg| for A and for B, as printed."""
    one, two = published_models()
    rows = ((two.A[_PITCH_RATE], one.A[_PITCH_RATE]), (two.B[_PITCH_RATE], one.B[_PITCH_RATE]))
    return float(min(np.linalg.norm(second) / np.linalg.norm(first) for second, first in rows))


def _commanded_dihedral(evidence: Evidence, law: str) -> float:
    return float(np.degrees(evidence.setting.configuration.reference.signal.constant[LINEAR_STATES.index("dihedral")]))


def _tracking_claims() -> tuple[Claim, ...]:
    settling = tuple(
        Claim(
            f"5.1-{index + 1}",
            f"Fig. {figure}: the {_WORDS[state]} shows a short initial adjustment in both cases",
            f"latest time at which the {state} error enters its band for good, s",
            worst(_both, lambda metrics: metrics.settling, of=(state,)),
            "<=",
            "short_adjustment",
            laws=(*TRACKING, REWEIGHTED),
            why=_WHY[state],
        )
        for index, (figure, state) in enumerate(zip((3, 4, 5), TRACKED, strict=True))
    )
    close = tuple(
        Claim(
            f"5.1-{index + 5}",
            f"At 5 degrees the controller keeps the {_WORDS[state]} close to its command",
            f"rms of the {state} error over the late window, as a fraction of the command",
            worst(_second, lambda metrics: metrics.relative_error, of=(state,)),
            "<=",
            "close",
            laws=(*TRACKING, REWEIGHTED),
            why=_WHY[state],
        )
        for index, state in enumerate(TRACKED)
    )
    bounded = Claim(
        "5.1-4",
        "Tracking is bounded after the initial adjustment in both cases, with the same controller parameters",
        "largest tracking error after the adjustment over the largest before",
        worst(_both, lambda metrics: metrics.growth),
        "<=",
        "bounded",
    )
    return (*settling, bounded, *close)


_WHY = {
    "speed": "",
    "alpha": "the printed Q and R pay more for the inputs that hold this angle than for the error that is left",
    "dihedral": "part of the disturbance adds to the rate of the dihedral, which no input reaches",
}

CLAIMS = (
    *_tracking_claims(),
    Claim(
        "5.1-8",
        "The second set has the stronger pitch-rate coupling, in the fourth rows of A and B",
        "smaller of |row at 5 deg| / |row at 15 deg| for the printed A and B",
        _coupling,
        ">",
        1.0,
        laws=(PRINT,),
        subject=PRINT,
    ),
    Claim(
        "5.1-9",
        "Fig. 6: the five control channels remain smooth",
        "largest total variation over range of an input, late window",
        worst(_both, lambda metrics: metrics.wiggle),
        "<=",
        "smooth",
        why="the fractional powers switch sign with the current residual, step by step",
    ),
    Claim(
        "5.1-10",
        "Figs. 7, 8: the weights change during the early interval; learning is concentrated in the prescribed window",
        "smaller share of the path of the weights that lies inside the learning time",
        smallest(_both, of_learning(lambda learning: learning.path_share)),
        ">=",
        "concentrated",
        laws=LEARNING,
    ),
    Claim(
        "5.1-11",
        "Fig. 7: the weights then remain bounded",
        "largest change of the weights after the learning time over their size",
        worst(_both, of_learning(lambda learning: learning.late_change)),
        "<=",
        "bounded",
        laws=LEARNING,
    ),
    Claim(
        "5.1-12",
        "Figs. 8, 10: weight increments and update norm decrease after the main adaptation",
        "largest update after the learning time over the largest before",
        worst(_both, of_learning(lambda learning: learning.late_update)),
        "<=",
        "fallen",
        laws=LEARNING,
    ),
    Claim(
        "5.1-13",
        "Fig. 9: the Bellman residual is not forced to zero but stays bounded afterward",
        "largest residual at the simulated error after the learning time over the largest before",
        residual_growth(_both),
        "<=",
        "bounded",
        laws=LEARNING,
    ),
    Claim(
        "5.1-14",
        "This supports the predefined-time convergence of the critic (Theorem 1)",
        "|K - K*| / |K*| at the end of the learning time, larger of both cases",
        gain_error(_both),
        "<=",
        "close",
        laws=LEARNING,
        why="a bounded residual does not make an accurate critic: the stack's fixed point is the value of the policies"
        " stored in it, and the slow directions of its regressors do not move in time",
    ),
    Claim(
        "5.1-15",
        "The zero-sum controller suppresses bounded disturbances",
        "cost over delta^2 times the energy of d, disturbance alone from rest, larger of both cases",
        _attenuation,
        "<",
        1.0,
        laws=_DISTURBED,
    ),
    Claim(
        "5.1-16",
        "The linear model applies up to 15 degrees of dihedral",
        "commanded dihedral, degrees, without the trim that it is added to",
        _commanded_dihedral,
        "<=",
        15.0,
        laws=(PRINT,),
        subject=PRINT,
        why="the command leaves the range in which the model is said to apply",
    ),
)


def pictures(setting: Setting, flown: Mapping[FlightPlan, FlightRecord]) -> tuple[PaperFigure, ...]:
    """Figures 3 to 10."""
    T_w = setting.configuration.predefined_time(_SECTION)
    shown = (PRINTED, MODIFIED, CERTIFIED, CERTIFIED_FF, EXACT_FF)
    cases = [[flown[FlightPlan(angle, law)] for law in shown] for angle in (CASE_I, CASE_II)]
    steered = [[flown[FlightPlan(angle, law)] for law in (MODIFIED, CERTIFIED, EXACT)] for angle in (CASE_I, CASE_II)]
    learning = [[flown[FlightPlan(angle, law)] for angle in (CASE_I, CASE_II)] for law in (MODIFIED, CERTIFIED)]
    by_case = [list(group) for group in zip(*learning, strict=True)]
    each = [
        (f"{record.plan.law}, {title}", record)
        for group in learning
        for title, record in zip(_TITLES, group, strict=True)
    ]
    return (
        *(
            PaperFigure(
                number,
                f"{_WORDS[state].capitalize()} tracking",
                2,
                graphs.beside(graphs.state_panel, _TITLES, cases, "law", T_w, state),
            )
            for number, state in zip((3, 4, 5), TRACKED, strict=True)
        ),
        PaperFigure(6, "Control inputs", 2, graphs.input_panels(_TITLES, steered, "law", T_w)),
        PaperFigure(7, "Critic weights", 2, tuple(graphs.weights_panel(*pair, T_w) for pair in each)),
        PaperFigure(8, "Critic-weight increments", 2, tuple(graphs.increments_panel(*pair, T_w) for pair in each)),
        PaperFigure(9, "Bellman residuals", 2, graphs.beside(graphs.residual_panel, _TITLES, by_case, "law", T_w)),
        PaperFigure(
            10, "Critic weight-update norms", 2, graphs.beside(graphs.update_panel, _TITLES, by_case, "law", T_w)
        ),
    )


EXPERIMENT = Experiment(_SECTION, "Different trim points", flights, CLAIMS, pictures)
