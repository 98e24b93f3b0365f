"""The mistake in a wrong critic, where its numbers identify one.

A repair is a guess from the critic's own numbers. Another game (another δ, Q, R, discount, time step, matrices or
dihedral angle) is found by a search along one parameter, and solved. A mistake is named only when the repaired critic,
or the answer of the other game, is the exact one but for a part of the error. A network is judged by its derivatives at
the origin and by the quadratic V and linear u nearest to it over the box; none is exact, so this part is larger.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.game.basis import Basis
from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units, spectrum
from controller.riccati.certificate import relative_residual
from controller.riccati.discrete import quick_discounted, sampled
from controller.riccati.gare import GameSolution, solve_game
from controller.riccati.gare_schur import quick_solution
from controller.riccati.smallest_delta import minimum_delta
from hfa_model.printed_matrices import published_models
from hfa_support.errors import BadInputError, NoSolutionError
from verification.critic.candidate import Candidate
from verification.critic.critic_errors import SMALL, relative_error, value_errors

#: A cause must explain the error down to this part of it, and is named before others that explain up to so many times
#: more. Noise in tens of entries cannot be explained by one number.
EXPLAINED, AS_GOOD = 1e-3, 10.0
#: The same of a network, and the least error that asks for a cause.
OF_NETWORKS: dict[str, Any] = {"explained": 0.15, "as_good": 1.5, "least": 0.03}
#: A repair with a fitted number, or one for each state, explains more by chance: so many times what it leaves counts. A
#: network's mistake that leaves less than `CLEAR` is not sought among other games.
FITTED, CLEAR = {"every entry": 10.0, "scaled by": 5.0}, 0.05
#: A network whose P is this near is taken for right, and its policy for wrong from there on.
NEAR, FAR = 0.1, 0.3
#: A residual below this marks a root of the Riccati equation, if not the right one.
_ROOT = 1e-9
#: A factor this near to a power of ten, in decades, is that power.
_NEAR = 1e-3
_DEGREES = 180.0 / math.pi
_NOT_TOGETHER = "K is not R⁻¹B'P: the stored K and P do not belong together, or not to this plant and R"
#: Numbers of a critic beyond the one that is solved for; one alone would fit by chance.
_REDUNDANT = 2
#: Where a search along one parameter begins: factors of its value in the game, and angles in degrees (none at 0, where
#: the matrices of the aircraft are stationary).
_FACTORS = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)
_ANGLES = (1.0, 3.0, 5.0, 8.0, 12.0, 16.0, 20.0)
_TIMES = (1e-3, 1e-2, 5e-2, 0.2, 1.0)
#: Steps of time with which a discount is sought, s.
_USUAL = (0.01, 0.02, 0.05, 0.1)
_STEPS, _STEP = 30, 1e-5
#: Where there is no game, as a difference: so many times that of the start.
_NO_GAME = 1e3
#: A search must take the difference down to this part of the best start's, or to rounding.
_REACHED, _ROUNDING = 0.1, 1e-9
#: Below this part of the error a polynomial is the LQR; above it, a game that is like it would look the same.
_SAME = 1e-6
#: States at which a network is fitted over the box.
_SAMPLES = 2000
GameAt = Callable[[float], Game]


class Answer(NamedTuple):
    """P (n, n), None where only a gain is known, and K (m, n)."""

    P: np.ndarray | None
    K: np.ndarray


class _Family(NamedTuple):
    """Games along one parameter: what differs, with the value of the parameter in it; the answer; starts of a
    search."""

    said: str
    value: Callable[[float], float]
    answer: Callable[[float], Answer]
    starts: list[float]


#: The mistake in words, and P (n, n) or K (m, n) without it.
Repair = tuple[str, np.ndarray]


@dataclass(frozen=True)
class _Judge:
    """What a critic is compared with. weights: of the entries of P (n, n) and of K (m, n), in which errors are sizes.
    explained, as_good, least: see `EXPLAINED`. families: of `_families`."""

    game: Game
    exact: GameSolution
    weights: Answer
    families: list[_Family]
    explained: float = EXPLAINED
    as_good: float = AS_GOOD
    least: float = 0.0

    def value_error(self, P: np.ndarray) -> float:
        """|P - exact| / |exact|, Frobenius norms."""
        return relative_error(P * self.weights.P, self.exact.P * self.weights.P)

    def gain_error(self, K: np.ndarray) -> float:
        """|K - exact| / |exact|, Frobenius norms."""
        return relative_error(K * self.weights.K, self.exact.K * self.weights.K)

    def named(
        self, repairs: Iterable[Repair], error: Callable[[np.ndarray], float], before: float
    ) -> tuple[float, str]:
        """The part of the error before that the best mistake leaves, and its name: the first that is about as good;
        (inf, "") where none explains enough."""
        before = min(before, 1.0)

        def chance(said: str) -> float:
            return max((by for words, by in FITTED.items() if words in said and self.least), default=1.0)

        left = [(error(matrix) / before * chance(said), said) for said, matrix in repairs] if before > 0.0 else []
        best = min((each for each, _ in left), default=math.inf)
        if not best <= (self.explained if before > self.least else EXPLAINED):
            return math.inf, ""
        return best, next(said for each, said in left if each <= max(self.as_good * best, _ROUNDING / before))

    def repaired_gain(self, K: np.ndarray, more: Iterable[Repair] = ()) -> tuple[float, str]:
        """`named` of the mistakes of a gain."""
        repairs = itertools.chain(repairs_of_gain(self.game, K, self.exact.K, self.weights.K), more)
        return self.named(repairs, self.gain_error, self.gain_error(K))

    def another_game(self, P: np.ndarray | None, K: np.ndarray) -> tuple[float, str]:
        """`named` of the games whose solution P (n, n) may be, or without it whose gain K. Of a polynomial that is near
        the LQR's, another game must explain what the LQR leaves."""
        what, error, given = ("gain", self.gain_error, K) if P is None else ("solution", self.value_error, P)
        exact, before = self.exact.K if P is None else self.exact.P, error(given)
        found = [
            (f"this is the {said.format(what)}", given - matrix + exact)
            for said, other in _other_games(self, P, K)
            if (matrix := other.K if P is None else other.P) is not None
        ]
        if found and "LQR" in found[0][0] and self.explained == EXPLAINED:
            lqr = error(found[0][1])
            if lqr > _SAME * before:
                found, before = found[1:], min(lqr, before)
        best = self.named(found, error, before)
        if best[1] or self.least or not self.families or "a step" in self.families[0].said:
            return best
        return replace(self, families=_in_discounted_steps(self.game)).another_game(P, K)


