"""Text and tables as LaTeX that needs no package."""

from __future__ import annotations

import re

from hfa_support.reporting.text import Table

_ESCAPED = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': "''",
    "[": "{[}",  # "\\ [" would be a length
    "]": "{]}",
    "-": "-{}",  # "--" would be a dash
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
}
_MATHEMATICS = {
    **{"±": r"\pm", "²": "^2", "³": "^3", "¹": "^1", "⁴": "^4", "⁻": "^-", "₀": "_0", "₁": "_1", "₂": "_2"},
    **{"∂": r"\partial", "∞": r"\infty", "°": r"^\circ", "≤": r"\le", "≥": r"\ge", "√": r"\surd", "×": r"\times"},
    **{"α": r"\alpha", "γ": r"\gamma", "δ": r"\delta", "η": r"\eta", "θ": r"\theta", "λ": r"\lambda", "µ": r"\mu"},
    **{"π": r"\pi", "ρ": r"\rho", "σ": r"\sigma", "Δ": r"\Delta", "Γ": r"\Gamma", "Σ": r"\Sigma", "κ": r"\kappa"},
}
_SIGNS = {**_ESCAPED, **{sign: rf"\ensuremath{{{command}}}" for sign, command in _MATHEMATICS.items()}}


def latex_text(text: str) -> str:
    """The text with every sign that LaTeX would take for a command escaped, and mathematical signs as such."""
    return "".join(_SIGNS.get(sign, sign) for sign in text)


def latex_table(table: Table) -> str:
    """The first column to the left, the others to the right, as on a terminal."""
    columns = "l" + "r" * (len(table.header) - 1)
    header, *body = (" & ".join(map(_cell, row)) + r" \\" for row in (table.header, *table.rows))
    lines = [header, r"\hline", *body]
    return "\n".join([rf"\noindent\begin{{tabular}}{{{columns}}}", *lines, r"\end{tabular}"])


def _cell(cell: object) -> str:
    """A cell; a sign before a digit is a minus, not a hyphen."""
    text = " ".join(str(cell).split())
    return re.sub(r"^-\{\}(?=[\d.])", "$-$", latex_text(text))
