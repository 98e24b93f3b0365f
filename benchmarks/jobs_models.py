"""Start-up, trims, linear models and games, compared with python-control and SciPy."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from math import asin, atan2, cos, sin, sqrt
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import hfa
from benchmarks.report import Limit, Row, in_turn, shortest
from controller.game.zero_sum import Game
from hfa.paper import default_parameters
from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model
from hfa_model import LINEAR_STATES, STATES, Parameters
from hfa_model.atmosphere import density
from hfa_model.choice import aircraft
from hfa_support.native.bound import BoundFunction
from trim.hfa.level_flight import level_flight
from trim.point.condition import TrimCondition, usual_condition
from trim.point.linearize import linearize
from trim.point.solve import level_model, trim
from trim.point.system import TrimSystem
from trim.sweeps.mode_tracking import track_modes
from trim.sweeps.points import TRIMMED, trim_points

# python-control counts imposed states as constraints and warns of too many.
warnings.filterwarnings("ignore", "number of constraints", UserWarning)

_STATE = np.array([68.0, np.radians(2.8), np.radians(2.8), 0.0, 0.0, 0.0])


def _start(quick: bool) -> list[Row]:
    """Return comparisons of commands, in new processes, with `import control`."""
    repeats = 1 if quick else 5
    environment = dict(os.environ)
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    of_one_thread = {**environment, "OPENBLAS_NUM_THREADS": "1"}
    hfa = str(Path(sys.executable).with_name("hfa"))
    peer = (sys.executable, "-c", "import control")
    run = partial(subprocess.run, check=True, stdout=subprocess.DEVNULL, env=environment)
    rows = []
    gain = Path(tempfile.mkdtemp()) / "K.npz"
    run((hfa, "solve", "--dihedral", "15", "-o", str(gain)))
    for words, least, target in (
        (("trim", "--dihedral", "15"), "import casadi", 6.0),
        (("linearize", "--dihedral", "15"), "import casadi", 1.0),
        (("verify", "--dihedral", "15", "--weights", str(gain)), "import casadi", 1.0),
        (("--help",), "pass", 1.0),
    ):
        shortest_run = partial(run, (sys.executable, "-c", least), env=of_one_thread)
        seconds = shortest(shortest_run, repeats=repeats)
        rows.append(
            Row(
                f"`hfa {' '.join(words).replace(str(gain), gain.name)}`, new process",
                '`python -c "import control"`',
                in_turn(partial(run, (hfa, *words)), partial(run, peer), repeats=repeats),
                target,
                limit=Limit(seconds, f'`python -c "{least}"`'),
            )
        )
    return rows


def _one_game(quick: bool) -> list[Row]:
    """Return comparisons of `hfa.solve` with the ordered Schur form of the same equation."""
    rows = []
    for states, goal in ((6, 25),) if quick else ((6, 25), (24, 20), (48, 15), (96, 15)):
        games = [game_of(states, seed) for seed in range(2 if quick else 960 // states)]
        timing = in_turn(
            partial(_each, hfa.solve, games),
            partial(_each, schur_value, games),
            len(games),
            len(games),
            repeats=1 if quick else 5,
        )
        job = f"`hfa.solve` of a game of {states} states: certificate, cost, L2 gain"
        peer = "the bare equation by SciPy's ordered Schur form, no certificate"
        rows.append(Row(job, peer, timing, 1.0 / goal))
    return rows


def game_of(states: int, seed: int) -> Game:
    """Return a random game with one input for every four states, E = I and delta 50."""
    random = np.random.default_rng(seed)
    inputs = max(1, states // 4)
    A = random.standard_normal((states, states)) / sqrt(states)
    B = random.standard_normal((states, inputs))
    return Game(A, B, Q=np.eye(states), R=np.eye(inputs), delta=50.0)


def _each(function: Callable[[Game], Any], games: Sequence[Game]) -> None:
    for game in games:
        function(game)


def schur_value(game: Game) -> np.ndarray:
    """Return the value matrix P (n, n) of a game with R = I from SciPy's ordered Schur form."""
    from scipy.linalg import schur

    n = len(game.A)
    H = np.block([[game.A, -game.S], [-game.Q, -game.A.T]])
    _, basis, _ = schur(H, sort="lhp")
    return np.linalg.solve(basis[:n, :n].T, basis[n:, :n].T)


