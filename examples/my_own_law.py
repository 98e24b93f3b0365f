"""A user-defined learning law, which is run and checked: damped policy iteration.

The law uses samples z, their derivatives F = A z, and B, E, Q, R and delta, but not A. The current
policies are u = -K z and d = L z. In each step, the law fits the weights W of their value to all
samples by least squares,

    (dpsi/dz)' W (F - B K z + E L z) = -z'(Q + K'R K - delta² L'L) z,

and moves the weights by 10 % of the difference. The aircraft at 5 deg is stable without control, so
the law can begin at W = 0. After np.savez("mine.npz", W=W), the command for this check is
`hfa verify --dihedral 5 --weights mine.npz`. The script, run with .venv/bin/python, prints

    PASS on the linear game, typical box: optimal cost, exact within 1e-06
"""

import numpy as np

import controller
import hfa
import hfa_model

SHARE = 0.1  # fraction of the distance to the fitted weights


def step(game, psi, states, drifts, weights):
    """Return weights that are moved by SHARE toward those of the value of the current policies.

    states, drifts: random states z, (N, n), and their derivatives A z
    """
    P = psi.matrix(weights)
    K = game.gain(P)
    L = game.disturbance_gain(P)
    rate = drifts - states @ K.T @ game.B.T + states @ L.T @ game.E.T
    cost = game.Q + K.T @ game.R @ K - game.delta**2 * L.T @ L
    # The equation above at each sample, in units of the sizes of the functions psi.
    size = np.linalg.norm(psi.psi(states), axis=0)
    rows = np.einsum("jmi,ji->jm", psi.gradient(states), rate)
    right = -np.einsum("ji,ik,jk->j", states, cost, states)
    fitted = np.linalg.lstsq(rows / size, right, rcond=None)[0] / size
    return weights + SHARE * (fitted - weights)


aircraft = hfa.aircraft()
model = hfa.paper.level_model(aircraft, 5 * hfa_model.DEGREE)
game = hfa.paper.published_game(model)
states = np.random.default_rng(0).uniform(-1.0, 1.0, (60, len(game.A)))
psi = controller.basis("quadratic", len(game.A))
W = np.zeros(psi.size)
for _ in range(400):
    W = step(game, psi, states, states @ game.A.T, W)
print(hfa.verify(game, hfa.from_weights(game, W)).headline)
