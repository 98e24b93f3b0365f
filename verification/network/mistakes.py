"""Mistakes of a policy that is not linear: a bias, and actions that are clipped."""

from __future__ import annotations

import numpy as np

from controller.critic.critic import Critic
from controller.riccati.gare import Solution
from hfa_support.reporting.text import percent
from verification.critic_errors import relative_error

#: Number of random states in the box, half of them corners, and the same for a wide network.
STATES = 8000
STATES_OF_WIDE = 200
#: Smallest number of states that are no corners and have the extreme value of a clipped input.
CLIPPED = 3
#: Largest error of the rest of a policy with a bias or clipped actions.
REST = 0.01
#: An input that stays below this part of the largest exact one is squashed.
SQUASHED = 0.9


def mistake_of_policy(critic: Critic, exact: Solution, box: np.ndarray, limit: float) -> str:
    """Return a sentence on a constant or on clipped actions that explain the errors of u, or "".

    They explain the errors if those of the rest of the policy are at most `REST`. Errors are
    relative to the largest exact input in the box.

    box: half-widths of the box of states, (n,)
    limit: largest error that passes
    """
    count = STATES_OF_WIDE if critic.is_wide else STATES
    states = np.random.default_rng(2).uniform(-1.0, 1.0, (count, len(box)))
    states[1::2] = np.sign(states[1::2])
    states *= box
    u = critic.u(states)
    bias = critic.u(np.zeros(len(box)))
    sizes = np.maximum(np.abs(exact.K) @ box, np.finfo(float).tiny)
    errors = np.abs(u - bias + states @ exact.K.T) / sizes
    if np.all(u == u[0]):
        return "the policy never moves an input: u is the same in the whole box"
    rest = 0.0
    clips, still = [], []
    for name, unit, values, error in zip(
        exact.names.inputs, exact.names.input_units, u.T, errors.T, strict=True
    ):
        extremes = (values[::2].min() + 0.0, values[::2].max() + 0.0)  # no -0
        if extremes[0] == extremes[1]:
            still.append(name)
            continue
        levels = [level for level in extremes if np.sum(values[::2] == level) >= CLIPPED]
        clipped = np.isin(values, levels)
        rest = max(rest, float(error[~clipped].max(initial=0.0)))
        if levels:
            at = " and ".join(f"{level:.4g}" for level in levels) + _shown(unit)
            share = percent(100.0 * float(clipped[::2].mean()))
            clips.append(f"{name} is clipped at {at} in {share}")
    facts = [bias_text(critic, exact)] if np.any(np.abs(bias) > limit * sizes) else []
    if still:
        facts.append(f"{' and '.join(still)} {'is' if len(still) == 1 else 'are'} never moved")
    if clips:
        facts.append(f"{', '.join(clips)} of the box")
    if not facts or not rest <= REST:
        return _squashed(critic, exact, u, sizes)
    otherwise = "exact" if rest <= limit else f"off by {rest:.2g}"
    return f"{'; '.join(facts)}; otherwise the policy is {otherwise}"


def _squashed(critic: Critic, exact: Solution, u: np.ndarray, sizes: np.ndarray) -> str:
    """Return a sentence on inputs with right slopes that stay below the exact ones, or "".

    u: inputs at states in the box, (N, m)
    sizes: largest exact inputs in the box, (m,)
    """
    if relative_error(critic.K, exact.K) > REST:
        return ""
    texts = [
        f"{name} stays within ±{reach:.4g}{_shown(unit)}, where the exact one reaches {size:.4g}"
        for name, unit, reach, size in zip(
            exact.names.inputs, exact.names.input_units, np.abs(u).max(axis=0), sizes, strict=True
        )
        if reach < SQUASHED * size
    ]
    return f"K is right, but {', '.join(texts)}: a squash, as tanh" if texts else ""


def bias_text(critic: Critic, exact: Solution) -> str:
    """Return a sentence on the inputs at the origin, which are not 0."""
    u = critic.u(np.zeros(critic.K.shape[1]))
    units = exact.names.input_units
    values = [f"{value:.4g}{_shown(unit)}" for value, unit in zip(u, units, strict=True)]
    return f"u at the origin is {', '.join(values)}, not 0: a bias"


def _shown(unit: str) -> str:
    return "" if unit in ("", "1") else f" {unit}"
