"""Start-up, trims, linear models and games: against python-control, an optimizer and SciPy."""

from __future__ import annotations

import subprocess
import sys
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.numpy_dynamics import six_state_rates
from benchmarks.report import Row, in_turn
from controller.game.zero_sum import published_game
from controller.riccati.gare_batch import solve_games
from hfa_model import LINEAR_STATES, STATES, Aircraft, default_parameters
from hfa_support.model import load_model
from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import c_compiler
from trim.linear.linear_model import level_model
from trim.linear.modes import track_modes
from trim.point.condition import TrimCondition, usual_condition
from trim.point.solve import find_operating_point
from trim.sweeps.points import TRIMMED, trim_points

_STATE = np.array([68.0, np.radians(2.8), np.radians(2.8), 0.0, 0.0, 0.0])


def rows(quick: bool = False) -> list[Row]:
    """All figures of models."""
    angles, peer_angles = (500, 2) if quick else (10_000, 100)
    with warnings.catch_warnings():
        # python-control counts the states that it is told to hold as constraints, and warns of too many of them.
        warnings.filterwarnings("ignore", "number of constraints", UserWarning)
        trims = [_one_point(), *_many_points(angles, peer_angles), _optimizer(angles, peer_angles // 2)]
        trims += [row for turning in (False, True) for row in _f16(turning, angles, peer_angles)]
    return [*_startup(1 if quick else 11), *trims, _games(20 if quick else 1000)]


def _startup(repeats: int) -> list[Row]:
    """A trim, and the help, from nothing to the last line."""

    def run(*words: str) -> None:
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)

    hfa, peer = str(Path(sys.executable).with_name("hfa")), 'python -c "import control"'
    found = []
    for words in (("trim", "--dihedral", "15"), ("--help",)):
        timing = in_turn(
            lambda words=words: run(hfa, *words), lambda: run(sys.executable, "-c", "import control"), repeats=repeats
        )
        found.append(Row(f"`hfa {' '.join(words)}`, new process", f"`{peer}`", timing, 1.0))
    return found


def _games(count: int) -> Row:
    """Exact game solutions with certificates between 0 and 20 degrees, against SciPy's solver without one."""
    from scipy.linalg import block_diag, solve_continuous_are

    flights = trim_points(Aircraft(), ("dihedral",), np.radians(np.linspace(0.0, 20.0, count))[:, None])
    index = [STATES.index(name) for name in LINEAR_STATES]
    A, B = flights.A[:, index][:, :, index], flights.B[:, index]
    game = published_game(A[count // 2], B[count // 2])
    weights = block_diag(game.R, -(game.delta**2) * np.eye(6))

    def ours():
        assert solve_games(A, B, game).certified.all()

    def peer():
        for a, b in zip(A[::5], B[::5], strict=True):
            solve_continuous_are(a, np.hstack([b, game.E]), game.Q, weights)

    timing = in_turn(ours, peer, units=count, peer_units=count / 5)
    job = f"{count} game Riccati equations, certified"
    return Row(job, "SciPy solve_continuous_are, no certificate", timing, 0.4)


def peer_system():
    """The published dynamics as a python-control system."""
    import control

    rates = six_state_rates(default_parameters().values, 40_000.0)
    return control.nlsys(rates, None, inputs=5, states=6, outputs=6)


def peer_point(system, dihedral: float):
    """python-control: find the four free inputs by Levenberg-Marquardt, then linearize."""
    import control

    state = _STATE.copy()
    state[4] = dihedral
    point = control.find_operating_point(
        system,
        state,
        [40.0, 0.0, 0.03, 0.0, -0.05],
        state_indices=range(6),
        input_indices=[1],
        deriv_indices=[0, 1, 3, 5],
        root_method="lm",
    )
    return point, control.linearize(system, point.states, point.inputs)


def _one_point() -> Row:
    aircraft, system = Aircraft(), peer_system()

    def ours():
        for _ in range(100):
            trim_points(aircraft, ("dihedral",), np.array([[np.radians(10.0)]]))

    def peer():
        for _ in range(20):
            peer_point(system, np.radians(10.0))

    timing = in_turn(ours, peer, units=100, peer_units=20)
    exact = level_model(aircraft, np.radians(10.0))
    _, model = peer_point(system, np.radians(10.0))
    error = max(np.abs(model.A - exact.A).max(), np.abs(model.B - exact.B).max())
    return Row(
        "one trim and its exact A, B, from Python",
        "python-control find_operating_point (lm) + linearize",
        timing,
        10.0,
        f"largest error of the peer's entries {error:.1e}, of ours rounding",
    )


def _many_points(count: int, peer_count: int) -> list[Row]:
    aircraft, system = Aircraft(), peer_system()
    angles = np.radians(np.linspace(0.0, 20.0, count))

    def peer():
        for angle in angles[:: count // peer_count]:
            peer_point(system, angle)

    def full():
        flights = trim_points(aircraft, ("dihedral",), angles[:, None], compile_code=True)
        assert (flights.status == TRIMMED).all()
        rows = [STATES.index(name) for name in LINEAR_STATES]
        track_modes(flights.A[:, rows][:, :, rows], LINEAR_STATES)

    peer_name = "python-control, point by point"
    found = [
        Row(
            f"{count} dihedral angles, no compiler",
            peer_name,
            in_turn(
                lambda: trim_points(aircraft, ("dihedral",), angles[:, None], compile_code=False),
                peer,
                units=count,
                peer_units=peer_count,
            ),
            10.0,
        )
    ]
    if c_compiler() is not None:
        timing = in_turn(
            lambda: trim_points(aircraft, ("dihedral",), angles[:, None], compile_code=True),
            peer,
            units=count,
            peer_units=peer_count,
        )
        found.append(Row(f"{count} dihedral angles, generated C", peer_name, timing, 200.0))
    found.append(
        Row(
            f"{count} dihedral angles with tracked modes, every residual and limit checked",
            peer_name + " (trim, A, B only)",
            in_turn(full, peer, units=count, peer_units=peer_count, repeats=3),
            20.0,
        )
    )
    return found


#: Held by a flight straight ahead, which leaves 5 unknowns of the 12 of a turn: angle of attack, pitch, power,
#: throttle and elevator.
_AHEAD = ("beta", "roll", "roll_rate", "pitch_rate", "yaw_rate", "aileron", "rudder")


def f16_case(turning: bool) -> tuple[TrimCondition, str, float, float]:
    """The F-16's condition, what varies in it, and from where to where: the turn rate at 502 ft/s, or the speed."""
    model = load_model(f"{Path(__file__).parents[1] / 'examples' / 'f16.py'}:F16")
    usual = usual_condition(model)
    if turning:
        return usual, "turn_rate", 0.0, 0.2
    imposed = {name: value for name, value in usual.imposed.items() if name in model.variables or name == "gamma"}
    steady = dict.fromkeys(("speed", "alpha", "pitch_rate", "power"), 0.0)
    return TrimCondition(imposed | dict.fromkeys(_AHEAD, 0.0), steady, model=model), "speed", 300.0, 700.0


def f16_peer(condition: TrimCondition) -> Callable[[str, Sequence[float]], list[Any]]:
    """(name, its values) -> python-control's operating points and linear models, each started from the one before. Its
    system calls the equations compiled by CasADi."""
    import casadi as ca
    import control

    model, named = condition.model, [name for name in condition.imposed if name in condition.model.outputs]
    bound = []
    for outputs in ((), tuple(named)):
        vectors = model.layout.symbols("x", "u", "p")
        parts = model.layout.expressions([ca.vertsplit(each) for each in vectors], outputs)
        bound.append(BoundFunction(ca.Function("peer", vectors, [parts[len(outputs) > 0]])))
        bound[-1].inputs[2][:] = model.p

    def called(function: BoundFunction) -> Callable[..., np.ndarray]:
        def at(t: float, x: np.ndarray, u: np.ndarray, params: Any) -> np.ndarray:
            function.inputs[0][:], function.inputs[1][:] = x, u
            function()
            return function.results[0].copy()

        return at

    system = control.nlsys(*map(called, bound), states=len(model.states), inputs=len(model.inputs), outputs=len(named))
    states, inputs = list(model.states), list(model.inputs)
    first = find_operating_point(model, condition)

    def points(varied: str, values: Sequence[float]) -> list[Any]:
        x, u, found = np.array(first.states), np.array(first.inputs), []
        for value in values:
            imposed = {**condition.imposed, varied: value}
            if varied in states:
                x[states.index(varied)] = value
            point = control.find_operating_point(
                system,
                x,
                u,
                [imposed[name] for name in named],
                state_indices=[states.index(name) for name in imposed if name in states],
                input_indices=[inputs.index(name) for name in imposed if name in inputs],
                deriv_indices=[states.index(name) for name in condition.equations[0]],
            )
            x, u = np.array(point.states), np.array(point.inputs)
            found.append((point, control.linearize(system, x, u)))
        return found

    return points


def _f16(turning: bool, count: int, peer_count: int) -> list[Row]:
    """Straight ahead (5 unknowns) and in a turn (12)."""
    condition, name, low, high = f16_case(turning)
    values, peer = np.linspace(low, high, count), f16_peer(condition)

    def ours(compile_code: bool) -> None:
        found = trim_points(condition.model, (name,), values[:, None], condition, compile_code=compile_code)
        assert (found.status == TRIMMED).all()

    job = f"{count} points of an F-16 with {len(condition.free)} unknowns"
    found = []
    for compiled, target in ((False, 10.0), (True, 100.0 if turning else 300.0)):
        if compiled <= (c_compiler() is not None):
            timing = in_turn(
                partial(ours, compiled),
                lambda: peer(name, values[:: count // peer_count]),
                units=count,
                peer_units=peer_count,
            )
            how = "generated C" if compiled else "no compiler"
            found.append(Row(f"{job}, {how}", "python-control (hybr, from the neighbour) + linearize", timing, target))
    return found


def _optimizer(count: int, peer_count: int) -> Row:
    """CasADi's Opti with IPOPT, as optimization-based aircraft tools trim."""
    import casadi as ca

    aircraft = Aircraft()
    opti = ca.Opti()
    u, dihedral = opti.variable(4), opti.parameter()
    state = ca.vertcat(68.0, np.radians(2.8), 40_000.0, np.radians(2.8), 0.0, dihedral, 0.0)
    f = aircraft.model.functions(())(state, ca.vertcat(u[0], 0.0, u[1:]), aircraft.model.p)[0]
    opti.subject_to(f[[0, 1, 4, 6]] == 0)
    opti.minimize(0)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    angles = np.radians(np.linspace(0.0, 20.0, count))

    def peer():
        for angle in angles[:: count // peer_count]:
            opti.set_value(dihedral, angle)
            opti.set_initial(u, [40.0, 0.03, 0.0, -0.05])
            opti.solve()

    return Row(
        f"{count} dihedral angles, trim alone for the peer",
        "CasADi Opti + IPOPT, point by point",
        in_turn(
            lambda: trim_points(aircraft, ("dihedral",), angles[:, None], compile_code=True),
            peer,
            units=count,
            peer_units=peer_count,
        ),
        500.0,
    )
