"""Deployment of a policy: observations, actions and timing."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.critic.network.declared import Normalizer
from hfa_flight.policies.deployment.actor import Actor, Wanted, box_of, read_actor
from hfa_support.errors import BadInputError, file_faults, prefix_errors, shown
from hfa_support.files import NUMBER, POSITIVE, Number, checked, read_toml, write_text
from hfa_support.reporting.report import Reported

if TYPE_CHECKING:
    from hfa_aircraft.model import Model


def toml_text(tables: Mapping[str, Mapping[str, Any]]) -> str:
    """Return tables of texts, numbers, paths, lists and mappings as TOML, name -> entries."""
    lines = []
    for table, entries in tables.items():
        lines.append(f"[{table}]")
        lines += [_toml_entry(*entry) for entry in entries.items()]
    return "\n".join([*lines, ""])


def _toml_entry(name: str, value: Any) -> str:
    """Return "name = value", with the name in quotes where TOML requires them."""
    key = name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name)
    return f"{key} = {_toml_value(value)}"


def _toml_value(value: Any) -> str:
    """Return a value as TOML."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(_toml_entry(*entry) for entry in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    if isinstance(value, float):  # in 15 digits: without the rounding errors of a conversion
        return repr(float(f"{value:.15g}"))
    return json.dumps(str(value) if isinstance(value, Path) else value)


#: Largest delay that is assessed, in samples.
MOST_SAMPLES = 100
#: Permitted sample times, s. A flight of minutes then has at most a million samples.
_SAMPLE_TIME = Number(1e-4, 10.0)
_NOT_NEGATIVE = Number(0.0)
_OBSERVATION_ENTRY: dict[Any, Any] = {
    "about": None,
    "scale": NUMBER,
    "formula": str,
    "quantizer": POSITIVE,
}
_ACTION_ENTRY: dict[Any, Any] = {"box": [NUMBER], "map": str, "quantizer": POSITIVE}
_POLICY: dict[Any, Any] = {
    "file": None,
    "normalizer": None,
    "activation": str,
    "squash": None,
    "network": str,
}
#: Tables of a deployment file -> kinds of their entries. A name with * is required.
_ENTRIES: dict[Any, Any] = {
    "policy*": _POLICY,
    "observation*": {str: _OBSERVATION_ENTRY},
    "action*": {str: _ACTION_ENTRY},
    "timing*": {"dt*": _SAMPLE_TIME, "delay": _NOT_NEGATIVE},
    "cost": {"Q*": {str: _NOT_NEGATIVE}, "R*": {str: POSITIVE}},
}
_NORMALIZER: dict[Any, Any] = {
    "mean*": [NUMBER],
    "variance*": [_NOT_NEGATIVE],
    "epsilon": _NOT_NEGATIVE,
    "clip": Number(0.0, above=True, infinite=True),
}


