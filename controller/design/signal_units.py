"""The unit of a controller's states and signals, by their names."""

from __future__ import annotations

import re

from controller.design.design import SHORT_PERIOD
from hfa_model.outputs import OUTPUTS, unit_of
from hfa_model.vectors import INPUT_UNITS, STATES

#: How names end -> what the unit of the rest is multiplied with.
_ENDS = {
    "_command_end": "",
    "_command_rate": "/s",
    "_command": "",
    "_feedforward": "",
    "_estimate": "",
    "_measured": "",
    "_integral": " s",
    "_position": "",
}
_INPUT_RATES = {f"{name}_rate": f"{unit}/s" for name, unit in INPUT_UNITS._asdict().items()}


def signal_unit(name: str) -> str:
    """ft/s of speed_estimate, ft/s^2 s of the integral of an acceleration; "" of a name that says none."""
    rest = name.removeprefix("model_").removesuffix(SHORT_PERIOD)
    known = _INPUT_RATES | INPUT_UNITS._asdict()
    if rest in known:
        return known[rest]
    if rest in STATES or rest in OUTPUTS:
        return unit_of(rest)
    for end, times in _ENDS.items():
        if rest.endswith(end):
            unit = signal_unit(rest.removesuffix(end))
            return re.sub(r"^(.*/.*)/s$", r"(\1)/s", f"{unit}{times}") if unit else ""
    return ""
