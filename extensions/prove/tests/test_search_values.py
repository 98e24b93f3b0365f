"""Computations of the searches, compared with closed forms and brute force."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import casadi as ca
import numpy as np
import pytest
from as_proved import as_proved
from proof_cases import proved, two_trims

from hfa_aircraft.march.ending import FAR, FAR_OF_STARTS, Outcome
from hfa_aircraft.model import Model, Signal
from hfa_prove.check.cover import OpenBoxError, RefutedError, SmallestBoxError
from hfa_prove.check.equilibrium import Equilibrium
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.search import obstacles, region_boxes, shape_boxes, shape_squares
from hfa_prove.search.clock import Clock, OutOfTimeError
from hfa_prove.search.cost import CostBound, CostSearch, _Proved
from hfa_prove.search.cost_fit import CostProblem, Fit, TargetFlights, quadratic_piece
from hfa_prove.search.family import Box, Family
from hfa_prove.search.flights import Inputs, flight_costs
from hfa_prove.search.invariant import DisturbedLoop, _bisected, _falls
from hfa_prove.search.level import LevelSearch, ball_of
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.obstacles import (
    LevelSet,
    first_obstacle,
    obstacles_around,
    rises,
    starts_by_outcome,
)
from hfa_prove.search.proof import CertificateFile, Proof
from hfa_prove.search.region import PROVERS, provers_of
from hfa_prove.search.region_boxes import BoxesSearch
from hfa_prove.search.region_search import (
    RegionProblem,
    Settings,
    lyapunov_matrices,
    refuse_unstable,
)
from hfa_prove.search.region_squares import SquaresSearch, settings_of
from hfa_prove.search.schedule import (
    ProvedBox,
    ScheduleSearch,
    _first_weight,
    _gaps,
    _lyapunov,
    _weight,
)
from hfa_prove.search.shape_boxes import Growth, Shape
from hfa_prove.search.squares import BASE, Terms, packed_monomials
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Limits, Plant
from hfa_prove.statements.schedule import Run
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.provenance import Provenance

P = np.array([[2.0, 0.5], [0.5, 1.0]])
V = PolynomialFunction.quadratic(P)
T = np.array([[1.5, 0.9], [0.0, 2.0]])


@pytest.mark.parametrize(("values", "binds"), [
    ((-0.96, 1.0), False), ((-0.98, 1.0), True), ((-0.5, 1.93), False), ((-0.5, 1.95), True),
])  # fmt: skip
def test_a_limit_that_the_set_touches_at_either_end_binds(
    values: tuple[float, float], binds: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A limit binds if the set reaches 97 % of the distance to its lowest or highest value."""
    signals = {"far": (np.array([-0.1, 0.1]), -1.0, 2.0), "x": (np.array(values), -1.0, 2.0)}

    def signals_at(edge: np.ndarray) -> Any:
        assert V(edge) == pytest.approx(0.5)
        return signals

    loop = cast(Any, SimpleNamespace(limited_signals=signals_at))
    far, near = np.array([1.0, 1.0]), np.array([0.5, 1.0])
    starts = {Outcome.LEFT: np.array([far, near, 2.0 * far])}

    def flown(loop: Any, proved: Any, rays: np.ndarray, clock: Any) -> Any:
        assert np.linalg.norm(np.linalg.solve(T, rays.T), axis=0) == pytest.approx(1.0)
        return starts

    monkeypatch.setattr(obstacles, "starts_by_outcome", flown)
    proved = LevelSet(V, 0.5, T)
    found = obstacles_around(loop, proved, (0.5, near), Clock(60.0))
    assert found.limits == (("x",) if binds else ())
    assert (found.rises[0], found.simulated) == (0.5, True)
    level, place = found.starts[Outcome.LEFT]
    assert level == V(near[None])[0]
    assert np.array_equal(place, near)


def test_an_obstacle_simulation_may_end_early(monkeypatch: pytest.MonkeyPatch) -> None:
    def ended(*arguments: Any) -> Any:
        raise OutOfTimeError("flights", 0.0)

    monkeypatch.setattr(obstacles, "starts_by_outcome", ended)
    loop = cast(Any, SimpleNamespace(limited_signals=lambda edge: {}))
    found = obstacles_around(loop, LevelSet(V, 1.0, T), (np.inf, None), Clock(60.0))
    assert (found.simulated, found.starts) == (False, {})


@pytest.mark.parametrize("quick", [False, True])
def test_the_first_obstacle_is_the_lowest_point_of_v(quick: bool) -> None:
    """On the half-plane a'z >= 1, z'P z is lowest at z = P⁻¹a / (a'P⁻¹a), with 1 / (a'P⁻¹a)."""
    a = np.array([0.9, 0.7])
    lowest = 1.0 / (a @ np.linalg.solve(P, a))
    level, place = first_obstacle(lambda z: z @ a >= 1.0, V, 2.0 * T, quick=quick)
    assert place is not None
    assert lowest <= level == pytest.approx(lowest, rel=2e-3)
    assert level == V(place[None])[0]
    assert 1.0 <= a @ place < 1.001
    assert first_obstacle(lambda z: z @ a >= 50.0, V, T, quick=quick) == (np.inf, None)


def test_the_first_obstacle_of_each_ray_is_found() -> None:
    """The factor is that of the nearest boundary, within the bisections, or inf without any."""
    rays = np.array([[1.0, 0.0], [0.0, 1.0], [2.0, 0.0], [0.0, 0.03]])
    radii = np.linspace(0.1, 1.0, 10)

    def is_obstacle(z: np.ndarray) -> np.ndarray:
        return np.asarray((z[:, 0] >= 0.73) & (z[:, 0] < 1.3) | (z[:, 1] >= 0.02))

    found = obstacles._along(is_obstacle, rays, radii)
    assert found == pytest.approx([0.73, 0.02, 0.365, 0.02 / 0.03], abs=0.1 / 2**11)
    assert np.all(is_obstacle(found[:, None] * rays))
    none = obstacles._along(lambda z: np.zeros(len(z), bool), rays, radii)
    assert np.all(none == np.inf)


def test_a_set_has_its_volume_and_its_points() -> None:
    """The size is that of the ellipsoid; only points within level and unit ball are contained."""
    proved = LevelSet(V, 0.7, T)
    assert proved.size == pytest.approx((0.7**2 / np.linalg.det(P)) ** 0.25, rel=0.02)
    assert LevelSet(V, 1e9, T).size == 0.0
    z = np.random.default_rng(0).uniform(-2.0, 2.0, (500, 2))
    level = np.einsum("ki,ij,kj->k", z, P, z)
    y = np.linalg.norm(z @ np.linalg.inv(T).T, axis=1)
    assert np.array_equal(proved.contains(z), (level <= 0.7) & (y <= 1.0))
    small = LevelSet(V, 0.7, 0.2 * T)
    assert np.array_equal(small.contains(z), (level <= 0.7) & (y <= 0.2))
    wave = PolynomialFunction.of_terms([(4.0, (2,)), (-1.0, (4,))])  # highest, 4, at z² = 2
    line = LevelSet(wave, 1.0, np.eye(1))
    assert line.level(np.array([[1.0], [2.0]])) == pytest.approx([3.0, 4.0], rel=2e-3)


def cubic(limits: Limits) -> LoopValues:
    """Return x' = -x + x³, which converges for |x| < 1 alone."""
    model = Model(
        "cubic", {"x": Signal()}, {}, lambda x, u, p, w: ({"x": x.x**3 - x.x}, {}), trim={}
    )
    return LoopValues(Loop(model, {}, {"x": 0.0}, {}, {}, limits, Gain(np.zeros((0, 1)))))


