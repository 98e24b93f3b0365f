"""Proof of an upper bound on the error of a network over a box of states, by branch and bound."""

from __future__ import annotations

import time

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from verification.enclosure.relaxation import Relaxation
from verification.verdict import Proof

#: Number of boxes for which bounds are computed before the next boxes are chosen.
_BATCH = 1024


def prove(
    what: str,
    errors: ca.Function,
    b: np.ndarray,
    limit: float,
    seconds: float,
    progress: Progress | None = None,
) -> Proof | None:
    """Prove |errors(z)| <= limit for |z_i| <= b_i by branch and bound, for at most `seconds` s.

    The proof also ends at a state whose error exceeds the limit. The result contains the fraction
    of the box that is proved. The result is None if `errors` contains operations for which no bound
    is implemented.

    what: description of the errors, for `Proof.what`
    b: half-widths of the box, (n,)
    """
    y = ca.SX.sym("y", len(b))
    scaled = ca.Function("errors", [y], [ca.densify(errors(ca.DM(b) * y))])
    try:
        relaxation = Relaxation(scaled, what)
    except (BadInputError, OverflowError):  # a coefficient overflows double precision
        return None
    begin = time.monotonic()
    centres = np.zeros((1, len(b)))
    half_widths = np.ones((1, len(b)))
    count = 0
    while len(centres):
        distances = np.max(np.abs(centres) - half_widths, axis=1)
        fraction = max(float(distances.min()), 0.0)
        elapsed = time.monotonic() - begin
        if progress is not None:
            progress(min(elapsed, seconds), seconds, f"proved on {fraction:.2g} times the box")
        if elapsed >= seconds:
            return Proof(what, limit, fraction, count)
        batch = min(_BATCH, len(centres))
        order = np.argpartition(distances, batch - 1)
        bounds = relaxation.over(centres[order[:batch]], half_widths[order[:batch]])
        count += batch
        worst = int(np.argmax(np.nan_to_num(bounds.lowest)))
        if bounds.lowest[worst] > limit:
            corner = bounds.corner[worst]
            if np.abs(np.array(scaled(corner))).max() > limit:
                return Proof(what, limit, fraction, count, b * corner)
        is_open = ~(bounds.highest <= limit)
        wide = order[:batch][is_open]
        halves = _halves(centres[wide], half_widths[wide], bounds.gaps[is_open])
        waiting = order[batch:]
        centres = np.concatenate([centres[waiting], halves[0]])
        half_widths = np.concatenate([half_widths[waiting], halves[1]])
    return Proof(what, limit, 1.0, count)


def _halves(
    centres: np.ndarray, half_widths: np.ndarray, gaps: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the centres and half-widths of both halves of each box."""
    # Each box is halved across the input with the largest gap. If a gap is not finite or all are 0,
    # the box is halved across its widest input.
    boxes = np.arange(len(centres))
    # Without information on the gaps, as without a bound, the widest input is halved.
    known = np.all(np.isfinite(gaps), axis=1) & np.any(gaps > 0.0, axis=1)
    across = np.argmax(np.where(known[:, None], gaps, half_widths), axis=1)
    halved = half_widths.copy()
    halved[boxes, across] *= 0.5
    step = halved[boxes, across]
    lower = centres.copy()
    lower[boxes, across] -= step
    upper = centres.copy()
    upper[boxes, across] += step
    return np.concatenate([lower, upper]), np.concatenate([halved, halved])
