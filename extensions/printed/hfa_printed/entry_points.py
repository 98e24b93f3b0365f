"""Entry points of this extension for the command `hfa`."""

from hfa.entry_points import CommandEntry

PRINTED = CommandEntry(
    "critic",
    "compare every printed digit of P, K, L, W or H, name wrong entries",
    "hfa_printed.commands.printed:printed",
    example="hfa printed studies/published/sources/radp_suspension.toml",
    results=("hfa_printed.printed_verdict:PrintedVerdict",),
)
