"""How far to trust the identification: what it determines, what it predicts, which structures the print excludes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.parameters import save_parameters
from hfa_model.printed_matrices import published_models
from hfa_model.variants import Newton, Published, Variant
from hfa_model.vectors import LINEAR_STATES
from hfa_support.progress import Progress
from trim.identification.identification_result import IDENTIFIED, Fit, Identification, LeftOut, Structure
from trim.identification.identify import ROUGH, fit, identify
from trim.linear.compare import EntryRow, compare, regenerate


def _with_newtons(method: str) -> Variant:
    """The published structure with one method of Newton's."""
    changed: type[Published] = type(f"PublishedWith_{method}", (Published,), {method: getattr(Newton, method)})
    return changed()


#: The published structure with each of its departures from Newton undone, one at a time, then all.
ALTERNATIVES: tuple[tuple[str, Variant], ...] = (
    ("outer lever (s/6) sin η", _with_newtons("outer_lever")),
    ("outer section moment times cos η", _with_newtons("section_projection")),
    ("hinge coupling of Newton", _with_newtons("hinge_coupling")),
    ("hinge inertia of Newton", _with_newtons("hinge_inertia")),
    ("all four: newton", Newton()),
)


def run_identification(seed: int = 0, progress: Progress | None = None) -> Identification:
    """Identify, then collect the evidence; a few seconds. progress: called with (stages done, stages in all)."""
    stages = len(ALTERNATIVES) + 2

    def done(stage: int) -> None:
        if progress is not None:
            progress(stage, stages)

    best, starts = identify(seed)
    done(1)
    aircraft = Aircraft(best.parameters.values, Published())
    tables = {model.dihedral_deg: compare(regenerate(aircraft, model), model) for model in published_models()}
    return Identification(best, starts, tables, _structures(best, seed, done), _left_out(done))


def save_fit(fitted: Fit, path: Path) -> None:
    """Write one fit as a parameters file."""
    header = (
        "The aircraft behind the printed matrices. Written by `hfa identify`; do not edit.\n"
        f"Sum of squares {fitted.sum_of_squares:.2f} half units^2 over {fitted.entries} printed entries "
        f"(rounding alone gives {fitted.expected_sum:.1f} on average).\n"
        "The covariance is that of small errors: sample it in the logarithms of the parameters, as\n"
        "hfa_model.sample_parameters does. Sampled as a plain Gaussian it spreads entries of A up to 4.8 times too far."
    )
    save_parameters(fitted.parameters, path, header)


def _structures(best: Fit, seed: int, done: Callable[[int], None]) -> tuple[Structure, ...]:
    rng = np.random.default_rng(seed)
    rows = [Structure("published", best.sum_of_squares, best.largest)]
    for index, (description, variant) in enumerate(ALTERNATIVES):
        # From the published optimum and from rough guesses: the alternative gets its best chance.
        near = np.log([abs(getattr(best.parameters.values, name) / ROUGH[name]) for name in IDENTIFIED])
        tries = [
            fit(published_models(), variant, noise=noise) for noise in (near, None, rng.normal(size=near.size) / 3)
        ]
        chosen = min(tries, key=lambda one: one.sum_of_squares)
        rows.append(Structure(description, chosen.sum_of_squares, chosen.largest))
        done(2 + index)
    return tuple(rows)


def _left_out(done: Callable[[int], None]) -> tuple[LeftOut, ...]:
    rows = []
    first, second = published_models()
    for known, unknown in ((first, second), (second, first)):
        fitted = fit([known], Published(), prior=True)
        table = compare(regenerate(Aircraft(fitted.parameters.values, Published()), unknown), unknown)
        rows_of = {name: [entry for entry in table if entry.row == name] for name in LINEAR_STATES}
        errors = {name: _row_error(entries, 1.0) for name, entries in rows_of.items()}
        pitch = rows_of["pitch_rate"]
        factor = sum(e.computed * e.printed for e in pitch) / sum(e.computed**2 for e in pitch)
        # A direction is determined when the data know it to 1 % (singular value s: standard error 1/(s √3)).
        determined = int(np.count_nonzero(fitted.singular_values * np.sqrt(3) > 100))
        shape_error = _row_error(pitch, factor)
        rows.append(LeftOut(known.dihedral_deg, unknown.dihedral_deg, determined, errors, shape_error))
    done(len(ALTERNATIVES) + 2)
    return tuple(rows)


def _row_error(entries: list[EntryRow], factor: float) -> float:
    size = max(abs(entry.printed) for entry in entries)
    return max(abs(factor * entry.computed - entry.printed) for entry in entries) / size
