"""Proofs of gain schedules: closed forms, forgeries of each clause, and what must stay open."""

import copy
import math
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from cli import answer
from flint import arb
from proofs import CONSTANT, FLOAT, certificate, changed, decided, float_equations

import hfa as package
from hfa import BadInputError, Model, NoSolutionError, Signal
from hfa_prove import Family, Gains, prove_schedule
from hfa_prove.certificate import read_content
from hfa_prove.check.schedule import ScheduleProof, check_schedule
from hfa_prove.check.trims import SteadyFlight
from hfa_prove.statements.schedule import ScheduleStatement, ScheduleWitness


def decay(low, high, k=1.0, c=2.9):
    """Return the least decay rate of the float over its scheduling variable, the pull of its spring."""
    pulls = np.linspace(low, high, 2001)
    roots = [np.roots([1.0, 0.1 + c, pull + k]).real.max() for pull in pulls.tolist()]
    return -max(roots)


def proved(low, high, gains=CONSTANT, **more):
    """Return the proof about the float for all pulls from low to high, N/m."""
    return prove_schedule(Family(FLOAT), gains, low, high, **more)


def without_p(pieces=10**3, n=2):
    """Return the witness of a proof of the decay rate alone, which needs no matrix P (n, n)."""
    return ScheduleWitness(pieces, breakpoints=np.zeros(0), P=np.zeros((0, n, n)))


@pytest.fixture
def few_samples(monkeypatch):
    """Let the search evaluate the loop at 21 scheduling values in place of 161, which is faster."""
    monkeypatch.setattr("hfa_prove.search.schedule._SAMPLES", 21)


def test_a_decay_rate_is_proved_to_its_closed_form():
    """99.9 % of the exact decay rate is proved, and 100.1 % is refused at the worst pull. Without a
    given decay rate, 99 % of the exact one is proved.
    """
    exact = decay(1.0, 2.0)
    assert proved(1.0, 2.0, decay_rate=0.999 * exact).statement.decay_rate == 0.999 * exact
    with pytest.raises(NoSolutionError, match="open at pull 1"):
        proved(1.0, 2.0, decay_rate=1.001 * exact)
    assert proved(1.0, 2.0).statement.decay_rate == pytest.approx(0.99 * exact, rel=1e-3)


def in_other_units(depth, heave):
    """Return the float with a depth and a heave in other units, and its gains."""

    def equations(x, u, p, w):
        x = SimpleNamespace(depth=x.depth / depth, heave=x.heave / heave)
        rates, outputs = float_equations(x, u, p, w)
        return {"depth": depth * rates["depth"], "heave": heave * rates["heave"]}, outputs

    states = {"depth": Signal("m", depth), "heave": Signal("m/s", heave)}
    model = replace(FLOAT, states=states, equations=equations, trim={"depth": depth, "heave": 0.0})
    return model, Gains(CONSTANT.breakpoints, CONSTANT.K / np.array([depth, heave]))


def test_proved_rates_do_not_depend_on_units(few_samples):
    """The proved decay rate, and the largest proved rate of the pull, are the same with a depth in mm
    and a heave in km/s.
    """
    found = []
    for units in ((1.0, 1.0), (1e3, 1e-3)):
        model, gains = in_other_units(*units)
        statement = prove_schedule(
            Family(model), gains, 1.0, 1.5, scheduled_rate="largest"
        ).statement
        found.append((statement.decay_rate, statement.scheduled_rate))
    assert found[1] == pytest.approx(found[0], rel=1e-9)


#: K at the pulls 1 and 2.
TABLE = Gains(np.array([1.0, 2.0]), np.array([[[1.0, 2.0]], [[3.0, 4.0]]]))


def test_pulls_beyond_the_table_of_gains_are_refused():
    """No proof extrapolates gains that are given at pulls from 1 to 2 to the pull 2.5."""
    with pytest.raises(BadInputError, match="table of gains covers 1 to 2"):
        proved(1.0, 2.5, TABLE)


def folded(rate, least):
    """Return x' = u² - p - rate(x, u), y' = v - p - y, with the trims u = ±√p, u >= least, v = p."""
    inputs = {"u": Signal("1", 1.0, least, 9.0), "v": Signal("1", 1.0, -9.0, 9.0)}
    return Model(
        "fold", {"x": Signal(), "y": Signal()}, inputs,
        lambda x, u, p, w: ({"x": u.u * u.u - p.p - rate(x.x, u.u), "y": u.v - p.p - x.y}, {}),
        parameters={"p": Signal(start=1.0)}, schedule="p", trim={"x": 0.0, "y": 0.0},
    )  # fmt: skip


