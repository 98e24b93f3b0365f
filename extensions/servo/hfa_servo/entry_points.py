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
        "controller.schedule.scheduled_controller:ControllerData",
        "controller.schedule.scheduled_controller:ControllerFile",
        "controller.plant.plant_report:OutputSolution controller.plant.plant_report:StateSolution",
    ),
)
