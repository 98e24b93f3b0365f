"""Random samples of the identified parameters, as uncertain as the print leaves them."""

from __future__ import annotations

from hfa_model.parameters import Parameters, ParameterSet
from hfa_support.entry_points import PARTS, part


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
    draw = part(PARTS, "parameters.samples", "sample_parameters")
    samples: tuple[Parameters, ...] = draw(parameters, count, seed)
    return samples
