"""The mistake in a wrong critic, where its numbers identify one.

A repair is a guess from the critic's own numbers. Another game (another δ, Q, R, discount, time
step, matrices or dihedral angle) is found by a search along one parameter, and solved. A mistake is
named only when the repaired critic, or the answer of the other game, is the exact one but for a
part of the error. A network is judged by its derivatives at the origin and by the quadratic V and
linear u nearest to it over the box; none is exact, so this part is larger."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import lru_cache, partial
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.game.basis import Basis, basis
from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units, spectrum
from controller.riccati.derivations import quick_solution
from controller.riccati.discrete import quick_discounted, sampled
from controller.riccati.gare import Solution, solve_game
from controller.riccati.normal_form import relative_residual
from controller.riccati.smallest_delta import minimum_delta
from hfa_model.printed_matrices import published_models
from hfa_support.errors import BadInputError, NoSolutionError
from verification.critic.critic_errors import SMALL, matrix_errors, relative_error

#: A residual below this marks a root of the Riccati equation, if not the right one.
_ROOT = 1e-9
#: Below this part of the error a polynomial is the LQR; above it, a game that is like it would look
#: the same.
_SAME = 1e-6
#: A factor this near to a power of ten, in decades, is that power.
_NEAR = 1e-3
_DEGREE = math.pi / 180.0
_NOT_TOGETHER = (
    "K is not R⁻¹B'P: the stored K and P do not belong together, or not to this plant and R"
)
#: Numbers of a critic beyond those that are solved for; fewer would fit by chance.
_REDUNDANT = 2
#: Steps of a search, and the relative step of its derivative.
_STEPS, _STEP = 30, 1e-5
#: Where there is no game, as a difference: so many times that of the start.
_NO_GAME = 1e3
#: A search must take the difference down to this part of the best start's, or to rounding.
_REACHED, _ROUNDING = 0.1, 1e-9
#: A network whose P is this near is taken for right, and its policy for wrong from there on.
NEAR, FAR = 0.1, 0.3
#: States at which a network is fitted over the box.
_SAMPLES = 2000


class _Asked(NamedTuple):
    """explained: a cause must explain the error down to this part of it, and as_good: is named
    before others that explain up to so many times more. Noise in tens of entries cannot be
    explained by one number. least: error that asks for such a cause. fitted: words of a repair with
    fitted numbers, so many times what it leaves counts. clear: a mistake that leaves less than this
    is not sought among other games."""

    explained: float
    as_good: float
    least: float
    fitted: tuple[tuple[str, float], ...]
    clear: float


_OF_POLYNOMIALS = _Asked(1e-3, 10.0, 0.0, (("scaled by", 10.0),), 0.0)
_OF_NETWORKS = _Asked(0.15, 1.5, 0.03, (("every entry", 10.0), ("scaled by", 5.0)), 0.05)


class Answer(NamedTuple):
    """P (n, n), None where only a gain is known, and K (m, n)."""

    P: np.ndarray | None
    K: np.ndarray


class _Seen(NamedTuple):
    """A matrix of the critic, kind "P" or "K", beside the exact one, and weights of its entries in
    errors."""

    kind: str
    given: np.ndarray
    exact: np.ndarray
    weights: np.ndarray
    asked: _Asked

    def error(self, matrix: np.ndarray) -> float:
        """|matrix - exact| / |exact|, weighted, Frobenius norms."""
        return relative_error(matrix * self.weights, self.exact * self.weights)

    def is_of(self, said: str, other: Answer) -> Repair:
        """The critic taken for the answer to another question: what is wrong is its difference from
        that."""
        matrix = getattr(other, self.kind)
        return f"this is the {said.format(_NOUN[self.kind])}", self.given - matrix + self.exact

    def named(self, repairs: Iterable[Repair]) -> tuple[float, str]:
        """The part of the error that the best repair leaves, and its name: the first that is about
        as good; (inf, "") where none explains enough."""
        asked, before = self.asked, min(self.error(self.given), 1.0)
        if not before > 0.0:
            return math.inf, ""
        left = []
        for said, matrix in repairs:
            chance = max((by for words, by in asked.fitted if words in said), default=1.0)
            left.append((self.error(matrix) / before * chance, said))
        best = min((each for each, _ in left), default=math.inf)
        if not best <= (asked.explained if before > asked.least else _OF_POLYNOMIALS.explained):
            return math.inf, ""
        return best, next(
            said for each, said in left if each <= max(asked.as_good * best, _ROUNDING / before)
        )


#: The mistake in words, and P (n, n) or K (m, n) without it.
Repair = tuple[str, np.ndarray]
GameAt = Callable[[float], Game]
_NOUN = {"P": "solution", "K": "gain"}
#: Of P and of K: what is meant, and mistakes of all entries with the factor that removes them.
_MEANT = {
    "P": ("value", "V is z'Pz, without a factor 1/2"),
    "K": ("gain", "the policy is u = -K z"),
}
_FACTORS = {"has the wrong sign": -1.0, "is half the exact one": 2.0, "is twice the exact one": 0.5}
#: What the rows and columns of a matrix are: word, axes of the matrix, factor of one in degrees.
_Sides = tuple[tuple[str, tuple[int, ...], float], ...]
_SIDES: dict[str, _Sides] = {
    "P": (("state", (0, 1), _DEGREE),),
    "K": (("input", (0,), 1.0 / _DEGREE), ("state", (1,), _DEGREE)),
}
_OF_SLOPES: _Sides = (("slope", (0,), 1.0 / _DEGREE), ("state", (1,), _DEGREE))


def diagnose(
    game: Game,
    exact: Solution,
    candidate: Critic,
    limit: float,
    at_dihedral: GameAt | None = None,
    box: np.ndarray | None = None,
) -> str:
    """One sentence that names the mistake which this critic makes, or "" when none is recognized.

    limit: of the errors. at_dihedral: degrees -> the game there, to recognize a critic of another
    angle. box: (n,), half widths of the box of states, of a network."""
    P, others = candidate.P, lru_cache(lambda: _families(game, at_dihedral))
    if candidate.network and box is not None:
        return _of_network(game, exact, candidate, box, others)
    value, gain = _seen(game, candidate, exact.P, exact.K)
    if value is None:
        return _cause(game, gain, others)
    assert P is not None
    together = gain.error(gain.given + exact.K - game.gain(P)) <= limit
    if all(check.ok for check in matrix_errors(game, "P", P, exact.P, limit)):
        beyond = len(P) * (len(P) + 1) // 2
        if candidate.weights is not None and candidate.weights[beyond:].any():
            place = beyond + int(np.argmax(np.abs(candidate.weights[beyond:])))
            return (
                f"weight {place + 1} is {candidate.weights[place]:.6g}: on a linear plant the value is quadratic, and "
                "every weight beyond the quadratic ones must be 0"
            )
        return gain.named(repairs(game, gain))[1] or ("" if together else _NOT_TOGETHER)
    if relative_error(P, P.T) > limit:
        return "P is not symmetric: the value z'Pz depends on (P + P')/2 alone"
    of_weights = (
        ()
        if candidate.weights is None or candidate.basis is None
        else repairs_of_weights(candidate.weights, exact.P, candidate.basis)
    )
    named = _cause(game, value, others, of_weights)
    units, abscissa = balanced_units(game), spectrum(game.A - game.S @ P).abscissa
    residual = relative_residual(in_units(game, units), P * np.outer(units, units))
    if named or not together or residual > _ROOT or abscissa < 0.0:
        return named or ("" if together else _NOT_TOGETHER)
    said = (
        f"its residual is {residual:.2g}, but A - S P is not Hurwitz (abscissa {abscissa:+.3g} 1/s)"
    )
    return f"this is another root of the Riccati equation: {said}"


def repaired(game: Game, P: np.ndarray, K: np.ndarray, candidate: Critic) -> str:
    """The mistake of a critic whose right answer is P and K, of whatever problem: that of its
    value, else of its gain, else that it is the answer in continuous time; or ""."""
    value, gain = _seen(game, candidate, P, K)
    seen, exact = value or gain, solve_game(game)
    continuous = seen.is_of("{} in continuous time, without discount", Answer(exact.P, exact.K))
    return seen.named([*repairs(game, seen), continuous])[1]


def _cause(
    game: Game, seen: _Seen, others: Callable[[], list[_Family]], more: Iterable[Repair] = ()
) -> str:
    """The best of these and the usual repairs, else of other games, which take longer; or ""."""
    return (
        seen.named([*more, *repairs(game, seen)])[1] or seen.named(_other_games(seen, others()))[1]
    )


def _seen(
    game: Game, candidate: Critic, P: np.ndarray, K: np.ndarray
) -> tuple[_Seen | None, _Seen]:
    """What a polynomial has of P and of K, in balanced units."""
    units, given = balanced_units(game), candidate.P
    inputs = np.outer(np.sqrt(np.diag(game.R)), units)
    value = None if given is None else _Seen("P", given, P, np.outer(units, units), _OF_POLYNOMIALS)
    return value, _Seen("K", candidate.K, K, inputs, _OF_POLYNOMIALS)


def _of_network(
    game: Game,
    exact: Solution,
    candidate: Critic,
    box: np.ndarray,
    others: Callable[[], list[_Family]],
) -> str:
    """The mistake that explains most, of the network at the origin or over the box. V, slopes and
    inputs count by their size in the box."""
    own_policy = "policy" in candidate.network
    has_value = "V" in candidate.network

    def rows(matrix: np.ndarray) -> np.ndarray:
        sizes = np.linalg.norm(matrix * box, axis=1, keepdims=True)
        return box / np.maximum(sizes, SMALL * sizes.max())

    def views(of: Critic) -> list[list[_Seen]]:
        """At the origin and over the box: P, if there is any, and K."""
        sizes = {"P": rows(exact.P) if not has_value else np.outer(box, box), "K": rows(exact.K)}
        return [
            [
                _Seen(kind, getattr(answer, kind), getattr(exact, kind), size, _OF_NETWORKS)
                for kind, size in sizes.items()
                if getattr(answer, kind) is not None
            ]
            for answer in (Answer(of.P, of.K), fitted(game, of, box))
        ]

    seen, own = (
        views(candidate),
        slice(None if own_policy else -1),
    )  # a K that follows from P is not judged
    origin, over = ([each.error(each.given) for each in view] for view in seen)
    if max(origin[0], origin[-1] if own_policy else 0.0) <= SMALL:
        return "it is right at the origin and wrong away from it"
    named = [(math.inf, "")]
    for each in (*seen[0][own], *seen[1][own]):
        slopes = _repairs_of_sides(each, _OF_SLOPES) if each.kind == "P" and not has_value else ()
        named.append(each.named([*repairs(game, each), *slopes]))
    if min(named)[0] > _OF_NETWORKS.clear:
        for said, read in candidate.variants.items():
            with contextlib.suppress(BadInputError):  # the file is gone
                other = views(read())
                named += [
                    here[0].named([(said, there[0].given)])
                    for here, there in zip(seen, other, strict=True)
                ]
    if min(named)[0] > _OF_NETWORKS.clear:
        named += [each.named(_other_games(each, others())) for each in seen[1][own]]
    if candidate.gradient is not None and not own_policy and over[0] <= NEAR and over[-1] > FAR:
        hidden = f"V is near and its policy off by {over[-1]:.2g}: u = -½ R⁻¹B'∂V/∂z amplifies what V hardly shows"
        named.append((_OF_NETWORKS.explained, hidden))
    return min(named)[1]


def fitted(game: Game, candidate: Critic, box: np.ndarray) -> Answer:
    """The quadratic V and the linear u nearest to a network over the box, by least squares, without
    what is constant and, of V, linear."""
    z = np.random.default_rng(2).uniform(-1.0, 1.0, (_SAMPLES, len(box)))
    network, symbols = candidate.network, ca.SX.sym("z", len(box))
    shown = [network[name](symbols) for name in ("V", "gradient", "policy") if name in network]
    sampled = ca.Function("sampled", [symbols], [ca.vertcat(*shown)])((z * box).T)
    values, ones = (
        np.nan_to_num(np.array(sampled).T, posinf=0.0, neginf=0.0),
        np.ones((_SAMPLES, 1)),
    )
    linear = np.linalg.lstsq(np.hstack([z, ones]), values, rcond=None)[0][:-1].T / box
    if candidate.gradient is None:
        return Answer(None, -linear)
    P = linear[: len(box)] / 2.0
    if "V" in network:
        functions = basis("quadratic", len(box))
        terms = np.hstack([functions.psi(z), z, ones])
        P = functions.matrix(np.linalg.lstsq(terms, values[:, 0], rcond=None)[0]) / np.outer(
            box, box
        )
    return Answer(P, -linear[-len(candidate.K) :] if "policy" in network else game.gain(P))


def repairs_of_weights(
    weights: np.ndarray, exact: np.ndarray, functions: Basis
) -> Iterator[Repair]:
    """Products z_i z_j column by column, without their factor 2, or two in each other's place;
    weights: (M,)."""
    row, column = np.triu_indices(functions.states)
    given, known = (
        each[: functions.quadratic_size] for each in (weights, functions.weights(exact))
    )
    twice, placed = np.where(row == column, 1.0, 2.0), np.empty_like(given)
    placed[np.lexsort((row, column))] = given
    by_column, lack = "stand column by column", "lack the factor 2 of products z_i z_j"
    yield f"the weights {by_column}; they must go row by row, i <= j", functions.matrix(placed)
    yield f"the weights {lack}; they are 2 P_ij", functions.matrix(twice * given)
    yield (
        f"the weights {by_column} and {lack}; they must go row by row, i <= j",
        functions.matrix(twice * placed),
    )
    wrong = np.sort(np.argsort(np.abs(given - known), kind="stable")[-2:])
    if len(given) > 1:
        swapped = given.copy()
        swapped[wrong] = given[wrong[::-1]]
        yield (
            f"weights {wrong[0] + 1} and {wrong[1] + 1} are interchanged",
            functions.matrix(swapped),
        )


def repairs(game: Game, seen: _Seen) -> Iterator[Repair]:
    """Sign and factor of a symmetric P (n, n) or of K (m, n); the factor 2 off the diagonal of P;
    R⁻¹ and the order of the entries of K; and `_repairs_of_sides`."""
    matrix, exact, name = seen.given, seen.exact, seen.kind
    if name == "P":
        matrix = (matrix + matrix.T) / 2.0
        seen = seen._replace(given=matrix)
    noun, meant = _MEANT[name]
    for said, factor in _FACTORS.items():
        yield f"the {noun} {said}: {meant}", factor * matrix
    factor = float(
        np.sum(matrix * exact * seen.weights**2) / (np.sum((exact * seen.weights) ** 2) or 1.0)
    )
    if math.isfinite(factor) and factor != 0.0:
        decades = math.log10(abs(factor))
        ten = factor > 0.0 and round(decades) and abs(decades - round(decades)) < _NEAR
        factor = 10.0 ** round(decades) if ten else factor
        if ten or _known(seen) >= 1 + _REDUNDANT:
            yield f"every entry of {name} is {factor:.6g} times the exact one", matrix / factor
    if name == "P":
        off = np.where(np.eye(len(matrix), dtype=bool), 1.0, 0.5)
        yield "P has entries beside the diagonal of twice their size: they are W / 2", matrix * off
    else:
        if len(set(matrix.shape)) == 1:
            yield "K is transposed", matrix.T
        yield "R⁻¹ is missing: this is B'P, and K is R⁻¹B'P", np.linalg.solve(game.R, matrix)
        yield (
            "K was read row by row, its entries stand column by column",
            matrix.reshape(matrix.shape[::-1]).T,
        )
    yield from _repairs_of_sides(seen, _SIDES[name])


def _repairs_of_sides(seen: _Seen, sides: _Sides) -> Iterator[Repair]:
    """Order, signs, degrees and scales of the states, inputs or slopes that the rows and columns of
    a matrix are."""
    for kind, axes, degree in sides:
        matrix, exact, weights = (each if 0 in axes else each.T for each in seen[1:4])
        size, both = len(matrix), len(axes) == 2

        def back(
            by: np.ndarray, matrix: np.ndarray = matrix, axes: tuple[int, ...] = axes
        ) -> np.ndarray:
            found = by @ matrix
            return (found @ by.T if len(axes) == 2 else found) if 0 in axes else found.T

        order = _order(matrix, exact, weights, both=both)
        said = ", ".join(str(place + 1) for place in order)
        yield f"the {kind}s are in the order {said}", back(np.eye(size)[order].T)
        with np.errstate(all="ignore"):
            factors = np.sum(matrix * exact * weights**2, axis=1) / np.sum(
                (exact * weights) ** 2, axis=1
            )
            if both:  # each by least squares, the others as they are
                signs = np.sign(matrix * exact)[int(np.argmax(np.diag(exact)))]
                factors = np.where(signs < 0.0, -1.0, 1.0) * np.sqrt(
                    np.abs(np.diag(matrix) / np.diag(exact))
                )
                factors = -factors if 2 * (factors < 0.0).sum() > size else factors
                for place in np.tile(np.arange(size), 5):
                    line = exact[place] * factors * weights[place] ** 2
                    factors[place] = matrix[place] @ line / (exact[place] * factors @ line)
            angles = np.abs(np.log(np.abs(factors) / degree)) < 1.5
        flipped = factors < 0.0
        for which, one, many, by in (
            (flipped, "has the wrong sign", "have the wrong sign", np.where(flipped, -1.0, 1.0)),
            (angles, "is in degrees", "are in degrees", np.where(angles, 1.0 / degree, 1.0)),
        ):
            if which.any() and not which.all():
                *places, last = (str(place + 1) for place in np.flatnonzero(which))
                named = (
                    f"{kind}s {', '.join(places)} and {last} {many}"
                    if places
                    else f"{kind} {last} {one}"
                )
                yield named, back(np.diag(by))
        if _known(seen) >= size + _REDUNDANT and np.all(np.isfinite(factors) & (factors > 0.0)):
            said = ", ".join(f"{each:.3g}" for each in factors)
            yield f"the {kind}s look scaled by {said}", back(np.diag(1.0 / factors))


def _known(seen: _Seen) -> int:
    """How many numbers a critic has to match."""
    return int(np.count_nonzero(np.triu(seen.exact) if seen.kind == "P" else seen.exact))


def _order(given: np.ndarray, exact: np.ndarray, weights: np.ndarray, *, both: bool) -> np.ndarray:
    """order in which the rows given[i] are most like exact[order[i]]; both: whatever the order of
    the columns."""
    from scipy.optimize import linear_sum_assignment

    with np.errstate(all="ignore"):
        if both:
            rows, others = np.sort(given)[:, None], np.sort(exact)[None]
            away = np.sum(
                np.nan_to_num(np.abs(rows - others) / (np.abs(rows) + np.abs(others))), axis=-1
            )
        else:
            away = np.sum(((given[:, None] - exact[None]) * weights[None]) ** 2, axis=-1)
    return np.asarray(linear_sum_assignment(np.nan_to_num(away, nan=1e300, posinf=1e300))[1])


class _Family(NamedTuple):
    """Games along one parameter x: what differs, with value(x) in it; the answer at x; where a
    search of x begins; one game alone has no start."""

    said: str
    answer: Callable[[float], Answer]
    starts: tuple[float, ...] = ()
    value: Callable[[float], float] = math.exp


def _families(game: Game, at: GameAt | None) -> list[_Family]:
    """The LQR and the games of printed matrices; with another delta, with Q or R scaled, at another
    angle, with a discount, in discrete time."""
    factors = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)
    angles = (1.0, 3.0, 5.0, 8.0, 12.0, 16.0, 20.0)  # none where stationary
    logs, times = (tuple(map(math.log, each)) for each in (factors, (1e-3, 1e-2, 5e-2, 0.2, 1.0)))
    size = game.delta if math.isfinite(game.delta) else minimum_delta(game).value
    lqr, another, step = (
        game.with_delta(math.inf),
        "{{}} of another game, ",
        "in discrete time, a step of {:.4g} s",
    )

    def delta(x: float) -> float:  # P and K are smooth in x = 1/δ², relative
        return size / math.sqrt(x)

    def scaled(name: str) -> GameAt:
        return lambda x: replace(game, **{name: math.exp(x) * getattr(game, name)})

    def of(game_at: GameAt) -> Callable[[float], Answer]:
        def answer(x: float) -> Answer:
            P = quick_solution(other := game_at(x))
            return Answer(P, other.gain(P))

        return answer

    found = list[_Family]()
    if math.isfinite(game.delta):
        said = f"LQR {{{{}}}} (delta = inf), not the game's at delta = {game.delta:.6g}"
        found.append(_Family(said, of(lambda _: lqr)))
    if size > 0.0:
        with_delta = of(lambda x: game.with_delta(delta(x)))
        found.append(_Family(f"{another}at delta = {{:.4g}}", with_delta, factors, delta))
    if at is not None:
        for each in published_models():
            if each.B.shape == game.B.shape:
                said = f"{another}of the matrices printed for {each.dihedral_deg:g} deg"
                printed = replace(game, A=each.A, B=each.B)
                found.append(_Family(said, of(partial(lambda alone, _: alone, printed))))
        found.append(_Family(f"{another}at dihedral {{:.4f}} deg", of(at), angles, float))
    found += [
        _Family(f"{another}with Q {{:.4g}} times as large", of(scaled("Q")), logs),
        _Family(f"{another}with R {{:.4g}} times as large", of(scaled("R")), logs),
        _Family(
            f"{another}with a discount of {{:.4g}} 1/s",
            of(lambda x: discounted(game, math.exp(x))),
            logs,
        ),
        _Family(f"{another}{step}", lambda x: held(game, math.exp(x)), times),
        _Family(
            f"{another}{step} and its whole cost",
            lambda x: held(game, math.exp(x), whole=True),
            times,
        ),
    ]
    if math.isfinite(game.delta):
        found.append(
            _Family(f"{another}of the LQR {step}", lambda x: held(lqr, math.exp(x)), times)
        )
    return found


def _other_games(seen: _Seen, families: list[_Family]) -> Iterator[Repair]:
    """Of each family the game whose answer is nearest, as a repair. Of a polynomial that is near
    the LQR's and is not the LQR's, another game must explain what the LQR leaves."""
    few, before = _known(seen) <= _REDUNDANT, math.inf  # a few numbers fit many games
    for family in families:
        x = 0.0 if not family.starts else None if few else _searched(seen, family)
        if x is None:
            continue
        with contextlib.suppress(NoSolutionError):
            found = seen.is_of(family.said.format(family.value(x)), family.answer(x))
            left, near_lqr = (
                seen.error(found[1]),
                seen.asked is _OF_POLYNOMIALS and family.said.startswith("LQR"),
            )
            if near_lqr and left > _SAME * seen.error(seen.given):
                before = left * seen.asked.explained
            elif left <= before:
                yield found


def discounted(game: Game, rate: float) -> Game:
    """The game whose P is that of ∫ e^(-rate t) (z'Qz + u'Ru - δ² d'd) dt; rate: 1/s."""
    return replace(game, A=game.A - 0.5 * rate * np.eye(len(game.A)))


def held(game: Game, step: float, *, whole: bool = False) -> Answer:
    """The answer with u and d held over each step, s; whole: its cost is not multiplied by its
    length."""
    P, K = quick_discounted(sampled(game, step))
    return Answer(P / step if whole else P, K)


def _searched(seen: _Seen, family: _Family) -> float | None:
    """The parameter at which the answer differs least, by least squares.

    It lies between the starts or as far beyond them. None when the difference does not fall to
    `_REACHED` of the best start's."""
    from scipy.optimize import least_squares

    @lru_cache
    def difference(parameter: float) -> np.ndarray | None:
        try:
            with np.errstate(divide="raise", invalid="raise"):
                found = getattr(family.answer(parameter), seen.kind)
                return np.ravel(
                    (found - seen.given) * seen.weights / np.linalg.norm(found * seen.weights)
                )
        except (NoSolutionError, BadInputError, ValueError, ArithmeticError):  # no such game
            return None

    starts = family.starts
    tried = [
        (float(np.linalg.norm(found)), at, found)
        for at in starts
        if (found := difference(at)) is not None
    ]
    if not tried:
        return None
    first, start, there = min(tried, key=lambda each: each[0])
    nowhere = np.full_like(there, _NO_GAME * max(first, _ROUNDING))
    found = least_squares(
        lambda at: nowhere if (here := difference(float(at[0]))) is None else here,
        [start],
        bounds=(2.0 * min(starts) - max(starts), 2.0 * max(starts) - min(starts)),
        ftol=0.1,
        xtol=1e-14,
        gtol=1e-15,
        diff_step=_STEP,
        max_nfev=_STEPS,
    )
    left = float(np.linalg.norm(found.fun))
    return (
        float(found.x[0])
        if left <= max(_REACHED * first, seen.asked.explained, _ROUNDING)
        else None
    )
