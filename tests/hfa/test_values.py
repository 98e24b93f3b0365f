"""Words of the command line become values in the units of the model, or are refused."""

import numpy as np
import pytest

import hfa
from hfa.options import argument_types as types
from hfa_support.files import Number

DEGREE, KNOT = np.pi / 180.0, 1852.0 / 3600.0


def model():
    """Return a model with a speed, an angle, a rate of it and a parameter without a unit."""
    return hfa.Model(
        "small",
        {
            "speed": hfa.Signal("m/s", max=90.0),
            "alpha": hfa.Signal("rad"),
            "q": hfa.Signal("rad/s"),
        },
        {"u": hfa.Signal("N")},
        lambda x, u, p, w: ({"speed": u.u - x.speed, "alpha": x.q, "q": -x.alpha}, {"n": x.speed}),
        parameters={"k": hfa.Signal("1", start=1.0)},
        outputs={"n": hfa.Signal("1")},
    )


#: Kind of a word -> right words and their values, and wrong ones with the reason.
KINDS = {
    "number": (
        types.number,
        [("1e3", 1000.0), (" -2 ", -2.0)],
        [("1_0", "is '1_0'; give a finite number"), ("inf", "is 'inf'; give"), ("x" * 99, "x...")],
    ),
    "seconds": (
        types.seconds,
        [("20ms", 0.02), ("2", 2.0), ("1.5 min", 90.0)],
        [("3 m", "is '3 m'; give a time in s, or with a unit: 20ms"), ("0", "above 0")],
    ),
    "names": (
        types.listed_names,
        [("a, b", ("a", "b")), ("a", ("a",))],
        [("a,,b", "give names separated by commas"), ("a,b,a", "contains a twice; remove one a")],
    ),
    "whole": (
        types.whole(2, 5),
        [("2", 2), ("5", 5), ("3.0", 3)],
        [
            (word, f"is {word}; give a whole number from 2 to 5")
            for word in ("1", "6", "2.5", "3e9")
        ],
    ),
    "one of": (
        types.one_of("si", "us"),
        [("SI", "si"), ("us", "us")],
        [("uk", "is 'uk'; choose from si, us")],
    ),
    "speed": (
        lambda text: types.quantity(model(), "speed", text),
        [("30", 30.0), ("60 kt", 60 * KNOT), ("-1 km/h", -1 / 3.6)],
        [("3 kg", "is '3 kg'; give"), ("fast", "is 'fast'; give a finite number")],
    ),
    "angle": (
        lambda text: types.quantity(model(), "alpha", text),
        [("180", np.pi), ("1 rad", 1.0), ("90deg", np.pi / 2)],
        [("1 m", "is '1 m'; give")],
    ),
    "parameter": (
        lambda text: types.quantity(model(), "k", text, Number(0.0)),
        [("2", 2.0), ("50%", 0.5)],
        [("-3", "of at least 0"), ("-3 %", "of at least 0")],
    ),
    "unknown": (
        lambda text: types.quantity(model(), "sped", text),
        [("5", 5.0)],
        [("5 m", "is the unknown variable 'sped'; did you mean speed?")],
    ),
    "state": (
        lambda text: types.linear_state(model(), "alpha", text, Number(0.0)),
        [("90", np.pi / 2)],
        [("-1", "of at least 0")],
    ),
    "span": (
        lambda text: types.span(model(), "alpha", text),
        [("-90:1rad", (-np.pi / 2, 1.0))],
        [
            ("1", "is '1'; give LOW:HIGH"),
            ("1:2:3", "is '1:2:3'; give LOW:HIGH"),
            ("2:1", "give two different limits, the lower first"),
            ("1:1", "give two different limits, the lower first"),
        ],
    ),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_word_is_a_value_or_refused_with_what_to_give(kind):
    """Angles are typed in degrees, units convert, and a refusal names the word and the kind."""
    convert, right, wrong = KINDS[kind]
    for text, value in right:
        found = convert(text)
        assert type(found) is type(value), text
        if not isinstance(value, str) and kind != "names":
            value = pytest.approx(value, rel=1e-14)
        assert found == value
    for text, said in wrong:
        with pytest.raises(hfa.BadInputError) as refused:
            convert(text)
        assert said in str(refused.value)


@pytest.mark.parametrize(
    ("name", "text", "values"),
    [
        ("speed", "20:30:5", [20, 25, 30]),
        ("speed", "35:35.3:0.1", [35.0, 35.1, 35.2, 35.3]),
        ("speed", "20:29:5", [20, 25]),
        ("speed", "20:20:5", [20]),
        ("speed", "10kt:20 kt:5kt", [10 * KNOT, 15 * KNOT, 20 * KNOT]),
        ("speed", "60kt,35", [60 * KNOT, 35]),
        ("speed", "7", [7]),
        ("alpha", "-5:5:5", [-5 * DEGREE, 0, 5 * DEGREE]),
        ("alpha", "1rad,90", [1, np.pi / 2]),
        ("q", "0:0.3:0.1", [0, 0.1 * DEGREE, 0.2 * DEGREE, 0.3 * DEGREE]),
    ],
)
def test_a_range_has_the_typed_decimals_up_to_its_end(name, text, values):
    """All values of a range are those of its decimals, and none is beyond its end."""
    found = types.array_of(name, types.value_range(model(), name, text), len(values))
    assert found == pytest.approx(np.array(values, float), rel=1e-14, abs=1e-16)
    assert found[-1] <= max(values)
    if len(values) > 1:
        with pytest.raises(
            hfa.BadInputError, match=f"{name} has {len(values)} points, but at most"
        ):
            types.array_of(name, types.value_range(model(), name, text), len(values) - 1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1:2", "is '1:2'; give start:stop:step, a list a,b,c or one number"),
        ("1:2:0", "has the step 0; give a positive step"),
        ("1:2:-1", "has the step -1; give a positive step"),
        ("2:1:1", "runs backwards from 2 to 1; give the lower number first"),
        ("1:2:1kt", "give all three numbers in the same unit"),
        ("1kt:2km/h:1kt", "give all three numbers in the same unit"),
        ("1:x:1", "is 'x'; give a finite number"),
        ("1:2 kg:1", "is '2 kg'; give"),
        ("0:1:1e-9", "is a range of 1,000,000,001 points (maximum"),
        ("10,050 ft", "is '10,050 ft'; write 10050 ft"),
        ("-1,000", "write -1000"),
        ("1,x", "is 'x'; give a finite number"),
    ],
)
def test_a_wrong_range_is_refused(text, said):
    """A range has three numbers in one unit, increases, and has not too many values."""
    with pytest.raises(hfa.BadInputError) as refused:
        types.value_range(model(), "speed", text)
    assert said in str(refused.value)
