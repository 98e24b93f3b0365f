from dataclasses import dataclass

from hfa.options.command import command
from hfa.options.request import option
from hfa.options.trims import AircraftOptions


@dataclass(frozen=True, kw_only=True, eq=False)
class GreetRequest(AircraftOptions):
    """Whom to greet."""

    loudly: bool = option("in capitals")


@command(GreetRequest)
def greet(request: GreetRequest) -> int:
    """Say the name of an aircraft."""
    words = f"hello, {request.model.name}"
    print(words.upper() if request.loudly else words)
    return 0