def diagnose(
    game: Game,
    exact: GameSolution,
    candidate: Candidate,
    limit: float,
    at_dihedral: GameAt | None = None,
    box: np.ndarray | None = None,
) -> str:
    """One sentence that names the mistake which this critic makes, or "" when none is recognized.

    limit: of the errors. at_dihedral: degrees -> the game there, to recognize a critic of another angle. box: (n,),
    half widths of the box of states, of a network.
    """
    families = _families(game, candidate.K, at_dihedral)
    about, units = candidate.nonlinear, balanced_units(game)
    if about is not None and about.z is not None and box is not None:
        return _of_network(game, exact, candidate, box, families)
    weights = Answer(np.outer(units, units), np.outer(np.sqrt(np.diag(game.R)), units))
    judge = _Judge(game, exact, weights, families)
    P, K = candidate.P, candidate.K
    if P is None:
        return judge.repaired_gain(K)[1] or judge.another_game(None, K)[1]
    together = judge.gain_error(K + exact.K - game.gain(P)) <= limit
    if all(check.ok for check in value_errors(game, P, exact.P, limit)):
        beyond = candidate.functions.quadratic_size
        if candidate.weights is not None and candidate.weights[beyond:].any():
            place = beyond + int(np.argmax(np.abs(candidate.weights[beyond:])))
            return (
                f"weight {place + 1} is {candidate.weights[place]:.6g}: on a linear plant the value is quadratic, and "
                "every weight beyond the quadratic ones must be 0"
            )
        return judge.repaired_gain(K)[1] or ("" if together else _NOT_TOGETHER)
    if relative_error(P, P.T) > limit:
        return "P is not symmetric: the value z'Pz depends on (P + P')/2 alone"
    P = (P + P.T) / 2.0
    repairs = repairs_of_value(P, exact.P, np.outer(units, units))
    if candidate.weights is not None:
        repairs = itertools.chain(repairs_of_weights(candidate.weights, exact.P, candidate.functions), repairs)
    _, named = judge.named(repairs, judge.value_error, judge.value_error(P))
    if named:
        return named
    found = judge.another_game(P, K)[1]
    if not together:
        both = found and found.replace("solution", "gain") == judge.another_game(None, K)[1]
        return found.replace("solution", "solution and gain") if both else _NOT_TOGETHER
    return found or _another_root(game, P)


