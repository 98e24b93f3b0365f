"""Laws that plan on the nonlinear model. Their package is loaded when such a law is chosen."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from hfa.options.option import is_installed
from hfa_support.errors import BadInputError

#: Law that plans a flight at each sample.
PREDICTIVE = "predictive"
#: Law -> location of the function (problem, game, **settings) -> policy, "package.module:name".
LAWS = {
    PREDICTIVE: "hfa_flight.plan.predictive:policy_of",
    "state-dependent": "hfa_flight.plan.state_dependent:state_dependent_of",
}
#: Location of the function (policy, problem, tick) -> policy that is kept inside its limits.
KEEP_INSIDE = "hfa_flight.plan.keep_inside:kept_inside"


def loaded(location: str) -> Any:
    """Return a function of `LAWS`, or `KEEP_INSIDE`.

    Raises BadInputError if its package is not installed.
    """
    module, _, name = location.partition(":")
    package = module.partition(".")[0]
    if not is_installed(package):
        raise BadInputError(f"this law requires the package {package}; install it")
    return getattr(import_module(module), name)


def compared(law: str) -> str:
    """Return the sentence on how the cost of a law's flight is compared with the best flight's."""
    return f"`hfa optimize --law {law} --start ...` compares its cost with that of the best flight."
