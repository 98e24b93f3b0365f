"""The `Model` of an FMU for model exchange.

The states, inputs, outputs and tunable parameters of the model are those of the FMU, with the
units, nominal values, limits and start values of its `modelDescription.xml`. A dot or bracket in a
name becomes "_". A trim imposes the start values of the inputs by default, and solves for the
states.

A and B are exact if the FMU gives directional derivatives. Otherwise they are central differences,
and a note in every report gives their step and error. They are dense: the dependencies that an FMU
declares are not used.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from multiprocessing.util import get_temp_dir
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.about import About, Domain, Source
from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal, identifiers
from hfa_fmu.description import Description, Variable, described, library_of
from hfa_fmu.function import STEP, Evaluator, casadi_function
from hfa_fmu.library import FmuError, Instance, Interface, Parameter
from hfa_support.errors import BadInputError, prefix_errors, shortened
from hfa_support.files import regular_file, unpacked

#: Largest relative difference between the derivatives of an FMU and differences of its rates.
_LARGEST_DISAGREEMENT = 1e-3
#: Distance of a search's start from an event at the start values, in nominal values.
_EVENT_DISTANCE = 1e-3
#: Longest time of the first evaluation of a library, s.
_LONGEST_RUN = 15.0


def read_model(text: str) -> Model:
    """Return the model of an FMU. The compiled code in the FMU is executed, first in a process of
    its own.

    text: path of the file

    Raises BadInputError if the file is not an FMU for model exchange in FMI 2.0 or 3.0, if it has
    no continuous states or no library for this system, or if its code ends the process, does not
    return, fails, or depends on time.
    """
    content = regular_file(text).read_bytes()
    return _read(text, hashlib.sha256(content).hexdigest())


@cache
def _read(text: str, digest: str) -> Model:
    """Return the model of a file with this hash. Its library is loaded once in a process."""
    with prefix_errors(text):
        folder = _unpacked(Path(text))
        description = described(folder)
        interface = _interface(folder, description)
        start = [
            variable.start
            for variable in (*description.states, *description.inputs, *description.parameters)
        ]
        _run_once(interface, start)
        try:
            instance = Instance(interface)
        except OSError as error:
            raise BadInputError(f"its library cannot be loaded ({error})") from error
        return _model_of_variables(instance, description, start, Source(text, digest))


def _unpacked(file: Path) -> Path:
    """Return a new folder with the files of an FMU, which remains until the process ends."""
    # It is in the temporary folder of this process and of the workers that it starts.
    folder = Path(tempfile.mkdtemp(prefix="fmu-", dir=get_temp_dir()))
    try:
        for name, member in unpacked(file.read_bytes()).items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(member)
    except OSError as error:
        raise BadInputError(f"the FMU cannot be unpacked ({error}); export it again") from error
    return folder


def _interface(folder: Path, description: Description) -> Interface:
    """Return what the calls of an unpacked FMU require."""
    resources = folder / "resources"
    parameters = [  # the fields: name, value reference, FMI's type, is_whole, start value
        Parameter(
            description.names[parameter.name],
            parameter.reference,
            parameter.kind,
            parameter.is_whole,
            parameter.start,
        )
        for parameter in description.parameters
    ]
    return Interface(
        library=str(library_of(folder, description)),
        version=description.version,
        title=description.title,
        token=description.token,
        # FMI 3.0 passes a path that ends with a separator, FMI 2.0 a URI
        resources=f"{resources}/" if description.version == 3 else resources.as_uri(),
        indicators=len(description.indicators),
        states=[variable.reference for variable in description.states],
        rates=[variable.reference for variable in description.rates],
        inputs=[variable.reference for variable in description.inputs],
        parameters=parameters,
        outputs=[variable.reference for variable in description.outputs],
        has_steps=any(variable.is_discrete for variable in description.inputs),
    )


def _run_once(interface: Interface, start: list[float]) -> None:
    """Evaluate an FMU in a process of its own. Raises BadInputError if that ends or hangs it."""
    command = [sys.executable, "-I", str(Path(__file__).with_name("library.py"))]
    task = json.dumps([interface, start]).encode()
    try:
        run = subprocess.run(
            command, input=task, capture_output=True, timeout=_LONGEST_RUN, check=False
        )
    except subprocess.TimeoutExpired:
        raise BadInputError(
            f"its library does not return within {_LONGEST_RUN:g} s; export it again"
        ) from None
    if run.returncode:
        raise BadInputError(
            f"its library ends the process that runs it (exit code {run.returncode}); export it "
            "again"
        )


def _model_of_variables(
    instance: Instance, description: Description, start: list[float], source: Source
) -> Model:
    """Return the model of the variables of an FMU.

    start: start values of states, inputs and parameters, as the FMU states them
    """
    states, inputs, parameters, outputs = (
        {description.names[variable.name]: _signal(variable) for variable in group}
        for group in (
            description.states,
            description.inputs,
            description.parameters,
            description.outputs,
        )
    )

    nominals = [
        np.array([signal.nominal for signal in group.values()])
        for group in (states, inputs, parameters)
    ]
    whole = [parameter.is_whole for parameter in description.parameters]
    count = len(states) + len(outputs)  # of the values that the FMU computes
    evaluator = Evaluator(instance, nominals, count, description.indicators, whole)
    # Searches begin beside an event at the start values.
    begun = _start_beside_events(evaluator, np.array(start), len(states))
    begun_states = begun[: len(states)].tolist()
    states = {
        name: signal._replace(start=value)
        for (name, signal), value in zip(states.items(), begun_states, strict=True)
    }

    about = _about(evaluator, description, begun)
    on_events = _note_on_events(description.indicators, begun.tolist() != start)
    on_names = _note_on_similar_names(description.names)
    about = replace(about, notes=(*about.notes, *on_events, *on_names))

    function = casadi_function(evaluator)

    def equations(x: Any, u: Any, p: Any, _: Any) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        values = ca.vertsplit(function(ca.vertcat(*x, *u, *p)))
        rates = dict(zip(states, values[: len(states)], strict=True))
        return rates, dict(zip(outputs, values[len(states) :], strict=True))

    return Model(
        description.title,
        states=states,
        inputs=inputs,
        equations=equations,
        parameters=parameters,
        outputs=outputs,
        trim={name: signal.start for name, signal in inputs.items()},
        domain=Domain(flown=_fault_of_flight(evaluator)),
        about=about,
        source=source,
    )


def _start_beside_events(evaluator: Evaluator, start: np.ndarray, n: int) -> np.ndarray:
    """Return start values (x, u, p), moved off an event at which no derivative exists.

    n: number of states, which are moved
    """
    is_state = np.arange(start.size) < n
    for move in (0.0, _EVENT_DISTANCE, -_EVENT_DISTANCE):
        begun = start + move * evaluator.nominals * is_state
        try:
            for unit in np.eye(n, start.size):  # along each state
                evaluator.refuse_events(begun, unit)
        except FmuError:
            continue
        return begun
    return start


def _note_on_events(indicators: tuple[str, ...], is_moved: bool) -> tuple[str, ...]:
    """Return a note on the events of an FMU, and whether a search begins beside one."""
    if not indicators:
        return ()
    note = f"event indicators of the FMU: {len(indicators)}; its equations change where one is 0"
    if is_moved:
        note += (
            f", as at the start values: searches begin {_EVENT_DISTANCE:g} nominal values beside"
        )
    return (note,)


def _note_on_similar_names(names: Mapping[str, str]) -> tuple[str, ...]:
    """Return a note on variables whose names differ only in characters that become "_"."""
    # `identifiers` appends "_" to a name that is already used.
    shared = Counter(plain.rstrip("_") for plain in names.values())
    alike = [
        f"{plain} is {shortened(name)}"
        for name, plain in names.items()
        if shared[plain.rstrip("_")] > 1
    ]
    return (f"names alike: {', '.join(alike)}",) if alike else ()


def _about(evaluator: Evaluator, description: Description, start: np.ndarray) -> About:
    """Return what reports say about an FMU, and let the evaluator use the derivatives it gives.

    start: values (x, u, p) at which derivatives are compared
    """
    warnings: tuple[str, ...] = ()
    why_none = _why_no_derivatives(evaluator, description, start)
    evaluator.gives_slopes = not why_none
    try:
        error_of_differences = f"about {_error_of_differences(evaluator, start):.1g}"
        if evaluator.gives_slopes:
            warnings = _warnings(evaluator, start)
    except FmuError as error:
        error_of_differences = f"unknown, because {error},"
    note = "A and B: exact, by the FMU"
    if not evaluator.gives_slopes:
        note = (
            f"A and B: central differences, steps {STEP:g} of the nominal values; error "
            f"{error_of_differences} at the start values ({why_none})"
        )
    # A variable may also be named as in the FMU, body.speed, or by the identifier of this name,
    # body_speed, where the model calls it speed.
    names = description.names
    name_of_identifier = {plain: names[name] for name, plain in identifiers(names).items()}
    return About(
        notes=(note, *description.offered),
        warnings=warnings,
        aliases={**name_of_identifier, **names},
        equations="FMU",
        fault=lambda: evaluator.fault,
    )


def _why_no_derivatives(evaluator: Evaluator, description: Description, start: np.ndarray) -> str:
    """Return why an FMU gives no derivatives at the start values, or "" if it does."""
    if not description.has_directional:
        return "the FMU provides no derivatives"
    try:
        evaluator.instance.along(start.tobytes(), np.ones(evaluator.count_of_x_and_u))
    except FmuError as error:
        return f"the FMU declares derivatives, but {error}"
    return ""


def _error_of_differences(evaluator: Evaluator, start: np.ndarray) -> float:
    """Return the error of the central differences, relative to the largest entry of a row."""
    below, above = _one_sided_jacobians(evaluator, start, STEP)
    far_below, far_above = _one_sided_jacobians(evaluator, start, 2.0 * STEP)
    slopes, nominals = 0.5 * (below + above), evaluator.nominals[: evaluator.count_of_x_and_u]
    # Where f is smooth, the error is c h² for the step h. Steps of h and 2 h then differ by 3 c h².
    smooth_error = (0.5 * (far_below + far_above) - slopes) / 3.0
    # Where f is smooth, the difference between the slopes of both sides is proportional to h: 0
    # remains. At a nonsmooth point, it is the jump of the slope for h and for 2 h: half remains.
    half_jump = (above - below) - 0.5 * (far_above - far_below)
    return max(_largest_error(part, slopes, nominals) for part in (smooth_error, half_jump))


def _warnings(evaluator: Evaluator, start: np.ndarray) -> tuple[str, ...]:
    """Return a warning about derivatives of an FMU that are not those of its rates."""
    below, above = _one_sided_jacobians(evaluator, start, STEP)
    differences = 0.5 * (below + above)
    given = np.array([evaluator.along(start, unit) for unit in _unit_vectors(evaluator)]).T
    nominals = evaluator.nominals[: evaluator.count_of_x_and_u]
    difference = _largest_error(given - differences, differences, nominals)
    if difference <= _LARGEST_DISAGREEMENT:
        return ()
    return (f"the derivatives of the FMU differ from differences of its rates by {difference:.1g}",)


def _unit_vectors(evaluator: Evaluator) -> np.ndarray:
    """Return the unit vectors of the states and inputs, (n + m, n + m + parameters)."""
    return np.eye(evaluator.count_of_x_and_u, evaluator.nominals.size)


def _one_sided_jacobians(
    evaluator: Evaluator, start: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the Jacobians (m, n) by differences from below and from above the start values.

    step: relative to the nominal values
    """
    columns = [evaluator.sided(start, unit, step) for unit in _unit_vectors(evaluator)]
    below, above = (np.array(side).T for side in zip(*columns, strict=True))
    return below, above


