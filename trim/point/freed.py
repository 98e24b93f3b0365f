"""Trims that solve for parameters, such as the center of gravity at a limit of the elevator."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import Any

from hfa_aircraft.model import Model
from hfa_aircraft.signals import record
from hfa_support.errors import BadInputError
from trim.point.condition import TrimCondition, freed_parameters
from trim.point.operating_point import OperatingPoint
from trim.point.problem import TrimProblem


@lru_cache(maxsize=16)
def with_parameters_as_inputs(model: Model, names: tuple[str, ...]) -> Model:
    """Return the model with some of its parameters as inputs, which a trim can solve for."""
    inputs, parameters = record(tuple(model.inputs)), record(tuple(model.parameters))

    def equations(x: Any, u: Any, p: Any, w: Any) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        """Return rates by state and outputs by name, with the parameters that u contains."""
        # u contains the inputs of the model, and the parameters that are inputs here.
        own_u = inputs(*(getattr(u, name) for name in model.inputs))
        own_p = parameters(*(getattr(u if name in names else p, name) for name in model.parameters))
        return model.equations(x, own_u, own_p, w)

    def begin(imposed: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the initial values that the model computes, at the start values of `names`."""
        starts = {name: model.parameters[name].start for name in names}
        return model.trimming.initial({**starts, **imposed})

    # the original value of each changed parameter, without those that are inputs now
    declared = {name: value for name, value in model.source.declared.items() if name not in names}
    return replace(
        model,
        inputs={**model.inputs, **{name: model.parameters[name] for name in names}},
        parameters={name: signal for name, signal in model.parameters.items() if name not in names},
        equations=equations,
        trimming=replace(model.trimming, begin=begin),
        source=replace(model.source, declared=declared),
    )


def with_found_parameters(
    point: OperatingPoint, model: Model, condition: TrimCondition
) -> OperatingPoint:
    """Return a point of `with_parameters_as_inputs` as one of the model with the parameters found.

    condition: condition of the trim, which sets the parameters free
    """
    found = {name: point[name] for name in freed_parameters(condition)}
    fixed = model.with_parameters(**found)
    problem = None
    with suppress(BadInputError):  # a failed trim can have parameters that the model refuses
        problem = TrimProblem(fixed, condition, point.values, point.trim_problem.kept)
    inputs = record(tuple(model.inputs))(*(point[name] for name in model.inputs))
    found_point = replace(point, inputs=inputs, model=fixed, found_by=problem)
    # `_undetermined` is cached from the solved problem, in which the parameters were unknowns. It
    # would be another one of `problem`, in which they are fixed.
    vars(found_point)["_undetermined"] = point._undetermined
    return found_point
