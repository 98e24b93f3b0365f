"""Entry points of this extension for the command `hfa`."""

from hfa.entry_points import CommandEntry

PRINTED = CommandEntry(
    "critic",
    "check every digit of a printed answer, name the wrong entry",
    "hfa_printed.commands.printed:printed",
    example="hfa printed studies/published/sources/radp_suspension.toml",
    results=("hfa_printed.printed_verdict:PrintedVerdict",),
)
