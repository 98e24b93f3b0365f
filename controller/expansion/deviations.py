"""Smooth equations of an aircraft in deviations from its trim: z' = F(z, u), F(0, 0) = 0."""

from __future__ import annotations

import casadi as ca
import numpy as np

from controller.game.zero_sum import Game
from hfa_aircraft.layout import components
from hfa_support.errors import BadInputError
from trim.linear.linear_model import LinearModel
from trim.linear.nonsmooth import near_switches, rates_of

#: Largest difference between A or B of the game and of the aircraft, relative to the largest entry
#: of its row and column.
SAME = 1e-8
#: Largest rate at a trim, relative to the scale of the rate: the accuracy of saved points.
STEADY = 1e-6


def deviation_rates(linear: LinearModel, game: Game) -> ca.Function:
    """Return the CasADi Function (z, u) -> F(z, u), the rates of the deviations, (n,).

    The states and inputs that the linear model omits stay at the trim. The rates at the trim are
    subtracted: F(0, 0) = 0.

    linear: linear model at the trim
    game: game on this linear model

    Raises BadInputError if the equations contain tables, have a switch at the trim, have other
    derivatives than A and B of the game, if a rate is not 0 at the operating point, or if the game
    is in discrete time.
    """
    game.refuse_steps("the nonlinear game")
    model = linear.model
    refuse_kinks(linear)
    rates = rates_about_trim(linear)
    at_trim = rates(0, 0)
    for name, rate in zip(linear.states, np.array(at_trim)[:, 0].tolist(), strict=True):
        if not abs(rate) <= STEADY * model.rate_scale(name):
            raise BadInputError(
                f"{model.title}: the rate of {name} is {rate:.3g} at the operating point; give a "
                "trim at which the states of the linear model are constant"
            )
    z, u = rates.sx_in()
    from_trim = ca.Function("rates", [z, u], [ca.densify(rates(z, u) - at_trim)])
    _refuse_other_plant(from_trim, game, model.title)
    return from_trim


def rates_about_trim(linear: LinearModel) -> ca.Function:
    """Return the CasADi Function (z, u) -> z', (n,), of the deviations from the trim.

    The states and inputs that the linear model omits stay at the trim.
    """
    point = linear.point
    model = linear.model
    z = ca.SX.sym("z", len(linear.states))
    u = ca.SX.sym("u", len(linear.inputs))
    deviations = dict(zip(linear.states, components(z), strict=True))
    deviations |= zip(linear.inputs, components(u), strict=True)
    states = [value + deviations.get(name, 0.0) for name, value in point.states._asdict().items()]
    inputs = [value + deviations.get(name, 0.0) for name, value in point.inputs._asdict().items()]
    rates, _ = model.layout.expressions((states, inputs, model.p.tolist()), ())
    return ca.Function("plant", [z, u], [rates[model.state_places(linear.states)]])


def refuse_kinks(linear: LinearModel) -> None:
    """Raise BadInputError if the equations call tables, or if one of their switches is at the trim.

    linear: linear model at the trim
    """
    model = linear.model
    rates = rates_of(model.layout)
    operations = {rates.instruction_id(k) for k in range(rates.n_instructions())}
    if ca.OP_CALL in operations:
        raise BadInputError(
            f"{model.title}: the equations call a table or another function, which has no power "
            "series; use an aircraft with smooth equations, or leave out the order"
        )
    near, columns = near_switches(model, linear.point.x[None], linear.point.u[None], model.p[None])
    if near.size:
        names = [(*model.states, *model.inputs)[column] for column in columns]
        raise BadInputError(
            f"{model.title}: |.|, min, max or a comparison of {', '.join(names)} switches at the "
            "trim, where the value has no power series; choose another trim, or leave out the order"
        )


def _refuse_other_plant(rates: ca.Function, game: Game, title: str) -> None:
    """Raise BadInputError unless A and B of the game are the derivatives of F at the trim."""
    z, u = rates.sx_in()
    f = rates(z, u)
    jacobians = ca.Function("AB", [z, u], [ca.jacobian(f, z), ca.jacobian(f, u)])(0, 0)
    for name, of_game, jacobian in zip("AB", (game.A, game.B), jacobians, strict=True):
        exact = np.array(ca.densify(jacobian))
        if not np.isfinite(exact).all():
            raise BadInputError(f"{title}: {name} is not finite at the trim")
        if of_game.shape != exact.shape or not _are_same(of_game, exact):
            raise BadInputError(
                f"{title}: {name} of the game is not the linear model at this trim; give the "
                "linear model of which the game was made"
            )


def _are_same(given: np.ndarray, exact: np.ndarray) -> bool:
    """Return whether two matrices agree up to `SAME`, in any units of rows and columns."""
    sizes = np.abs(exact)
    scales = np.minimum(sizes.max(axis=1)[:, None], sizes.max(axis=0)[None, :])
    return bool(np.all(np.abs(given - exact) <= SAME * scales))
