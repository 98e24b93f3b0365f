"""The file of an identified aircraft, which `--aircraft` reads."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from hfa_identify.identified import Identified


def aircraft_text(found: Identified) -> str:
    """The TOML text of an aircraft with the estimates as its parameters, with their bands.

    BadInputError where the model was not loaded from a file that can be named."""
    source = found.model.source[0]
    if not source:
        raise BadInputError("-o FILE.toml names the aircraft's file; give the aircraft as a file")
    rows = [f"aircraft = '{source}'", "", "[parameters]"]
    rows += [f"{name} = {each.value!r}" for name, each in found.parameters.items()]
    rows += ["", "# The ends of the 95 % bands.", "[bands]"]
    rows += [f"{name} = [{each.low!r}, {each.high!r}]" for name, each in found.parameters.items()]
    return "\n".join(rows) + "\n"