def repaired(game: Game, P: np.ndarray, K: np.ndarray, candidate: Candidate) -> str:
    """The mistake of a critic whose right answer is P and K, of whatever problem: that of its value, else of its gain,
    else that it is the answer in continuous time; or ""."""
    exact, units = solve_game(game), balanced_units(game)
    weights = Answer(np.outer(units, units), np.outer(np.sqrt(np.diag(game.R)), units))
    judge = _Judge(game, replace(exact, P=P, K=K), weights, [])
    continuous = "this is the {} in continuous time, without discount"
    if candidate.P is None:
        more = [(continuous.format("gain"), candidate.K - exact.K + K)]
        return judge.repaired_gain(candidate.K, more)[1]
    V = (candidate.P + candidate.P.T) / 2.0
    repairs = itertools.chain(
        repairs_of_value(V, P, np.outer(units, units)), [(continuous.format("solution"), V - exact.P + P)]
    )
    return judge.named(repairs, judge.value_error, judge.value_error(V))[1]


def _of_network(game: Game, exact: GameSolution, candidate: Candidate, box: np.ndarray, families: list[_Family]) -> str:
    """The mistake that explains most, of the network at the origin or over the box. V counts by its size in the box, or
    each state alike; slopes and inputs count by the size of each in the box."""
    about = candidate.nonlinear
    assert about is not None

    def views(of: Candidate) -> list[Answer]:
        return [Answer(of.P, of.K), fitted(game, of, box)]

    def rows(matrix: np.ndarray) -> np.ndarray:
        sizes = np.linalg.norm(matrix * box, axis=1, keepdims=True)
        return box / np.maximum(sizes, SMALL * sizes.max())

    seen = views(candidate)
    diagonal = 1.0 / np.sqrt(np.maximum(np.diag(exact.P), SMALL * np.diag(exact.P).max()))
    sizes = [np.outer(box, box), rows(exact.P) if about.V is None else np.outer(diagonal, diagonal)]
    judges = [_Judge(game, exact, Answer(each, rows(exact.K)), families, **OF_NETWORKS) for each in sizes]
    at_zero = seen[0].P
    origin = 0.0 if at_zero is None else judges[0].value_error(at_zero)
    if max(origin, 0.0 if about.u is None else judges[0].gain_error(seen[0].K)) <= SMALL:
        return "it is right at the origin and wrong away from it"
    named = [(math.inf, "")]
    for (P, K), judge in itertools.product(seen, judges):
        if P is not None:
            V, slopes = (P + P.T) / 2.0, _repairs_of_map(P, exact.P, judge.weights.P, ("slope", "state"))
            repairs = itertools.chain(repairs_of_value(V, exact.P, judge.weights.P), slopes if about.V is None else ())
            named.append(judge.named(repairs, judge.value_error, judge.value_error(P)))
        if about.u is not None:
            named.append(judge.repaired_gain(K))
    P, K = seen[1]
    off, away = judges[0].gain_error(K), math.inf if P is None else judges[0].value_error(P)
    quiet = relative_error(seen[0].K, K) <= EXPLAINED  # a network without noise, whose small errors have a cause too
    wrong = quiet or (off if P is None or about.u is not None else away) > judges[0].least / 3.0
    if wrong and min(named)[0] > CLEAR:
        for said, read in about.variants.items():
            for given, other in zip(seen, views(read()), strict=True):
                if given.P is None or other.P is None:
                    error: Any = judges[0].gain_error
                    before, matrix = error(given.K), other.K
                else:
                    error = judges[0].value_error
                    before, matrix = error(given.P), other.P
                named.append(judges[0].named([(said, matrix)], error, before))
    if wrong and min(named)[0] > CLEAR:
        P, K = seen[1]
        named += [judge.another_game((P + P.T) / 2.0, K) for judge in judges if P is not None]
        named += [judge.another_game(None, K) for judge in judges[:1] if about.u is not None]
    if away <= NEAR and about.u is None and off > FAR:
        hidden = f"V is near and its policy off by {off:.2g}: u = -½ R⁻¹B'∂V/∂z amplifies what V hardly shows"
        named.append((judges[0].explained, hidden))
    return min(named)[1]


