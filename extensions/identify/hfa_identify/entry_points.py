"""Entry points of the identification extension: commands and formats."""

from hfa.entry_points import CommandEntry

#: Formats to which `--draws N` adds a section.
_WITH_DRAWS = (
    "trim",
    "linear-model",
    "game-solution",
    "critic-check",
    "assessment",
    "monte-carlo-summary",
)
IDENTIFY = CommandEntry(
    "model",
    "identify parameters from flight records, with 95 % bands",
    "hfa_identify.commands.identify:identify",
    example="hfa identify examples/uav_record.csv --aircraft examples/uav.toml --free Cm_q",
    results=(
        "hfa_identify.identified:Identified",
        *(f"hfa.{name}/1 verification.drawn:WithDraws" for name in _WITH_DRAWS),
    ),
)