def test_the_nearest_diverging_and_leaving_starts_are_found() -> None:
    """x' = -x + x³ diverges from |x| > 1 and leaves the limit 0.8 before."""
    square = PolynomialFunction.quadratic(np.eye(1))
    proved = LevelSet(square, 0.25, 0.5 * np.eye(1))
    rays = np.array([[0.5], [-0.5]])
    found = starts_by_outcome(cubic({"x": (-np.inf, 0.8)}), proved, rays, Clock(60.0))
    ((left,),) = found[Outcome.LEFT]
    ((lost,),) = found[Outcome.DIVERGED]
    assert 0.8 < left < 0.85
    assert -1.06 < lost < -1.0
    assert set(found) == {Outcome.LEFT, Outcome.DIVERGED}
    with pytest.raises(OutOfTimeError):
        starts_by_outcome(cubic({}), proved, rays, Clock(-1.0))


def test_starts_cover_the_surroundings_of_the_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """Flights last 12 slowest time constants, from the edge of the set to 20 times its distance."""
    model = Model(
        "two", {"a": Signal(), "b": Signal()}, {},
        lambda x, u, p, w: ({"a": -0.5 * x.a, "b": -4.0 * x.b}, {}), trim={},
    )  # fmt: skip
    loop = LoopValues(Loop(model, {}, {"a": 0.0, "b": 0.0}, {}, {}, {}, Gain(np.zeros((0, 2)))))
    proved = LevelSet(PolynomialFunction.quadratic(np.diag([4.0, 0.01])), 1.0, np.eye(2))
    tried: list[np.ndarray] = []

    def outcomes(loop: Any, starts: np.ndarray, holds: Any, seconds: float, clock: Any) -> Any:
        tried.append(starts)
        assert seconds == pytest.approx(24.0)
        return np.full(len(starts), Outcome.ELSEWHERE, dtype=object)

    monkeypatch.setattr(obstacles, "outcomes", outcomes)
    found = starts_by_outcome(loop, proved, np.eye(2), Clock(60.0))
    distances = np.linalg.norm(tried[0], axis=1).reshape(10, 2)
    share = np.linspace(0.1, 1.0, 10)[:, None] ** 2
    edge = np.array([0.5, 1.0])  # b reaches the level beyond the unit ball
    assert distances == pytest.approx(edge + 19.0 * edge * share)
    assert set(found) == {Outcome.DIVERGED}
    assert len(tried) == 2
    assert np.linalg.norm(obstacles._unit(np.array([[3.0, 4.0], [0.1, 0.0]])), axis=1) == (
        pytest.approx(1.0)
    )


def test_a_flight_diverges_beyond_its_start_and_many_nominal_values(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bounds: list[np.ndarray] = []
    rule = obstacles.EndRule

    def recorded(far: np.ndarray, *others: Any) -> Any:
        bounds.append(far)
        return rule(far, *others)

    monkeypatch.setattr(obstacles, "EndRule", recorded)
    starts = np.array([[1.0, 1e9], [-2.0, 1.0]])
    free = LoopValues(Loop(**{**vars(limited_loop().loop), "limits": {}}))
    obstacles.outcomes(free, starts, lambda z: np.ones(len(z), bool), 1.0, Clock(60.0))
    assert bounds[0].tolist() == [FAR * 2.0, FAR_OF_STARTS * 1e9]


def test_sums_of_squares_require_a_polynomial_policy() -> None:
    loop = cubic({}).loop
    z = ca.SX.sym("z")
    function = ca.Function("u", [z], [ca.SX(0, 1)])
    of_function = RegionProblem(Loop(**{**vars(loop), "policy": function}))
    assert (provers_of(RegionProblem(loop)), provers_of(of_function)) == (
        ("squares", "boxes"), ("boxes",),
    )  # fmt: skip
    with pytest.raises(BadInputError, match="polynomial policy; use --prover boxes"):
        PROVERS["squares"](of_function, Settings(2, Clock(60.0)))


def test_v_rises_where_its_derivative_is_not_negative() -> None:
    """V' = 2 x (x³ - x) is negative for 0 < |x| < 1, and an undefined V' counts as a rise."""
    square = PolynomialFunction.quadratic(np.eye(1))
    z = np.array([[0.0], [0.5], [-0.999], [1.001], [-2.0], [np.nan]])
    rising = rises(cubic({}), square.slope)(z)
    assert rising.tolist() == [True, False, False, True, True, True]


def limited_loop() -> LoopValues:
    """Return a loop at x = (1, 2) with limits of one state and of the output y = a² + 3 b."""
    model = Model(
        "limited", {"a": Signal(nominal=2.0), "b": Signal(nominal=3.0), "c": Signal()}, {},
        lambda x, u, p, w: ({"a": -x.a, "b": x.a - 2.0 * x.b, "c": -x.c}, {"y": x.a**2 + 3.0 * x.b}),
        outputs={"y": Signal()}, linear=("a", "b"), trim={},
    )  # fmt: skip
    limits = {"b": (-1.0, 4.0), "y": (-np.inf, 11.0)}
    return LoopValues(
        Loop(model, {}, {"a": 1.0, "b": 2.0}, {}, {"c": 0.0}, limits, Gain(np.zeros((0, 2))))
    )


def test_limited_signals_are_deviations_from_the_equilibrium() -> None:
    values = limited_loop()
    z = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 2.5], [-1.0, -3.5], [0.5, 0.5]])
    assert values.limited == ("b", "y")
    assert np.array_equal(values.permitted_deviations, [[-3.0, 2.0], [-np.inf, 4.0]])
    signals = values.limited_signals(z)
    b, low, high = signals["b"]
    assert np.array_equal(b, z[:, 1])
    assert (low, high) == (-3.0, 2.0)
    y = (1.0 + z[:, 0]) ** 2 + 3.0 * (2.0 + z[:, 1]) - 7.0
    assert signals["y"][0] == pytest.approx(y)
    assert values.beyond(z).tolist() == [False, True, True, True, False]
    assert np.allclose(values.J, [[-1.0, 0.0], [1.0, -2.0]])
    assert np.allclose(values.limited_rows, [[0.0, 1.0], [2.0, 3.0]])
    assert np.allclose(
        values.rates(z), np.column_stack([-1.0 - z[:, 0], z[:, 0] - 3.0 - 2.0 * z[:, 1]])
    )
    assert values.nominal.tolist() == [2.0, 3.0]
    far = np.array([[-1.01 * FAR * 2.0, -1.0], [-0.99 * FAR * 2.0, -1e9], [np.nan, 0.0]])
    free = LoopValues(Loop(**{**vars(values.loop), "limits": {}}))
    assert free.away(far).tolist() == [True, True, True]
    assert free.away(np.array([[-0.99 * FAR * 2.0, 0.0]])).tolist() == [False]
    assert values.away(z).tolist() == values.beyond(z).tolist()


def test_weights_give_their_lyapunov_matrices() -> None:
    """J'P + P J = -diag(w²), first with w = 1 / nominal and then within a factor of 10."""
    J = np.array([[-1.0, 2.0], [0.0, -3.0]])
    nominal = np.array([2.0, 0.5])
    first, *others = lyapunov_matrices(J, nominal, 20)
    assert np.allclose(J.T @ first + first @ J, -np.diag([0.25, 4.0]))
    assert len(others) == 19
    for each in others:
        weights = np.sqrt(-np.diag(J.T @ each + each @ J)) * nominal
        assert np.all((weights > 0.1) & (weights < 10.0))
    assert list(lyapunov_matrices(-J, nominal, 3)) == []


@pytest.mark.parametrize("mode", [0.0, 0.5])
def test_a_linearization_on_or_right_of_the_axis_is_refused(mode: float) -> None:
    refuse_unstable(-np.eye(2))
    with pytest.raises(NoSolutionError, match=f"{mode:.3g}"):
        refuse_unstable(np.diag([-1.0, mode]))