def fitted(game: Game, candidate: Candidate, box: np.ndarray) -> Answer:
    """The quadratic V and the linear u nearest to a network over the box, by least squares, without what is constant
    and, of V, linear."""
    about = candidate.nonlinear
    assert about is not None
    z = np.random.default_rng(2).uniform(-1.0, 1.0, (_SAMPLES, len(box)))
    shown = [each for each in (about.V, about.F, about.u) if each is not None]
    sampled = ca.Function("sampled", [about.z], [ca.densify(ca.vertcat(*shown))])((z * box).T)
    values, ones = np.nan_to_num(np.array(sampled).T, posinf=0.0, neginf=0.0), np.ones((_SAMPLES, 1))
    linear = np.linalg.lstsq(np.hstack([z, ones]), values, rcond=None)[0][:-1].T / box
    if about.F is None:
        return Answer(None, -linear)
    if about.V is None:
        P = linear[: len(box)] / 2.0
    else:
        functions = candidate.functions
        terms = np.hstack([functions.psi(z), z, ones])
        P = functions.matrix(np.linalg.lstsq(terms, values[:, 0], rcond=None)[0]) / np.outer(box, box)
    return Answer(P, game.gain(P) if about.u is None else -linear[-about.u.numel() :])


def repairs_of_weights(weights: np.ndarray, exact: np.ndarray, functions: Basis) -> Iterator[Repair]:
    """Products z_i z_j column by column, without their factor 2, or two in each other's place; weights: (M,)."""
    row, column = np.triu_indices(functions.states)
    given, known = (each[: functions.quadratic_size] for each in (weights, functions.weights(exact)))
    twice, placed = np.where(row == column, 1.0, 2.0), np.empty_like(given)
    placed[np.lexsort((row, column))] = given
    by_column, lack = "stand column by column", "lack the factor 2 of products z_i z_j"
    yield f"the weights {by_column}; they must go row by row, i <= j", functions.matrix(placed)
    yield f"the weights {lack}; they are 2 P_ij", functions.matrix(twice * given)
    yield f"the weights {by_column} and {lack}; they must go row by row, i <= j", functions.matrix(twice * placed)
    wrong = np.sort(np.argsort(np.abs(given - known), kind="stable")[-2:])
    if len(given) > 1:
        swapped = given.copy()
        swapped[wrong] = given[wrong[::-1]]
        yield f"weights {wrong[0] + 1} and {wrong[1] + 1} are interchanged", functions.matrix(swapped)


def repairs_of_value(P: np.ndarray, exact: np.ndarray, weights: np.ndarray) -> Iterator[Repair]:
    """Of a symmetric P, (n, n): sign, factor, factor 2 off the diagonal; order, signs, degrees, scales of states."""
    yield "the value has the wrong sign", -P
    yield "the value is half the exact one: V here is z'Pz of the cost without a factor 1/2", 2.0 * P
    yield "the value is twice the exact one: V here is z'Pz of the cost without a factor 2", P / 2.0
    yield from _one_factor("P", P, exact, weights, int(np.count_nonzero(np.triu(exact))))
    off = np.where(np.eye(len(P), dtype=bool), 1.0, 0.5)
    yield "P has entries beside the diagonal of twice their size: they are W / 2", P * off
    order = _order(P, exact, weights)
    yield f"the states are in the order {_listed(order)}", _placed(_placed(P, order).T, order).T
    row = int(np.argmax(np.diag(exact)))
    flipped = P[row] * exact[row] < 0.0
    signs = np.where(~flipped if 2 * flipped.sum() > len(P) else flipped, -1.0, 1.0)
    if (signs < 0.0).any():
        yield f"{_named('state', signs < 0.0)} of the other sign", P * np.outer(signs, signs)
    with np.errstate(divide="ignore", invalid="ignore"):
        factors = np.sqrt(np.diag(P) / np.diag(exact))
    for said, units in _degrees("state", factors, 1.0 / _DEGREES):
        yield said, P / np.outer(units, units)
    if len(P) > _REDUNDANT and np.all(np.isfinite(factors) & (factors > 0.0)):
        for place in np.tile(np.arange(len(P)), 5):  # each by least squares, the others as they are
            row = exact[place] * factors
            factors[place] = abs(float(P[place] @ row / (row @ row)))
        yield f"the states look scaled {_by(factors)}", P / np.outer(factors, factors)


