"""What this extension offers to the command `hfa`."""

from hfa.doors import CommandEntry

IDENTIFY = CommandEntry(
    "model",
    "parameters of an aircraft from flight records, with 95 % bands",
    "hfa_identify.commands.identify:identify",
    example="hfa identify --aircraft examples/uav.toml flight.csv --free Cm_alpha,Cm_q",
    results=("hfa_identify.identified:Identified",),
)
