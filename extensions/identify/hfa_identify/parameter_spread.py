"""Normally distributed uncertain parameters of an aircraft."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hfa_aircraft.model import Model


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
        center = np.array(list(self.values.values()))
        sizes = center if self.of_logarithms else np.sqrt(np.diag(self.covariance))
        sizes = np.where(sizes == 0.0, 1.0, sizes)  # of a parameter that is known exactly
        variances, axes = np.linalg.eigh(self.covariance / np.outer(sizes, sizes))
        # The symmetric square root does not depend on the signs and the order of the eigenvectors.
        root = axes * np.sqrt(np.maximum(variances, 0.0)) @ axes.T
        z = np.random.default_rng(seed).standard_normal((count, len(center))) @ root
        return np.asarray(center * np.exp(z) if self.of_logarithms else center + sizes * z)

    def aircraft(self, model: Model, count: int, seed: int) -> list[Model]:
        """Return `count` models with random parameters, clipped to the limits of the model."""
        signals = [model.parameters[name] for name in self.values]
        ends = np.array([(signal.min, signal.max) for signal in signals]).T
        rows = np.clip(self.draws(count, seed), *ends).tolist()
        return [model.with_parameters(**dict(zip(self.values, row, strict=True))) for row in rows]
