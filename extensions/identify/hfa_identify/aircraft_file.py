"""Text of the aircraft file with identified parameters, for `--aircraft`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from hfa_identify.identified import Identified


def aircraft_text(found: Identified) -> str:
    """Return the TOML text of an aircraft file with the estimates, bands and covariance.

    The file refers to the aircraft file from which the model was loaded. Estimated errors of
    columns are in [sensors]. [covariance] is omitted if it is not finite.

    Raises BadInputError if the model was not loaded from a file.
    """
    source = found.model.extras.source[0]
    if not source:
        raise BadInputError(
            "-o FILE.toml requires an aircraft that was read from a file; add --aircraft FILE"
        )
    own = [name for name in found.parameters if name in found.model.parameters]
    errors = [name for name in found.parameters if name not in own]
    places = [list(found.parameters).index(name) for name in own]
    rows = [f"aircraft = '{source}'", "", "[parameters]"]
    rows += [f"{name} = {found.parameters[name].value!r}" for name in own]
    rows += ["", "# Ends of the 95 % bands.", "[bands]"]
    rows += [f"{name} = [{each.low!r}, {each.high!r}]" for name, each in found.parameters.items()]
    if errors:
        rows += ["", "# Errors of the columns of the records.", "[sensors]"]
        rows += [f"{name} = {found.parameters[name].value!r}" for name in errors]
    covariance = found.covariance[np.ix_(places, places)]
    if np.isfinite(covariance).all():
        rows += [
            "",
            "# Covariance of the parameters, for --draws.",
            "[covariance]",
            f"names = {own!r}",
        ]
        rows += ["rows = [", *(f"    {row!r}," for row in covariance.tolist()), "]"]
    return "\n".join(rows) + "\n"
