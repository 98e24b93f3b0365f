"""Attributes and arguments in the words of other tools, and functions of `hfa` as methods."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from typing import Any

from controller.riccati.gare import Solution
from controller.riccati.solution_report import AnalysedGame, solve
from hfa_support.arguments import argument_tests
from hfa_support.errors import nearest
from hfa_support.reporting.report import Reported
from hfa_support.unknown import no_attribute
from trim.linear.linear_model import LinearModel

_SAME_ARGUMENTS = """
K: policy
T: time seconds
U: u
X0: initial
controller: policy
duration: seconds
gain: policy
input: inputs
output: outputs
point: points
start: initial
seconds: time
t: time seconds
tf: seconds time
u: policy
x0: initial
"""
_SAME_ATTRIBUTES = """
as_dict: to_dict
controllability: ctrb
controllable: is_controllable
damping_ratio: damping
converged: ok
derivatives: rates_at
eigenvalues: closed_loop_eigenvalues
gain: K
gamma: delta
info: report
n_inputs: ninputs
n_outputs: noutputs
n_states: nstates
natural_frequency: frequency
observability: obsv
omega: frequency
passed: ok
regret: cost_lost
stable: is_stable
suboptimality: cost_lost
success: ok
summary: report
t: time
to_csv: save
to_dataframe: to_pandas
to_mat: save
to_matlab: save
to_npz: save
u: inputs
value: cost
wn: frequency
x: states
zeta: damping
"""
#: Keyword of python-control or SciPy -> arguments of the same meaning.
ARGUMENTS = {
    word: names.split()
    for word, names in (line.split(": ") for line in _SAME_ARGUMENTS.strip().splitlines())
}
#: Attribute of results of SciPy, pandas or python-control -> attribute of the same meaning.
ATTRIBUTES = dict(line.split(": ") for line in _SAME_ATTRIBUTES.strip().splitlines())
#: Attributes that the analysis of a game adds to its solution.
_ANALYSED = {*AnalysedGame.__annotations__, *vars(AnalysedGame)}


def attribute(value: Any, name: str, *more: str) -> Any:
    """Return the attribute that a word of another tool means, or a function of `hfa` as a method.

    A function of `hfa` is a method of its first argument: model.linearize(point). A solution has
    the attributes that `hfa.solve` adds, and a linear model its modes: linear.phugoid.

    more: further attributes for the message

    Raises AttributeError, which suggests the nearest attributes, for another name.
    """
    same = ATTRIBUTES.get(name)
    if same is not None and hasattr(value, same):
        return getattr(value, same)
    if isinstance(value, LinearModel):
        for mode in value.modes:
            if mode.name.replace(" ", "_") == name:
                return mode
    if name == "to_json" and isinstance(value, Reported):
        return value.report().json
    if type(value) is Solution and name in _ANALYSED:
        return getattr(solve(value.game), name)
    method = _method(value, name)
    if method is not None:
        return method
    methods = [each for each in nearest(name, dir(_public())) if _method(value, each) is not None]
    names = value.keys() if hasattr(type(value), "keys") else ()
    raise no_attribute(value, name, *methods, *names, *more)


def _public() -> Any:
    """Return the module `hfa`, which no extension imports."""
    return import_module("hfa")


def _method(value: Any, name: str) -> Callable[..., Any] | None:
    """Return a function of `hfa` with its first argument given, or None where it has another."""
    function = getattr(_public(), name, None) if name in dir(_public()) else None
    if not inspect.isfunction(function):
        return None
    tests = argument_tests(inspect.unwrap(function), 0)
    is_method = any(holds(value) for place, _, holds, _ in tests if place == 0)
    return partial(function, value) if is_method else None


def keywords(known: Sequence[str], named: dict[str, Any]) -> dict[str, Any]:
    """Return the keywords of a call, with words of other tools replaced by arguments.

    known: arguments of the function
    """
    meant: dict[str, Any] = {}
    for word, value in named.items():
        same = [each for each in ARGUMENTS.get(word, ()) if each in known]
        is_other = word not in known and same and same[0] not in {*named, *meant}
        meant[same[0] if is_other else word] = value
    return meant
