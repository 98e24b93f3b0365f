"""Fit a neural network to the exact game at 15 deg, without torch: CasADi for the gradient, SciPy's L-BFGS.

    python examples/train_a_network.py critic.npz --of V --hidden 32,32
    hfa verify --dihedral 15 --weights critic.npz --set activation=tanh --set scale=0.142857142857,10,10,10,10,10

The network takes z_i / b_i, b the half widths of the box of states, and fits V and dV/dz (`--of V`), dV/dz or u.
"""

from __future__ import annotations

import argparse
import itertools

import casadi as ca
import numpy as np

import hfa

#: Half widths of the box: ft/s, rad, rad/s.
BOX = np.array([7.0, 0.1, 0.1, 0.1, 0.1, 0.1])
ACTIVATIONS = {
    "tanh": ca.tanh,
    "relu": lambda x: ca.fmax(x, 0.0),
    "softplus": lambda x: ca.log(1.0 + ca.exp(x)),
}


def game_at(degrees: float) -> hfa.Game:
    """The paper's game on the aircraft at this dihedral angle."""
    model = hfa.paper.level_model(hfa.aircraft(), np.radians(degrees))
    return hfa.paper.published_game(model)


def fit(
    game: hfa.Game,
    of: str = "V",
    hidden: tuple[int, ...] = (32, 32),
    activation: str = "tanh",
    points: int = 2000,
    steps: int = 400,
    seed: int = 0,
    box: np.ndarray = BOX,
) -> dict[str, np.ndarray]:
    """State dict of the network y -> V, dV/dz or u (of: "V", "gradient", "policy") at z = box y, float32."""
    from scipy.optimize import minimize

    exact, rng = hfa.solve_game(game), np.random.default_rng(seed)
    n = len(game.A)
    y = rng.uniform(-1.0, 1.0, (n, points)) * rng.uniform(0.0, 1.0, points) ** 0.5
    z = box[:, None] * y
    slopes = 2.0 * exact.P @ z * box[:, None]
    target = {
        "V": np.sum(z * (exact.P @ z), axis=0)[None],
        "gradient": slopes,
        "policy": -exact.K @ z,
    }[of]
    unit = target.std(axis=1, keepdims=True)
    widths = (n, *hidden, len(target))
    sizes = [each for a, b in itertools.pairwise(widths) for each in ((b, a), (b, 1))]
    start = [
        rng.normal(size=each) / np.sqrt(each[1]) if each[1] > 1 else np.zeros(each)
        for each in sizes
    ]
    w, x = ca.MX.sym("w", sum(each.size for each in start)), ca.MX.sym("x", n, points)
    ends = np.cumsum([0, *(each.size for each in start)]).tolist()
    layers = [
        ca.reshape(w[a:b], *size) for a, b, size in zip(ends[:-1], ends[1:], sizes, strict=True)
    ]
    out = x
    for place in range(0, len(layers), 2):
        out = layers[place] @ (ACTIVATIONS[activation](out) if place else out) + ca.repmat(
            layers[place + 1], 1, points
        )
    loss = ca.sumsqr(out - target / unit) / out.numel()
    if of == "V":  # and its slopes
        loss += ca.sumsqr(ca.gradient(ca.sum2(out), x) - slopes / unit) / slopes.size
    function = ca.Function("loss", [w, x], [loss, ca.gradient(loss, w)])

    def descent(weights: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = function(weights, y)
        return float(value), np.array(slope).ravel()

    first = np.concatenate([each.ravel(order="F") for each in start])
    found = minimize(
        descent, first, jac=True, method="L-BFGS-B", options={"maxiter": steps, "maxfun": 2 * steps}
    )
    arrays = [
        found.x[a:b].reshape(size, order="F")
        for a, b, size in zip(ends[:-1], ends[1:], sizes, strict=True)
    ]
    arrays[-2], arrays[-1] = arrays[-2] * unit, arrays[-1] * unit
    if of == "gradient":
        arrays[-2], arrays[-1] = arrays[-2] / box[:, None], arrays[-1] / box[:, None]
    names = [f"{place}.{kind}" for place in range(0, len(arrays), 2) for kind in ("weight", "bias")]
    return {
        name: (each if name.endswith("weight") else each.ravel()).astype("float32")
        for name, each in zip(names, arrays, strict=True)
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file")
    parser.add_argument("--of", default="V", choices=("V", "gradient", "policy"))
    parser.add_argument("--hidden", default="32,32")
    parser.add_argument("--activation", default="tanh", choices=ACTIVATIONS)
    parser.add_argument("--dihedral", default=15.0, type=float)
    parser.add_argument("--points", default=2000, type=int)
    parser.add_argument("--steps", default=400, type=int)
    parser.add_argument("--seed", default=0, type=int)
    given = vars(parser.parse_args())
    file, degrees = given.pop("file"), given.pop("dihedral")
    given["hidden"] = tuple(map(int, given["hidden"].split(",")))
    np.savez(file, **fit(game_at(degrees), **given))
