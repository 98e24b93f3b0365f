"""Conversion of call arguments that are given in other forms than a function declares.

Accepted are keywords of other tools, another order, and an earlier member of the chain Model ->
OperatingPoint -> LinearModel -> Game. For an earlier member, the declared argument is computed from
it and from keywords.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import Any, get_args

import numpy as np

from controller.critic.critic import Critic, from_gain, from_parts
from controller.critic.critic_file import read_critic
from controller.game.zero_sum import Game
from controller.riccati.gare import Solution
from hfa_aircraft.model import Model
from hfa_servo.notebook.labels import aligned
from hfa_servo.notebook.public import public
from hfa_support.arguments import argument_tests, evaluated
from hfa_support.errors import BadInputError, shown
from trim.linear.linear_model import LinearModel
from trim.point.condition import TrimCondition, release, usual_condition
from trim.point.operating_point import OperatingPoint

_SAME_ARGUMENTS = """
K: policy
T: time seconds timepts
U: u inputs
X0: initial initial_state
aircraft: model
at: points
controller: policy
duration: seconds time
gain: policy
input: inputs
inputs: policy
output: outputs
point: points
sample_time: dt
start: initial
seconds: time
t: time seconds T timepts
t_final: seconds time
tf: seconds time
time_step: dt
timestep: dt
u: policy
w: omega
x0: initial X0 initial_state
"""
#: Keyword of python-control, SciPy or gymnasium -> equivalent arguments of this project.
ARGUMENTS = {
    word: names.split()
    for word, names in (line.split(": ") for line in _SAME_ARGUMENTS.strip().splitlines())
}
#: Classes of the chain, in order. A trim condition is made from a model and values.
_LINKS = (Model, TrimCondition, OperatingPoint, LinearModel, Game)
#: Keywords that specify a game on a linear model.
_OF_GAME = ("Q", "R", "delta", "E")
#: Keyword that no function accepts -> advice for the message.
_ELSEWHERE = {"minimize": "use optimize for the least cost, or quickest_flight for the least time"}


def keywords(known: Sequence[str], named: dict[str, Any]) -> dict[str, Any]:
    """Return the keywords of a call, renamed from the names of other tools to those of the
    function.

    known: argument names of the function
    named: keywords of the call
    """
    meant: dict[str, Any] = {}
    for word, value in named.items():
        same = [each for each in ARGUMENTS.get(word, ()) if each in known]
        is_other = word not in known and same and same[0] not in {*named, *meant}
        meant[same[0] if is_other else word] = value
    return meant


def call_meant(
    function: Callable[..., Any], arguments: tuple[Any, ...], named: dict[str, Any]
) -> tuple[tuple[Any, ...], dict[str, Any]] | None:
    """Return the arguments of a failed call in the form that the function accepts.

    Returns None if no conversion is known. Raises BadInputError for a keyword that belongs to
    another call, and for an array whose labels are not names of the plant's states or inputs.

    function: the called function
    arguments: positional arguments of the call
    named: keywords of the call
    """
    signature = inspect.signature(function)
    words = keywords([each for each in signature.parameters if each != "self"], named)
    for word, place in _ELSEWHERE.items():
        if word in words and word not in signature.parameters:
            raise BadInputError(f"{word} is not an argument; {place}")
    if function is inspect.unwrap(Game.__init__):
        return _game_meant(arguments, words) or aligned(function, arguments, named)
    in_order = aligned(function, arguments, named)
    if in_order is not None:
        return in_order
    if not any(_link(_classes(function, each)) for each in signature.parameters.values()):
        return _transfer_meant(signature, arguments, named, words)
    reading = _Reading(function, list(arguments), words)
    is_same = _identities(reading.arguments, reading.words) == _identities(arguments, named)
    return None if is_same or not reading.is_complete else (reading.arguments, reading.words)


def _identities(
    arguments: tuple[Any, ...], named: dict[str, Any]
) -> tuple[list[int], dict[str, int]]:
    """Return the identity (`id`) of each argument and keyword, because arrays cannot be compared
    with ==.
    """
    return [*map(id, arguments)], {name: id(value) for name, value in named.items()}


def _game_meant(
    arguments: tuple[Any, ...], words: dict[str, Any]
) -> tuple[tuple[Any, ...], dict[str, Any]] | None:
    """Return the arguments of Game(linear, Q, R, delta) as the fields of a game.

    Returns None if the first argument is not a linear model.
    """
    linear = linear_of(arguments[1]) if len(arguments) > 1 else None
    if linear is None:
        return None
    game = public().game(linear, *arguments[2:], **words)
    return arguments[:1], {each.name: getattr(game, each.name) for each in fields(Game)}


def _transfer_meant(
    signature: inspect.Signature,
    arguments: tuple[Any, ...],
    named: dict[str, Any],
    words: dict[str, Any],
) -> tuple[tuple[Any, ...], dict[str, Any]] | None:
    """Return the arguments of a call such as step("elevator", "pitch"), with inputs= and outputs=
    instead.

    Returns None if the call needs no change.

    named: keywords of the call
    words: the keywords, renamed to the function's names
    """
    names, others = leading_names(arguments[1:])
    if names and {"inputs", "outputs"} <= {*signature.parameters} - {*words}:
        selected = dict(zip(("inputs", "outputs"), names, strict=False))
        return (*arguments[:1], *others), words | selected
    return None if words.keys() == named.keys() else (arguments, words)


def leading_names(arguments: Sequence[Any]) -> tuple[list[Any], list[Any]]:
    """Return the leading arguments that are names, at most two, and the remaining arguments.

    A string or a list of strings counts as a name.
    """
    names = list(takewhile(_is_names, arguments[:2]))
    return names, list(arguments[len(names) :])


def _is_names(value: Any) -> bool:
    is_list = isinstance(value, (list, tuple)) and len(value) > 0
    return isinstance(value, str) or (is_list and all(isinstance(each, str) for each in value))


def accepts(function: Callable[..., Any], value: Any) -> bool:
    """Return whether a value can be the first argument of a function, possibly after a
    conversion.
    """
    function = inspect.unwrap(function)
    first = next(iter(inspect.signature(function).parameters.values()), None)
    tests = argument_tests(function, 0)
    if any(holds(value) for place, _, holds, _ in tests if place == 0):
        return True
    link = None if first is None else _link(_classes(function, first))
    if link is Model:
        return isinstance(value, OperatingPoint)
    return link in (LinearModel, Game) and isinstance(value, (OperatingPoint, LinearModel))


def _classes(function: Callable[..., Any], parameter: inspect.Parameter) -> tuple[Any, ...]:
    """Return the classes in the annotation of a function's parameter."""
    annotation = evaluated(parameter.annotation, function)
    return get_args(annotation) or (annotation,)


