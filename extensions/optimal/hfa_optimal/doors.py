"""What this extension offers to the command `hfa`."""

from hfa.doors import CommandEntry

OPTIMIZE = CommandEntry(
    "flight",
    "the best flight found of the nonlinear aircraft, beside those of policies",
    "hfa_optimal.commands.optimize:optimize",
    example="hfa optimize --dihedral 15 --start speed=5,alpha=2.865",
    results=(
        "hfa_optimal.best_flight:BestFlight",
        "hfa_optimal.starts:StartsTable",
    ),
)