def repairs_of_gain(game: Game, K: np.ndarray, exact: np.ndarray, weights: np.ndarray) -> Iterator[Repair]:
    """Of K, (m, n): sign, factor, R⁻¹, transposition, order, signs, degrees and scales of inputs and states."""
    m, n = K.shape
    yield "the gain has the wrong sign: the policy is u = -K z", -K
    yield "the gain is half the exact one", 2.0 * K
    yield "the gain is twice the exact one", K / 2.0
    if m == n:
        yield "K is transposed", K.T
    yield "R⁻¹ is missing: this is B'P, and K is R⁻¹B'P", np.linalg.solve(game.R, K)
    yield from _one_factor("K", K, exact, weights, int(np.count_nonzero(exact)))
    yield "K was read row by row, its entries stand column by column", K.reshape(n, m).T
    yield from _repairs_of_map(K, exact, weights, ("input", "state"))


def _repairs_of_map(K: np.ndarray, exact: np.ndarray, weights: np.ndarray, kinds: tuple[str, str]) -> Iterator[Repair]:
    """Order, signs, degrees and scales of what the rows of a matrix are, and of what its columns are."""
    for kind, axis, degree in ((kinds[0], 1, _DEGREES), (kinds[1], 0, 1.0 / _DEGREES)):
        order = _matched(K, exact, weights) if axis else _matched(K.T, exact.T, weights.T)
        placed = _placed(K, order) if axis else _placed(K.T, order).T
        yield f"the {kind}s are in the order {_listed(order)}", placed
        with np.errstate(divide="ignore", invalid="ignore"):
            factors = np.sum(K * exact * weights**2, axis=axis) / np.sum((exact * weights) ** 2, axis=axis)
        flipped = factors < 0.0
        if flipped.any() and not flipped.all():
            verb = "has" if flipped.sum() == 1 else "have"
            said = _named(kind, flipped).rpartition(" ")[0]
            signs = np.expand_dims(np.where(flipped, -1.0, 1.0), axis)
            yield f"{said} {verb} the wrong sign", K * signs
        for said, units in _degrees(kind, factors, degree):
            yield said, K / np.expand_dims(units, axis)
        if min(K.shape) > 1 and np.all(np.isfinite(factors) & (factors > 0.0)):
            yield f"the {kind}s look scaled {_by(factors)}", K / np.expand_dims(factors, axis)


def _by(factors: np.ndarray) -> str:
    return f"by {', '.join(f'{each:.3g}' for each in factors)}"


def _one_factor(name: str, matrix: np.ndarray, exact: np.ndarray, weights: np.ndarray, known: int) -> Iterator[Repair]:
    """The factor that least squares give, where enough of the known numbers test it."""
    factor = float(np.sum(matrix * exact * weights**2) / (np.sum((exact * weights) ** 2) or 1.0))
    if not (math.isfinite(factor) and factor != 0.0):
        return
    decades = math.log10(abs(factor))
    if factor > 0.0 and round(decades) and abs(decades - round(decades)) < _NEAR:
        factor = 10.0 ** round(decades)
    elif known < 1 + _REDUNDANT:
        return
    yield f"every entry of {name} is {factor:.6g} times the exact one", matrix / factor


def _degrees(kind: str, factors: np.ndarray, degree: float) -> Iterator[tuple[str, np.ndarray]]:
    """Some states or inputs, not all, in degrees: the mistake, and the factors (n,) that remove it.

    factors: of each state or input, as they look. degree: what one in degrees has.
    """
    angles = np.abs(np.log(np.abs(np.where(factors == 0.0, np.nan, factors)) / degree)) < 1.5
    if angles.any() and not angles.all():
        yield f"{_named(kind, angles)} in degrees", np.where(angles, degree, 1.0)