#: x' = u² - p - x u, with the branch of trims u = √p alone.
FOLD = folded(lambda x, u: x * u, 0.0)
#: x' = u² - p - x, with both branches of trims u = ±√p.
BOTH = folded(lambda x, u: x, -9.0)


def fold(low, high, model=FOLD):
    """Return the proof of the decay rate 0.5 of a folded model for p from low to high, without gain."""
    flight = Family(model).flight(low, high)
    no_gain = Gains(np.array([1.0]), np.zeros((1, 2, 2)))
    statement = ScheduleStatement(flight, no_gain, decay_rate=0.5)
    return ScheduleProof(statement, without_p(10**4))


def test_a_trim_is_claimed_only_where_krawczyks_test_holds():
    """One piece of trims from p = 0.5 to 0.6 contains u = √p and v = p; from 0.01 to 1, the slope
    2 u of the equation varies too much for the test.
    """
    guess = np.array([0.7, 0.5])
    trims = fold(0.5, 0.6).flight.trims(0.5, 0.6, guess)
    for p in (0.5, 0.55, 0.6):
        u, v = trims.at(p, trims.offset)
        assert u.overlaps(arb(p).sqrt())
        assert v.overlaps(arb(p))
        assert float(u.rad()) < 0.1
    with pytest.raises(NoSolutionError, match="not proved to exist"):
        fold(0.01, 1.0).flight.trims(0.01, 1.0, guess)


def test_a_jump_to_another_branch_is_refused(monkeypatch):
    """A proof about the branch u = -√p of the trims of x' = u² - p - x is verified. It is refused if the
    checker's estimates of the trims jump to the other branch, u = √p, above p = 0.75.
    """
    proof = fold(0.5, 1.0, BOTH)
    assert proof.statement.flight.first["u"] < 0.0
    estimate = SteadyFlight.estimate

    def jumping(flight, guess, s):
        u, v = guess
        return estimate(flight, np.array([u if s < 0.75 else abs(u), v]), s)

    assert check_schedule(proof.statement, proof.witness) > 0
    monkeypatch.setattr(SteadyFlight, "estimate", jumping)
    with pytest.raises(NoSolutionError, match="one branch"):
        check_schedule(proof.statement, proof.witness)


def planar(loop, unit="rad"):
    """Return the aircraft whose loop without gain is x' = C(angle) x, C (2, 2)."""

    def equations(x, u, p, w):
        (aa, ab), (ba, bb) = loop(p.angle)
        rates = {"a": aa * x.a + ab * x.b + u.u, "b": ba * x.a + bb * x.b}
        return {**rates, "c": u.u - x.c}, {}

    states = {name: Signal() for name in "acb"}
    inputs = {"u": Signal("1", 1.0, -1.0, 1.0)}
    trim = dict.fromkeys("abc", 0.0)
    angle = Signal(unit, start=0.0)
    more = {"parameters": {"angle": angle}, "schedule": "angle", "trim": trim}
    return Family(
        Model("plane", states, inputs, equations, linear=("a", "b"), steady=("c",), **more)
    )


NO_GAIN = Gains(np.array([0.0]), np.zeros((1, 1, 2)))


@pytest.mark.parametrize(("unit", "is_proved"), [("rad", True), ("deg", False)])
def test_an_angle_of_the_equations_in_degrees_is_not_converted(unit, is_proved):
    """From 90 to 100 deg, x' = (angle - 2) x is stable if the angle of the equations is in rad, at
    most 1.75, and not if it is in deg, up to 100.
    """
    family = planar(lambda angle: ((angle - 2.0, 0.0), (0.0, -1.0)), unit)
    with decided(is_proved, "not below"):
        assert prove_schedule(family, NO_GAIN, 90.0, 100.0, decay_rate=0.2).size > 0


@pytest.mark.parametrize(("growth", "is_proved"), [(-0.9, True), (1.0, False)])
def test_a_loop_that_switches_on_a_piece_is_refused(growth, is_proved):
    """For x' = -x below s = 0.7 and x' = growth x above, a proof from s = 0 to 1, which contains the jump,
    is refused: bounds by derivatives in s do not hold there. From 0.75, beyond the jump, it is found.
    """
    family = planar(lambda s: ((ca.if_else(s > 0.7, growth, -1.0), 0.0), (0.0, -1.0)))
    low = 0.75 if is_proved else 0.0
    ends = math.degrees(low), math.degrees(1.0)
    statement = ScheduleStatement(family.flight(*ends), NO_GAIN, decay_rate=0.5)
    with decided(is_proved, "switches"):
        assert check_schedule(statement, without_p()) > 0


