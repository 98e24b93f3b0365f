"""The main job, checked: both printed pairs regenerated from one aircraft and compared entry by entry."""

from __future__ import annotations

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.published import PublishedModel, published_models
from hfa_model.reporting.checks import at_most
from trim.linear.compare import compare, eigenvalue_errors, regenerate
from trim.linear.linear_model import LinearModel
from verification.published.regeneration_result import RegeneratedPair, Regeneration

#: Within 1 half unit an entry prints the same; within 3 it prints the same or one off in the last digit.
MOST_HALF_UNITS = 3.0
#: Eigenvalues: relative, or absolute for those slower than `SLOW`, 1/s.
MOST_EIGENVALUE_ERROR = 2e-3
MOST_SLOW_EIGENVALUE_ERROR = 5e-4
SLOW = 1.0


def regenerate_all(aircraft: Aircraft) -> Regeneration:
    """Trim and linearize at both printed angles and compare the result with the print."""
    return Regeneration(tuple(check_pair(regenerate(aircraft, printed), printed) for printed in published_models()))


def check_pair(model: LinearModel, published: PublishedModel) -> RegeneratedPair:
    """Every entry of A and B against its print; the spectrum and its stability against those of the printed A."""
    entries = compare(model, published)
    printed, computed = _spectrum(published.A), _spectrum(model.A)
    errors = eigenvalue_errors(computed, printed)
    slow = np.abs(printed) < SLOW
    worst = max(entries, key=lambda entry: abs(entry.half_units))
    unstable = int(np.count_nonzero(printed.real > 0)), int(np.count_nonzero(computed.real > 0))
    checks = (
        at_most(
            "largest entry error, half units",
            abs(worst.half_units),
            MOST_HALF_UNITS,
            f"{worst.name} is {worst.computed:.6g}, printed {worst.printed:.6g}",
        ),
        at_most(
            "fast eigenvalues, relative error",
            float((errors / np.abs(printed))[~slow].max()),
            MOST_EIGENVALUE_ERROR,
            "the fast modes differ from those of the printed A",
        ),
        at_most(
            "slow eigenvalues, absolute error, 1/s",
            float(errors[slow].max(initial=0.0)),
            MOST_SLOW_EIGENVALUE_ERROR,
            "the slow modes differ from those of the printed A",
        ),
        at_most(
            "unstable eigenvalues, difference in number",
            abs(unstable[0] - unstable[1]),
            0,
            f"the printed A has {unstable[0]} unstable eigenvalues, the regenerated one {unstable[1]}",
        ),
    )
    return RegeneratedPair(published, model, entries, printed, computed, checks)


def _spectrum(A: np.ndarray) -> np.ndarray:
    values = np.linalg.eigvals(A)
    return values[np.lexsort((-values.imag, -np.round(np.abs(values), 6)))]
