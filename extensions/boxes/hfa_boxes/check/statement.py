"""The statement about a region whose policy is a function. The checker interprets or refuses every
field, the digest covers all of them, and a report shows them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from operator import mul
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_boxes.check.loop import Loop
from hfa_boxes.check.piece import Piece, Terms, read_terms
from hfa_boxes.check.plant import Plant
from hfa_boxes.enclosure.program import LARGEST
from hfa_proof.checker.aircraft import model_of
from hfa_proof.checker.reading import Fields, require
from hfa_support.errors import BadInputError

#: By how much the stated equilibrium may be off the enclosed one, in nominal values.
SAME_EQUILIBRIUM = 1e-6
#: Highest degree of a polynomial policy.
HIGHEST_POLICY = 12


class Gain(NamedTuple):
    """The policy u0 - K z + q(z), z: deviations from the trim, before the limits.

    K: (m, n)
    terms: input -> the terms of degree 2 and more of its q; inputs without have q = 0
    """

    K: np.ndarray
    terms: Mapping[str, Terms]

    def function(self, inputs: tuple[str, ...]) -> ca.Function:
        """z (n,) -> deviations of the inputs (m,)."""
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

    def content(self) -> dict[str, Any]:
        """Return the policy as stored in a file."""
        rows = {
            name: [[value, list(powers)] for value, powers in terms]
            for name, terms in self.terms.items()
        }
        return {"K": self.K.tolist(), "terms": rows}


@dataclass(frozen=True, eq=False)
class BoxStatement:
    """Every trajectory of the loop that begins in the set of the piece exists for all time, stays
    there and within all limits, and converges to the equilibrium; z: deviations from that.

    The set of a V of degree 2 is {V <= rho}: V > rho outside the cube too.

    loop: the model with its policy and saturated inputs
    policy: the SHA-256 of its instructions, or its coefficients
    equilibrium: moving state -> value, within `SAME_EQUILIBRIUM` nominal values
    piece: V and its level, in coordinates
    extents: moving state -> lowest and highest deviation in the set, or beyond
    """

    loop: Loop
    policy: str | Gain
    equilibrium: Mapping[str, float]
    piece: Piece
    extents: Mapping[str, tuple[float, float]]

    @property
    def rho(self) -> float:
        """Level of V."""
        return self.piece.c

    @property
    def degree(self) -> int:
        """Degree of V."""
        return max(sum(powers) for _, powers in self.piece.W.terms)

    @classmethod
    def read(cls, content: Any, own: Model | None, policy: ca.Function | None) -> BoxStatement:
        """The statement of a certificate.

        content: of its entry `statement`
        own: the user's model, if the statement concerns one
        policy: the user's; deviations of the states -> those of the inputs. None where the
            certificate has its coefficients

        Malformed names the first entry that cannot be; BadInputError another model or policy.
        """
        entries = Fields("statement", content)
        plant = read_plant(entries, content, own)
        states = plant.states
        stated = _read_policy(entries, plant)
        if isinstance(stated, Gain):
            policy = stated.function(tuple(plant.inputs))
        elif policy is None:
            raise BadInputError("concerns a network; give it by --weights or --policy")
        elif stated != digest_of(policy):
            raise BadInputError("is about another policy; give that one's --weights and options")
        loop = Loop(**vars(plant), policy=policy)
        equilibrium = numbers_of(entries, "equilibrium", states)
        piece = Piece.read(entries.fields("piece"), len(states))
        listed = entries.fields("extents")
        extents = {name: listed.pair(name) for name in states}
        listed.close()
        require(all(low < 0.0 < high for low, high in extents.values()), "extents", extents)
        entries.close()
        _check_limits(loop)
        return cls(loop, stated, equilibrium, piece, extents)

    def content(self) -> dict[str, Any]:
        """Return the statement as stored in a file, which `read` reads."""
        loop = self.loop
        policy = self.policy.content() if isinstance(self.policy, Gain) else self.policy
        return {
            **facts(loop.model),
            "parameters": dict(loop.parameters),
            "trim": dict(loop.trim),
            "inputs": dict(loop.inputs),
            "held": dict(loop.held),
            "limits": {name: pair_of(pair) for name, pair in loop.limits.items()},
            "policy": policy,
            "equilibrium": dict(self.equilibrium),
            "piece": self.piece.content(),
            "extents": {name: list(pair) for name, pair in self.extents.items()},
        }


def _read_policy(entries: Fields, plant: Plant) -> str | Gain:
    stated = entries.value("policy", lambda value: isinstance(value, (str, dict)))
    if isinstance(stated, str):
        return stated
    gain = Fields("policy", stated)
    K = gain.array("K", len(plant.inputs), len(plant.states))
    rows = gain.fields("terms")
    terms = {}
    for name in plant.inputs:
        if rows.has(name):
            terms[name] = read_terms(rows, name, len(plant.states), HIGHEST_POLICY)
    rows.close()
    gain.close()
    return Gain(K, terms)


def read_plant(entries: Fields, content: Any, own: Model | None) -> Plant:
    """The model about a trim, and its limits; Malformed names the first entry that cannot be.

    content: that of the entries
    own: the user's model, if the statement concerns one
    """
    model = model_of(content.get("dynamics"), content.get("source"), own)
    for name, fact in facts(model).items():
        entries.same(name, fact)
    states = tuple(model.linear)
    held = tuple(name for name in model.states if name not in states)
    return Plant(
        model,
        numbers_of(entries, "parameters", tuple(model.parameters)),
        numbers_of(entries, "trim", states),
        numbers_of(entries, "inputs", tuple(model.inputs)),
        numbers_of(entries, "held", held),
        _limits(entries, model),
    )


def digest_of(policy: ca.Function) -> str:
    """Return the SHA-256 of a policy's instructions and all digits of its numbers.

    BadInputError where it is too large to be proved."""
    function = policy.expand() if policy.is_a("MXFunction") else policy
    if function.n_instructions() > LARGEST:
        raise BadInputError(
            f"the policy has {function.n_instructions()} operations; at most {LARGEST} are proved"
        )
    hashed = hashlib.sha256()
    for index in range(function.n_instructions()):
        code = function.instruction_id(index)
        places = (*function.instruction_input(index), -1, *function.instruction_output(index))
        number = float(function.instruction_constant(index)).hex() if code == ca.OP_CONST else ""
        hashed.update(f"{code} {places} {number};".encode())
    return hashed.hexdigest()


def model_limits(
    model: Model, states: Mapping[str, float], parameters: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Return lowest and highest value of every state, input and output with limits: min and max of
    its declaration, and the envelope of the model about this trim.

    states: all of them, at the trim
    parameters: name -> value
    """
    limits = {}
    for name in (*model.states, *model.inputs, *model.outputs):
        signal = model.signals[name]
        limits[name] = (signal.min, signal.max)
    if model.extras.envelope is not None:
        x = model.layout.record("x", [states[name] for name in model.states])
        p = model.layout.record("p", [parameters[name] for name in model.parameters])
        limits |= model.extras.envelope(x, p)
    return {name: pair for name, pair in limits.items() if np.isfinite(pair).any()}


