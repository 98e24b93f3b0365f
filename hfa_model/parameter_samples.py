"""Random samples of the identified parameters, within the uncertainty from the printed digits."""

from __future__ import annotations

from hfa_model.parameters import Parameters, ParameterSet
from hfa_support.entry_points import PARTS, part


def sample_parameters(parameters: ParameterSet, count: int, seed: int) -> tuple[Parameters, ...]:
    """Return random samples of the identified parameters, p_i exp(z_i) with z ~ N(0, C_ij / (p_i
    p_j)).

    All other parameters are unchanged. The samples are Gaussian in the logarithms of the
    parameters. The printed matrices determine products and quotients of parameters much more
    precisely than single parameters.

    parameters: p and its covariance C
    count: number of samples
    seed: the same seed gives the same samples

    Raises BadInputError if there is no covariance, an identified parameter is zero, or count or
    seed is out of range.
    """
    draw = part(PARTS, "parameters.samples", "sample_parameters")
    samples: tuple[Parameters, ...] = draw(parameters, count, seed)
    return samples
