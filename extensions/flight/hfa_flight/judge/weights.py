"""Weights Q and R of the cost of a deployed policy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from controller.game.linear_game import default_weight
from hfa_aircraft.model import Model
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.equilibrium import Equilibrium
from hfa_support.errors import BadInputError, numbers_in, prefix_errors
from trim.point.operating_point import OperatingPoint


def has_weights(deployed: Deployed) -> bool:
    """Return whether the deployment file or the plant file contains the weights Q and R."""
    about = deployed.model.about
    is_of_file = about.weights_source == "file" and {"Q", "R"} <= set(about.weights)
    return deployed.deployment.cost is not None or is_of_file


def refuse_cross_weights(model: Model) -> None:
    """Raise BadInputError if a plant file contains cross weights N."""
    if np.any(numbers_in("N", model.about.weights.get("N", 0.0))):
        raise BadInputError(
            f"{model.name} has cross weights N, which are not supported; remove N, or give a "
            "deployment file with Q and R in [cost]"
        )


def cost_weights(deployed: Deployed) -> tuple[Mapping[str, float], Mapping[str, float]]:
    """Return Q of states and outputs, and R of inputs, by name, as given in the deployment file.

    Without a cost, the weights of the linear states and the commanded inputs are those of the model
    (`default_weight`).

    Raises BadInputError if a matrix Q or R of a model from a plant file is not diagonal.
    """
    cost = deployed.deployment.cost
    if cost is not None:
        return cost["Q"], cost["R"]
    model = deployed.model
    refuse_cross_weights(model)
    R = usual_weights("R", model)
    return usual_weights("Q", model), {name: R[name] for name in deployed.commanded}


def usual_weights(matrix: str, model: Model) -> dict[str, float]:
    """Return the diagonal of the default weight "Q" or "R" (`default_weight`), by name.

    Raises BadInputError if the matrix in a plant file is not diagonal.
    """
    names = tuple(model.linear if matrix == "Q" else model.inputs)
    weight = default_weight(matrix, model, model.linear, tuple(model.inputs))
    with prefix_errors(model.name):
        return diagonal_weights(matrix, weight, names)


def diagonal_weights(matrix: str, given: Any, names: Sequence[str]) -> dict[str, float]:
    """Return name -> weight of a diagonal matrix (k, k), or of its diagonal (k,).

    Raises BadInputError if the matrix is not diagonal.
    """
    weights = numbers_in(matrix, given)
    diagonal = np.diagonal(weights) if weights.ndim == 2 else weights
    if diagonal.shape != (len(names),) or np.count_nonzero(weights) > np.count_nonzero(diagonal):
        raise BadInputError(
            f"{matrix} is not a diagonal matrix of {len(names)} weights; give one weight for each "
            f"of {', '.join(names)}"
        )
    return dict(zip(names, diagonal.tolist(), strict=True))


def weights_at(
    deployed: Deployed, place: Equilibrium | OperatingPoint
) -> tuple[np.ndarray, np.ndarray]:
    """Return Q (k, k) of the linear states and R (m', m') of the commanded inputs.

    The weights are those of the deployment file; an output with the weight q and the slopes c
    contributes q c c' to Q. Without them, they are the default weights of the model.

    Raises BadInputError for an output that depends on the inputs, and for cross weights.

    place: point at which the outputs are linearized
    """
    model, linear = deployed.model, deployed.model.linear
    if deployed.deployment.cost is None:
        refuse_cross_weights(model)
        usual = partial(default_weight, model=model, states=linear, inputs=deployed.commanded)
        return usual("Q"), usual("R")
    of_states, of_inputs = cost_weights(deployed)
    outputs = tuple(name for name in of_states if name not in linear)
    slopes = deployed.model.at(place.states, place.inputs, outputs)
    if np.any(slopes.D):
        wrong = [name for name, row in zip(outputs, slopes.D, strict=True) if row.any()]
        raise BadInputError(
            f"cost.Q.{wrong[0]} weights an output that depends directly on the inputs, which is "
            "not supported; give weights of states instead"
        )
    rows = deployed.model.state_places(linear)
    Q = np.diag([float(of_states.get(name, 0.0)) for name in linear])
    for name, row in zip(outputs, slopes.C[:, rows], strict=True):
        Q += float(of_states[name]) * np.outer(row, row)
    R = np.diag([float(of_inputs[name]) for name in deployed.commanded])
    return Q, R


def offset_rate(deployed: Deployed, point: OperatingPoint, equilibrium: Equilibrium) -> float:
    """Return the cost per second at an equilibrium, z'Qz + v'Rv in deviations from the trim."""
    Q, R = weights_at(deployed, point)
    model = point.model
    rows, columns = model.state_places(model.linear), model.input_places(deployed.commanded)
    z = (equilibrium.states - point.x)[rows]
    v = (equilibrium.inputs - point.u)[columns]
    return float(z @ Q @ z + v @ R @ v)


def cost_rate(deployed: Deployed) -> ca.Function:
    """Return the CasADi Function (X, U, trim) -> x'Q x + u'R u, the cost rate of an episode.

    x are the deviations of states and outputs from the trim, and u those of the inputs. Q and R are
    the weights from `cost_weights`.
    """
    Q, R = cost_weights(deployed)
    X, U, trim = deployed.symbols()
    here = deployed.values(X, U, trim)
    there = deployed.at_trim(trim)
    terms = [weight * (here[name] - there[name]) ** 2 for name, weight in {**Q, **R}.items()]
    return ca.Function("cost_rate", [X, U, trim], [ca.densify(ca.SX(sum(terms)))])