def plant_of(equations: Any, low: float, high: float) -> tuple[Plant, Equilibrium]:
    """Return a plant with two states and one limited input about 0."""
    model = Model("plant", {"a": Signal(), "b": Signal()}, {"u": Signal()}, equations, trim={})
    plant = Plant(model, {}, {"a": 0.0, "b": 0.0}, {"u": 0.0}, {}, {"u": (low, high)})
    at = cast(Any, SimpleNamespace(x=np.zeros(3)))
    return plant, at


def test_inputs_of_a_flight_minimize_the_hamiltonian() -> None:
    """No input within the limits has a lower p · f(z, v) + v'R v."""

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"a": x.b, "b": u.u + 0.2 * u.u**2 - ca.sin(x.a)}, {}

    plant, at = plant_of(equations, -0.5, 0.7)
    inputs = Inputs(plant, at, np.array([[1.5]]))
    random = np.random.default_rng(0)
    z = random.uniform(-1.0, 1.0, (60, 2))
    p = random.uniform(-4.0, 4.0, (60, 2))
    v = inputs.best(z, p)
    assert np.all((v >= -0.5) & (v <= 0.7))
    assert {-0.5, 0.7} < set(v.ravel().tolist())
    grid = np.linspace(-0.5, 0.7, 1201)
    price = p[:, 1:] * (grid + 0.2 * grid**2) + 1.5 * grid**2
    found = p[:, 1] * (v + 0.2 * v**2).ravel() + 1.5 * v.ravel() ** 2
    assert np.all(found <= price.min(axis=1) + 1e-6)
    assert np.allclose(inputs.rates(z, v)[:, 1], (v + 0.2 * v**2).ravel() - np.sin(z[:, 0]))
    assert np.allclose(inputs.linear(), [[0.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])


def test_flights_of_a_linear_plant_cost_the_quadratic_value() -> None:
    """Without active limits, the flights of the LQR cost z'P z. A flight that leaves costs inf."""

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"a": x.b, "b": u.u}, {}

    plant, at = plant_of(equations, -np.inf, np.inf)
    Q, R = np.diag([1.0, 2.0]), np.array([[0.5]])
    half = math.sqrt(0.5)
    b = math.sqrt(2.0 + 2.0 * half)  # of K = [1 / r, b / r] with r² = R
    K = np.array([[1.0 / half, b / half]])
    value = np.array([[b, half], [half, b * half]])
    J = np.array([[0.0, 1.0], [-K[0, 0], -K[0, 1]]])
    assert np.allclose(J.T @ value + value @ J + Q + K.T @ R @ K, 0.0)
    z = np.array([[1.0, 0.0], [0.0, 1.0], [-0.5, 1.5], [3.0, 0.0]])
    costs = flight_costs(
        Inputs(plant, at, R), (Q, R, value), lambda z: 2.0 * z @ value,
        lambda z: np.abs(z[:, 0]) < 2.0, z, Clock(60.0),
    )  # fmt: skip
    exact = np.einsum("ki,ij,kj->k", z, value, z)[:3]
    assert np.all((costs[:3] > exact) & (costs[:3] < 1.03 * exact))  # inputs are held in each step
    assert costs[3] == np.inf


def test_a_clock_divides_the_time_that_is_left() -> None:
    """A step gets its share of the time that is left, and the whole is left after it."""
    clock = Clock(100.0)
    with clock.step(0.25):
        assert clock.left == pytest.approx(25.0, abs=1.0)
        with clock.step(0.5):
            assert clock.left == pytest.approx(12.5, abs=1.0)
    assert clock.left == pytest.approx(100.0, abs=1.0)
    assert 0.0 <= clock.used < 1.0
    with pytest.raises(OutOfTimeError, match=r"after fitting, 0\.75 of the cube undecided"):
        Clock(-1.0)(1.0, 4.0, "fitting")

    def interrupted(done: float, total: float, what: str = "") -> None:
        raise KeyboardInterrupt

    stopped = Clock(100.0, interrupted)
    with pytest.raises(KeyboardInterrupt):
        stopped(0.0, 1.0)
    assert stopped.interrupted


