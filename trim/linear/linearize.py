"""Exact linearization at an operating point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hfa_aircraft.model import Model
from trim.linear.linear_model import LinearModel
from trim.linear.nonsmooth import linearization_at
from trim.linear.reduction import positions, reduction_note
from trim.point.condition import usual_condition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import trim


def linearize(
    model: Model,
    point: OperatingPoint,
    *,
    full: bool = False,
    states: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
    outputs: tuple[str, ...] | None = None,
    disturbances: tuple[str, ...] | None = None,
) -> LinearModel:
    """Return the linear model at an operating point, exact to rounding.

    A = ∂f/∂X, B = ∂f/∂U, C = ∂y/∂X, D = ∂y/∂U, E = ∂f/∂w, F = ∂y/∂w at (X0, U0) and w = 0.

    The derivatives are computed by algorithmic differentiation. At a nonsmooth point the mean
    of the slopes on both sides is used (`LinearModel.nonsmooth_points`).

    model: model of the aircraft
    point: operating point of the model
    full: whether all states are kept; by default only the model's linear states, for the flexible
        aircraft the paper's six (Section 2.2)
    states, inputs: as in `LinearModel.select`, of all states of the model; a note names the states
        that are then omitted (`LinearModel.reduction`)
    outputs: names of outputs or states; by default the states of the linear model
    disturbances: names; by default the first disturbance if `outputs` are given, otherwise none

    Raises BadInputError if the point belongs to another model, or a name is unknown. Raises
    NotFiniteError if a derivative is not finite.

    >>> import hfa
    >>> point = hfa.trim(hfa.aircraft(), hfa.paper.level_flight(0.2))
    >>> hfa.linearize(hfa.aircraft(), point).A.shape
    (6, 6)
    """
    point._refuse_other_model(model)
    if states or inputs:
        positions("state", states or (), tuple(model.states))  # raises for an unknown name
        # The linear model of all states is reduced to the chosen ones.
        kept = states or model.linear
        shown = outputs or tuple(kept)
        whole = linearize(model, point, full=True, outputs=shown, disturbances=disturbances or ())
        linear = whole.select(kept, inputs)
        declared = whole.select(model.linear)  # the default, with which the note compares
        note = reduction_note(linear.matrices, declared.matrices)
        return replace(linear, reduction=note)
    every_state = tuple(model.states)
    states = every_state if full else model.linear
    rows = np.array(model.state_places(states))
    shown = tuple(outputs or states)
    if outputs:  # `positions` raises for an unknown name
        positions("output", shown, (*every_state, *model.outputs))
    if disturbances is None:
        disturbances = () if outputs is None else tuple(model.disturbances)[:1]
    else:
        positions("disturbance", disturbances, tuple(model.disturbances))
    slopes, nonsmooth_points = linearization_at(
        model, point.states, point.inputs, shown, disturbances
    )
    return LinearModel(
        A=slopes.A.take(rows, axis=0).take(rows, axis=1),
        B=slopes.B.take(rows, axis=0),
        states=states,
        inputs=tuple(model.inputs),
        point=point,
        outputs=shown,
        C=slopes.C.take(rows, axis=1),
        D=slopes.D,
        E=slopes.E.take(rows, axis=0),
        F=slopes.F,
        output_offsets=slopes.y,
        disturbances=tuple(disturbances),
        nonsmooth_points=nonsmooth_points,
    )


def direct_disturbances(point: OperatingPoint, kept: Sequence[str]) -> tuple[str, ...]:
    """Return the disturbances of a model, or none if one acts on the kept states through lags that
    the model's linear states omit: a linear model has no column for this effect.

    Lags are omitted states that a trim balances, other than an altitude.

    kept: names of the states of the linear model
    """
    model = point.model
    disturbances = tuple(model.disturbances)
    lags = [name for name in model.steady if name not in (*model.linear, *kept)]
    if not lags or not disturbances:
        return disturbances
    whole = linearize(model, point, full=True, disturbances=disturbances)
    is_kept, is_lag = np.isin(whole.states, kept), np.isin(whole.states, lags)
    acts_on_kept = np.any(whole.A[np.ix_(is_kept, is_lag)], axis=0)  # of each lag
    is_disturbed = np.any(whole.E[is_lag], axis=1)
    return () if (acts_on_kept & is_disturbed).any() else disturbances


def level_model(model: Model, scheduled: float) -> LinearModel:
    """Return the linear model of an aircraft at the trim that its model declares.

    For the flexible aircraft, this trim is the paper's level flight.

    model: model of the aircraft
    scheduled: value of the scheduling variable; for the flexible aircraft the dihedral angle, rad

    Raises TrimError if the trim does not exist.

    >>> import hfa
    >>> hfa.paper.level_model(hfa.aircraft(), 0.2).states
    ('speed', 'alpha', 'pitch', 'pitch_rate', 'dihedral', 'dihedral_rate')
    """
    condition = usual_condition(model).at(hold={model.schedule: scheduled})
    return linearize(model, trim(model, condition))
