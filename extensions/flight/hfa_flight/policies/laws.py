"""Laws that plan on the nonlinear model (`hfa_flight.plan`)."""

from __future__ import annotations

#: Law that plans a flight at each sample.
PREDICTIVE = "predictive"
#: Names of all laws.
LAWS = (PREDICTIVE, "state-dependent")


def compared(law: str) -> str:
    """Return the sentence on how the cost of a law's flight is compared with the best flight's."""
    return f"`hfa optimize --law {law} --start ...` compares its cost with that of the best flight."
