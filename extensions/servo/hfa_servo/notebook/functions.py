"""Further functions of `hfa`: functions under names of other tools, and results' methods as
functions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from controller.game.array_file import read_arrays
from hfa_aircraft.signals import Signal
from hfa_servo.notebook.calls import ANALYSED
from hfa_servo.notebook.public import public
from hfa_support.entry_points import COMMANDS, offered
from hfa_support.errors import BadInputError, file_faults
from hfa_support.files import regular_file
from hfa_support.reporting.by_name import ByName
from hfa_support.reporting.report import Reported
from trim.linear.linear_model import LinearModel
from trim.linear.mode import Mode
from trim.point.operating_point import OperatingPoint

_SAME_FUNCTIONS = """
find_trim: trim
findop: trim
fly_policy: fly
linmod: linearize
load_aircraft: load_model
load_policy: read_critic
make_env: environment
read_model: load_model
read_policy: read_critic
ss: LinearModel
"""
#: Command without a Python function of the same name -> what to write in Python.
_INSTEAD = {
    "export": 'write linear.save("model.mat") for MATLAB, or use',
    "design": "write [hfa.lqr(linear, Q, R) for linear in hfa.sweep(model, ...)], or use",
}
#: Function of MATLAB or gymnasium -> equivalent function of this project.
FUNCTIONS = dict(line.split(": ") for line in _SAME_FUNCTIONS.strip().splitlines())


def function(name: str, get: Callable[[str], Any]) -> Callable[..., Any] | None:
    """Return the function for a name that `hfa` does not define, or None.

    The function is one that other tools call by this name, or a method or property of results, as
    in hfa.save(linear, FILE) and hfa.modes(linear).

    get: function from a public name to its object

    Raises AttributeError if the name is the name of a command.
    """
    if name in FUNCTIONS:
        known: Callable[..., Any] = get(FUNCTIONS[name])
        return known
    if name in ("load", "prove"):
        return load if name == "load" else prove
    if name in offered(COMMANDS):
        raise AttributeError(
            f"hfa.{name} does not exist; {_INSTEAD.get(name, 'use')} the command hfa {name}"
        )
    if name[0] == "_" or not _is_attribute(name, get):
        return None

    def of_result(*arguments: Any, **named: Any) -> Any:
        """Return a property, or the value of a method, of the first argument.

        The other arguments are arguments of the method. Raises BadInputError if the first argument
        is not a result.
        """
        result = arguments[0] if arguments else None
        if not isinstance(result, (Reported, Mode, ByName)):
            import control

            matrices = f", or control.{name}(...)" if hasattr(control, name) else ""
            raise BadInputError(
                f"hfa.{name} is a method of results and models; write result.{name}(...){matrices}"
            )
        member = getattr(result, name)
        return member(*arguments[1:], **named) if callable(member) else member

    of_result.__name__ = name
    return of_result


def _is_attribute(name: str, get: Callable[[str], Any]) -> bool:
    """Return whether a name is an attribute of a result or a function of python-control.

    Returns False if a public name of `hfa` differs from the name only in capitals.
    """
    import control
    from control import matlab

    if name.lower() in {each.lower() for each in dir(public())}:
        return False
    results = map(get, ("Model", "OperatingPoint", "LinearModel", "Solution", "Flight", "Verdict"))
    if name in ANALYSED or any(hasattr(each, name) for each in results):
        return True
    return any(callable(getattr(each, name, None)) for each in (control, matlab))


def prove(game: Any, critic: Any = None, *more: Any, **named: Any) -> Any:
    """Return the proof for a critic or, without a critic, for the exact solution of a game.

    game: a game, or a value from which a game is made
    critic: a critic, a gain K, or None
    more, named: further arguments of `hfa.prove_critic` or `hfa.prove_solution`
    """
    hfa = public()
    if critic is None:
        return hfa.prove_solution(game, *more, **named)
    return hfa.prove_critic(game, critic, *more, **named)


def _with_units(linear: LinearModel, stored: Mapping[str, Any]) -> LinearModel:
    """Return a linear model with the name of the dynamics and the units that its file stores."""
    changes: dict[str, Any] = {}
    if "dynamics" in stored:
        changes["name"] = f"{linear.model.name} of {stored['dynamics']}"
    for kind in ("state", "input"):
        names = getattr(linear, f"{kind}s")
        units = [str(unit) for unit in stored.get(f"{kind}_units", ())]
        if len(units) == len(names):
            changes[f"{kind}s"] = {
                name: Signal(unit) for name, unit in zip(names, units, strict=True)
            }
    point = replace(linear.point, model=replace(linear.model, **changes))
    return replace(linear, point=point)


def load(path: str | Path, *more: Any, **named: Any) -> Any:
    """Load an aircraft, deployment, operating point, linear model, game or critic from a file.

    path: file that `save` wrote (.json, .npz or .mat), a deployment file, an aircraft file, or the
      text of an aircraft such as "examples/f16.py:F16"
    more: the model for an operating point, or the game for a critic
    named: keywords of the function that reads this kind of file

    Raises BadInputError if the file cannot be read or its kind is not recognized.
    """
    hfa = public()
    text = str(path)
    suffix = Path(text).suffix.lower()
    if suffix == ".toml":
        with file_faults(text):
            contents = regular_file(text).read_text("utf-8", "replace")
        return hfa.Deployment.load(path) if "[observation" in contents else hfa.load_model(text)
    if suffix not in (".json", ".npz", ".mat"):
        return hfa.load_model(text)
    stored = read_arrays(path)
    if "operating_point" not in stored and "residuals" in stored:
        if not more:
            raise BadInputError(
                f"{text} is an operating point, which cannot be loaded without a model; write "
                "hfa.load(FILE, model)"
            )
        return OperatingPoint.load(Path(text), *more, **named)
    if {"Q", "R"} <= {*stored} or ("delta" in stored and "A" in stored):
        return hfa.load_game(path, **named)
    if {"A", "B"} <= {*stored}:
        names: dict[str, Any] = {
            key: tuple(map(str, stored[key]))
            for key in ("states", "inputs", "outputs")
            if key in stored
        }
        matrices = [stored[key] for key in "ABCD" if key in stored]
        return _with_units(LinearModel(*matrices, **names), stored)
    return hfa.read_critic(path, *more, **named)
