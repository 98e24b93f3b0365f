"""Units of a controller's signals."""

from __future__ import annotations

import re

from hfa_aircraft.model import Model

#: Ending of a name -> factor on the unit of the name without it.
_ENDS = {
    "_command_end": "",
    "_rate": "/s",
    "_command": "",
    "_estimate": "",
    "_integral": " s",
    "_position": "",
}


def signal_unit(model: Model, name: str) -> str:
    """Return the unit of a controller signal, derived from its name, or "" if the unit is unknown.

    Examples are ft/s for speed_estimate, and ft/s^2 s for the integral of an acceleration.
    """
    without_lag = re.sub(r"_lag_\d+$", "", name).removeprefix("model_")
    whole, _ = model.part(without_lag)
    if whole in model.signals:
        return model.unit(whole)
    for ending, times in _ENDS.items():
        if without_lag.endswith(ending):
            unit = signal_unit(model, without_lag.removesuffix(ending))
            if not unit:
                return ""
            # "(ft/s)/s" instead of "ft/s/s".
            return re.sub(r"^(.*/.*)/s$", r"(\1)/s", unit + times)
    return ""