@dataclass(frozen=True, eq=False, repr=False)
class Deployment(Reported):
    """Observations, actions and timing of a policy.

    policy: file (a path or a CasADi Function), normalizer, and settings that the file does not
        state: activation, squash, network. Without a file the deployment describes an environment
        for training.
    observation: name or formula -> about ("trim" or a number) and scale, in the order of the
        network's inputs. An observation is (value - about) / scale. With a quantizer q, in the unit
        of the value, the value is rounded to multiples of q.
    action: input -> box (lowest, highest) and map, a formula of a, trim and names of the aircraft.
        With a quantizer q, in the unit of the input, the input is rounded to multiples of q.
    timing: dt and delay. dt is the sample time, s. delay is the time from a sample until its action
        moves the input, s.
    cost: Q of states or outputs, R of inputs, or None if unknown.
    folder: folder of relative file names.
    origin: name of the deployment file, for messages.

    Raises BadInputError for a wrong entry. `on(model)` checks the names.

    >>> import casadi as ca
    >>> import hfa
    >>> o = ca.SX.sym("o", 2)
    >>> deployment = hfa.Deployment(
    ...     policy={"file": ca.Function("policy", [o], [-0.5 * o[1]])},
    ...     observation={"alpha": {}, "pitch_rate": {}},
    ...     action={"elevator": {"box": [-1, 1], "map": "trim + 0.3 * a"}},
    ...     timing={"dt": 0.02},
    ... )
    >>> deployment.dt, deployment.delay
    (0.02, 0.0)
    """

    policy: Mapping[str, Any]
    observation: Mapping[str, Any]
    action: Mapping[str, Any]
    timing: Mapping[str, Any]
    cost: Mapping[str, Any] | None = None
    folder: Path = field(default_factory=Path)
    origin: str = "the deployment"

    def __post_init__(self) -> None:
        """Check every entry that can be checked without the aircraft."""
        with prefix_errors(self.origin):
            tables = {name: _plain(table) for name, table in self._tables().items()}
        for name, value in checked(self.origin, tables, _ENTRIES).items():
            object.__setattr__(self, name, value)
        with prefix_errors(self.origin):
            self._check_policy()
            self._check_observation()
            self._check_action()
            if self.delay > MOST_SAMPLES * self.dt:
                raise BadInputError(
                    f"timing.delay is {self.delay:g} s; give at most "
                    f"{MOST_SAMPLES * self.dt:g} s ({MOST_SAMPLES} samples)"
                )

    def _tables(self) -> dict[str, Any]:
        """Return the tables of the deployment, by name. Without a cost there is no such table."""
        names = [name.removesuffix("*") for name in _ENTRIES]
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    def __getstate__(self) -> dict[str, Any]:
        """Return the tables of the deployment for pickling.

        The content of the policy's files is omitted. An unpickled copy reads the files again.
        """
        return {table.name: getattr(self, table.name) for table in fields(self)}

    @staticmethod
    def load(path: str | Path) -> Deployment:
        """Load the deployment in the TOML file `path`.

        Raises a BadInputError that names the file, the wrong entry and the correction.
        """
        if Path(path).suffix.lower() != ".toml":
            raise BadInputError(
                f"{path} is not a deployment file (.toml); give a .toml file in which policy.file "
                "is the path of the policy"
            )
        with file_faults(path):
            entries = read_toml(path)
        entries = checked(str(path), entries, {**_ENTRIES, "policy*": {**_POLICY, "file*": None}})
        return Deployment(**entries, folder=Path(path).parent, origin=str(path))

    @staticmethod
    def of(given: Deployment | str | Path) -> Deployment:
        """Return a deployment unchanged, or load it from the TOML file with this path."""
        return given if isinstance(given, Deployment) else Deployment.load(given)

    @staticmethod
    def usual(model: Model, dt: float = 0.02, sensors: tuple[str, ...] = ()) -> Deployment:
        """Return a default deployment of a model, for training.

        What sensors measure, or all linear states without them, is observed, as deviations from the
        trim divided by the nominal values.
        All inputs are actions. An action a in [-1, 1] moves an input by up to half its range, or by
        its nominal value if a limit is not finite.

        dt: sample time, s
        sensors: states and outputs
        """
        from hfa_flight.air.gust_equations import in_gusts

        signals = in_gusts(model).signals
        action = {}
        for name, signal in model.inputs.items():
            half = (signal.max - signal.min) / 2
            size = half if math.isfinite(half) else signal.nominal
            action[name] = {"box": [-1.0, 1.0], "map": f"trim + {size!r} * a"}
        return Deployment(
            policy={},
            observation={
                name: {"scale": signals[name].nominal} for name in sensors or model.linear
            },
            action=action,
            timing={"dt": dt},
        )

    def _check_policy(self) -> None:
        """Raise BadInputError for a wrong squash or normalizer."""
        squash = self.policy.get("squash")
        if squash is not None and not isinstance(squash, bool):
            raise BadInputError(f"policy.squash is {shown(squash)}; give true or false")
        normalizer = self.policy.get("normalizer")
        if isinstance(normalizer, dict):
            checked("policy.normalizer", normalizer, _NORMALIZER)
        elif normalizer is not None and not isinstance(normalizer, (str, Path)):
            raise BadInputError(
                "policy.normalizer is neither a file nor a table; give a file, or a table of "
                "mean, variance, epsilon and clip"
            )

    def _check_observation(self) -> None:
        """Raise BadInputError without observations, and for a wrong `about` or `scale`."""
        if not self.observation:
            raise BadInputError("observation is empty; list the inputs of the network, in order")
        for name, entry in self.observation.items():
            about = entry.get("about", "trim")
            if about != "trim" and NUMBER.of(about) is None:
                raise BadInputError(
                    f'observation.{name}.about is {shown(about)}; give "trim" or a number'
                )
            if entry.get("scale", 1.0) == 0.0:
                raise BadInputError(f"observation.{name}.scale is 0; give a divisor other than 0")

    def _check_action(self) -> None:
        """Raise BadInputError without actions, and for a wrong box."""
        if not self.action:
            raise BadInputError(
                "action is empty; list the inputs of the aircraft that the "
                "network commands, in order"
            )
        for name, entry in self.action.items():
            box = entry.get("box")
            if box is not None and not (len(box) == 2 and box[0] < box[1]):
                raise BadInputError(
                    f"action.{name}.box is {shown(box)}; give [lowest, highest] "
                    "with lowest < highest"
                )

    @property
    def dt(self) -> float:
        """Sample time, s."""
        return float(self.timing["dt"])

    @property
    def delay(self) -> float:
        """Time from a sample until the command computed from it acts, s."""
        return float(self.timing.get("delay", 0.0))

    @cached_property
    def actor(self) -> Actor:
        """Network of the policy.

        Raises BadInputError if the policy's file is missing, cannot be read or contradicts the
        deployment file.
        """
        boxes = {name: entry.get("box") for name, entry in self.action.items()}
        try:
            actor = read_actor(Wanted(self.policy, self.folder, len(self.observation), boxes))
            self._refuse_other_gain(actor.of_gain)
            return actor
        except BadInputError as error:
            # No option is named: settings that are missing belong in the deployment file.
            raise BadInputError(f"{self.origin}: {error}") from error

    def _refuse_other_gain(self, declared: Mapping[str, Any]) -> None:
        """Raise BadInputError if a gain is of other signals or of another sample time.

        declared: what the file of the gain says about it, empty for other policies
        """
        observed = [entry.get("formula", name) for name, entry in self.observation.items()]
        for key, table, listed in (
            ("states", "observation", observed),
            ("inputs", "action", [*self.action]),
        ):
            of_file = [*declared.get(key, ())]
            if of_file and of_file != listed:
                raise BadInputError(
                    f"K is a gain of the {key} {', '.join(of_file)}, but [{table}] lists "
                    f"{', '.join(listed)}; list them as the file does, or remove {key} from it"
                )
        dt = declared.get("dt")  # True: a sample time that is not stated
        if dt not in (None, True) and not math.isclose(float(dt), self.dt, rel_tol=1e-6):
            raise BadInputError(
                f"K is a gain for dt = {float(dt):g} s, but timing.dt is {self.dt:g} s; give "
                "timing.dt of the file"
            )

    @property
    def normalizer(self) -> Normalizer | None:
        """Normalizer of the observations before the network, or None if the policy has none."""
        return self.actor.declared.normalizer

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest action, (m,) each, infinite without a box."""
        # Boxes of the table [action] of the deployment, where a missing one is infinite.
        boxes = {name: entry.get("box") for name, entry in self.action.items()}
        # The box that the policy's file declares, or else that of the deployment.
        box = self.actor.declared.action if "file" in self.policy else box_of(boxes)
        assert box.low is not None
        assert box.high is not None
        return box.low, box.high

    def save(self, path: str | Path) -> None:
        """Write the deployment file .toml.

        Paths of the policy's files become relative to the folder of the deployment file.

        Raises BadInputError for another suffix, and if the policy is a function and not a file.
        """
        if Path(path).suffix.lower() != ".toml":
            raise BadInputError(f"{path}: a deployment file is TOML; give a file .toml")
        policy = dict(self.policy)
        if not isinstance(policy.get("file"), (str, Path)):
            raise BadInputError(
                "the deployment has no file of a policy; write deployment.changed("
                'policy={"file": "ppo.zip"}).save("ppo.toml")'
            )
        for name in ("file", "normalizer"):
            if isinstance(policy.get(name), (str, Path)):
                file = os.path.relpath(self.folder / policy[name], Path(path).parent)
                policy[name] = Path(file).as_posix()
        write_text(path, toml_text({**self._tables(), "policy": policy}))

    def changed(self, **changes: Any) -> Deployment:
        """Return the deployment with some tables replaced.

        The policy's files are reread only if the table `policy` is replaced.
        """
        changed = replace(self, **changes)
        if "policy" not in changes and "actor" in self.__dict__:  # the cached property
            changed.__dict__["actor"] = self.__dict__["actor"]
        return changed


def _plain(value: Any) -> Any:
    """Return a value with mappings as dictionaries, and tuples and arrays as lists."""
    if isinstance(value, Mapping):
        for name in value:
            if not isinstance(name, str):
                raise BadInputError(f"the key {shown(name)} is not text; write the key in quotes")
        return {name: _plain(entry) for name, entry in value.items()}
    if isinstance(value, tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value
