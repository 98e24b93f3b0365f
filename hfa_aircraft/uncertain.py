"""Uncertain parameters of an aircraft, read from its file or from the HFA's parameter set."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, is_finite
from hfa_support.files import read_toml


@dataclass(frozen=True, eq=False)
class ParameterSpread:
    """Uncertain parameters whose values, or logarithms, are normally distributed.

    values: name -> mean value p_i.
    covariance: covariance C of the values, (n, n).
    of_logarithms: if True, a random value is p_i exp(z_i), where z has the covariance C_ij / (p_i
        p_j). Otherwise it is p_i + z_i, where z has the covariance C.
    """

    values: Mapping[str, float]
    covariance: np.ndarray
    of_logarithms: bool = False

    def draws(self, count: int, seed: int) -> np.ndarray:
        """Return random values of the parameters, (count, n)."""
        # z, relative to the sizes s, has the covariance C_ij / (s_i s_j). It consists of standard
        # normal numbers times the square root of this matrix.
        center = np.array(list(self.values.values()))
        sizes = center if self.of_logarithms else np.sqrt(np.diag(self.covariance))
        sizes = np.where(sizes == 0.0, 1.0, sizes)  # of a parameter that is known exactly
        variances, axes = np.linalg.eigh(self.covariance / np.outer(sizes, sizes))
        # Unlike V sqrt(variances), this square root does not depend on signs and order of V.
        root = axes * np.sqrt(np.maximum(variances, 0.0)) @ axes.T
        z = np.random.default_rng(seed).standard_normal((count, len(center))) @ root
        return np.asarray(center * np.exp(z) if self.of_logarithms else center + sizes * z)

    def aircraft(self, model: Model, count: int, seed: int) -> list[Model]:
        """Return `count` models with random parameters, clipped to the limits of the model."""
        signals = [model.parameters[name] for name in self.values]
        ends = np.array([(signal.min, signal.max) for signal in signals]).T
        rows = np.clip(self.draws(count, seed), *ends).tolist()
        return [model.with_parameters(**dict(zip(self.values, row, strict=True))) for row in rows]


#: Largest asymmetry and negative eigenvalue of correlations that are rounding, in files with eight
#: digits.
_ROUNDING = 1e-8
_ADVICE = "give the file that `hfa identify -o FILE.toml` writes"


def spread_of_file(path: str, model: Model) -> ParameterSpread:
    """Return the uncertain parameters given by [covariance] in an aircraft file.

    Raises BadInputError if [covariance] is missing or is not a covariance of parameters.
    """
    data = read_toml(path) if path.endswith(".toml") and Path(path).is_file() else {}
    table = data.get("covariance")
    if table is None:
        raise BadInputError(f"{path} has no [covariance], which --draws requires; {_ADVICE}")
    table = table if isinstance(table, Mapping) else {}
    names, rows = table.get("names", ()), table.get("rows", ())
    are_known = isinstance(names, list) and all(name in model.parameters for name in names)
    if not names or not are_known or not _is_square(rows, len(names)):
        raise BadInputError(
            f"{path}: [covariance] does not consist of names of parameters and one row for each "
            f"name; {_ADVICE}"
        )
    matrix = np.array(rows, dtype=float)
    if not is_covariance(matrix):
        raise BadInputError(f"{path}: [covariance] is not a covariance matrix; {_ADVICE}")
    values = {name: model.parameters[name].start for name in names}
    return ParameterSpread(values, matrix)


def spread_of(model: Model, known: Any, held: Collection[str]) -> ParameterSpread:
    """Return the uncertain parameters of an aircraft. Units are SI if the model is in SI.

    known: file of the aircraft or of its parameters, or a `ParameterSet`
    held: names of parameters that are left out

    Raises BadInputError if the covariance is unknown.
    """
    native = model.native
    if isinstance(known, str):
        spread = spread_of_file(known, native)
    else:
        if not known.covariance.size:
            raise BadInputError(
                "--draws requires the covariance of the parameters; give --parameters FILE with "
                "a [covariance]"
            )
        spread = spread_of_set(known)
    if model is not native:
        spread = _in_units_of(model, spread)
    is_kept = np.array([name not in held for name in spread.values])
    return replace(
        spread,
        values={name: value for name, value in spread.values.items() if name not in held},
        covariance=spread.covariance[is_kept][:, is_kept],
    )


def spread_of_set(known: Any) -> ParameterSpread:
    """Return the uncertain parameters of a `ParameterSet`, with normally distributed logarithms.

    The uncertain parameters are those that the set identifies.
    """
    values = {name: getattr(known.values, name) for name in known.identified}
    return ParameterSpread(values, known.covariance, of_logarithms=True)


def _in_units_of(model: Model, spread: ParameterSpread) -> ParameterSpread:
    """Return the uncertain parameters in the units of a converted model."""
    factors = np.array([model.native_factor(name) for name in spread.values])
    values = {
        name: value * factor
        for (name, value), factor in zip(spread.values.items(), factors.tolist(), strict=True)
    }
    covariance = spread.covariance * np.outer(factors, factors)
    return replace(spread, values=values, covariance=covariance)


def _is_square(rows: Any, size: int) -> bool:
    """Return whether `rows` is a list of `size` lists of `size` finite numbers."""
    if not isinstance(rows, list) or len(rows) != size:
        return False
    return all(
        isinstance(row, list) and len(row) == size and all(map(is_finite, row)) for row in rows
    )


def is_covariance(matrix: np.ndarray) -> bool:
    """Return whether a matrix (n, n) can be a covariance: symmetric, no negative eigenvalue."""
    # The correlations are examined, because parameters of different units differ in size.
    variances = np.diag(matrix)
    sizes = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    with np.errstate(over="ignore"):
        correlations = matrix / sizes[:, None] / sizes
    if not np.isfinite(correlations).all():
        return False
    if np.abs(correlations - correlations.T).max(initial=0.0) > _ROUNDING:
        return False
    return bool((variances >= 0.0).all() and np.linalg.eigvalsh(correlations).min() >= -_ROUNDING)
