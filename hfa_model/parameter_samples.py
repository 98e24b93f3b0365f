"""Random aircraft that the print allows: parameters drawn from their covariance."""

from __future__ import annotations

import numpy as np

from hfa_model.parameters import Parameters, ParameterSet
from hfa_model.support.errors import BadInputError


def sample_parameters(parameters: ParameterSet, count: int, seed: int) -> tuple[Parameters, ...]:
    """p_i exp(z_i), z ~ N(0, C_ij / (p_i p_j)): the identified parameters varied together, the others as they are.

    C: the covariance of `parameters`. The print determines products and quotients of the parameters far better than
    the parameters, and those of logarithms are sums, which a Gaussian keeps. Drawn as p + N(0, C) the spread of an
    entry of A comes out up to 4.8 times too large. The same seed gives the same samples.
    BadInputError when there is no covariance, or an identified parameter is zero.
    """
    if not parameters.covariance.size:
        raise BadInputError(
            "samples need parameters with their covariance, such as the parameters.toml of `hfa identify`"
        )
    if count < 1 or seed < 0:
        raise BadInputError(f"count is {count} and seed is {seed}; give at least one sample and no negative seed")
    columns = [Parameters._fields.index(name) for name in parameters.identified]
    table = np.tile(np.array(parameters.values, dtype=float), (count, 1))
    center = table[0, columns]
    if not center.all():
        name = parameters.identified[int(np.argmin(np.abs(center)))]
        raise BadInputError(f"{name} is zero and identified; its logarithm cannot be sampled")
    variances, axes = np.linalg.eigh(parameters.covariance / np.outer(center, center))
    # The symmetric root, which does not depend on the signs and the order of the axes.
    root = axes * np.sqrt(np.maximum(variances, 0.0)) @ axes.T
    deviations = np.random.default_rng(seed).standard_normal((count, len(columns))) @ root
    table[:, columns] *= np.exp(deviations)
    return tuple(Parameters(*row) for row in table.tolist())
