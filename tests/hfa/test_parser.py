"""Options are declared as fields of a request: their values, help and refusals."""

from dataclasses import dataclass
from typing import ClassVar

import pytest

import hfa
from hfa.options.argument_types import number
from hfa.options.parser import PAPER, Parser, option, options_of


@dataclass(frozen=True, kw_only=True)
class Request:
    """Options of each kind. `size` is usual, and first in the help."""

    usual: ClassVar = ("size",)

    verbose: bool = option("say more", names="-v --verbose")
    size: float = option("a size", "X", number, default=2.0)
    rate: float | None = option("of the paper", "HZ", number, group=PAPER)
    names: tuple = option("names", "NAME", repeated=True)
    values: dict = option(
        "values", "NAME=VALUE", lambda name, text: (name, number(text)), named=True
    )
    texts: dict = option(lambda: "texts by name", "NAME=TEXT", named=True, rare=True)
    limit: dict = option("limits of a trim", "NAME=LOW:HIGH", named=True)
    several: tuple = option("numbers", "X", number, default=(), count="+", required=True)
    color_: str = option("optional word", "COLOR", default="none", alone="red")
    output: str = option("written file", "FILE", names="-o --output")


def parsed(*words):
    """Return the values of a command line, with the required option."""
    parser = Parser(options_of(Request), prog="hfa test")
    return parser.parse_words([*words, "--several", "1"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--size x", "--size is 'x'; give a finite number"),
        ("--size 1 --size 2", "--size is given twice (1 and 2); give one value"),
        ("--size --", "--size "),
        ("--sizes 1", "unknown option --sizes; did you mean --size?"),
        ("--frobnicate", "unknown option --frobnicate (see `hfa test --help`)"),
        ("--siz 1", "unknown option --siz; did you mean --size?"),
        ("--values a", "--values 'a' is not NAME=VALUE; give a name and a value"),
        ("--values a=x", "--values a is 'x'; give a finite number"),
        ("--values a=1,a=2", "--values a is given twice (1 and 2); give one value"),
        ("stray", "unrecognized arguments: stray (see `hfa test --help`)"),
        ("--output", "--output expected one argument"),
        ("-o a -o b", "--output is given twice (a and b); give one value"),
    ],
)
def test_wrong_words_are_refused(words, said):
    """A message has the option by its long name, the fault, and what to give."""
    with pytest.raises(hfa.BadInputError) as refused:
        parsed(*words.split())
    assert str(refused.value).startswith(said)


def test_the_help_has_usual_options_first_and_rare_ones_by_name(capsys):
    """Required options come first, then usual ones, those of the output, of the paper, and rare
    ones, which the short help lists by name. The long help explains all.
    """
    parser = Parser(
        options_of(Request),
        prog="hfa test",
        example="hfa test 1",
        second_words=lambda: {"sub": "more"},
    )
    order = ["several", "size", "verbose", "names", "values", "color_", "output", "rate"]
    assert [*options_of(Request)] == [*order, "texts", "limit"]
    short, whole = parser.format_help(), parser.format_help(more=True)
    assert short.startswith("usage: hfa test [options]")
    assert "more (hfa test --help more): --texts, --limit\n" in short
    assert "texts by name" not in short
    assert "texts by name" in whole
    assert "rarely used:" in whole
    assert f"{PAPER}:" in short
    assert "more (hfa" not in whole
    for text in (short, whole):
        assert text.endswith("\n  hfa test sub       more\n\nexample: hfa test 1\n")
        assert text.index("--several") < text.index("--size") < text.index("-o FILE")
    long = Parser(options_of(Request), prog="hfa test", example="x" * 71).format_help()
    assert long.endswith("\nexample:\n" + "x" * 71 + "\n")
    for word, expected in (("", short), ("more", whole)):
        with pytest.raises(SystemExit):
            parser.parse_words(["--help", *([word] if word else [])])
        assert capsys.readouterr().out == expected