def test_an_unfinished_certificate_is_written_at_intervals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file is written after 2 s and 9 times the duration of the last writing, and at the end."""
    now = 0.0
    written: list[float] = []
    duration = 0.5

    def write(path: Path, origin: Any) -> None:
        nonlocal now
        written.append(now)
        now += duration

    monkeypatch.setattr("hfa_prove.search.proof.time", SimpleNamespace(monotonic=lambda: now))
    proof = cast(Any, SimpleNamespace(write=write))
    file = CertificateFile(tmp_path / "proof.json", Provenance("a test", "published"))
    for at in (1.9, 2.1, 7.0, 7.2, 10.0):
        now = at
        file.save(proof)
    assert written == [2.1, 7.2]
    file.save(proof, finished=True)
    assert written == [2.1, 7.2, 10.0]
    assert file.known(cast(Any, None), cast(Any, None)) == {}
    with pytest.raises(NoSolutionError, match="no certificate is written"):
        Proof(cast(Any, None), {}).write(tmp_path / "none.json", Provenance("", ""))
    assert list(tmp_path.iterdir()) == []


def test_the_proof_of_a_scalar_schedule_has_its_closed_form() -> None:
    """x' = 1 + p - x² + u with u = -k(p) (x - s), s = sqrt(1 + p): F = -2 s - k, and A = -2 s.

    The decay rate is 0.9 times that at a center. V = P x² with P = W / (2 |F|) decreases while
    |p'| < 2 F² / |F'|.
    """
    data = proved("two trims").data
    p = np.linspace(1.0, 1.5, 501)
    s = np.sqrt(1.0 + p)
    F = -2.0 * s - (0.5 + 0.1 * (p - 1.0))
    slowest = np.min(-F)
    assert data["decay_rate"] == pytest.approx(0.9 * 3.525, rel=1e-9)  # of one box, about 1.25
    assert data["decay_rate"] < slowest
    fastest = np.min(2.0 * F**2 / (1.0 / s + 0.1))
    assert 0.9 * fastest <= data["scheduled_rate"] <= fastest
    assert float(f"{data['scheduled_rate']:.1e}") == data["scheduled_rate"]
    lyapunov = data["lyapunov"]
    (breakpoints,) = lyapunov["scheduled"].values()
    P = np.interp(p, breakpoints, np.array(lyapunov["P"]).ravel())
    slope = np.diff(np.array(lyapunov["P"]).ravel()) / np.diff(breakpoints)
    assert np.all(2.0 * F * P + data["scheduled_rate"] * np.max(np.abs(slope)) < 0.0)
    assert np.max(np.diff(breakpoints)) <= 0.125 * Family(two_trims()).step
    reached = 1.0
    for box in data["boxes"]:
        ((low, high),) = box["scheduled"].values()
        assert low == reached
        reached = high
        (((least, most),),) = box["A"]
        exact = (-2.0 * np.sqrt(1.0 + high), -2.0 * np.sqrt(1.0 + low))
        assert least <= exact[0] < exact[1] <= most
        assert (least, most) == pytest.approx(exact, abs=0.02)
        (((least, most),),) = box["B"]
        assert least <= 1.0 <= most < least + 1e-9
    assert reached == 1.5
    assert data["loop"]["boxes"] == len(data["boxes"])


def test_ranges_of_a_schedule_are_joined_and_cut() -> None:
    """Gaps are what no run covers, and neighbors with equal bounds are one range."""
    runs = [Run(3.0, 4.0, 0, 0), Run(1.0, 2.0, 0, 0), Run(1.5, 1.75, 0, 0)]
    assert _gaps(runs, 0.0, 5.0) == [(0.0, 1.0), (2.0, 3.0), (4.0, 5.0)]
    assert _gaps(runs, 1.0, 4.0) == [(2.0, 3.0)]
    boxes = {
        "loop": [
            ProvedBox(Box(low, high), least, most, 0.0, {})
            for low, high, least, most in (
                (0.0, 1.0, 0, 0), (1.0, 2.0, 0, 0), (3.0, 4.0, 0, 3), (3.0, 3.5, 1, 2),
            )
        ],
        "modes": [ProvedBox(Box(2.0, 2.5), 0, 0, 0.0, {})],
    }  # fmt: skip
    trims = SimpleNamespace(stated_trim=lambda start: start)
    search = cast(Any, SimpleNamespace(boxes=boxes, low=0.0, high=5.0, trims=trims))
    assert ScheduleSearch._runs(search, "loop", 4) == (
        Run(0.0, 2.0, 0, 0), Run(2.0, 3.0, 0, 4), Run(3.0, 3.5, 1, 2), Run(3.5, 4.0, 0, 3),
        Run(4.0, 5.0, 0, 4),
    )  # fmt: skip
    assert ScheduleSearch._stated_trims(search) == (0.0, 3.0)


def test_the_first_level_touches_its_nearest_limit() -> None:
    """{z'P z <= c} reaches a limit g'z = d for c = d² / (g'P⁻¹g), the least c of all limits."""
    for limits, signal in (
        ({"b": (-1.0, 4.0)}, ((0.0, 1.0), 2.0)),
        ({"b": (1.5, 4.0)}, ((0.0, 1.0), 0.5)),
        ({"b": (-1.0, 4.0), "y": (-np.inf, 7.25)}, ((2.0, 3.0), 0.25)),
        ({"a": (0.9, np.inf), "b": (-1.0, 4.0)}, ((1.0, 0.0), 0.1)),
        ({}, ((1.0, 0.0), 200.0)),
    ):
        plant = LoopValues(Loop(**{**vars(limited_loop().loop), "limits": limits}))
        search = cast(Any, SimpleNamespace(plant=plant, _n=2))
        level, T = SquaresSearch._limit_of(search, P)
        g, distance = np.array(signal[0]), signal[1]
        exact = distance**2 / (g @ np.linalg.solve(P, g))
        assert exact > level == pytest.approx(exact, rel=1e-6)
        assert np.allclose(T.T @ P @ T, level * np.eye(2), rtol=1e-9)
        states = {name: pair for name, pair in limits.items() if name != "y"}
        loop = Loop(**{**vars(plant.loop), "limits": states})
        at = cast(Any, SimpleNamespace(x=np.array([1.0, 2.0])))
        boxes = cast(Any, SimpleNamespace(loop=loop, equilibrium=at, samples=plant))
        near = {
            name: min(abs(low - x), abs(high - x))
            for (name, x) in (("a", 1.0), ("b", 2.0))
            for low, high in (states.get(name, (-np.inf, np.inf)),)
        }
        wanted = [min(near["a"], 200.0), min(near["b"], 300.0)]
        get = BoxesSearch._limit_distances.fget  # type: ignore[attr-defined]
        assert get(boxes) == pytest.approx(wanted)


@pytest.mark.parametrize(("highest", "known"), [(0.37, 0.0), (0.37, 0.2), (1.0, 0.0), (0.0, 0.0)])
def test_the_largest_share_is_found_by_bisection(highest: float, known: float) -> None:
    """The share holds, and one that is larger by 0.04 % fails."""
    tried: list[float] = []

    def holds(share: float) -> bool:
        tried.append(share)
        return share <= highest

    found = LevelSearch.largest(cast(Any, SimpleNamespace(holds=holds)), known)
    assert found <= highest <= 1.0004 * found
    assert len(tried) < 20
    assert min(tried) >= known


def test_a_ball_holds_the_ellipsoid_closely() -> None:
    """The boundary of {z'P z <= 0.7} lies inside the unit ball of y, within 1 %."""
    T = ball_of(P, 0.7)
    angles = np.linspace(0.0, 2.0 * np.pi, 100)
    z = np.linalg.solve(np.linalg.cholesky(P).T, np.array([np.cos(angles), np.sin(angles)]))
    lengths = np.linalg.norm(np.linalg.solve(T, np.sqrt(0.7) * z), axis=0)
    assert np.all((lengths > 0.99) & (lengths < 1.0))


@pytest.mark.parametrize(
    ("n", "degree", "degrees"),
    [
        (1, 4, [2, 4]), (2, 2, [2]), (2, 6, [2, 4, 6]), (3, 2, [2, 2]), (4, 6, [2, 2, 4]),
        (5, 6, [2]), (6, 2, [2]),
    ],
)  # fmt: skip
def test_degrees_of_proofs_follow_from_the_number_of_states(
    n: int, degree: int, degrees: list[int]
) -> None:
    """With more states, V and its proofs have lower degrees. A proof contains V' in its degrees."""
    settings = settings_of(n, degree)
    assert [setting.degree for setting in settings] == degrees
    assert all(2 * setting.half >= setting.degree for setting in settings)
    assert all(setting.order >= 2 * setting.half - 1 for setting in settings)


def test_a_set_on_boxes_is_reduced_to_the_state_limits() -> None:
    """The set of a V is scaled in length by a share, and within the limits of the states."""
    shape = Shape.of_matrix(np.diag([1.0, 1.0]), np.diag([-1.0, -2.0]), 2)
    at = cast(Any, SimpleNamespace(x=np.zeros(2)))
    for limit, share, end in ((9.0, 0.5, 0.5), (9.0, 0.25, 0.25), (0.2, 0.5, 0.2), (0.2, 0.1, 0.1)):
        ends = np.array([[-9.0, limit], [-9.0, 9.0]])
        loop = SimpleNamespace(states=("a", "b"), ends={("a", "b"): ends}.get)
        search = cast(Any, SimpleNamespace(J=np.diag([-1.0, -2.0]), loop=loop, equilibrium=at))
        (low, high), _ = BoxesSearch._part(search, shape, share).extents().ends
        assert (-low, high) == pytest.approx((end, end), rel=1e-2)
        assert high <= limit


def packed_value(terms: Terms, y: np.ndarray) -> float:
    """Return the value of a polynomial with packed exponents at a point y (n,)."""
    total = 0.0
    for key, value in zip(terms.keys.tolist(), terms.values.tolist(), strict=True):
        powers = [key // BASE**i % BASE for i in range(len(y))]
        total += value * float(np.prod(y ** np.array(powers)))
    return total


def test_polynomials_of_a_step_have_their_values() -> None:
    """Means over the unit ball, squares m'Q m, balls and limits are those of their formulas."""
    means = {
        1: {(2,): 1 / 3, (4,): 1 / 5, (3,): 0.0},
        2: {(2, 0): 1 / 4, (4, 0): 1 / 8, (2, 2): 1 / 24, (1, 1): 0.0, (1, 2): 0.0},
        3: {(2, 0, 0): 1 / 5, (0, 4, 0): 3 / 35, (2, 2, 0): 1 / 35},
    }
    for expected in means.values():
        found = shape_squares._means(np.array(list(expected)))
        assert found == pytest.approx(list(expected.values()))
    y = np.array([0.3, -0.7])
    Q = np.random.default_rng(0).normal(size=(6, 6))
    ones = np.ones(1)
    keys = packed_monomials(2, 0, 2)
    m = np.array([packed_value(Terms(np.array([key]), ones), y) for key in keys])
    assert sorted(m) == pytest.approx(sorted([1.0, *y, *y**2, y[0] * y[1]]))
    square = shape_squares._square(2, 0, 2, Q)
    assert packed_value(square, y) == pytest.approx(m @ Q @ m)
    assert packed_value(shape_squares._square(2, 1, 1, np.eye(2)), y) == pytest.approx(y @ y)
    assert shape_squares._degrees(square.keys).max() == 4
    ball = shape_squares._ball(2, 1.5)
    assert ball(y[None])[0] == pytest.approx(y @ y / 2.25 - 1.0)
    step = cast(Any, SimpleNamespace(search=SimpleNamespace(T=T), n=2))
    row = np.array([0.5, -2.0])
    signal = row @ T @ y
    for low, high in ((-3.0, 2.0), (-np.inf, 2.0), (-3.0, np.inf)):
        beyond = shape_squares._Step._beyond(step, row, low, high)
        least, most = max(low, -high), min(high, -low)
        if np.isfinite([low, high]).all():
            least, most = low, high
        expected = (signal - least) * (signal - most) / abs(least * most)
        assert packed_value(beyond, y) == pytest.approx(expected)


def scalar_plant(equations: Any, limits: Limits) -> tuple[Plant, Equilibrium]:
    model = Model("scalar", {"x": Signal()}, {"u": Signal()}, equations, trim={})
    plant = Plant(model, {}, {"x": 0.0}, {"u": 0.0}, {}, limits)
    return plant, cast(Any, SimpleNamespace(x=np.zeros(2)))


@pytest.mark.parametrize("share", [0.6, 0.9])
def test_the_level_of_a_share_ends_where_its_inequality_fails(share: float) -> None:
    """x' = -x³ + u with q = r = 1 has p = 1, and W = a x² fails from the level (1 - a²) / 2."""
    plant, at = scalar_plant(lambda x, u, p, w: ({"x": u.u - x.x**3}, {}), {"x": (-3.0, 2.0)})
    one = np.eye(1)
    problem = CostProblem(plant, at, one, one, one, 4, 0.02)
    level = problem.permitted_level(share, 4.0)
    assert level == pytest.approx((1.0 - share**2) / 2.0, rel=1e-2)
    linear = CostProblem(
        *scalar_plant(lambda x, u, p, w: ({"x": u.u}, {}), {}), one, one, one, 4, 0.02
    )
    assert linear.permitted_level(share, 4.0) == np.inf
    assert problem.in_envelope(np.array([[-3.1], [-2.9], [1.9], [2.1]])).tolist() == [
        False, True, True, False,
    ]  # fmt: skip
    costs = problem.saturated_lqr_costs(np.array([[0.01], [2.5]]), Clock(60.0))
    assert costs[0] == pytest.approx(1e-4, rel=0.05)
    assert costs[1] == np.inf


def test_pieces_of_the_linear_cost_have_their_coordinates() -> None:
    """In y = M z, z'P z and the least of the inequality are diagonal, and samples fill the cube."""

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"a": x.b, "b": u.u - 0.5 * x.a}, {}

    plant, at = plant_of(equations, -1.0, 1.0)
    Q, R = np.diag([1.0, 2.0]), np.array([[0.5]])
    problem = CostProblem(plant, at, Q, R, P, 4, 0.02)
    z = problem.ball(300, 2.0, np.random.default_rng(0))
    assert z.shape == (300, 2)
    cost = np.einsum("ki,ij,kj->k", z, P, z)
    assert problem.linear_cost(z) == pytest.approx(cost)
    assert np.all(cost <= 2.0)
    assert np.max(cost) > 1.9
    M = problem.coordinates(0.75, z)
    N = np.linalg.inv(M)
    G = P @ np.array([[0.0], [1.0]])
    for form in (P, Q + 0.75 * G @ G.T / 0.5):
        turned = N.T @ form @ N
        assert np.allclose(turned, np.diag(np.diag(turned)), atol=1e-9)
    assert np.max(np.abs(z @ M.T)) <= 1.0 + 1e-9
    piece = quadratic_piece(problem, 0.75, 1.5)
    assert (piece.c, piece.whole) == (1.5, False)
    assert piece.W.at(z @ piece.M.T) == pytest.approx(0.75 * cost, rel=1e-6)
    inside = np.abs(z[0.75 * cost <= 1.5] @ piece.M.T)
    assert np.all(inside < 0.75)


def test_the_worst_disturbance_raises_v_fastest() -> None:
    """Of all ends of the disturbances, none gives a higher V' at a state."""
    model = Model(
        "gusty", {"a": Signal(), "b": Signal()}, {},
        lambda x, u, p, w: (
            {"a": -x.a + w.first * (1.0 + x.b) + w.second, "b": -x.b - 0.5 * w.second}, {},
        ),
        disturbances={"first": Signal(), "still": Signal(), "second": Signal()}, trim={},
    )  # fmt: skip
    sizes = {"first": 0.2, "second": 0.3}
    loop = Loop(model, {}, {"a": 1.0, "b": -0.5}, {}, {}, {}, Gain(np.zeros((0, 2))), sizes)
    disturbed = DisturbedLoop(loop, V)
    z = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 2))
    a, b = (z + np.array([1.0, -0.5])).T
    rises = []
    for first in (-0.2, 0.2):
        for second in (-0.3, 0.3):
            rates = np.column_stack([-a + first * (1.0 + b) + second, -b - 0.5 * second])
            rises.append(np.sum(V.slope(z) * rates, axis=1))
    found = np.sum(V.slope(z) * disturbed.rates(z), axis=1)
    assert found == pytest.approx(np.max(rises, axis=0))


