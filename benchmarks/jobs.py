"""The timed jobs: name -> function of `quick`, which returns comparisons."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import math
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import count, islice
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

import hfa
from benchmarks.report import Comparison, in_turn
from hfa.main import main
from hfa.paper import level_flight, published_game
from hfa_support.native.bound import BoundFunction
from trim import usual_condition

# python-control counts imposed states as constraints and warns of too many.
warnings.filterwarnings("ignore", "number of constraints", UserWarning)

ROOT = Path(__file__).parents[1]
F16 = f"{ROOT}/examples/f16.py:F16"
HAS_JSBSIM = importlib.util.find_spec("jsbsim") is not None
CONTROL = "python-control find_operating_point + linearize, same compiled equations"
#: Variables that are 0 in a straight flight of the F-16: of the 12 unknowns in a turn, 5 remain.
_ZERO_AHEAD = ("beta", "roll", "roll_rate", "pitch_rate", "yaw_rate", "aileron", "rudder")


def start(quick: bool) -> list[Comparison]:
    """Return comparisons of commands, in new processes, with `import control`."""
    variables = {**os.environ}
    variables.pop("PYTHONDONTWRITEBYTECODE", None)  # a user's modules are compiled once
    run = partial(subprocess.run, check=True, stdout=subprocess.DEVNULL, env=variables)
    command = str(Path(sys.executable).with_name("hfa"))
    gain = Path(tempfile.mkdtemp()) / "K.npz"
    run((command, "solve", "--dihedral", "15", "-o", str(gain)))
    return [
        in_turn(
            f"`hfa {' '.join(words).replace(str(gain), gain.name)}`, new process",
            '`python -c "import control"`',
            1.0,
            partial(run, (command, *words)),
            partial(run, (sys.executable, "-c", "import control")),
            rounds=1 if quick else 5,
        )
        for words in (
            ("--help",),
            ("trim", "--dihedral", "15"),
            ("linearize", "--dihedral", "15"),
            ("verify", "--dihedral", "15", "--weights", str(gain)),
        )
    ]


class TrimmedPlant(NamedTuple):
    """States (n,) and inputs (m,) of a trim, and A (n, n) of its linear model."""

    states: np.ndarray
    inputs: np.ndarray
    A: np.ndarray

    @classmethod
    def of(cls, condition: hfa.TrimCondition) -> TrimmedPlant:
        """Return the trim at a condition with its linear model."""
        point = hfa.trim(condition.model, condition)
        A = hfa.linearize(condition.model, point).A
        return cls(np.array(point.states), np.array(point.inputs), A)


def usual(aircraft: str) -> hfa.TrimCondition:
    """Return the usual trim condition of an aircraft."""
    return usual_condition(hfa.load_model(aircraft))


def same_points(
    condition: hfa.TrimCondition, ours: Sequence[TrimmedPlant], theirs: Sequence[TrimmedPlant]
) -> None:
    """Assert that two lists contain the same trims.

    States and inputs agree to 1e-6 of their nominal values, and A, which python-control computes by
    finite differences, to 0.2 % of its largest entry in units of the nominal values. The column of
    the sideslip is left out: at 0 the 737 is not smooth, and differences see one side.

    condition: trim condition of the aircraft; A of `ours` has only the states of its linear models
    """
    model = condition.model
    sizes = model.nominal(model.states)
    input_sizes = model.nominal(model.inputs)
    names = hfa.linearize(model, hfa.trim(model, condition)).states
    places = [list(model.states).index(name) for name in names]
    units = sizes[places] / sizes[places][:, None]
    smooth = [name != "beta" for name in names]  # not the column of the sideslip
    close = partial(np.testing.assert_allclose, rtol=1e-6, atol=1e-6)
    for found, peer in zip(ours, theirs, strict=True):
        close(found.states / sizes, peer.states / sizes)
        close(found.inputs / input_sizes, peer.inputs / input_sizes)
        A, peer_A = found.A * units, peer.A[np.ix_(places, places)] * units
        close(A[:, smooth], peer_A[:, smooth], rtol=0.0, atol=2e-3 * abs(A).max())


def control_points(
    condition: hfa.TrimCondition,
) -> Callable[[str, Sequence[float]], list[TrimmedPlant]]:
    """Return a function that trims and linearizes an aircraft with python-control.

    The function (name, values of this variable) returns what is found at each value. Each search
    starts from the preceding operating point. CasADi evaluates the equations.

    condition: trim condition of the aircraft
    """
    import control

    model = condition.model
    states, inputs = list(model.states), list(model.inputs)
    imposed_outputs = [name for name in condition.imposed if name in model.outputs]
    unknowns = len(states) + len(inputs) + len(imposed_outputs) - len(condition.imposed)
    # Without as many equations as unknowns, python-control minimizes the residuals ("lm").
    is_square = unknowns == len(condition.rates) + len(imposed_outputs)
    first = hfa.trim(model, condition)
    system = control.nlsys(
        _evaluated(model, ()),
        _evaluated(model, tuple(imposed_outputs)),
        states=len(states),
        inputs=len(inputs),
        outputs=len(imposed_outputs),
    )

    def points(varied: str, values: Sequence[float]) -> list[TrimmedPlant]:
        """Return the trims with the variable `varied` imposed at each value, in this order."""
        x, u = np.array(first.states), np.array(first.inputs)
        trims = []
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
                root_method="hybr" if is_square else "lm",
            )
            x, u = np.array(point.states), np.array(point.inputs)
            trims.append(TrimmedPlant(x.copy(), u.copy(), control.linearize(system, x, u).A))
        return trims

    return points


def _evaluated(model: hfa.Model, outputs: tuple[str, ...]) -> Callable[..., np.ndarray]:
    """Return the rates of a model, or these outputs if any, as a function (t, x, u, params).

    python-control gives `params`, which is not used: the parameters are those of the model.
    """
    vectors = model.layout.symbols("x", "u", "p")
    rates, values = model.layout.expressions(vectors, outputs)
    function = BoundFunction(ca.Function("peer", vectors, [values if outputs else rates]))
    function.inputs[2][:] = model.p

    def at(t: float, x: np.ndarray, u: np.ndarray, params: Any) -> np.ndarray:
        function.inputs[0][:], function.inputs[1][:] = x, u
        function.evaluate()
        return function.results[0].copy()

    return at


def one_trim(quick: bool) -> list[Comparison]:
    """Return comparisons of one trim and its linear model of four aircraft with python-control."""
    # Aircraft, trim condition, variable that python-control is given, and required ratio of times.
    cases = [
        ("the HFA", level_flight(np.radians(10.0)), "dihedral", 3.0),
        ("an F-16", usual(F16), "turn_rate", 1.0),
        ("a table of derivatives", usual(f"{ROOT}/examples/uav.toml"), "speed", 1.0),
    ]
    if HAS_JSBSIM:
        cases.append(("the 737 of JSBSim", usual("jsbsim:737"), "speed", 1.0))
    return [_one_trim(quick, *case) for case in cases]


def _one_trim(
    quick: bool, aircraft: str, condition: hfa.TrimCondition, name: str, goal: float
) -> Comparison:
    """Return the comparison of one trim, at its imposed value of the variable `name`."""
    number = 20  # trims in each timed call

    def ours() -> list[TrimmedPlant]:
        return [TrimmedPlant.of(condition) for _ in range(number)]

    theirs = partial(control_points(condition), name, [condition.imposed[name]] * number)
    job = f"one trim of {aircraft} and its exact A, B, from Python"
    units, rounds = (float(number), float(number)), 1 if quick else 7
    return in_turn(job, CONTROL, goal, ours, theirs, units, rounds, partial(same_points, condition))


def sweeps(quick: bool) -> list[Comparison]:
    """Return comparisons of trims and linear models at many points with python-control."""
    turn = usual(F16)
    model = turn.model
    of_straight_flight = {
        name: value
        for name, value in turn.imposed.items()
        if name in model.variables or name == "gamma"
    }
    steady = dict.fromkeys(("speed", "alpha", "pitch_rate", "power"), 0.0)
    straight = hfa.TrimCondition(
        model, of_straight_flight | dict.fromkeys(_ZERO_AHEAD, 0.0), steady
    )
    degrees = np.pi / 180.0
    # Name of the points, trim condition, variable, its first and last value, required time ratio.
    cases = [
        ("dihedral angles of the HFA", level_flight(0.0), "dihedral", 0.0, 20.0 * degrees, 20.0),
        ("points of an F-16 with 5 unknowns", straight, "speed", 300.0, 700.0, 30.0),
        ("points of an F-16 with 12 unknowns", turn, "turn_rate", 0.0, 0.2, 12.0),
    ]
    if HAS_JSBSIM:
        boeing = usual("jsbsim:737")
        cases.append(("speeds of the 737 of JSBSim", boeing, "speed", 460.0, 640.0, 20.0))
    return [_sweep(quick, *case) for case in cases]


def _sweep(
    quick: bool,
    job: str,
    condition: hfa.TrimCondition,
    name: str,
    low: float,
    high: float,
    goal: float,
) -> Comparison:
    """Return the comparison of a sweep of the variable `name` from `low` to `high`."""
    count, peer_count = (500, 5) if quick else (10_000, 50)  # python-control needs small steps
    values = np.linspace(low, high, count)
    common = slice(None, None, count // peer_count)

    def ours() -> list[TrimmedPlant]:
        swept = hfa.sweep(condition.model, {name: values}, condition=condition)
        assert swept.trimmed.all()
        points = zip(swept.states[common], swept.inputs[common], swept.A[common], strict=True)
        return [TrimmedPlant(*point) for point in points]

    theirs = partial(control_points(condition), name, values[common].tolist())
    units, rounds = (count, peer_count), 1 if quick else 5
    agree = partial(same_points, condition)
    return in_turn(f"{count} {job}", CONTROL, goal, ours, theirs, units, rounds, agree)


def random_game(states: int, seed: int) -> hfa.Game:
    """Return a random game on an unstable plant, with one input for every four states, E = I and
    delta 500.
    """
    random = np.random.default_rng(seed)
    inputs = max(1, states // 4)
    A = random.standard_normal((states, states)) / np.sqrt(states)
    B = random.standard_normal((states, inputs))
    assert np.linalg.eigvals(A).real.max() > 0.0
    return hfa.Game(A, B, Q=np.eye(states), R=np.eye(inputs), delta=500.0)


def schur_value(game: hfa.Game) -> np.ndarray:
    """Return P (n, n) of a game with R = I and E = I by SciPy's ordered Schur form; nan without a
    stable subspace of n dimensions.
    """
    from scipy.linalg import schur

    n = len(game.A)
    S = game.B @ game.B.T - np.eye(n) / game.delta**2
    _, basis, stable = schur(np.block([[game.A, -S], [-game.Q, -game.A.T]]), sort="lhp")
    P = np.linalg.solve(basis[:n, :n].T, basis[n:, :n].T).T
    return np.asarray(P if stable == n else np.full((n, n), np.nan))


def has_value(game: hfa.Game) -> bool:
    """Return whether a game has a value P >= 0 by the Schur form."""
    P = schur_value(game)
    return bool(np.isfinite(P).all() and np.linalg.eigvalsh((P + P.T) / 2.0)[0] >= 0.0)


def bisected_delta(game: hfa.Game) -> float:
    """Return the smallest delta with a value P >= 0 by the Schur form, 1e-6 too large at most."""
    low, high = 1.0, game.delta  # a delta without and one with a value
    while high > low * (1.0 + 1e-6):
        middle = (low * high) ** 0.5
        low, high = (low, middle) if has_value(game.with_delta(middle)) else (middle, high)
    return high


def peer_solves(game: hfa.Game) -> bool:
    """Return whether a game has a value and SciPy's ordering succeeds at each delta."""
    try:
        return has_value(game) and math.isfinite(bisected_delta(game))
    except np.linalg.LinAlgError:
        return False


