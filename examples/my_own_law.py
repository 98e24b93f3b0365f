"""A user-defined learning law, which is run, recorded and checked: damped policy iteration.

The law uses samples z, their derivatives F = A z, and B, E, Q, R and delta, but not A. The current
policies are u = -K z and d = L z. At each tick, the law fits the weights W of their value to all
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

TICK = 0.05  # s
SHARE = 0.1  # fraction of the distance to the fitted weights


class DampedPolicyIteration:
    """Damped policy iteration, a learning law for `controller.run`.

    `controller.run` calls `start`, `advance` and `observe`.

    game: the game
    states: random states z, (N, n)
    drifts: their derivatives A z without inputs, (N, n)
    """

    ticks = 400

    def __init__(self, game, states, drifts):
        self.game = game
        self.states, self.drifts = states, drifts
        self.psi = controller.basis("quadratic", len(game.A))
        self.slopes = self.psi.gradient(states)  # dpsi/dz of the M functions, (N, M, n)
        self.size = np.linalg.norm(self.psi.psi(states), axis=0)  # of each function, (M,)

    def start(self):
        """Return the memory before the first tick: the weights W = 0."""
        return {"weights": np.zeros(self.psi.size)}

    def advance(self, tick, memory):
        """Return the memory after a tick.

        The weights are moved by the fraction SHARE toward the weights of the value of the current
        policies.
        """
        game = self.game
        z = self.states
        P = self.psi.matrix(memory["weights"])
        K = game.gain(P)
        L = game.disturbance_gain(P)
        rate = self.drifts - z @ K.T @ game.B.T + z @ L.T @ game.E.T
        cost = game.Q + K.T @ game.R @ K - game.delta**2 * L.T @ L
        # The equation above at each sample, in unknowns that are scaled by `size`.
        rows = np.einsum("jmi,ji->jm", self.slopes, rate)
        right = -np.einsum("ji,ik,jk->j", z, cost, z)
        fitted = np.linalg.lstsq(rows / self.size, right, rcond=None)[0] / self.size
        return {"weights": memory["weights"] + SHARE * (fitted - memory["weights"])}

    def observe(self, tick, memory):
        """Return the quantities to record at this tick: the time in seconds and the weights."""
        return {"time": TICK * tick, "weights": memory["weights"]}


aircraft = hfa.aircraft()
model = hfa.paper.level_model(aircraft, 5 * hfa_model.DEGREE)
game = hfa.paper.published_game(model)
states = np.random.default_rng(0).uniform(-1.0, 1.0, (60, len(game.A)))
run = controller.run(DampedPolicyIteration(game, states, states @ game.A.T))
W = run.history["weights"][-1]
print(hfa.verify(game, hfa.from_weights(game, W)).headline)