def test_the_highest_falling_level_is_bisected() -> None:
    """x' = -x + x³ + w with |w| <= 0.2: V' < 0 on x² = c between the roots of x - x³ = 0.2."""
    model = Model(
        "cubic", {"x": Signal()}, {}, lambda x, u, p, w: ({"x": x.x**3 - x.x + w.w}, {}),
        disturbances={"w": Signal()}, trim={},
    )  # fmt: skip
    square = PolynomialFunction.quadratic(np.eye(1))
    roots = np.sort(np.roots([1.0, 0.0, -1.0, 0.2]).real)[1:] ** 2
    for limits, highest in (({}, roots[1]), ({"x": (-0.6, 0.7)}, 0.36)):
        loop = Loop(
            model, {}, {"x": 0.0}, {}, {}, limits, Gain(np.zeros((0, 1))), {"w": 0.2}
        )  # fmt: skip
        plant = DisturbedLoop(loop, square)
        one = 2.0 * np.eye(1)
        assert [_falls(plant, square, one, level)[0] for level in (0.9 * roots[0], 0.3, 0.9)] == [
            False, True, False,
        ]  # fmt: skip
        low, above = _bisected(plant, square, one, highest / 1.2)
        assert low <= highest <= above
        assert above / low == pytest.approx((2000.0 ** (1.0 / 29.0)) ** (1.0 / 16.0))
        _, place = _falls(plant, square, one, 0.9)
        assert (place is None) == (limits != {} and roots[1] > 0.9)


J = np.array([[-1.0, 0.75], [0.0, -3.0]])


def quartic_shape() -> Shape:
    """Return V = z'P z + 0.3 a⁴ - 0.1 a b³, in coordinates that are not those of its proof."""
    in_z = PolynomialFunction.of_terms(
        [(2.0, (2, 0)), (1.0, (1, 1)), (1.0, (0, 2)), (0.3, (4, 0)), (-0.1, (1, 3))]
    )
    M = np.array([[1.0, 0.25], [-0.5, 0.75]])
    V = in_z.substituted(np.linalg.inv(M))
    return Shape.of_piece(Piece(M, Polynomial(2, V.terms), 1.0), 4)