@pytest.mark.parametrize(
    ("ends", "weights", "is_proved"),
    [
        ((0.0, 2.0), (1.0, 1.0), True),
        ((0.0, 2.0), (9.0, 1.0), False),
        ((0.0, 2.0), (1.0, 1.0, 9.0), False),
        ((0.0, 2.0), (9.0, 1.0, 1.0), False),
        ((0.0, 0.5), (9.5, 1.0), True),
        ((0.0, 0.5), (10.2, 1.0), False),
        ((0.0, 0.5), (1.0, 2.5), True),
        ((0.0, 0.5), (1.0, 2.7), False),
        ((-0.5, 0.0), (2.5, 1.0), True),
        ((-0.5, 0.0), (2.7, 1.0), False),
        ((-0.1, 0.1), (9.0,), True),  # for |s| < 3 / 16 alone
        ((-0.3, 0.1), (9.0,), False),
        ((-0.1, 0.3), (9.0,), False),
    ],
)
def test_v_decreases_between_the_ends_and_breakpoints(ends, weights, is_proved):
    """V = a² + p b², with p linear in s between `weights`, decreases under a' = -a - 4 s b and
    b' = 4 s a - b, where V' = -2 (a² + p b²) + 8 s (p - 1) a b, if p > 4 s² (p - 1)².

    From 9 to 1 it fails at s = 1 (p = 5), from 10.2 to 1 between 0.28 and 0.33 alone, and from 1 to
    2.7 at the end alone.
    """
    turn = planar(lambda s: ((-1.0, -4.0 * s), (4.0 * s, -1.0)))
    low, high = map(math.degrees, ends)
    flight = turn.flight(low, high)
    # All eigenvalues have the real part -1.
    statement = ScheduleStatement(flight, NO_GAIN, decay_rate=0.9, scheduled_rate=0.1)
    P = np.array([np.diag([1.0, weight]) for weight in weights])
    witness = ScheduleWitness(10**3, np.linspace(low, high, len(weights)), P)
    places = np.linspace(*ends, 1001)
    p = np.interp(places, np.linspace(*ends, len(weights)), weights)
    assert bool(np.all(p > 4.0 * places**2 * (p - 1.0) ** 2)) == is_proved
    with decided(is_proved, "motion"):
        assert check_schedule(statement, witness) > 0


@pytest.fixture(scope="module")
def content():
    """Return the content of a certificate of the float, with V for a moving pull."""
    found = proved(1.0, 2.0, scheduled_rate="largest")
    assert found.statement.scheduled_rate == math.inf
    return certificate(found.statement, found.witness.content())


def checked(content, model=FLOAT):
    """Return the number of pieces of the proof of a certificate."""
    return check_schedule(*read_content(content, model))