def _largest_error(error: np.ndarray, slopes: np.ndarray, nominals: np.ndarray) -> float:
    """Return the largest error of a Jacobian (m, n), relative to the largest entry of its row."""
    # The entries are multiplied by the nominal values of the arguments.
    sizes = np.abs(slopes * nominals).max(axis=1, keepdims=True)
    errors = np.abs(error) * nominals
    return float(np.max(np.divide(errors, sizes, out=np.zeros_like(errors), where=sizes > 0.0)))


def _fault_of_flight(evaluator: Evaluator) -> Callable[[Any, Any, Any], str]:
    """Return `Domain.flown` of an FMU: failed calls, and events."""

    def reason(x: np.ndarray, u: np.ndarray, p: np.ndarray) -> str:
        """Return why f is not valid along states (N, n) with inputs (N, m), or ""."""
        if not np.isfinite(x).all():  # the results of a failed call are NaN
            return evaluator.fault
        rows = np.hstack([x, u, np.tile(p, (len(x), 1))])
        try:
            if event := evaluator.event_among(rows):
                return f"an event of the FMU, at which its equations change: {event}"
        except FmuError as error:
            return str(error)
        return ""

    return reason


def _signal(variable: Variable) -> Signal:
    """Return the unit, nominal value, limits and start value of a variable of an FMU."""
    nominal = variable.nominal
    if nominal in (0.0, 1.0):  # not stated; exporting tools also write FMI's default, 1
        nominal = max(1.0, abs(variable.start))
    return Signal(
        variable.unit or "1", nominal, min=variable.low, max=variable.high, start=variable.start
    )