def test_a_shape_keeps_its_values_in_every_form() -> None:
    """Coordinates, degree and cube do not change V(z); a level divides it."""
    shape = quartic_shape()
    z = np.random.default_rng(0).uniform(-0.6, 0.6, (60, 2))
    a, b = z.T
    V = np.einsum("ki,ij,kj->k", z, P, z) + 0.3 * a**4 - 0.1 * a * b**3
    scaled = shape.of_level(0.5)
    for same in (
        shape, shape.diagonal(J), shape.in_cube(), shape.of_degree(6), scaled.of_level(2.0),
        shape.stretched(np.array([2.0, 0.3])), Shape.of_piece(shape.piece(), 2),
    ):  # fmt: skip
        assert same.values(z) == pytest.approx(V, abs=1e-9)
    assert scaled.values(z) == pytest.approx(2.0 * V)
    assert Shape.of_piece(Piece(np.eye(2), Polynomial(2, ((3.0, (2, 0)),)), 1.5), 2).values(z) == (
        pytest.approx(2.0 * a**2)
    )
    step = 1e-6 * np.eye(2)
    slopes = [(shape.values(z + each) - shape.values(z - each)) / 2e-6 for each in step]
    assert shape.gradients(z) == pytest.approx(np.column_stack(slopes), abs=1e-6)
    small = 1e-4 * z
    y = small @ shape.M.T
    falls = -np.sum(shape.gradients(small) * (small @ J.T), axis=1)
    assert np.einsum("ki,ij,kj->k", y, shape.linear_decay(J), y) == pytest.approx(falls, rel=1e-5)
    T_slow = shape.slow(J)
    assert np.allclose(T_slow.T @ shape.linear_decay(J) @ T_slow, np.eye(2), atol=1e-9)
    edge = shape.edge_points(300)
    assert shape.values(edge @ shape.N.T) == pytest.approx(1.0, rel=1e-6)
    cube = shape.in_cube()
    assert 0.4 < np.max(np.abs(cube.edge_points(300))) < 1.0
    inside = shape.values(z) <= 1.0
    level_set = shape.level_set()
    assert np.array_equal(level_set.contains(z), inside)
    turned = shape.diagonal(J)
    for form in (turned.square, turned.linear_decay(J)):
        assert np.allclose(form, np.diag(np.diag(form)), atol=1e-7)
    assert np.allclose(turned.square, np.eye(2), atol=1e-7)


def test_sizes_and_extents_of_an_ellipse_are_exact() -> None:
    """The volume is π / sqrt(det P), and z_i is at most sqrt(P⁻¹_ii); multipliers prove it."""
    shape = Shape.of_matrix(P, J, 2)
    assert shape.size() == pytest.approx(np.linalg.det(P) ** -0.25, rel=0.02)
    half = np.sqrt(np.diag(np.linalg.inv(P)))
    for tried, exact in ((shape, half), (quartic_shape(), None)):
        extents = tried.extents()
        if exact is not None:
            assert np.all(extents.ends[:, 1] >= exact)
            assert extents.ends == pytest.approx(np.column_stack([-exact, exact]), rel=1e-2)
        z = tried.edge_points(500) @ tried.N.T
        z = np.concatenate([z, 0.5 * z, 0.9 * z])
        room = 1.0 - tried.values(z)
        for i in range(2):
            for side, sign in enumerate((-1.0, 1.0)):
                proved_bound = sign * z[:, i] + extents.multipliers[i, side] * room
                assert np.max(proved_bound) <= sign * extents.ends[i, side]
        assert np.all(extents.multipliers > 0.0)


@pytest.mark.parametrize(
    ("limits", "level", "rises"), [({}, 1.0, True), ({"a": (-9.0, 0.5)}, 0.25, False)]
)
def test_the_bound_of_a_shape_is_its_first_obstacle(
    limits: Limits, level: float, rises: bool
) -> None:
    """For a' = a³ - a and b' = b³ - b, V = a² + b² is first obstructed at |a| = 1 or a limit."""
    model = Model(
        "cubics", {"a": Signal(), "b": Signal()}, {},
        lambda x, u, p, w: ({"a": x.a**3 - x.a, "b": x.b**3 - x.b}, {}), trim={},
    )  # fmt: skip
    still = {"a": 0.0, "b": 0.0}
    samples = LoopValues(Loop(model, {}, still, {}, {}, limits, Gain(np.zeros((0, 2)))))
    shape = Shape.of_matrix(np.eye(2), -np.eye(2), 2)
    for quick in (False, True):
        found = shape.bound(samples, 4.0, quick=quick)
        assert level <= found.level == pytest.approx(level, rel=0.1 if quick else 0.01)
        assert found.rises is rises
        assert found.place is not None
        assert shape.values(found.place[None])[0] == pytest.approx(found.level, rel=1e-6)
    assert shape.bound(samples, 0.8 * level) == (np.inf, None, False)


def test_rows_of_the_growth_are_its_inequalities() -> None:
    """Each row times the coefficients is -V' over the modal decay; beyond a limit it is V."""
    model = Model(
        "linear", {"a": Signal(), "b": Signal()}, {},
        lambda x, u, p, w: ({"a": -x.a, "b": -3.0 * x.b + 0.1 * x.a**2}, {}), trim={},
    )  # fmt: skip
    limits = {"a": (-np.inf, 0.4)}
    still = {"a": 0.0, "b": 0.0}
    samples = LoopValues(Loop(model, {}, still, {}, {}, limits, Gain(np.zeros((0, 2)))))
    shape = Shape.of_matrix(np.diag([4.0, 9.0]), samples.J, 2)
    decay = shape.modal_decay(samples.J)
    expected = np.diag([1.0 * 4.0, 3.0 * 9.0]) + shape_boxes._SLOWLY * 2.0 * np.diag([4.0, 9.0])
    assert decay == pytest.approx(expected, rel=1e-3, abs=1e-9)
    growth = Growth(samples, shape, lambda what: None)
    growth._decay = decay
    inside = growth._inside(shape, 0.5, 400)
    assert inside.shape == (400, 2)
    V = shape.V(inside)
    assert 0.45 < np.max(V) <= 0.5 + 1e-9
    edge = growth._edge(shape, 0.5, 50)
    assert shape.V(edge) == pytest.approx(0.5)
    y = np.concatenate([inside, edge, growth._edge(shape, 1.0, 50)])
    z = y @ shape.N.T
    rows, least = growth._rows(shape, y)
    found = rows @ shape.V.coefficients
    falls = -np.sum(shape.gradients(z) * samples.rates(z), axis=1)
    falls /= np.einsum("ki,ij,kj->k", z, decay, z)
    beyond = z[:, 0] > 0.4
    near = np.concatenate([np.zeros(450), np.full(50, 0.5)])  # V = 1 is halfway of 0.9 to 1.1
    leeway = shape_boxes._LEEWAY * near
    assert np.any(beyond)
    assert found == pytest.approx(np.where(beyond, shape.V(y), falls + leeway * shape.V(y)))
    assert least == pytest.approx(np.where(beyond, 1.02, shape_boxes._DECAY + leeway))
    linear = growth._linear_rows(shape, z[:20]) @ shape.V.coefficients
    of_J = -np.sum(shape.gradients(z[:20]) * (z[:20] @ samples.J.T), axis=1)
    assert linear == pytest.approx(of_J / np.einsum("ki,ij,kj->k", z[:20], decay, z[:20]))
    quartic = shape.of_degree(4)
    columns = growth._unknowns(quartic)
    is_square = quartic.V.degrees == 2
    assert columns.shape[1] == 1 + np.count_nonzero(~is_square)
    assert np.allclose(columns[is_square][:, 0], quartic.V.coefficients[is_square])
    assert not np.any(columns[is_square][:, 1:])
    assert np.array_equal(growth._unknowns(shape), np.eye(3))
    while growth.finer():
        pass
    assert growth._least_decay < shape_boxes._LEAST_DECAY


