"""A package of somebody else: aircraft of .cart files, mass and drag, and a command that greets."""

from pathlib import Path

from hfa.doors import CommandEntry
from hfa_aircraft import Model, Signal

GREET = CommandEntry("greeting", "say the name of an aircraft", "hfa_toy.greet:greet")


def read_cart(text: str) -> Model:
    mass, drag = map(float, Path(text).read_text("utf-8").split())
    return Model(
        "cart",
        {"speed": Signal("m/s", start=5.0)},
        {"thrust": Signal("N", start=1.0)},
        lambda x, u, p, w: ({"speed": (u.thrust - drag * x.speed) / mass}, {}),
        trim={"speed": 10.0},
    )
