"""A learning law of one's own, run, recorded and checked: policy iteration by least squares, taken in small steps.

The law sees samples z, their drifts F = A z, and B, E, Q, R and delta; not A. At each tick it fits the weights W of the
value of its present policies u = -K z, d = L z to all samples,

    (dpsi/dz)' W (F - B K z + E L z) = -z'(Q + K'R K - delta² L'L) z,

and goes a tenth of the way there. The aircraft at 5 deg is stable by itself, so that W = 0 is a start. With
np.savez("mine.npz", **run.history) the same check is `hfa verify --dihedral 5 --weights mine.npz --set
predefined_time=15`. Run it with .venv/bin/python; it prints

    PASS on the linear game: no cost lost, exact within 1e-06, stabilizing, L2 gain 148.9 (delta 200)
    the largest error stays within 1e-06 from 18.3 s on
    by 15 s: FAIL
"""

import numpy as np

import controller
import hfa
import hfa_model
import verification

TICK, SHARE = 0.05, 0.1


class DampedPolicyIteration:
    """A start, a pure step, and what to write down: all that `controller.run` asks of a law."""

    ticks = 400

    def __init__(self, game, pool):
        self.game, self.pool, self.psi = game, pool, controller.basis("quadratic", len(game.A))
        self.slopes = self.psi.gradient(pool.states)  # (N, M, n)
        self.size = np.linalg.norm(self.psi.psi(pool.states), axis=0)  # columns of one length

    def start(self):
        """Nothing is known: W = 0."""
        return {"weights": np.zeros(self.psi.size)}

    def advance(self, tick, memory):
        """A tenth of the way to the value of the present policies."""
        game, z = self.game, self.pool.states
        P = self.psi.matrix(memory["weights"])
        K, L = game.gain(P), game.disturbance_gain(P)
        rate = self.pool.drifts - z @ K.T @ game.B.T + z @ L.T @ game.E.T
        cost = game.Q + K.T @ game.R @ K - game.delta**2 * L.T @ L
        rows, right = (
            np.einsum("jmi,ji->jm", self.slopes, rate),
            -np.einsum("ji,ik,jk->j", z, cost, z),
        )
        fitted = np.linalg.lstsq(rows / self.size, right, rcond=None)[0] / self.size
        return {"weights": memory["weights"] + SHARE * (fitted - memory["weights"])}

    def observe(self, tick, memory):
        """The time and the weights."""
        return {"time": TICK * tick, "weights": memory["weights"]}


aircraft = hfa.aircraft()
model = hfa.paper.level_model(aircraft, 5 * hfa_model.DEGREE)
game = hfa.paper.published_game(model)
run = controller.run(DampedPolicyIteration(game, controller.random_pool(game, 60, seed=0)))
history = controller.critics_over_time(game, run.history["time"], W=run.history["weights"])
check = verification.check_history(game, history)
print(check.report().title)
print(check.table.sentence)
print(
    "by 15 s:",
    "PASS" if verification.check_history(game, history, predefined_time=15.0).ok else "FAIL",
)
