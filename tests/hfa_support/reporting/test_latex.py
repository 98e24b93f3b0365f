"""No sign of a report is a command of LaTeX by accident."""

from __future__ import annotations

import re

import pytest

from hfa_support.reporting.latex import latex_table, latex_text
from hfa_support.reporting.text import Table


@pytest.mark.parametrize(
    ("text", "escaped"),
    [
        ("pitch_rate, 5 %", r"pitch\_rate, 5 \%"),
        (r"a\b {c} ~ ^ # & $", r"a\textbackslash{}b \{c\} \textasciitilde{} \textasciicircum{} \# \& \$"),
        ("--free", r"-{}-{}free"),
        ("ft lbf/s²", r"ft lbf/s\ensuremath{^2}"),
        ("-0.0144 ± 0.7458i", r"-{}0.0144 \ensuremath{\pm} 0.7458i"),
    ],
)
def test_signs_are_escaped(text: str, escaped: str) -> None:
    assert latex_text(text) == escaped


def test_all_of_ascii_comes_out_as_text() -> None:
    """What is left when the known commands are taken away holds none of the signs that LaTeX acts on."""
    printable = "".join(map(chr, range(32, 127)))
    rest = re.sub(r"\\(text\w+\{\}|[&%$#_{}])|\{[\[\]]\}|-\{\}", "", latex_text(printable))
    assert not set(rest) & set('\\&%$#_{}~^<>|"[]-')
    assert set(rest) >= set("abcXYZ019 .,;:!?()*+/='`@")


def test_a_table_is_a_plain_tabular_with_minus_signs() -> None:
    table = Table(("name", "value", "unit"), [("alpha", "-2.80000", "deg"), ("[a]", "-", "x-y")])
    assert latex_table(table).splitlines() == [
        r"\noindent\begin{tabular}{lrr}",
        r"name & value & unit \\",
        r"\hline",
        r"alpha & $-$2.80000 & deg \\",
        r"{[}a{]} & -{} & x-{}y \\",
        r"\end{tabular}",
    ]