def facts(model: Model) -> dict[str, Any]:
    """Return the model's identity, the order of its states and inputs, and the units."""
    return {
        "dynamics": model.name,
        "source": model.extras.source[1],
        "states": list(model.linear),
        "state_units": list(model.units(model.linear)),
        "input_units": list(model.units(tuple(model.inputs))),
    }


def numbers_of(entries: Fields, name: str, names: tuple[str, ...]) -> dict[str, float]:
    """Read a number for each of the names, in their order."""
    numbers = entries.numbers(name, names)
    require(set(numbers) == set(names), name, sorted(numbers))
    return {each: numbers[each] for each in names}


def _limits(entries: Fields, model: Model) -> dict[str, tuple[float, float]]:
    """Read the limits by signal; a missing limit is null."""
    stated = entries.value("limits", lambda value: isinstance(value, dict))
    limits = {}
    for name, pair in stated.items():
        where = f"limits: {name}"
        require(name in (*model.states, *model.inputs, *model.outputs), where)
        require(isinstance(pair, list) and len(pair) == 2, where, pair)
        ends = Fields(where, {"low": pair[0], "high": pair[1]})
        low = -np.inf if pair[0] is None else ends.number("low")
        high = np.inf if pair[1] is None else ends.number("high")
        require(low < high, where, pair)
        limits[name] = (low, high)
    return limits


def pair_of(limits: tuple[float, float]) -> list[float | None]:
    """Return the limits as stored in a file."""
    return [end if np.isfinite(end) else None for end in limits]


def _check_limits(loop: Loop) -> None:
    """Malformed where a limit of the model is missing or another: the limits of an input are its
    saturation."""
    states = {**loop.trim, **loop.held}
    of_model = model_limits(loop.model, states, loop.parameters)
    for name in (*of_model, *loop.limits):
        least, most = of_model.get(name, (-np.inf, np.inf))
        require(name in loop.limits, f"limits: {name}: missing entry")
        low, high = loop.limits[name]
        if name in loop.inputs:
            require((low, high) == (least, most), f"limits: {name} not the model's", [low, high])
        require(least <= low and high <= most, f"limits: {name} beyond the model's", [low, high])