def six_state_rates(p: Parameters, altitude: float) -> Callable[..., np.ndarray]:
    """Return the rates of the published dynamics as a function (t, x (6,), u (5,), params) -> x'
    (6,).

    The function is plain Python, as a user of python-control would write it. A test compares the
    function with the project's model.

    p: parameters of the aircraft
    altitude: ft, at which the air density is evaluated
    """
    rho = float(density(altitude))
    area = p.panel_span * p.chord
    span = p.panel_span
    mass = p.panel_mass
    gravity = p.gravity
    total = 3 * mass
    c1 = 3 * p.inertia_pitch
    c2 = 2 * p.inertia_yaw - 2 * p.inertia_pitch + mass * span**2 / 6

    def panel(
        forward: float,
        sideward: float,
        downward: float,
        speed: float,
        aileron: float,
        elevator: float,
    ) -> tuple[float, ...]:
        local = sqrt(forward**2 + sideward**2 + downward**2)
        alpha = atan2(downward, forward)
        beta = asin(sideward / local)
        q = rho * local**2 / 2
        coefficient = p.lift_slope * alpha + p.aileron_lift * aileron
        tail = q * p.tail_area * p.lift_slope * (alpha + elevator)
        lift = q * area * coefficient + tail
        drag = rho * speed**2 / 2 * area * (p.zero_lift_drag + p.induced_drag * coefficient**2)
        moment = q * p.chord * area * (p.zero_lift_moment + p.aileron_moment * aileron)
        along = drag * cos(beta)
        X = lift * sin(alpha) - along * cos(alpha)
        Y = -drag * sin(beta)
        Z = -lift * cos(alpha) - along * sin(alpha)
        return X, Y, Z, -tail * cos(alpha), moment

    def rates(t: float, x: np.ndarray, u: np.ndarray, params: dict[str, Any]) -> np.ndarray:
        V, a, theta, q, eta, eta_rate = x.tolist()
        throttle, aileron_c, aileron_o, elevator_c, elevator_o = u.tolist()
        sa = sin(a)
        ca = cos(a)
        se = sin(eta)
        ce = cos(eta)
        hinge = V * sa + span / 3 * ce * eta_rate
        Xc, _, Zc, Tc, Mc = panel(V * ca + q * span / 3 * se, 0.0, hinge, V, aileron_c, elevator_c)
        normal = hinge * ce - span / 2 * eta_rate
        Xo, Yo, Zo, To, Mo = panel(
            V * ca - q * span / 6 * se, hinge * se, normal, V, aileron_o, elevator_o
        )
        X = Xc + 2 * Xo
        Z = Zc + 2 * (Zo * ce + Yo * se)
        D = -(X * ca + Z * sa)
        L = X * sa - Z * ca
        M = Mc + 2 * Mo + p.boom_length * (Tc + 2 * ce * To) + span / 3 * se * Xc
        M -= 2 * (span / 2 - span / 3 * se) * Xo
        H = -span / 2 * (Zo + mass * gravity * ce * cos(theta))
        T = p.thrust_per_throttle * throttle
        gamma = theta - a
        V_rate = (T * ca - D) / total - gravity * sin(gamma)
        a_rate = -(T * sa + L) / (total * V) + q + gravity * cos(gamma) / V
        q_rate = (M - 2 * c2 * se * ce * eta_rate * q) / (c1 + c2 * se**2)
        half = mass * span / 2
        inertial = half * ce * (V_rate * sa + V * ca * a_rate)
        coupling = half * (
            ce * V * ca * q - V * sa * se * eta_rate - 2 * span / 3 * ce * se * eta_rate**2
        )
        d2 = (p.inertia_pitch - p.inertia_yaw - mass * span**2 / 12) * se * ce * q**2
        d3 = p.inertia_roll + mass * span**2 / 4 + mass * span**2 / 6 * cos(eta**2)
        elastic = -p.hinge_damping * eta_rate - p.hinge_stiffness * eta
        return np.array(
            [V_rate, a_rate, q, q_rate, eta_rate, (H + elastic + inertial + coupling - d2) / d3]
        )

    return rates


def peer_system() -> Any:
    """Return the published dynamics as a python-control system."""
    import control

    rates = six_state_rates(default_parameters().values, 40_000.0)
    return control.nlsys(rates, None, inputs=5, states=6, outputs=6)


