"""Entry points of this extension for the command `hfa`."""

from hfa.entry_points import CommandEntry

REPORT = CommandEntry(
    "model",
    "write one page of trims, models, games and critics",
    "hfa_page.commands.report:report",
    example="hfa report --dihedral 15 -o report.html",
    install=".[page]",
    results=(
        "hfa_page.results:MainJobData",
        "hfa_page.results:ClaimsData",
        "hfa_page.results:FlightsData",
    ),
)