def _another_root(game: Game, P: np.ndarray) -> str:
    units = balanced_units(game)
    residual = relative_residual(in_units(game, units), P * np.outer(units, units))
    abscissa = spectrum(game.A - game.S @ P).abscissa
    if residual > _ROOT or abscissa < 0.0:
        return ""
    return (
        f"this is another root of the Riccati equation: its residual is {residual:.2g}, but A - S P is not Hurwitz "
        f"(abscissa {abscissa:+.3g} 1/s)"
    )


def _families(game: Game, K: np.ndarray, at: GameAt | None) -> list[_Family]:
    """Games with another delta, with Q or R scaled, at another angle, with a discount, in discrete time."""
    logs, times = (list(map(math.log, each)) for each in (_FACTORS, _TIMES))
    size = game.delta if math.isfinite(game.delta) else minimum_delta(game).value
    lqr = game.with_delta(math.inf)

    def delta(x: float) -> float:  # P and K are smooth in x = 1/δ², relative
        return size / math.sqrt(x)

    def scaled(name: str) -> GameAt:
        return lambda x: replace(game, **{name: math.exp(x) * getattr(game, name)})

    def of(game_at: GameAt) -> Callable[[float], Answer]:
        return lru_cache(lambda x: _answer(game_at(x)))

    def in_steps(other: Game, *, whole: bool = False) -> Callable[[float], Answer]:
        return lru_cache(lambda x: held(other, math.exp(x), whole=whole))

    step = "in discrete time, a step of {:.4g} s"
    return [
        _Family("at delta = {:.4g}", delta, of(lambda x: game.with_delta(delta(x))), list(_FACTORS) * (size > 0.0)),
        _Family("with Q {:.4g} times as large", math.exp, of(scaled("Q")), logs),
        _Family("with R {:.4g} times as large", math.exp, of(scaled("R")), logs),
        *([_Family("at dihedral {:.4f} deg", float, of(at), list(_ANGLES))] if at is not None else ()),
        _Family("with a discount of {:.4g} 1/s", math.exp, of(lambda x: discounted(game, math.exp(x))), logs),
        _Family(step, math.exp, in_steps(game), times),
        _Family(f"{step} and its whole cost", math.exp, in_steps(game, whole=True), times),
        _Family(f"of the LQR {step}", math.exp, in_steps(lqr), times * math.isfinite(game.delta)),
    ]


def _answer(game: Game) -> Answer:
    P = quick_solution(game)
    return Answer(P, game.gain(P))


def _other_games(judge: _Judge, P: np.ndarray | None, K: np.ndarray) -> Iterator[tuple[str, Answer]]:
    """The LQR, the games of matrices printed for the aircraft, and of each family the one whose answer is nearest: what
    differs, and the answer."""
    game = judge.game
    fixed = {f"LQR {{}} (delta = inf), not the game's at delta = {game.delta:.6g}": game.with_delta(math.inf)}
    fixed = fixed if math.isfinite(game.delta) else {}
    if any("dihedral" in family.said for family in judge.families):
        printed = [each for each in published_models() if each.B.shape == game.B.shape]
        said = "{{}} of another game, of the matrices printed for {:g} deg"
        fixed |= {said.format(each.dihedral_deg): replace(game, A=each.A, B=each.B) for each in printed}
    for name, other in fixed.items():
        with contextlib.suppress(NoSolutionError):
            yield name, _answer(other)
    few = np.count_nonzero(judge.exact.K if P is None else np.triu(judge.exact.P)) <= _REDUNDANT
    for family in judge.families[: 0 if few else None]:  # a few numbers fit many games
        found = _searched(judge, family, P, K)
        if found is not None:
            yield f"{{}} of another game, {family.said.format(family.value(found))}", family.answer(found)


def discounted(game: Game, rate: float) -> Game:
    """The game whose P is that of ∫ e^(-rate t) (z'Qz + u'Ru - δ² d'd) dt; rate: 1/s."""
    return replace(game, A=game.A - 0.5 * rate * np.eye(len(game.A)))