def _link(classes: Sequence[Any]) -> Any:
    """Return the first class of the chain (`_LINKS`) that is among `classes`, or None."""
    return next((each for each in _LINKS if each in classes), None)


def _axes(value: object) -> int:
    """Return the number of axes of an array-like value. The rows of the value may differ in
    length.
    """
    return np.asarray(value, dtype=object).ndim


def _is_gain(value: Any, linear: LinearModel | None = None) -> bool:
    """Return whether a value can be a gain K, which is a matrix that is not square.

    If the linear model is known, the shape must be (m, n).

    linear: linear model with m inputs and n states, or None if it is not known
    """
    shape = np.shape(value) if _axes(value) == 2 else (0, 0)
    return shape[0] != shape[1] and (linear is None or shape == linear.B.T.shape)


class _Reading:
    """Conversion of the arguments and keywords of a call to the form that the function accepts.

    Arguments without a known conversion remain unchanged.
    """

    def __init__(
        self, function: Callable[..., Any], given: list[Any], words: dict[str, Any]
    ) -> None:
        self.function = function
        self.rest = given
        self.words = words
        self.parameters = inspect.signature(function).parameters
        self.tests = {name: holds for _, name, holds, _ in argument_tests(function, 0)}
        self.is_complete = True
        found: dict[str, Any] = {}
        for name, parameter in self.parameters.items():
            if parameter.kind is parameter.POSITIONAL_OR_KEYWORD:
                self._read(name, parameter, found)
        self._read_critic(found)
        self._trims(found)
        self._build(found)
        self._refuse_missing(found)
        self.arguments: tuple[Any, ...] = ()
        if any(each.kind is each.VAR_POSITIONAL for each in self.parameters.values()):
            self.arguments = (*found.values(), *self.rest)
            return
        self.is_complete &= not self.rest
        self.words = {**found, **words}

    def _read(self, name: str, parameter: inspect.Parameter, found: dict[str, Any]) -> None:
        """Determine the argument `name` and add it to the arguments found so far.

        The argument is taken as given, from another place of the call, or made from other
        arguments.

        parameter: parameter of the function with this name
        found: arguments determined so far, by name

        Raises BadInputError if a gain K is given in place of Q.
        """
        holds = self.tests.get(name)
        link = _link(_classes(self.function, parameter))
        if name in self.words:
            value = self.words[name]
            if holds is not None and not holds(value):
                made = self._made(name, link, value, found)
                self.words[name] = value if made is None else made
            return
        first = self.rest[:1]
        places = [i for i, each in enumerate(self.rest) if link and isinstance(each, link)]
        if first and (holds is None or holds(first[0])):
            places = [0]
        if places:
            value = self.rest.pop(places[0])
            if name == "Q" and _is_gain(value):
                function = self.function.__name__
                raise BadInputError(
                    f"{function} does not accept a gain K; remove K, and compare the result with "
                    "the cost of fly(point, K)"
                )
            found[name] = self._changed(value) if isinstance(value, Game) else value
            return
        made = self._made(name, link, first[0], found) if first and self._has_others(name) else None
        if first and (made is not None or link is None):
            given = self.rest.pop(0)
            found[name] = given if made is None else made
            return
        if parameter.default is parameter.empty:
            made = self._derived(link, found)
            if made is not None:
                found[name] = made
            self.is_complete &= made is not None

    def _refuse_missing(self, found: Mapping[str, Any]) -> None:
        """Raise BadInputError if a file is given where more arguments are required, as in
        assess("policy.toml").

        found: arguments determined so far
        """
        missing = [
            name
            for name, parameter in self.parameters.items()
            if parameter.default is parameter.empty
            and parameter.kind is parameter.POSITIONAL_OR_KEYWORD
            and name not in (*found, *self.words)
        ]
        files = [each for each in found.values() if isinstance(each, (str, Path))]
        if missing and files and not self.rest:
            raise BadInputError(
                f"{self.function.__name__}: the argument {missing[0]} is missing, only "
                f"{shown(str(files[0]))} is given; add {missing[0]}=..."
            )

    def _has_others(self, name: str) -> bool:
        """Return whether the call contains more values than the required later parameters need.

        name: parameter of the function. The later parameters follow it in the signature.
        """
        names = list(self.parameters)
        needed = [
            each
            for each in names[names.index(name) + 1 :]
            if self.parameters[each].kind is inspect.Parameter.POSITIONAL_OR_KEYWORD
            and self.parameters[each].default is inspect.Parameter.empty
            and each not in self.words
            and not _link(_classes(self.function, self.parameters[each]))
        ]
        return len(self.rest) > len(needed)

    def _made(self, name: str, link: Any, value: Any, found: Mapping[str, Any]) -> Any:
        """Return the argument `name`, converted from a value, or None if no conversion is known.

        link: class of the chain Model, OperatingPoint, LinearModel, Game that is needed, or None
        found: arguments determined so far, by name
        """
        is_file = isinstance(value, (str, Path))
        model = found.get("model", self.words.get("model"))
        if link is Model and is_file:
            return self._loaded(str(value))
        if link is TrimCondition and isinstance(value, Mapping) and isinstance(model, Model):
            return release(usual_condition(model), hold=value)
        if link is OperatingPoint and isinstance(value, LinearModel):
            return value.point
        if link is OperatingPoint and isinstance(value, Mapping) and isinstance(model, Model):
            return public().trim(model, hold=value)
        if link is Game:
            return self._game(value, is_file)
        if link is LinearModel:
            return self._linear(value)
        if name == "critic":
            game = found.get("game", self.words.get("game"))
            return self._critic(game, value) if isinstance(game, Game) else None
        if name == "grid" and isinstance(model, Model) and model.schedule and _axes(value):
            return {model.schedule: value}
        if name == "points" and (
            isinstance(value, (OperatingPoint, LinearModel)) or _axes(value) == 0
        ):
            return [value.point if isinstance(value, LinearModel) else value]
        return None

    def _loaded(self, file: str) -> Any:
        """Return the model in an aircraft file.

        Raises BadInputError if the file contains no aircraft. For a function with flight records,
        the message also states the order of the arguments.
        """
        try:
            return public().load_model(file)
        except BadInputError as error:
            if "records" not in self.parameters:
                raise
            name = self.function.__name__
            raise BadInputError(f"{error}; write {name}(aircraft, records)") from error

    def _game(self, value: Any, is_file: bool) -> Any:
        """Return the game made from a value, or None for another value.

        - a solution: its game
        - a file: the game in the file, with weights from the keywords Q, R and delta
        - a linear model: the game with these weights, or with the matrices that follow in the call

        is_file: whether the value is a file
        """
        if isinstance(value, Solution):
            return value.game
        hfa = public()
        if is_file:
            return hfa.load_game(value, **self._weights())
        linear = self._linear(value)
        if linear is None:
            return None
        weights = self._weights()
        places = list(self.parameters)
        following = self.tests.get(places[1]) if len(places) > 1 else None
        is_matrix = len(self.rest) > 1 and following is not None and not following(self.rest[1])
        if is_matrix and not _is_gain(self.rest[1], linear):
            matrices = self.rest[1:]
            self.rest = self.rest[:1]
            return hfa.game(linear, *matrices, **weights)
        return hfa.game(linear, **weights)

    def _critic(self, game: Game, value: Any) -> Critic | None:
        """Return the critic made from a file, a solution, a training run or a gain K, or None."""
        if isinstance(value, (str, Path)):
            return read_critic(value, game)
        if isinstance(value, Solution):
            return from_parts(game, {"P": value.P, "K": value.K})
        if hasattr(value, "critic"):
            made: Critic = value.critic(game)
            return made
        return from_gain(game, value) if _axes(value) == 2 else None

    def _linear(self, value: Any) -> LinearModel | None:
        """Return the linear model made from a value, or None. A model is linearized at its trim."""
        return linear_of(self._trim(value) if isinstance(value, Model) else value)

    def _trim(self, model: Model) -> OperatingPoint:
        """Return the trim of a model at the values that the keywords specify."""
        point: OperatingPoint = public().trim(
            model, **self._held(model, "hold", "free", "condition", "at")
        )
        return point

    def _held(self, model: Model, *more: str) -> dict[str, Any]:
        """Return the keywords that name values of a model, and remove these keywords from the call.

        more: further names that are accepted
        """
        known = {*model.holdable, *model.rates, *model.parameters, *more}
        known -= {*self.parameters, *_OF_GAME}
        return {name: self.words.pop(name) for name in list(self.words) if name in known}

    def _weights(self) -> dict[str, Any]:
        """Return the keywords that specify a game, such as Q, and remove these keywords from the
        call.
        """
        names = [name for name in _OF_GAME if name in self.words and name not in self.parameters]
        return {name: self.words.pop(name) for name in names}

    def _changed(self, game: Game) -> Game:
        """Return a game with the fields that the keywords change, as in solve(game,
        delta=40).
        """
        weights = self._weights()
        return replace(game, **weights) if weights else game

    def _derived(self, link: Any, found: Mapping[str, Any]) -> Any:
        """Return a missing argument that is derived from other arguments, or None.

        - a game: made from matrices in the keywords
        - a model: the model of a given operating point
        - an operating point: the trim of the given model at the values in the keywords

        link: class of the missing argument
        found: arguments determined so far, by name
        """
        if link is Game:
            matrices = [each for each in ("A", "B", *_OF_GAME) if each in self.words]
            is_game = {"A", "B"} <= {*matrices}
            return Game(**{each: self.words.pop(each) for each in matrices}) if is_game else None
        if link is Model:
            given = (*self.rest, *self.words.values())
            point = next((each for each in given if isinstance(each, OperatingPoint)), None)
            if point is None:
                return None
            if "points" in self.parameters and any(each is point for each in self.rest):
                self.rest = [each for each in self.rest if each is not point]
                self.words["points"] = [point]
            return point.model
        model = found.get("model", self.words.get("model"))
        is_trim = link is OperatingPoint and isinstance(model, Model)
        return self._trim(model) if is_trim else None

    def _trims(self, found: Mapping[str, Any]) -> None:
        """Add the argument `points`: the trims of the model at the values in the keywords.

        An example is environment(model, speed=[150, 176]).

        found: arguments determined so far, by name
        """
        model = found.get("model")
        if not isinstance(model, Model) or "points" not in self.parameters:
            return
        if "points" in found or "points" in self.words:
            return
        held = self._held(model)
        if held:
            rows = np.broadcast_arrays(*map(np.atleast_1d, held.values()))
            trim = public().trim
            self.words["points"] = [
                trim(model, **dict(zip(held, row, strict=True))) for row in zip(*rows, strict=True)
            ]

    def _read_critic(self, found: dict[str, Any]) -> None:
        """Replace a critic file by the critic in it, if keywords of `hfa.read_critic` are given.

        An example is verify(game, FILE, activation="tanh").

        found: arguments determined so far, by name
        """
        place = found if "critic" in found else self.words
        file = place.get("critic")
        known = inspect.signature(read_critic).parameters
        unknown = [name for name in self.words if name not in self.parameters]
        if isinstance(file, (str, Path)) and unknown and {*unknown} <= {*known}:
            settings = {name: self.words.pop(name) for name in unknown}
            place["critic"] = read_critic(file, found.get("game"), **settings)

    def _build(self, found: dict[str, Any]) -> None:
        """Add a missing argument that is a dataclass, made from keywords that are fields of the
        class.

        An example is fly(..., gust=gust), in which the scenario is made with this gust.

        found: arguments determined so far, by name
        """
        unknown = {name for name in self.words if name not in self.parameters}
        if not unknown:
            return
        for name, parameter in self.parameters.items():
            if name in found or name in self.words:
                continue
            kinds: tuple[Any, ...] = _classes(self.function, parameter)
            for kind in kinds:
                if not is_dataclass(kind) or kind in _LINKS:
                    continue
                if unknown <= {field.name for field in fields(kind)}:
                    build: Any = kind
                    self.words[name] = build(**{word: self.words.pop(word) for word in unknown})
                    return


def linear_of(value: Any) -> LinearModel | None:
    """Return the linear model of a value, or None.

    The value may be an operating point, a linear model, or a continuous-time state-space system of
    another package.
    """
    if isinstance(value, OperatingPoint):
        return value.linearize()
    if isinstance(value, LinearModel):
        return value
    matrices = [getattr(value, name, None) for name in "ABCD"]
    if any(matrix is None for matrix in matrices) or getattr(value, "dt", None):
        return None
    A, B, C, D = map(np.asarray, matrices)
    labels: dict[str, Any] = {}
    for name in ("states", "inputs", "outputs"):
        names = tuple(getattr(value, f"{name.removesuffix('s')}_labels", ()))
        if names and all(map(str.isidentifier, names)):
            labels[name] = names
    return LinearModel(A, B, C, D, **labels)