_FLIGHT = "statement__flight"
_MODEL = f"{_FLIGHT}__model"
_LIFT = f"{_FLIGHT}__limits__lift"
_P, _P_AT = "witness__P", "witness__breakpoints"
_K, _GAINS_AT = "statement__gains__K", "statement__gains__breakpoints"
#: Changes of the certificate, and what the clause says that refuses it.
FORGED = [
    ({"statement__decay_rate": 1.01}, "not below"),
    ({"statement__decay_rate": 1.0 + 1e-12}, "not proved"),
    ({_K: [[[0.0, -0.2]]]}, "not below"),
    ({_K: [[[1.0, -2.9]]]}, "not below"),
    ({f"{_FLIGHT}__parameters__drag": -2.0}, "not below"),
    ({f"{_FLIGHT}__parameters__drag": -9.5}, "drag beyond the model's limits"),
    ({f"{_FLIGHT}__range": [1.0, 4.5]}, "open at pull"),
    ({_LIFT: [-9.0, 1.5]}, "lift is not proved"),
    ({_LIFT: [1.5, 4.0]}, "lift is not proved"),
    ({f"{_FLIGHT}__limits__load": [-9.0, 0.8]}, "load is not proved"),
    ({_LIFT: [-9.0, 5.0]}, "beyond the model's"),
    ({_LIFT: [-10.0, 4.0]}, "beyond the model's"),
    ({f"{_FLIGHT}__limits": {"lift": [-9.0, 4.0]}}, "limits: load"),
    ({f"{_FLIGHT}__limits__depth": [-9.0, 0.5]}, "depth beyond"),
    ({f"{_FLIGHT}__limits__depth": [1.5, 9.0]}, "depth beyond"),
    ({f"{_FLIGHT}__first__lift": 1.1}, "differs from the stated"),
    ({f"{_FLIGHT}__imposed__depth": 2.0}, "differs from the stated"),
    (
        {f"{_FLIGHT}__imposed": {"heave": 0.0}, f"{_FLIGHT}__first": {"depth": 1.0, "lift": 1.0}},
        "as many trim equations",
    ),
    (
        {f"{_FLIGHT}__imposed": {"depth": 1.0, "heave": 0.0, "lift": 1.0}, f"{_FLIGHT}__first": {}},
        "invalid entry: imposed",
    ),
    ({f"{_FLIGHT}__imposed__heave": 0.1}, "no values of the free"),
    # The pull is the scheduling variable, which has no imposed value.
    ({f"{_FLIGHT}__imposed__pull": 1.0}, "imposed: unknown entry"),
    *(
        ({_P: [P]}, "positive definite")
        for P in ([[1.0, 0.0], [0.0, -1.0]], [[1.0, 1.0], [1.0, 1.0]], [[0.0, 0.0], [0.0, 0.0]])
    ),
    ({_P: [[[1.0, 0.0], [0.0, 1.0]]]}, "motion"),
    ({_P: lambda P: np.add(P, [[0.0, 1e-6], [-1e-6, 0.0]]).tolist()}, "not symmetric"),
    ({_P_AT: []}, "breakpoints"),
    *(
        ({_P_AT: at, _P: lambda P, at=at: P[:1] * len(at)}, "breakpoints")
        for at in ([1.0, 1.8, 1.5, 2.0], [1.0, 1.0, 2.0])
    ),
    ({"witness__pieces": 1}, "open at pull"),
    ({f"{_MODEL}__dynamics": "newton"}, "with other equations"),
    ({f"{_MODEL}__equations": "0" * 64}, "with other equations"),
    ({f"{_MODEL}__nominal__0": 2.0}, "model: nominal"),
    ({f"{_MODEL}__state_units__0": "ft"}, "model: state_units"),
    ({"claim": 1.0}, "unknown entry"),
    *(
        ({_GAINS_AT: at, _K: [[[1.0, 2.9]]] * len(at)}, "breakpoints")
        for at in ([1.0, 1.5], [1.5, 2.0], [1.0, 1.8, 1.5, 2.0], [1.0, 1.0, 2.0])
    ),
]


@pytest.mark.parametrize(("changes", "said"), FORGED)
def test_each_clause_refuses_its_forgery(changes, said, content):
    """The certificate of the float, `content`, is verified. After each change in `FORGED`, it is refused
    by the clause whose words are listed beside the change.
    """
    assert checked(copy.deepcopy(content)) > 0
    with pytest.raises((NoSolutionError, BadInputError), match=said):
        checked(changed(content, **changes))


def game_at(degrees):
    """Return the paper's game at a dihedral angle."""
    point = package.trim(package.aircraft(), dihedral=np.radians(degrees))
    return package.paper.published_game(point.linearize())


@pytest.mark.slow
def test_the_command_proves_writes_and_checks(folder):
    """The paper's gains from 14 to 15 deg are proved for any rate of the angle, with at least 98 % of the
    decay rate of the eigenvalues at five angles. A table of these gains gives the same claim.

    --check verifies both certificates, the first also against the user's Q.
    """
    words = ("prove", "schedule", "--dihedral", "14:15")
    found = answer(*words, "--rate", "-o", "proof.json")
    assert found["scheduled_rate"] == "inf"
    Q = ",".join(f"{value:.17g}" for value in np.diag(game_at(14.0).Q))
    again = answer(
        "prove", "--check", "proof.json", "--dihedral", "14:15", "--dynamics", "published", "--Q", Q
    )
    assert again["not_given"] == []
    assert again["claim"] == found["claim"]
    claim = found["claim"]["gains"]
    first, last = np.array(claim["K"])
    decays = []
    for angle in np.linspace(14.0, 15.0, 5).tolist():
        game = game_at(angle)
        loop = game.A - game.B @ (first + (angle - 14.0) * (last - first))
        decays.append(-np.linalg.eigvals(loop).real.max())
    assert 0.98 * min(decays) < found["decay_rate"] < min(decays)
    np.savez("table.npz", dihedral_deg=claim["breakpoints"], K=claim["K"])
    own = answer(*words, "--weights", "table.npz", "--decay", "0.35", "-o", "own.json")
    assert own["claim"]["gains"] == claim
    answer("prove", "--check", "own.json", "--weights", "table.npz")
