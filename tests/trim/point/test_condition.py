"""Alternative variables in a trim condition, such as mach in place of speed."""

from __future__ import annotations

from typing import Any

import pytest

from hfa import Model, Signal
from hfa.extend import Trimming


def equations(x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    return {"speed": u.thrust - x.speed}, {"knots": 2.0 * x.speed, "mach": x.speed / 100.0}


MODEL = Model(
    "dart",
    {"speed": Signal()},
    {"thrust": Signal()},
    equations,
    outputs={"knots": Signal(), "mach": Signal()},
    trimming=Trimming(
        alternatives=(("speed", "knots", "mach"),),
        begin=lambda imposed: {
            "speed": imposed.get("knots", 0.0) / 2.0 + imposed.get("mach", 0.0) * 100.0
        },
    ),
)


@pytest.mark.parametrize(
    ("imposed", "in_terms_of_speed"),
    [
        ({"knots": 6.0, "thrust": 1.0}, {"speed": 3.0, "thrust": 1.0}),
        ({"mach": 0.5}, {"speed": 50.0}),
        ({"speed": 7.0}, {"speed": 7.0}),
        ({"knots": 6.0, "mach": 0.5}, {"knots": 6.0, "mach": 0.5}),  # they may contradict
        ({"speed": 7.0, "mach": 0.5}, {"speed": 7.0, "mach": 0.5}),
        ({"thrust": 1.0}, {"thrust": 1.0}),
    ],
)
def test_an_alternative_replaces_another_of_its_group(
    imposed: dict[str, float], in_terms_of_speed: dict[str, float]
) -> None:
    """An imposed alternative variable, knots or mach, is replaced by the first of its group,
    speed.
    """
    assert MODEL.trimming.with_first_alternatives(imposed) == in_terms_of_speed


def test_imposing_an_alternative_frees_the_others() -> None:
    """If mach is to be imposed, speed is removed from the imposed variables."""
    imposed = {"speed": 7.0, "thrust": 1.0}
    assert MODEL.trimming.without_alternatives(imposed, ["mach"]) == {"thrust": 1.0}
    assert MODEL.trimming.without_alternatives(imposed, ["thrust"]) == imposed
