"""Random samples of a `ParameterSet`: the entry point `parameters.samples`."""

from __future__ import annotations

from typing import Any

from hfa_identify.draws.parameters import spread_of_set
from hfa_support.errors import BadInputError, refuse_unless_whole


def samples_of_set(known: Any, count: int, seed: int) -> tuple[Any, ...]:
    """Return `count` random samples of the parameters.

    The logarithms of identified parameters are normally distributed. The other parameters are
    constant.

    Raises BadInputError if the covariance is missing, an identified parameter is zero, or `count`
    or `seed` is out of range.
    """
    if not known.covariance.size:
        raise BadInputError(
            "the parameters have no covariance, which random samples require; use the "
            "parameters.toml written by `python -m studies.identification`"
        )
    refuse_unless_whole("count", count, 1)
    refuse_unless_whole("seed", seed, 0)
    spread = spread_of_set(known)
    for name, value in spread.values.items():
        if value == 0.0:
            raise BadInputError(
                f"{name} is identified as 0, so the logarithm of {name} cannot be sampled; give "
                f"{name} a fixed value"
            )
    samples = []
    for row in spread.draws(count, seed).tolist():
        samples.append(known.values._replace(**dict(zip(spread.values, row, strict=True))))
    return tuple(samples)
