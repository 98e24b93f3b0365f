"""Messages for models whose equations fail. The module is imported only in this case."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hfa_aircraft.signals import VECTORS
from hfa_support.errors import BadInputError, refuse_unknown

if TYPE_CHECKING:
    from hfa_aircraft.layout import Layout


def refused(error: Exception, layout: Layout, arguments: list[Any]) -> BadInputError:
    """Return the error for a model whose equations raised an exception.

    error: the exception
    layout: equations and names of the model
    arguments: x, u, p and w of the failed call

    Raises BadInputError itself if the equations use an undeclared name.
    """
    for kind, vector, names in zip(VECTORS.values(), arguments, layout.names, strict=False):
        if isinstance(error, AttributeError) and error.obj is vector:
            refuse_unknown(
                f"{layout.name}: the equations use an undeclared name of {kind},",
                error.name,
                names,
            )
    said = " ".join(str(error).split())[:200]
    if not _takes_four(layout.equations):
        advice = "do not accept (x, u, p, w); declare all four, also those that are not used"
    elif "indices must be integers" in said:
        advice = f"use x['NAME']; write x.NAME ({said})"
    else:
        advice = (
            f"fail ({type(error).__name__}: {said}); use ca.if_else instead of if, and "
            "CasADi's functions (ca.sin) instead of those of other packages"
        )
    return BadInputError(f"{layout.name}: the equations {advice}")


def _takes_four(equations: Callable[..., Any]) -> bool:
    """Return whether a function can be called with four arguments."""
    try:
        inspect.signature(equations).bind(*VECTORS)
    except TypeError:
        return False
    return True
