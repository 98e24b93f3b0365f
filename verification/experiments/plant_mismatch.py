"""Section 5.3: the simulated A differs from the one that the controller knows, at 5 degrees; learning stops at T_w."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from hfa_model.published import published_data, published_models
from verification.experiments import graphs
from verification.experiments.claims import LEARNING, PRINT, Claim, Evidence
from verification.experiments.experiment import CASE_II, Experiment
from verification.experiments.experiment_flights import FlightPlan, FlightRecord
from verification.experiments.flown_laws import CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF, MODIFIED, PRINTED
from verification.experiments.measures import of_learning, residual_drop, spread, worst
from verification.experiments.metrics import TRACKED
from verification.experiments.panels import PaperFigure
from verification.experiments.setting import Setting

_SECTION = "5.3"
_FLOWN = (PRINTED, MODIFIED, CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF)
_SHOWN = (MODIFIED, CERTIFIED)
_DEFLECTIONS = ("aileron_center", "aileron_outer", "elevator_center", "elevator_outer")
_NAMES = ("speed", "angle of attack", "dihedral")


def flights(setting: Setting) -> tuple[FlightPlan, ...]:
    """Every law with every ΔA."""
    return tuple(plan for law in _FLOWN for plan in _all(setting, law))


def _all(setting: Setting, law: str) -> tuple[FlightPlan, ...]:
    return tuple(FlightPlan(CASE_II, law, uncertainty=factor) for factor in setting.configuration.uncertainty.factors)


def _eigenvalue_difference(evidence: Evidence, law: str) -> float:
    """Largest |λ - quoted| over the modes, each quoted magnitude against the nearest eigenvalue, 1/s."""
    eigenvalues = np.linalg.eigvals(published_models()[1].A)
    folded = np.abs(eigenvalues.real) + 1j * np.abs(eigenvalues.imag)  # the quoted signs are lost
    quoted = [_quoted(text) for text in published_data()["eigenvalues_quoted_for_5_deg"]["magnitudes"]]
    return float(max(np.abs(folded - value).min() for value in quoted))


def _quoted(text: str) -> complex:
    """ "4.82 +/- 18.66i" and "7.11" as numbers."""
    real, imaginary = re.fullmatch(r"([\d.]+)(?: \+/- ([\d.]+)i)?", text).groups()  # type: ignore[union-attr]
    return complex(float(real), float(imaginary or 0.0))


CLAIMS = (
    Claim(
        "5.3-1",
        "The model at 5 degrees has the eigenvalues quoted: 7.11, 0.019, 0.016 and 0.64i, 4.82 and 18.66i",
        "largest distance of a quoted eigenvalue from those of the printed A, 1/s",
        _eigenvalue_difference,
        "<=",
        0.01,
        laws=(PRINT,),
        subject=PRINT,
        why="the quoted numbers are of another source; the slow pair differs",
    ),
    Claim(
        "5.3-2",
        "Figs. 14-16: tracking is essentially invariant across the uncertainties",
        "largest relative spread of the late rms error of a tracked state between the cases",
        spread(_all, lambda metrics: metrics.rms_error, of=TRACKED),
        "<=",
        "alike",
    ),
    *(
        Claim(
            f"5.3-{index + 3}",
            f"Fig. {14 + index}: the {name} overlaps its command after 4 to 5 s in every case",
            f"latest time at which the {state} error enters its band for good, s",
            worst(_all, lambda metrics: metrics.settling, of=(state,)),
            "<=",
            "short_adjustment",
        )
        for index, (name, state) in enumerate(zip(_NAMES, TRACKED, strict=True))
    ),
    *(
        Claim(
            f"5.3-{index + 6}",
            f"Fig. {14 + index}: the steady-state error of the {name} is negligible in every case",
            f"largest rms of the {state} error over the late window, as a fraction of the command",
            worst(_all, lambda metrics: metrics.relative_error, of=(state,)),
            "<=",
            "close",
        )
        for index, (name, state) in enumerate(zip(_NAMES, TRACKED, strict=True))
    ),
    Claim(
        "5.3-9",
        "Figs. 14-16: rise times are nearly identical whatever the uncertainty",
        "largest relative spread between the cases of the time when an error first enters its band",
        spread(_all, lambda metrics: metrics.rise),
        "<=",
        "alike",
    ),
    Claim(
        "5.3-10",
        "Figs. 14-16: settling times are nearly identical whatever the uncertainty",
        "largest relative spread between the cases of the time when an error enters its band for good",
        spread(_all, lambda metrics: metrics.settling),
        "<=",
        "alike",
        why="an error that never settles in any case is left out",
    ),
    Claim(
        "5.3-11",
        "Fig. 17: the inputs are bounded, smooth and free of chatter and sustained oscillation",
        "largest total variation over range of an input, late window",
        worst(_all, lambda metrics: metrics.wiggle),
        "<=",
        "smooth",
    ),
    Claim(
        "5.3-12",
        "Fig. 17: the inputs do not saturate",
        "largest share of the flight in which trim plus input passes this project's limits",
        worst(_all, lambda metrics: metrics.beyond_limits),
        "<=",
        0.0,
        missing="limits of the inputs; this project assumes 20 deg for ailerons, 30 deg for elevators",
    ),
    Claim(
        "5.3-13",
        "Fig. 17: transients and peaks of the inputs are nearly indistinguishable between the cases",
        "largest relative spread of the peak of an input between the cases",
        spread(_all, lambda metrics: metrics.peak_input),
        "<=",
        "alike",
    ),
    Claim(
        "5.3-14",
        "Fig. 17: input rates stay within acceptable limits",
        "largest rate of a deflection over one tick, rad/s",
        worst(_all, lambda metrics: metrics.peak_rate, of=_DEFLECTIONS),
        "<=",
        1.0,
        missing="an acceptable rate; 1 rad/s stands here for a brisk actuator",
    ),
    Claim(
        "5.3-15",
        "Fig. 18: the weights converge to constants",
        "largest change of the weights over the last tenth of the learning time, over their size",
        worst(_all, of_learning(lambda learning: learning.end_change)),
        "<=",
        "steady",
        laws=LEARNING,
    ),
    Claim(
        "5.3-16",
        "Figs. 19, 21: increments decay rapidly; the update norm peaks early and then vanishes",
        "largest update in the last tenth of the learning time over the largest before",
        worst(_all, of_learning(lambda learning: learning.end_update)),
        "<=",
        "fallen",
        laws=LEARNING,
    ),
    Claim(
        "5.3-17",
        "Fig. 20: the Bellman residual drops by several orders of magnitude and stays near zero",
        "largest residual at the simulated error after the learning time over the one at the start",
        residual_drop(_all),
        "<=",
        "orders",
        laws=LEARNING,
        why="the error of the angle of attack stays, and with it the residual of a critic that is not exact",
    ),
    Claim(
        "5.3-18",
        "Closed-loop performance is preserved after learning is frozen, up to every uncertainty tested",
        "largest tracking error after the adjustment over the largest before",
        worst(_all, lambda metrics: metrics.growth),
        "<=",
        "bounded",
    ),
)


def pictures(setting: Setting, flown: Mapping[FlightPlan, FlightRecord]) -> tuple[PaperFigure, ...]:
    """Figures 14 to 21."""
    T_w = setting.configuration.predefined_time(_SECTION)
    groups = [[flown[plan] for plan in _all(setting, law)] for law in _SHOWN]
    each = [
        (f"{law}, {graphs.label_of(record, 'uncertainty')}", record)
        for pair in zip(*groups, strict=True)
        for law, record in zip(_SHOWN, pair, strict=True)
    ]
    shown = _SHOWN, groups, "uncertainty", T_w
    panels = (
        *(
            (f"{name} tracking, 5 deg", graphs.beside(graphs.state_panel, *shown, state))
            for name, state in zip(_NAMES, TRACKED, strict=True)
        ),
        ("control inputs, 5 deg", graphs.input_panels(*shown)),
        ("critic weights", tuple(graphs.weights_panel(*pair, T_w) for pair in each)),
        ("critic-weight increments", tuple(graphs.increments_panel(*pair, T_w) for pair in each)),
        ("Bellman residuals", graphs.beside(graphs.residual_panel, *shown)),
        ("critic weight-update norms", graphs.beside(graphs.update_panel, *shown)),
    )
    return tuple(
        PaperFigure(number, f"Model uncertainty and {what}", 2, drawn)
        for number, (what, drawn) in enumerate(panels, start=14)
    )


EXPERIMENT = Experiment(_SECTION, "Model uncertainty", flights, CLAIMS, pictures)