def _in_discounted_steps(game: Game) -> list[_Family]:
    """Games in discrete time with a discount, at the usual steps of time."""

    def of(step: float, *, whole: bool) -> Callable[[float], Answer]:
        return lru_cache(lambda x: held(game, step, math.exp(-math.exp(x) * step), whole=whole))

    def factor(step: float) -> Callable[[float], float]:
        return lambda x: math.exp(-math.exp(x) * step)

    said, starts = (
        "in discrete time, a step of {:g} s{}, with a discount of {{:.4g}} a step",
        list(map(math.log, (0.3, 3.0))),
    )
    return [
        _Family(said.format(step, " and its whole cost" * whole), factor(step), of(step, whole=whole), starts)
        for step, whole in itertools.product(_USUAL, (False, True))
    ]


def held(game: Game, step: float, discount: float = 1.0, *, whole: bool = False) -> Answer:
    """The answer with u and d held over each step, s; discount: of a step; whole: its cost is not multiplied by its
    length."""
    one, root = sampled(game, step), math.sqrt(discount)
    P, K = quick_discounted(replace(one, A=root * one.A, B=root * one.B, E=root * one.E))
    return Answer(P / step if whole else P, K)


def _searched(judge: _Judge, family: _Family, P: np.ndarray | None, K: np.ndarray) -> float | None:
    """The parameter at which the answer differs least from P, or without it from K, by least squares.

    It lies between the starts or as far beyond them. None when the difference does not fall to `_REACHED` of the best
    start's.
    """
    from scipy.optimize import least_squares

    def difference(parameter: float) -> np.ndarray | None:
        try:
            with np.errstate(divide="raise", invalid="raise"):
                found = family.answer(parameter)
                if P is None or found.P is None:
                    away, size = (found.K - K) * judge.weights.K, found.K * judge.weights.K
                else:
                    away, size = (found.P - P) * judge.weights.P, found.P * judge.weights.P
                return np.ravel(away / np.linalg.norm(size))
        except (NoSolutionError, BadInputError, ValueError, ArithmeticError):  # no such game
            return None

    tried = [(float(np.linalg.norm(found)), at, found) for at in family.starts if (found := difference(at)) is not None]
    if not tried:
        return None
    first, start, there = min(tried, key=lambda each: each[0])
    nowhere = np.full_like(there, _NO_GAME * max(first, _ROUNDING))
    starts = family.starts
    ends = 2.0 * min(starts) - max(starts), 2.0 * max(starts) - min(starts)
    found = least_squares(
        lambda at: nowhere if (here := difference(float(at[0]))) is None else here,
        [start],
        bounds=ends,
        ftol=0.1,
        xtol=1e-14,
        gtol=1e-15,
        diff_step=_STEP,
        max_nfev=_STEPS,
    )
    left = float(np.linalg.norm(found.fun))
    return float(found.x[0]) if left <= max(_REACHED * first, judge.explained, _ROUNDING) else None


def _matched(given: np.ndarray, exact: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """order in which the rows given[i] are most like exact[order[i]]."""
    from scipy.optimize import linear_sum_assignment

    away = np.sum(((given[:, None] - exact[None]) * weights[None]) ** 2, axis=-1)
    return np.asarray(linear_sum_assignment(np.nan_to_num(away, nan=1e300, posinf=1e300))[1])


def _order(P: np.ndarray, exact: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """order with P[i, j] about exact[order[i], order[j]]: by the diagonals, then by exchanges that help."""
    order = np.empty(len(P), dtype=int)
    order[np.argsort(np.diag(P))] = np.argsort(np.diag(exact))

    def away(order: np.ndarray) -> float:
        return float(np.linalg.norm((_placed(_placed(P, order).T, order).T - exact) * weights))

    for _ in P:
        others = [order]
        for i, j in itertools.combinations(range(len(P)), 2):
            others.append(order.copy())
            others[-1][[i, j]] = order[[j, i]]
        best = min(others, key=away)
        if best is order:
            break
        order = best
    return order


def _placed(matrix: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Row i of the matrix in place order[i]."""
    placed = np.empty_like(matrix)
    placed[order] = matrix
    return placed


def _listed(order: np.ndarray) -> str:
    return ", ".join(str(place + 1) for place in order)


def _named(kind: str, where: np.ndarray) -> str:
    """'state 2 is', 'states 2, 3 and 5 are'."""
    places = [str(place + 1) for place in np.flatnonzero(where)]
    if len(places) == 1:
        return f"{kind} {places[0]} is"
    return f"{kind}s {', '.join(places[:-1])} and {places[-1]} are"
