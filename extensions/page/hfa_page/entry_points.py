"""Entry points of this extension for the command `hfa`."""

from hfa.entry_points import CommandEntry

REPORT = CommandEntry(
    "model",
    "one page: trims, models, games, critics over the dihedral",
    "hfa_page.commands.report:report",
    example="hfa report --dihedral 15 -o report.html",
    install=".[page]",
    results=(
        "hfa_page.results:MainJobData",
        "hfa_page.results:ClaimsData",
        "hfa_page.results:FlightsData",
    ),
)
