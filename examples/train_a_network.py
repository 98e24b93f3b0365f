r"""Fit a network to the exact game solution with CasADi's gradient and SciPy's L-BFGS.

    python examples/train_a_network.py critic.npz --of V --hidden 32,32
    hfa verify --dihedral 15 --weights critic.npz --set activation=tanh \
        --set scale=0.142857142857,10,10,10,10,10

The dihedral angle is 15 deg, or that of `--dihedral`. The inputs of the network are z_i / b_i, where
b_i are the half-widths of the box. With `--of V` the network is fitted to V and dV/dz, with
`--of gradient` to dV/dz, and with `--of policy` to u.
"""

from __future__ import annotations

import argparse
import itertools

import casadi as ca
import numpy as np

import hfa

#: Half-widths of the box: ft/s, rad, rad/s.
BOX = np.array([7.0, 0.1, 0.1, 0.1, 0.1, 0.1])
ACTIVATIONS = {
    "tanh": ca.tanh,
    "relu": lambda x: ca.fmax(x, 0.0),
    "softplus": lambda x: ca.log(1.0 + ca.exp(x)),
}


def game_at(degrees: float) -> hfa.Game:
    """Return the paper's game for the aircraft at this dihedral angle in degrees."""
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
    """Return the float32 state dict of a network that maps y to V, dV/dz or u at z = box y.

    of: "V", "gradient" or "policy"
    hidden: width of each hidden layer
    activation: name of the activation of the hidden layers
    points: number of samples
    steps: largest number of iterations of L-BFGS
    seed: seed of the samples and of the initial weights
    box: half-widths (n,) of the box
    """
    from scipy.optimize import minimize

    exact = hfa.solve(game)
    rng = np.random.default_rng(seed)
    n = len(game.A)
    # Samples in the unit box, denser near 0, and their states.
    y = rng.uniform(-1.0, 1.0, (n, points)) * rng.uniform(0.0, 1.0, points) ** 0.5
    z = box[:, None] * y
    slopes = 2.0 * exact.P @ z * box[:, None]  # dV/dy of V = z'Pz
    target = {
        "V": np.sum(z * (exact.P @ z), axis=0)[None],
        "gradient": slopes,
        "policy": -exact.K @ z,
    }[of]
    unit = target.std(axis=1, keepdims=True)

    # Shapes of weight and bias of each layer, and their initial values.
    shapes = []
    for fan_in, fan_out in itertools.pairwise((n, *hidden, len(target))):
        shapes += [(fan_out, fan_in), (fan_out, 1)]
    initial = [initial_values(rng, shape) for shape in shapes]
    ends = np.cumsum([0, *(array.size for array in initial)]).tolist()

    w = ca.MX.sym("w", ends[-1])
    x = ca.MX.sym("x", n, points)
    layers = [
        ca.reshape(w[begin:end], *shape)
        for begin, end, shape in zip(ends[:-1], ends[1:], shapes, strict=True)
    ]
    output = x
    for k in range(0, len(layers), 2):  # the weight and the bias of a layer
        if k > 0:
            output = ACTIVATIONS[activation](output)
        output = layers[k] @ output + ca.repmat(layers[k + 1], 1, points)
    loss = ca.sumsqr(output - target / unit) / output.numel()
    if of == "V":
        slope_error = ca.gradient(ca.sum2(output), x) - slopes / unit
        loss += ca.sumsqr(slope_error) / slopes.size
    function = ca.Function("loss", [w, x], [loss, ca.gradient(loss, w)])

    def loss_and_slope(weights: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = function(weights, y)
        return float(value), np.array(slope).ravel()

    result = minimize(
        loss_and_slope,
        np.concatenate([array.ravel(order="F") for array in initial]),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": steps, "maxfun": 2 * steps},
    )
    arrays = [
        result.x[begin:end].reshape(shape, order="F")
        for begin, end, shape in zip(ends[:-1], ends[1:], shapes, strict=True)
    ]

    # The last layer is scaled to the unit of the target; dV/dz is dV/dy divided by the box.
    arrays[-2] = arrays[-2] * unit
    arrays[-1] = arrays[-1] * unit
    if of == "gradient":
        arrays[-2] = arrays[-2] / box[:, None]
        arrays[-1] = arrays[-1] / box[:, None]
    state_dict = {}
    for k in range(0, len(arrays), 2):
        state_dict[f"{k}.weight"] = arrays[k].astype("float32")
        state_dict[f"{k}.bias"] = arrays[k + 1].ravel().astype("float32")
    return state_dict


def initial_values(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Return random normal weights of variance 1/fan-in.

    For a single column (a bias), return zeros.
    """
    if shape[1] == 1:
        return np.zeros(shape)
    return rng.normal(size=shape) / np.sqrt(shape[1])


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
    options = vars(parser.parse_args())
    file = options.pop("file")
    degrees = options.pop("dihedral")
    options["hidden"] = tuple(int(width) for width in options["hidden"].split(","))
    np.savez(file, **fit(game_at(degrees), **options))
