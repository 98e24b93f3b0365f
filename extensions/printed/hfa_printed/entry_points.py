"""Entry points of this extension for the command `hfa`."""

from hfa.entry_points import CommandEntry

PRINTED = CommandEntry(
    "critic",
    "say whether every digit of a printed answer is right, and of which entry else",
    "hfa_printed.commands.printed:printed",
    example="hfa printed studies/published/sources/radp_suspension.toml",
    results=("hfa_printed.printed_verdict:PrintedVerdict",),
)