def test_the_largest_set_on_boxes_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """A set that is not larger than the present one is neither stored nor saved."""
    saved: list[float] = []
    settings = Settings(2, Clock(60.0), lambda region: saved.append(region.set.size))
    loop = cubic({"x": (-2.0, 2.0)}).loop
    search = BoxesSearch(RegionProblem(loop), settings)

    def decrease(loop: Any, at: Any, piece: Piece, ends: Any, multipliers: Any) -> Any:
        return SimpleNamespace(piece=piece, proved=lambda most, clock: 7)

    monkeypatch.setattr("hfa_prove.search.region_boxes.Decrease", decrease)
    for share in (0.5, 0.25, 0.75):
        search._prove(Shape.of_matrix(np.eye(1) / share**2, -np.eye(1), 2), f"{share}")
    assert saved == pytest.approx([0.5, 0.75])
    best = search._best
    assert best is not None
    assert (best.origin, best.size, best.witness["boxes"]) == ("0.75", 7, 14)
    low, high = best.extents["x"]
    assert (-low, high) == pytest.approx((0.75, 0.75), rel=1e-2)
    assert best.statement.equilibrium == {"x": 0.0}
    assert best.rho == 1.0
    with pytest.raises(OutOfTimeError):
        BoxesSearch(RegionProblem(loop), Settings(2, Clock(-1.0)))._report("the first V")


def cost_search(saved: list[CostBound]) -> CostSearch:
    """Return the search for bounds of a double integrator, with known flights."""
    plant, at = plant_of(lambda x, u, p, w: ({"a": x.b, "b": u.u}, {}), -1.0, 1.0)
    search = CostSearch(
        plant, at, (0, 1), (np.eye(2), np.eye(1), P), np.array([2.0, 0.5]),
        degree=4, margin=0.1, clock=Clock(60.0), save=saved.append,
    )  # fmt: skip
    z = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 0.5], [1.0, 1.0], [3.0, 0.0]])
    search.__dict__["_flights"] = (z, np.array([2.5, 1.0, 1.6, 4.0, np.inf]))
    return search


def test_targets_of_a_bound_are_its_poor_flights() -> None:
    """A fit considers flights up to the level that cost at least `least` and have a poor bound."""
    search = cost_search([])
    z, costs = search._flights
    assert search._good == pytest.approx(1.0 - 1.5 * 0.1)
    assert np.array_equal(search._bounds(), np.zeros(5))
    linear = np.einsum("ki,ij,kj->k", z, P, z)
    for c, least, chosen, weight in (
        (10.0, 0.0, [0, 1, 2, 3], 2.0), (10.0, 1.5, [0, 2, 3], 20.0),
        (0.9 * 2.5, 0.0, [0, 1, 2], 2.0), (0.9 * 2.499, 0.0, [1, 2], 2.0),
    ):  # fmt: skip
        found = search._target_flights(c, least)
        assert np.array_equal(found.z, z[chosen])
        assert np.array_equal(found.costs, costs[chosen])
        assert found.of_least == weight
    near = [0, 2, 3]  # costs from 0.3 c to c
    assert search._beyond(4.0) == pytest.approx(1.3 * max(1.0, np.max(linear[near] / costs[near])))
    assert search._beyond(1.0) == pytest.approx(1.3 * linear[1] / 1.0)
    assert search._beyond(0.5) == 1.3