def peer_point(system: Any, dihedral: float) -> tuple[Any, Any]:
    """Return the operating point and linear model at a dihedral angle, found with python-control.

    Levenberg-Marquardt finds the four free inputs.

    dihedral: rad
    """
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


def evaluations(
    model: Model,
    variables: tuple[str, ...],
    values: np.ndarray,
    condition: TrimCondition | None,
) -> Limit:
    """Return the least time of a trim with its linear model, as a limit for a sweep.

    The time is that of two evaluations: the equations with their Jacobian for a step of Newton's
    method, and A and B.

    model: model of the aircraft
    variables: names of the variables of the sweep
    values: values of the variables, (points, variables)
    condition: trim condition, or None for the usual one
    """
    condition = usual_condition(model) if condition is None else condition
    system = TrimSystem(model, condition.freed_for(variables), variables)
    columns = dict(zip(variables, values.T, strict=True))
    c = system.constants(len(values), columns)
    z = np.tile(system.start, (len(values), 1))
    parts = (system.equations.residual_rows, system.equations.linear_rows)
    seconds = sum(shortest(partial(each, z, c), len(values), repeats=3) for each in parts)
    return Limit(seconds, "two evaluations of the derivatives")


def _trim(quick: bool) -> list[Row]:
    """Return the comparison with python-control of one trim and its linear model."""
    flexible = aircraft()
    system = peer_system()

    condition = level_flight(np.radians(10.0))

    def ours() -> None:
        for _ in range(100):
            linearize(flexible, trim(flexible, condition))

    def peer() -> None:
        for _ in range(20):
            peer_point(system, np.radians(10.0))

    timing = in_turn(ours, peer, units=100, peer_units=20, repeats=1 if quick else 7)
    exact = level_model(flexible, np.radians(10.0))
    _, model = peer_point(system, np.radians(10.0))
    error = max(np.abs(model.A - exact.A).max(), np.abs(model.B - exact.B).max())
    angle = np.radians(np.full((1, 1), 10.0))
    return [
        Row(
            "one trim and its exact A, B, from Python",
            "python-control find_operating_point (lm) + linearize",
            timing,
            4.0,
            f"largest error of the peer's entries {error:.1e}, of ours rounding",
            limit=evaluations(flexible, ("dihedral",), angle, None),
        )
    ]


