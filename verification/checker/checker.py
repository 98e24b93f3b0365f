"""Re-verifies a certificate by other means than it was made with: nobody needs to trust the search or the prover.

Shares nothing with the prover but the model itself and the ball arithmetic of Arb. Every quantity is a Taylor model in
the place s within a box and the errors t of the parameters (`taylor_model.py`). Trims, and solutions of the Riccati
equation, are roots near the polynomials that the certificate states, proved by Krawczyk's operator along them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from flint import arb, ctx

from hfa_model.support.errors import BadInputError
from hfa_model.support.input_files import read_json
from verification.checker.checked_model import Content, between, check_modes, constant, exact, model_on
from verification.checker.taylor_model import Rejected

SCHEMA = "hfa.certificate/3"


class Verified(NamedTuple):
    """A verified statement; covers: list of boxes -> (low, high, unstable modes) of each, deg; rate: of decay, 1/s."""

    kind: str
    statement: Content
    covers: dict[str, list[tuple[float, float, int]]]
    rate: float


def sealed(head: str) -> str:
    """A JSON object without its last brace, closed by the SHA-256 of its text: an edited digit of any number shows."""
    return f'{head}, "digest": "{hashlib.sha256(head.encode()).hexdigest()}"}}\n'


def check_certificate(path: Path, progress: Callable[[int, int], None] | None = None) -> Verified:
    """BadInputError when the file is none or was edited; Rejected names the first box that fails."""
    from verification.checker.checked_game import check_game

    ctx.prec, where, covers, done = 256, "the statement", {}, 0
    try:
        content, text = read_json(path), path.read_text(encoding="utf-8")
        edited = content["schema"] != SCHEMA or text != sealed(text.rpartition(', "digest"')[0])
    except (OSError, ValueError, LookupError, AttributeError, TypeError) as error:
        raise BadInputError(f"{path}: is no certificate; `hfa prove schedule -o FILE.json` writes one") from error
    if edited:
        raise BadInputError(f"{path}: refused, the certificate was edited: its digest is that of other content")
    try:
        kind, claim, boxes = content["kind"], content["statement"], content["boxes"]
        names = {
            "schedule": ("loop", "modes", "motion")[: 3 if "dihedral_rate" in claim else 2],
            "game": ("solution", "loop", "modes", "value", "refused")[: 5 if "delta_min" in claim else 2],
            "lpv": ("cells",),
        }[kind]
        for name in names:
            covers[name] = [(*box["dihedral_deg"], box["unstable"]) for box in boxes[name]]
            low, high = claim["dihedral_deg"]
            ends = [low, *(end for run in covers[name] for end in run[:2]), high]
            if ends != sorted(ends) or (kind != "schedule" and (ends[::2] != ends[1::2] or not boxes[name])):
                raise Rejected("the boxes are out of place")
            for box in boxes[name]:
                where, done = f"{name} from {box['dihedral_deg'][0]} to {box['dihedral_deg'][1]} deg", done + 1
                (check_stability if name in ("loop", "modes", "motion") else check_game)(claim, name, box)
                if progress is not None:
                    progress(done, sum(len(boxes[each]) for each in names))
        rate = min((box["rate"] for box in boxes.get("loop", ()) if not box["unstable"]), default=0.0)
    except (Rejected, LookupError, TypeError, ValueError, AttributeError, ZeroDivisionError) as error:
        raise Rejected(f"{path}: {where} is not proved: {error or type(error).__name__}") from error
    return Verified(kind, claim, covers, rate)


def check_stability(claim: Content, name: str, box: Content) -> None:
    """The trim, the stated entries of A and B, and the number of unstable modes, of A or of the loop."""
    model, ends = model_on(claim, box), box["dihedral_deg"]
    A, B = model["A"], model["B"]
    for said, found in ((box["A"], A), (box["B"], B)) if "A" in box else ():
        limits = [pair for row in said for pair in row]
        if not all(arb(a) <= value <= arb(b) for (a, b), value in zip(limits, found.range().entries(), strict=True)):
            raise Rejected("an entry of A or B may lie outside its enclosure")
    if name != "modes":  # of ζ = (x, memory): ζ' = (A x - B K ζ, 0) + N (A X ζ - B K ζ) + M ζ
        K, M, N, X = (between(claim["table"], key, ends) for key in "KMNX")
        x = np.eye(A.parts[0].nrows(), M.parts[0].nrows())
        A = constant(x.T) * (A * constant(x) - B * K) + N * (A * X - B * K) + M
    if name == "motion":
        P = between(claim["lyapunov"], "P", ends)
        slope = P.parts[1] * (2 / (arb(ends[1]) - arb(ends[0])))
        check_modes(A, box, P, slope * arb(claim["dihedral_rate"]))
    else:
        check_modes(A, box, constant(box["H"]), exact(np.zeros(np.shape(box["H"]))))
