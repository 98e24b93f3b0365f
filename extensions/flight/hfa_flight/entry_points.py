"""Commands and file formats of this extension."""

from hfa.entry_points import CommandEntry

ABOUT_FMU = "interpolated models as an FMU with the inputs of the aircraft and the swept variables"

FLY = CommandEntry(
    "flight",
    "simulate a policy on the nonlinear aircraft",
    "hfa_flight.commands.fly:fly",
    example="hfa fly --dihedral 15 --gust 400:5",
    results=(
        "hfa_flight.step_flight:StepFlight",
        "hfa_flight.nonlinear_flight:Flight hfa_flight.nonlinear_flight:FlightHistory?",
        "hfa_flight.results:MemberSummary",
        "hfa_flight.results:MemberAttributes hfa_support.rows.store:OfAStore",
    ),
)
EXPORT = CommandEntry(
    "exchange",
    "write the aircraft for other tools: C source, FMU, MATLAB",
    "hfa_flight.commands.export:export",
    results=("hfa_flight.results:Exported",),
    example="hfa export --dihedral 15 -o folder",
)
