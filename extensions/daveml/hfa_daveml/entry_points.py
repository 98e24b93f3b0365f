"""Entry points of this extension for the command `hfa`."""

from hfa.entry_points import CommandEntry

DAVEML = CommandEntry(
    "model",
    "compute the check cases of a DAVE-ML file",
    "hfa_daveml.commands.daveml:daveml",
    example="hfa daveml examples/uav.dml",
    results=("hfa_daveml.check_cases:CheckedDocument",),
)