def test_a_bound_of_the_cost_states_its_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shares of the box, medians, levels and numbers of boxes are those of the proved pieces."""
    saved: list[CostBound] = []
    search = cost_search(saved)
    W = PolynomialFunction.quadratic(0.5 * P * 25.0)
    piece = Piece(0.2 * np.eye(2), W.rounded(), 1.5)
    known = as_proved(SimpleNamespace(pieces=(piece,)), sizes=(4,))
    linear = search.problem.linear_cost(search.starts)
    assert np.all(np.abs(search.starts) <= [2.0, 0.5])
    assert np.max(np.abs(search.starts), axis=0) == pytest.approx([2.0, 0.5], rel=0.01)
    gain = np.mean(np.minimum(0.5 * linear, 1.5) / linear)
    assert search._gain(0.5, 1.5) == pytest.approx(gain / 1e-6)
    search._search = lambda: None  # type: ignore[method-assign]
    found = search.found(known)
    assert search._level == 1.5
    assert search._fitted_at(1.5)
    covered = float(np.mean(0.5 * linear < 1.5))
    assert found.covered == pytest.approx((covered,))
    assert found.over_linear == pytest.approx((0.5,))
    assert (found.boxes, found.seconds, found.stopped) == ((4,), ((0.0, 0.0),), "")
    assert (found.witness.solved, found.witness.boxes) == (("a", "b"), (8,))
    assert found.statement.equilibrium == {"a": 0.0, "b": 0.0, "u": 0.0}
    present = np.minimum(0.5 * linear, 1.5)
    raised = np.maximum(np.minimum(0.75 * linear, 2.0) - present, 0.0) / linear
    assert search._gain(0.75, 2.0) == pytest.approx(np.mean(raised) / np.mean(present / linear))
    larger = _Proved(piece._replace(c=2.0), 5, (0.25, 0.75))
    assert search._tried(2.0, lambda: larger) is None
    assert [each.boxes for each in saved] == [(4, 5)]
    assert saved[0].seconds == ((0.0, 0.0), (0.25, 0.75))

    def refuted() -> Any:
        raise OpenBoxError("too narrow", np.zeros(2))

    assert isinstance(search._tried(9.0, refuted), OpenBoxError)
    assert search._stopped == "the level 9 is not proved: too narrow"
    assert len(saved) == 1
    empty = cost_search([])
    empty._search = refuted  # type: ignore[method-assign]
    with pytest.raises(OpenBoxError):
        empty.found()
    empty._search = lambda: None  # type: ignore[method-assign]
    empty._stopped = "nothing was tried"
    monkeypatch.setattr("hfa_prove.search.cost.kink_at", lambda plant, at: "a kink")
    with pytest.raises(
        NoSolutionError, match="no lower bound was proved: nothing was tried; a kink"
    ):
        empty.found()


def test_a_fitted_bound_is_just_below_the_exact_cost() -> None:
    """Of a linear plant without active limits, W is at most z'P z and close to (1 - margin) z'P z.

    Each row is the inequality divided by the running cost, or W / c >= 1.02 far out.
    """
    plant, at = plant_of(lambda x, u, p, w: ({"a": x.b, "b": u.u}, {}), -np.inf, np.inf)
    Q, R = np.diag([1.0, 2.0]), np.array([[0.5]])
    half = math.sqrt(0.5)
    b = math.sqrt(2.0 + 2.0 * half)
    exact = np.array([[b, half], [half, b * half]])
    problem = CostProblem(plant, at, Q, R, exact, 4, 0.1)
    z = problem.ball(50, 1.0, np.random.default_rng(0))
    wanted = TargetFlights(z, 1.0 * problem.linear_cost(z), 2.0)
    programs: list[int] = []
    fit = Fit(problem, 1.5, wanted, 1.3, programs.append)
    assert fit._W(z @ fit.M.T) == pytest.approx(0.9 * problem.linear_cost(z))
    v = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 1))
    rows, sides = fit._row(z, v)
    rate = np.sum((0.9 * 2.0 * z @ exact) * np.column_stack([z[:, 1], v]), axis=1)
    running = np.einsum("ki,ij,kj->k", z, Q, z) + 0.5 * v[:, 0] ** 2
    assert rows @ fit._W.coefficients == pytest.approx(rate / running, rel=1e-6, abs=1e-6)
    assert sides == pytest.approx(-(1.0 - 0.6 * 0.1))
    best = fit._best_inputs(z)
    assert best == pytest.approx(-(0.9 * z @ exact[:, 1:]) / 0.5, rel=1e-6)
    W = fit.fitted()
    assert programs
    found = W.at(z @ fit.M.T) / problem.linear_cost(z)
    assert np.all(found <= 1.0)
    assert np.all(found > 0.87)
    count = len(fit._rows)
    inner = np.array([0.2, -0.3])
    fit.refuted(inner)
    assert len(fit._rows) == count + 1
    rows, sides = fit._rows[-1], fit._sides[-1]
    own, side = fit._row(inner[None] @ fit.N.T, fit._best_inputs(inner[None] @ fit.N.T))
    assert len(rows) == 31
    assert (rows[0], sides[0]) == (pytest.approx(own[0]), side[0])
    fit.refuted(np.array([1.0, -0.3]))
    high = fit._W.monomials(np.array([[1.0, -0.3]]))[0] / 1.5
    assert fit._rows[-1][0] == pytest.approx(high)
    assert set(fit._sides[-1].tolist()) == {1.02}
    orthonormal = fit._orthonormal
    values = fit._W.monomials(fit._ball(3000) @ fit.M.T) @ orthonormal
    assert values.T @ values / 3000 == pytest.approx(np.eye(values.shape[1]), abs=0.35)


def boxes_search(degree: int = 4) -> BoxesSearch:
    loop = cubic({"x": (-2.0, 2.0)}).loop
    return BoxesSearch(RegionProblem(loop), Settings(degree, Clock(60.0)))


@pytest.mark.parametrize("highest", [9.0, 0.9, 0.1, 0.0])
def test_the_first_levels_rise_or_are_halved(highest: float) -> None:
    """Shares rise until one fails. If the first fails, it is halved until one is proved."""
    search = boxes_search()
    tried: list[float] = []

    def is_proved(growth: Any, share: float, origin: str, time_share: float) -> bool:
        tried.append(share)
        return share <= highest

    search._is_proved = is_proved  # type: ignore[method-assign]
    search._first_levels(cast(Any, None), "a test")
    first, *rising = region_boxes._RISING
    if highest >= first:
        proved_shares = [share for share in rising if share <= highest]
        failed = rising[len(proved_shares) : len(proved_shares) + 1]
        assert tried == [first, *proved_shares, *failed]
        return
    halved = [first / 2.0**i for i in range(len(tried))]
    assert tried == halved
    end = tried[-1]
    if highest:
        assert end <= highest < 2.0 * end
    else:
        assert end / 2.0 < region_boxes._LEAST <= end


def test_a_later_level_is_tried_if_it_can_be_larger() -> None:
    """Falling shares are tried while their set would be larger than the largest proved one."""
    search = boxes_search()
    tried: list[float] = []
    most = [0.0]

    def is_proved(growth: Any, share: float, origin: str, time_share: float) -> bool:
        tried.append(share)
        return share <= most[0]

    search._is_proved = is_proved  # type: ignore[method-assign]
    growth = cast(Any, SimpleNamespace(shape=SimpleNamespace(size=lambda: 2.0)))
    search._best = cast(Any, "a set")
    falling = region_boxes._FALLING
    for highest, largest, found, shares in (
        (9.0, 0.1, True, falling[:1]),
        (falling[1], 0.1, True, falling[:2]),
        (0.0, 0.1, False, falling),
        (9.0, 2.0 * falling[0], True, ()),  # hardly larger: V grows on without a proof
        (0.0, 1.95 / region_boxes._LARGER, False, falling[:1]),
    ):
        most[0] = highest
        search._largest = largest
        tried.clear()
        assert search._later_level(growth, "a test") is found
        assert tuple(tried) == tuple(shares)
    search._best = None
    search._first_levels = lambda growth, origin: None  # type: ignore[method-assign]
    assert not search._later_level(growth, "a test")


@pytest.mark.parametrize(
    ("degree", "present", "grown"), [(4, 2, [2, 4, 4, 4]), (2, 2, [2, 2, 2]), (4, 4, [4, 4, 4])]
)
def test_sets_grow_with_rising_degree(degree: int, present: int, grown: list[int]) -> None:
    """V grows with degree 2, then with the highest degree, and there with finer decay."""
    search = boxes_search(degree)
    found: list[int] = []
    search._grow = lambda growth, degree: found.append(degree)  # type: ignore[method-assign]
    search._later_level = lambda growth, origin: True  # type: ignore[method-assign]
    finer = iter([True, True, False])
    shape = SimpleNamespace(V=SimpleNamespace(degree=present))
    search._enlarge(cast(Any, SimpleNamespace(shape=shape, finer=lambda: next(finer))))
    assert found == grown


def test_each_first_v_is_proved_and_grown(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search without a set proves first levels. With one, it begins with the V of that set."""
    shape = Shape.of_matrix(np.eye(1), -np.eye(1), 2)
    monkeypatch.setattr(
        region_boxes, "Growth", lambda samples, shape, report: SimpleNamespace(shape=shape)
    )
    for earlier in (None, 0.25):
        search = boxes_search()
        steps: list[tuple[str, float]] = []

        def level(step: str, steps: Any, growth: Any, *others: Any) -> None:
            steps.append((step, float(growth.shape.V.coefficients[0])))

        search._first_shapes = lambda: [("a", shape), ("b", shape.of_level(2.0))]  # type: ignore[method-assign]
        search._first_levels = partial(level, "first", steps)  # type: ignore[method-assign]
        search._enlarge = partial(level, "grown", steps)  # type: ignore[method-assign]
        if earlier is None:
            search._search()
            assert steps == [("first", 1.0), ("grown", 1.0), ("first", 0.5), ("grown", 0.5)]
            continue
        piece = shape.of_level(earlier).piece()
        statement = SimpleNamespace(piece=piece)
        search._best = cast(Any, SimpleNamespace(statement=statement, origin="known"))
        search._search()
        assert steps == [("grown", 4.0), ("grown", 1.0), ("grown", 0.5)]


def test_the_weight_of_a_motion_is_that_of_the_modes() -> None:
    """P is half the identity in the modes of A. A scalar loop may move at 2 A² / |A'|."""
    vectors = np.linalg.eig(J)[1]
    solved = _lyapunov(J, _first_weight(J))
    assert np.allclose(vectors.conj().T @ solved @ vectors, 0.5 * np.eye(2))
    assert np.allclose(J.T @ solved + solved @ J, -_first_weight(J))
    points = [(np.array([[a]]), np.array([[slope]])) for a, slope in ((-1.0, 2.0), (-3.0, 4.0))]
    fastest, W = _weight(points)
    assert fastest == pytest.approx(1.0)
    assert W[0, 0] > 0.0


def test_a_refuted_set_is_changed_and_proved_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The refuted point, in the units of the states, becomes a constraint of the next V."""
    search = boxes_search()
    shape = Shape.of_matrix(4.0 * np.eye(1), -np.eye(1), 2)
    search._part = lambda shape, share: shape  # type: ignore[method-assign]
    places: list[np.ndarray] = []

    def refuted(place: np.ndarray) -> Shape | None:
        places.append(place)
        return shape if len(places) < 3 else None

    growth = cast(Any, SimpleNamespace(shape=shape, refuted=refuted))
    errors: list[Exception] = []

    def prove(part: Shape, origin: str) -> None:
        if errors:
            raise errors.pop(0)

    search._prove = prove  # type: ignore[method-assign]
    errors[:] = [RefutedError("refuted", np.array([0.5]))]
    assert search._is_proved(growth, 0.5, "a test", 0.5)
    assert search._stopped == "no V with a larger set was found"
    assert np.abs(places[0]) == pytest.approx([0.25])
    errors[:] = [SmallestBoxError("small", np.array([0.5])), RefutedError("x", np.array([0.5]))]
    assert not search._is_proved(growth, 0.5, "a test", 0.5)
    assert search._stopped.startswith("V' >= 0 or a limit is exceeded at x ")
    assert search._stopped.endswith("in 0.5 of the set by samples")
    places.clear()
    errors[:] = [OpenBoxError("too many boxes", np.array([0.5]))]
    assert not search._is_proved(growth, 0.25, "a test", 0.5)
    assert search._stopped == "at 0.25 of the set by samples, linearly: too many boxes"
