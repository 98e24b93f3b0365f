"""What a policy that is not linear does in the box: a bias, actions that are clipped, a squash."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controller.critic.critic import Critic
from controller.riccati.gare import Solution
from hfa_support.reporting.text import percent
from verification.critic_errors import is_gain_right

#: Number of random states in the box, half of them corners, and the same for a wide network.
STATES = 8000
STATES_OF_WIDE = 200
#: Smallest number of states that are no corners and have the extreme value of a clipped input.
CLIPPED = 3


class Finding(NamedTuple):
    """What a policy that is not linear does in the box.

    says: sentence
    other_error: largest error of u without the finding, relative to the largest exact input in the
        box
    """

    says: str
    other_error: float = 0.0


def finding_of_policy(
    critic: Critic, exact: Solution, box: np.ndarray, limit: float
) -> Finding | None:
    """Return what is found of a policy: a constant, clipped actions, or inputs that never move; or
    that it is squashed. None if nothing is found.

    box: half-widths of the box of states, (n,)
    limit: largest error that passes
    """
    count = STATES_OF_WIDE if critic.is_wide else STATES
    states = np.random.default_rng(2).uniform(-1.0, 1.0, (count, len(box)))
    corners, not_corners = slice(1, None, 2), slice(0, None, 2)
    states[corners] = np.sign(states[corners])
    states *= box
    u = critic.u(states)
    bias = critic.u(np.zeros(len(box)))
    sizes = np.maximum(np.abs(exact.K) @ box, np.finfo(float).tiny)
    errors = np.abs(u - bias + states @ exact.K.T) / sizes  # the exact u is -K z
    if np.all(u == u[0]):
        return Finding("the policy never moves an input: u is the same in the whole box")
    other_error = 0.0
    clips, unmoved = [], []
    for name, unit, values, error in zip(
        exact.names.inputs, exact.names.input_units, u.T, errors.T, strict=True
    ):
        inside = values[not_corners]
        extremes = (inside.min() + 0.0, inside.max() + 0.0)  # no -0
        if extremes[0] == extremes[1]:
            unmoved.append(name)
            continue
        levels = [level for level in extremes if np.sum(inside == level) >= CLIPPED]
        is_clipped = np.isin(values, levels)
        other_error = max(other_error, float(error[~is_clipped].max(initial=0.0)))
        if levels:
            at = " and ".join(f"{level:.4g}" for level in levels) + _unit_text(unit)
            share = percent(100.0 * float(is_clipped[not_corners].mean()))
            clips.append(f"{name} is clipped at {at} in {share}")
    facts = [bias_text(critic, exact)] if np.any(np.abs(bias) > limit * sizes) else []
    if unmoved:
        facts.append(f"{' and '.join(unmoved)} {'is' if len(unmoved) == 1 else 'are'} never moved")
    if clips:
        facts.append(f"{', '.join(clips)} of the box")
    if not facts:
        return _squashed(critic, exact, box, limit)
    says = "; ".join(facts)
    return Finding(
        f"{says}; otherwise the policy is exact" if other_error <= limit else says, other_error
    )


def _squashed(critic: Critic, exact: Solution, box: np.ndarray, limit: float) -> Finding | None:
    """Return that inputs with right slopes stay below the exact ones, or None.

    Each input is compared at the corner of the box where the exact one is largest.
    """
    if not is_gain_right(critic.K, exact, limit):
        return None
    corners = -box * np.where(exact.K < 0.0, -1.0, 1.0)
    texts = [
        f"{name} is {reached:.4g}{_unit_text(unit)}, where the exact one is {size:.4g}"
        for name, unit, reached, size in zip(
            exact.names.inputs,
            exact.names.input_units,
            np.diag(critic.u(corners)),
            np.abs(exact.K) @ box,
            strict=True,
        )
        if 0.0 <= reached < (1.0 - limit) * size
    ]
    if not texts:
        return None
    return Finding(f"K is right, but {', '.join(texts)}, as by a squash (tanh)")


def bias_text(critic: Critic, exact: Solution) -> str:
    """Return a sentence on the inputs at the origin, which are not 0."""
    u = critic.u(np.zeros(critic.K.shape[1]))
    units = exact.names.input_units
    values = [f"{value:.4g}{_unit_text(unit)}" for value, unit in zip(u, units, strict=True)]
    return f"u at the origin is {', '.join(values)}, not 0: a bias"


def _unit_text(unit: str) -> str:
    """Return a unit as it follows a number, or "" for none."""
    return "" if unit in ("", "1") else f" {unit}"
