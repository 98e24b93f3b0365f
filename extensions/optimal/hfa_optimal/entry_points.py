"""Entry points of the optimization extension: commands and formats."""

from hfa.entry_points import CommandEntry

OPTIMIZE = CommandEntry(
    "flight",
    "search for the best flight, and compare policies with it",
    "hfa_optimal.commands.optimize:optimize",
    example="hfa optimize --dihedral 15 --start speed=5,alpha=2.865",
    results=(
        "hfa_optimal.best_flight:BestFlight",
        "hfa_optimal.quickest:QuickestFlight",
        "hfa_optimal.initial_conditions:StartsTable",
        "hfa.critic-check/1 hfa_optimal.initial_conditions:WithFlights",
    ),
)

COST = CommandEntry(
    "proof",
    "lower bound of the cost of every nonlinear flight",
    "hfa_optimal.commands.cost:cost",
    example="hfa prove cost --aircraft examples/pendulum.py:PENDULUM",
    install=".[proof]",
    results=(
        "hfa_boxes.cost_results:FoundLowerBound",
        "hfa_boxes.cost_results:CheckedLowerBound",
    ),
)
