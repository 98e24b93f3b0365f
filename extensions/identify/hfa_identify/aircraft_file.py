"""Text of the aircraft file with identified parameters, for `--aircraft`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hfa_aircraft.loading import load_model, relative_to
from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from hfa_identify.identified import Identified


def aircraft_text(identified: Identified, folder: Path) -> str:
    """Return the TOML text of a file with the estimates, bands and covariance.

    The file names the aircraft, relative to its own folder, and the aircraft's SHA-256.
    [parameters] contains the estimates and all other values that differ from the aircraft's own.
    Estimated biases of columns are in [sensors]. [covariance] is omitted if it is not finite.

    folder: folder of the file

    Raises BadInputError if the model was not loaded from a file.
    """
    source = identified.model.source
    if not source.text:
        raise BadInputError(
            "-o FILE.toml requires an aircraft that was read from a file; add --aircraft FILE"
        )
    estimated = [name for name in identified.parameters if name in identified.model.parameters]
    biases = [name for name in identified.parameters if name not in estimated]
    usual = load_model(source.text).parameters
    values = {
        name: signal.start
        for name, signal in identified.model.parameters.items()
        if name in estimated or signal.start != usual[name].start
    }
    # JSON strings are valid TOML.
    rows = [f"aircraft = {json.dumps(relative_to(source.text, folder), ensure_ascii=False)}"]
    rows += [f'sha256 = "{source.digest}"', "", "[parameters]"]
    rows += [f"{name} = {value!r}" for name, value in values.items()]
    rows += ["", "# Ends of the 95 % bands.", "[bands]"]
    rows += [
        f"{name} = [{each.low!r}, {each.high!r}]" for name, each in identified.parameters.items()
    ]
    if biases:
        rows += ["", "# Biases of the columns of the records.", "[sensors]"]
        rows += [f"{name} = {identified.parameters[name].value!r}" for name in biases]
    places = [list(identified.parameters).index(name) for name in estimated]
    covariance = identified.covariance[np.ix_(places, places)]
    if np.isfinite(covariance).all():
        rows += [
            "",
            "# Covariance of the parameters, for --draws.",
            "[covariance]",
            f"names = {estimated!r}",
        ]
        rows += ["rows = [", *(f"    {row!r}," for row in covariance.tolist()), "]"]
    return "\n".join(rows) + "\n"
