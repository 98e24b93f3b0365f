"""Random samples of the identified parameters, as uncertain as the print leaves them."""

from __future__ import annotations

import numpy as np

from hfa_aircraft.parameter_spread import ParameterSpread
from hfa_model.parameters import Parameters, ParameterSet
from hfa_support.errors import BadInputError, refuse_unless_whole


def sample_parameters(parameters: ParameterSet, count: int, seed: int) -> tuple[Parameters, ...]:
    """p_i exp(z_i), z ~ N(0, C_ij / (p_i p_j)): random samples of the identified parameters,
    correlated; the other parameters are unchanged.

    parameters: p and its covariance C
    count: how many samples
    seed: the same seed gives the same samples

    The print determines products and quotients of the parameters far better than the parameters;
    their logarithms are sums, which a Gaussian keeps. Drawn as p + N(0, C) the spread of an entry
    of A comes out up to 4.8 times too large.

    Raises BadInputError when there is no covariance, an identified parameter is zero, or count or
    seed is out of range.
    """
    if not parameters.covariance.size:
        raise BadInputError(
            "samples need parameters with their covariance, such as the parameters.toml of"
            " `python -m studies.identification`"
        )
    refuse_unless_whole("count", count, 1)
    refuse_unless_whole("seed", seed, 0)
    columns = [Parameters._fields.index(name) for name in parameters.identified]
    table = np.tile(np.array(parameters.values, dtype=float), (count, 1))
    center = table[0, columns]
    if not center.all():
        name = parameters.identified[int(np.argmin(np.abs(center)))]
        raise BadInputError(f"{name} is zero and identified; its logarithm cannot be sampled")
    values = dict(zip(parameters.identified, center.tolist(), strict=True))
    spread = ParameterSpread(values, parameters.covariance, of_logarithms=True)
    table[:, columns] = spread.draws(count, seed)
    return tuple(Parameters(*row) for row in table.tolist())
