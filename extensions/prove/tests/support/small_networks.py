"""Small networks fitted to a linear gain by least squares, as policies for proofs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

ACTIVATIONS = {
    "tanh": np.tanh,
    "relu": lambda t: np.maximum(t, 0.0),
    "leaky_relu": lambda t: np.where(t > 0.0, t, 0.01 * t),
    "sigmoid": lambda t: 1.0 / (1.0 + np.exp(-t)),
    "elu": lambda t: np.where(t > 0.0, t, np.expm1(np.minimum(t, 0.0))),
}


def imitation(
    path: Path,
    K: np.ndarray,
    reach: np.ndarray,
    hidden: tuple[int, ...] = (16, 16),
    activation: str = "tanh",
    seed: int = 0,
) -> Path:
    """Write the state dict of a network u(z) near -K z for |z_i| <= reach_i, and return its path.

    The network has u(0) = 0. Its hidden weights are random, and its last layer is fitted.

    path: .npz
    K: (m, n)
    reach: (n,)
    hidden: widths of the hidden layers
    activation: name of the activation function
    seed: seed of the random weights
    """
    generator = np.random.default_rng(seed)
    act = ACTIVATIONS[activation]
    n = len(reach)
    points = generator.uniform(-1.2, 1.2, (4000, n))
    values = points.T
    at_zero = np.zeros((n, 1))
    arrays = {}
    size = n
    for layer, width in enumerate(hidden):
        weight = generator.normal(size=(width, size)) / np.sqrt(size)
        bias = 0.5 * generator.normal(size=width)
        arrays[f"{2 * layer}.weight"] = weight / reach if layer == 0 else weight
        arrays[f"{2 * layer}.bias"] = bias
        values = act(weight @ values + bias[:, None])
        at_zero = act(weight @ at_zero + bias[:, None])
        size = width
    wanted = -(points * reach) @ np.asarray(K).T
    # ridge regression, for small weights as after training
    features = (values - at_zero).T
    left = features.T @ features + 1e-3 * len(points) * np.eye(size)
    weight = np.linalg.solve(left, features.T @ wanted).T
    arrays[f"{2 * len(hidden)}.weight"] = weight
    arrays[f"{2 * len(hidden)}.bias"] = -(weight @ at_zero).ravel()
    np.savez(path, **arrays)
    return path
