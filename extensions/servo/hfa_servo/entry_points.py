"""Entry points of this extension for the command `hfa`."""

from hfa.entry_points import CommandEntry

#: Shipped designs.
ABOUT_DESIGN = "paper, servo"
DESIGN = CommandEntry(
    "flight",
    "design a certified controller for every point of a schedule",
    "hfa_servo.commands.design:design",
    example="hfa design --design paper --dihedral 5,10,15 -o gains.npz",
    results=(
        "hfa_servo.results:ControllerData",
        "hfa_servo.results:ControllerFile",
        "hfa_servo.plant_report:OutputSolution hfa_servo.plant_report:StateSolution",
    ),
)
