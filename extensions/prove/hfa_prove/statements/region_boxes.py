"""Statement of a certificate about the region of attraction of a policy, proved on boxes.

The checker interprets or refuses every field. The digest covers all fields, and reports show them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from operator import mul
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_prove.fields import Fields, Terms, require, rows_of
from hfa_prove.statements.loop import Loop
from hfa_prove.statements.piece import Piece
from hfa_prove.statements.plant import (
    Plant,
    Subject,
    check_limits_of_model,
    read_extents,
    read_plant,
    terms_by_input,
)
from hfa_support.errors import BadInputError
from verification.enclosure.program import LARGEST

#: Largest number of boxes that a certificate may state.
_MOST_BOXES = 100_000_000
#: Highest degree of a polynomial policy.
HIGHEST_POLICY = 12


class Gain(NamedTuple):
    """Policy u0 - K z + q(z) before saturation, with z the deviations from the trim.

    K: (m, n)
    terms: input -> terms of q of degree 2 and more, omitted if q = 0
    """

    K: np.ndarray
    terms: Mapping[str, Terms]

    def function(self, inputs: tuple[str, ...]) -> ca.Function:
        """Return the function from state deviations z (n,) to input deviations (m,).

        inputs: names of the inputs, in order
        """
        m, n = self.K.shape
        z = ca.SX.sym("z", n)
        deviations = ca.SX.zeros(m)
        for index, name in enumerate(inputs):
            total = ca.SX(0)
            for j in range(n):
                total -= self.K[index, j] * z[j]
            for coefficient, powers in self.terms.get(name, ()):
                factors = [z[j] for j, power in enumerate(powers) for _ in range(power)]
                total += coefficient * reduce(mul, factors)
            deviations[index] = total
        return ca.Function("gain", [z], [ca.densify(deviations)])

    @classmethod
    def read(cls, entries: Fields, plant: Plant) -> Gain:
        """Return the policy stored in a certificate.

        Raises Malformed for the first wrong entry.
        """
        K = entries.array("K", len(plant.inputs), len(plant.states))
        terms = terms_by_input(entries, "terms", plant, HIGHEST_POLICY)
        entries.close()
        return cls(K, terms)

    def content(self) -> dict[str, Any]:
        """Return the policy as stored in a file, in the form that `read` accepts."""
        rows = {name: rows_of(terms) for name, terms in self.terms.items()}
        return {"K": self.K.tolist(), "terms": rows}


@dataclass(frozen=True, eq=False)
class BoxStatement:
    """Claim that the trajectories from a set converge to the equilibrium of a closed loop.

    Every trajectory of the loop that begins in the set of the piece exists for all time, stays in
    the set and within all limits, and converges to the equilibrium. For V of degree 2, V > rho
    outside the cube |y_i| <= 1, and the set is {V <= rho}.

    loop: the model with its policy and saturated inputs
    policy: SHA-256 of the policy's instructions, or the coefficients
    equilibrium: moving state -> value, within `SAME_TRIM` nominal values of the proved equilibrium
    piece: V and its level, in coordinates y = M z, with z the deviations from the equilibrium
    extents: moving state -> lower and upper bound of the deviation in the set
    """

    loop: Loop
    policy: str | Gain
    equilibrium: Mapping[str, float]
    piece: Piece
    extents: Mapping[str, tuple[float, float]]

    @property
    def rho(self) -> float:
        """Level of V that defines the set."""
        return self.piece.c

    @property
    def degree(self) -> int:
        """Degree of V."""
        return max(sum(powers) for _, powers in self.piece.W.terms)

    @classmethod
    def read(cls, content: Any, subject: Subject) -> BoxStatement:
        """Return the statement of a certificate.

        content: the certificate's entry `statement`
        subject: the user's aircraft and policy

        Raises Malformed for the first wrong entry. Raises BadInputError in these cases:
        - The statement concerns another model.
        - The statement concerns a policy in a file, and the user gave none or another policy.
        """
        entries = Fields("statement", content)
        plant = read_plant(entries, content, subject)
        states = plant.states
        policy = subject.policy
        stated = entries.value("policy", lambda value: isinstance(value, (str, dict)))
        if isinstance(stated, dict):
            stated = Gain.read(Fields("policy", stated), plant)
            policy = stated.function(tuple(plant.inputs))
        elif policy is None:
            raise BadInputError(
                "the certificate is about a policy in a file; give this file with --weights or "
                "--policy"
            )
        elif stated != digest_of(policy):
            raise BadInputError(
                "the certificate is about another policy; give the file and the options used to "
                "prove the certificate"
            )
        loop = Loop(**vars(plant), policy=policy)
        equilibrium = entries.all_numbers("equilibrium", states)
        piece = Piece.read(entries.fields("piece"), len(states))
        extents = read_extents(entries, states)
        entries.close()
        check_limits_of_model(loop)
        return cls(loop, stated, equilibrium, piece, extents)

    def content(self) -> dict[str, Any]:
        """Return the certificate's entry `statement`, in the form that `read` accepts."""
        policy = self.policy.content() if isinstance(self.policy, Gain) else self.policy
        return {
            **self.loop.content(),
            "policy": policy,
            "equilibrium": dict(self.equilibrium),
            "piece": self.piece.content(),
            "extents": {name: list(pair) for name, pair in self.extents.items()},
        }


@dataclass(frozen=True, eq=False)
class BoxWitness:
    """Data for the proof of a region on boxes, not part of the claim.

    The bounds of the deviations z are proved with multiples of rho - V.

    multipliers: (n, 2), nonnegative factors of rho - V for the lower and upper bound of each z_i
    boxes: number of boxes after which the checker stops
    """

    multipliers: np.ndarray
    boxes: int

    @classmethod
    def read(cls, entries: Fields, statement: BoxStatement) -> BoxWitness:
        """Return the witness of a certificate.

        Raises Malformed for the first wrong entry.
        """
        multipliers = entries.array("multipliers", len(statement.loop.states), 2)
        require(bool(np.all(multipliers >= 0.0)), "witness: multipliers")
        boxes = entries.count("boxes", _MOST_BOXES)
        entries.close()
        return cls(multipliers, boxes)

    def content(self) -> dict[str, Any]:
        """Return the certificate's entry `witness`, in the form that `read` accepts."""
        return {"multipliers": self.multipliers.tolist(), "boxes": self.boxes}


def digest_of(policy: ca.Function) -> str:
    """Return the SHA-256 of a policy's instructions and of all digits of its constants.

    Raises BadInputError if the policy has more than `LARGEST` operations.
    """
    function = policy.expand() if policy.is_a("MXFunction") else policy
    if function.n_instructions() > LARGEST:
        raise BadInputError(
            f"the policy has {function.n_instructions()} operations, but at most {LARGEST} are "
            "supported; give a smaller policy"
        )
    hashed = hashlib.sha256()
    for index in range(function.n_instructions()):
        code = function.instruction_id(index)
        places = (*function.instruction_input(index), -1, *function.instruction_output(index))
        number = float(function.instruction_constant(index)).hex() if code == ca.OP_CONST else ""
        hashed.update(f"{code} {places} {number};".encode())
    return hashed.hexdigest()