def _angles(quick: bool) -> list[Row]:
    """Return comparisons of trims and linear models of the HFA at many dihedral angles."""
    count, peer_count = _counts(quick)
    flexible = aircraft()
    system = peer_system()
    angles = np.radians(np.linspace(0.0, 20.0, count))

    def ours(modes: bool = False) -> None:
        flights = trim_points(flexible, ("dihedral",), angles[:, None])
        assert (flights.status == TRIMMED).all()
        if modes:
            rows = [STATES.index(name) for name in LINEAR_STATES]
            track_modes(flights.A[:, rows][:, :, rows], LINEAR_STATES, flexible)

    def peer() -> None:
        for angle in angles[:: count // peer_count]:
            peer_point(system, angle)

    job = f"{count} dihedral angles"
    name = "python-control, point by point"
    units = (count, peer_count)
    limit = evaluations(flexible, ("dihedral",), angles[:, None], None)
    alone = Row(job, name, in_turn(ours, peer, *units), 60.0, limit=limit)
    job += " with tracked modes, every residual and limit checked"
    timing = in_turn(partial(ours, modes=True), peer, *units, repeats=3)
    limit = _with_modes(flexible, angles, limit)
    return [alone, Row(job, f"{name} (trim, A, B only)", timing, 20.0, limit=limit)]


def _with_modes(flexible: Model, angles: np.ndarray, limit: Limit) -> Limit:
    """Return the least time of trims, linear models and modes, at many dihedral angles."""
    kept = [STATES.index(name) for name in LINEAR_STATES]
    A = trim_points(flexible, ("dihedral",), angles[:, None]).A[:, kept][:, :, kept]
    seconds = shortest(partial(np.linalg.eig, A), len(A), repeats=3)
    return Limit(limit.seconds + seconds, f"{limit.what} and the eigenvectors")


#: Imposed in straight flight. Five unknowns remain of the 12 in a turn: angle of attack, pitch,
#: power, throttle and elevator.
_AHEAD = ("beta", "roll", "roll_rate", "pitch_rate", "yaw_rate", "aileron", "rudder")


def f16_case(turning: bool) -> tuple[TrimCondition, str, float, float]:
    """Return the trim condition of the F-16, the varied variable, and its lowest and highest value.

    turning: True for turn rates from 0 to 0.2 rad/s, False for speeds from 300 to 700 ft/s
    """
    model = load_model(f"{Path(__file__).parents[1] / 'examples' / 'f16.py'}:F16")
    usual = usual_condition(model)
    if turning:
        return usual, "turn_rate", 0.0, 0.2
    imposed = {
        name: value
        for name, value in usual.imposed.items()
        if name in model.variables or name == "gamma"
    }
    steady = dict.fromkeys(("speed", "alpha", "pitch_rate", "power"), 0.0)
    return (
        TrimCondition(model, imposed | dict.fromkeys(_AHEAD, 0.0), steady),
        "speed",
        300.0,
        700.0,
    )


def f16_peer(condition: TrimCondition) -> Callable[[str, Sequence[float]], list[Any]]:
    """Return a function that trims and linearizes an aircraft with python-control.

    The function (name, values of this variable) returns (operating point, linear model) at each
    value. Each search starts from the preceding operating point. The equations are compiled by
    CasADi.

    condition: trim condition of the aircraft
    """
    import control

    model = condition.model
    imposed_outputs = [name for name in condition.imposed if name in model.outputs]
    bound = []
    for outputs in ((), tuple(imposed_outputs)):
        vectors = model.layout.symbols("x", "u", "p")
        parts = model.layout.expressions([ca.vertsplit(each) for each in vectors], outputs)
        bound.append(BoundFunction(ca.Function("peer", vectors, [parts[len(outputs) > 0]])))
        bound[-1].inputs[2][:] = model.p

    def called(function: BoundFunction) -> Callable[..., np.ndarray]:
        def at(t: float, x: np.ndarray, u: np.ndarray, params: Any) -> np.ndarray:
            function.inputs[0][:] = x
            function.inputs[1][:] = u
            function()
            return function.results[0].copy()

        return at

    system = control.nlsys(
        *map(called, bound),
        states=len(model.states),
        inputs=len(model.inputs),
        outputs=len(imposed_outputs),
    )
    states = list(model.states)
    inputs = list(model.inputs)
    first = trim(model, condition)

    def points(varied: str, values: Sequence[float]) -> list[Any]:
        x = np.array(first.states)
        u = np.array(first.inputs)
        models = []
        for value in values:
            imposed = {**condition.imposed, varied: value}
            if varied in states:
                x[states.index(varied)] = value
            point = control.find_operating_point(
                system,
                x,
                u,
                [imposed[name] for name in imposed_outputs],
                state_indices=[states.index(name) for name in imposed if name in states],
                input_indices=[inputs.index(name) for name in imposed if name in inputs],
                deriv_indices=[states.index(name) for name in states if name in condition.rates],
            )
            x = np.array(point.states)
            u = np.array(point.inputs)
            models.append((point, control.linearize(system, x, u)))
        return models

    return points


def _f16(quick: bool) -> list[Row]:
    """Return comparisons of trims of the F-16: straight flight and a turn."""
    return [row for turning in (False, True) for row in _f16_flights(turning, *_counts(quick))]


def _counts(quick: bool) -> tuple[int, int]:
    """Return the number of points of a sweep for the project, and the number for the peer."""
    return (500, 2) if quick else (10_000, 100)


def _f16_flights(turning: bool, count: int, peer_count: int) -> list[Row]:
    condition, name, low, high = f16_case(turning)
    values = np.linspace(low, high, count)
    peer = f16_peer(condition)

    def ours() -> None:
        points = trim_points(condition.model, (name,), values[:, None], condition)
        assert (points.status == TRIMMED).all()

    job = f"{count} points of an F-16 with {len(condition.free)} unknowns"
    by = "python-control (hybr, from the neighbour) + linearize"
    every = values[:: count // peer_count].tolist()
    timing = in_turn(ours, partial(peer, name, every), count, peer_count)
    limit = evaluations(condition.model, (name,), values[:, None], condition)
    return [Row(job, by, timing, 12.0 if turning else 30.0, limit=limit)]


JOBS = {
    "start": _start,
    "trim": _trim,
    "angles": _angles,
    "f16": _f16,
    "one_game": _one_game,
}