SCHUR = "SciPy's ordered Schur form"


def games(quick: bool) -> list[Comparison]:
    """Return comparisons of solutions, their smallest delta and verdicts on their gains."""
    sizes = ((6, 25.0), (24, 20.0), (48, 15.0), (96, 15.0))  # states, permitted ratio of times
    chosen = sizes[:1] if quick else sizes
    return [comparison for size in chosen for comparison in _games(quick, *size)]


def _games(quick: bool, states: int, slower: float) -> Iterator[Comparison]:
    """Yield the comparisons of the first random games that the peer solves."""
    solvable = filter(peer_solves, (random_game(states, seed) for seed in count()))
    drawn = list(islice(solvable, 2 if quick else 480 // states))
    gains = [hfa.solve(game).K for game in drawn]
    of = f"of a game of {states} states, unstable"
    units, rounds = (len(drawn), len(drawn)), 1 if quick else 5
    close = partial(np.testing.assert_allclose, rtol=2e-6, atol=1e-8)

    def solved() -> list[np.ndarray]:
        return [hfa.solve(game).P for game in drawn]

    def judged() -> None:
        for game, K in zip(drawn, gains, strict=True):
            assert "PASS" in str(hfa.verify(game, K))

    yield in_turn(
        f"`hfa.solve` {of}: P, proved",
        f"the bare equation by {SCHUR}",
        1.0 / slower,
        solved,
        lambda: [schur_value(game) for game in drawn],
        units,
        rounds,
        close,
    )
    yield in_turn(
        f"`delta_min` {of}: proved from both sides",
        f"bisection by {SCHUR}",
        0.1,
        lambda: [hfa.solve(game).delta_min for game in drawn],
        lambda: [bisected_delta(game) for game in drawn],
        units,
        1 if states > 48 else rounds,
        close,
    )
    if states <= 48:
        job = f"`hfa.verify` of the gain {of}, printed"
        yield in_turn(job, "`hfa.solve`", 0.1, judged, solved, units, rounds)


def environment(quick: bool) -> list[Comparison]:
    """Return the comparison of an environment of JSBSim's c172p with JSBSim."""
    if not HAS_JSBSIM:
        return []
    import jsbsim

    model, frames, steps = hfa.load_model("jsbsim:c172p"), 6, 5 if quick else 100
    simulator = jsbsim.FGFDMExec(str(Path(jsbsim.__file__).parent))
    simulator.set_debug_level(0)
    simulator.load_model("c172p")
    simulator.set_dt(1.0 / 120.0)
    for name, value in {"h-sl-ft": 5000.0, "vc-kts": 80.0}.items():
        simulator[f"ic/{name}"] = value
    simulator.run_ic()

    def theirs() -> None:
        """Fly 20 times as many steps as one of the five episodes of `ours`: JSBSim is fast."""
        simulator.reset_to_initial_conditions(0)
        for _ in range(20 * steps * frames):
            simulator.run()

    episodes = hfa.environment(model, dt=frames / 120.0)
    still = np.zeros(len(model.inputs))

    def ours() -> None:
        for _ in range(5):
            episodes.reset()
            for _ in range(steps):
                episodes.step(still)

    job = "a step of 50 ms of an environment of the c172p"
    peer = "FGFDMExec.run of JSBSim, 6 a step, from its own start (not the same flight)"
    units = (5.0 * steps, 20.0 * steps)
    return [in_turn(job, peer, 2.0, ours, theirs, units, 1 if quick else 5)]


def flight(quick: bool) -> list[Comparison]:
    """Return comparisons of flights of the HFA under its exact policy with SciPy."""
    return [_flight(quick, seconds) for seconds in ((0.2,) if quick else (2.0, 20.0))]


def _flight(quick: bool, seconds: float) -> Comparison:
    """Return the comparison of a flight of some seconds, which ends in the same state for both."""
    from scipy.integrate import solve_ivp

    model = hfa.aircraft()
    point = hfa.trim(model)
    solution = hfa.solve(published_game(hfa.linearize(model, point)))
    rates = _evaluated(model, ())
    trim, inputs = np.array(point.states), np.array(point.inputs)
    lower = np.array([signal.min for signal in model.inputs.values()])
    upper = np.array([signal.max for signal in model.inputs.values()])
    linear_states = [list(model.states).index(name) for name in solution.names.states]
    start = trim.copy()
    start[list(model.states).index("pitch")] += 0.005

    def theirs() -> np.ndarray:
        def closed(t: float, x: np.ndarray) -> np.ndarray:
            return rates(
                t, x, np.clip(inputs - solution.K @ (x - trim)[linear_states], lower, upper), None
            )

        # With this tolerance, the last state agrees with that of `hfa.fly` to 1e-5 (`agree`).
        flown = solve_ivp(closed, (0.0, seconds), start, "LSODA", rtol=1e-6, atol=1e-9)
        assert flown.success
        return flown.y[:, -1]

    def ours() -> np.ndarray:
        flown = hfa.fly(model, point, solution, duration=seconds, initial={"pitch": 0.005})
        assert flown.time[-1] == seconds
        return flown.states[-1]

    def agree(last: np.ndarray, peer: np.ndarray) -> None:
        sizes = model.nominal(model.states)
        np.testing.assert_allclose(last / sizes, peer / sizes, rtol=0.0, atol=1e-5)

    job = f"{seconds:g} s of flight of the HFA under its exact policy"
    peer = "SciPy solve_ivp (LSODA), same compiled equations"
    return in_turn(job, peer, 0.3, ours, theirs, rounds=1 if quick else 5, agree=agree)


def predictive(quick: bool) -> list[Comparison]:
    """Return the time of a later sample of the predictive policy of the HFA, which no budget ends,
    and the sample time.

    The first sample, which finds the first plan, is not counted.
    """
    model = hfa.aircraft()
    point = hfa.trim(model)
    policy = hfa.predictive(model, point, budget=math.inf)
    states = np.array(point.states) + 0.02 * model.nominal(model.states)
    samples = count()
    policy(next(samples) * policy.dt, states)
    number = 2 if quick else 20

    def ours() -> None:
        for k in islice(samples, number):
            policy(k * policy.dt, states)

    job = "a sample of the predictive policy of the HFA, after the first"
    rounds = 1 if quick else 5
    return [in_turn(job, "its sample time", 1.0, ours, policy.dt, (float(number), 1.0), rounds)]


def proof(quick: bool) -> list[Comparison]:
    """Return the time of a proof of a schedule, whose search ends by itself, and a goal."""
    interval = "14:15" if quick else "0:20"

    def ours() -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            assert main(["prove", "schedule", "--dihedral", interval]) == 0

    job = f"proved decay of the HFA at every dihedral of {interval} deg"
    return [in_turn(job, "a goal of 10 s", 1.0, ours, 10.0, rounds=1 if quick else 3)]


JOBS = {
    "start": start,
    "trim": one_trim,
    "sweeps": sweeps,
    "games": games,
    "environment": environment,
    "flight": flight,
    "predictive": predictive,
    "proof": proof,
}
