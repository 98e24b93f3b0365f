"""Entry point of the command `hfa report`."""

from __future__ import annotations

from hfa.entry_points import CommandEntry

REPORT = CommandEntry(
    "model",
    "write one page of trims, models, games and critics",
    "hfa_page.command:report",
    example="hfa report --dihedral 15 -o report.html",
    install=("plotly",),
)
