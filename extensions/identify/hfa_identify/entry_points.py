"""Commands and formats of this extension."""

from hfa.entry_points import CommandEntry

IDENTIFY = CommandEntry(
    "model",
    "parameters of an aircraft from flight records, with 95 % bands",
    "hfa_identify.commands.identify:identify",
    example="hfa identify examples/uav_record.csv --aircraft examples/uav.toml --free Cm_q",
    results=("hfa_identify.identified:Identified", "hfa_identify.draws.spread:Draws"),
)
