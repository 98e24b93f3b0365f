"""Commands and file formats of this extension."""

from hfa.entry_points import CommandEntry

REGION = CommandEntry(
    "proof",
    "region of attraction of a loop with saturated inputs",
    "hfa_region.commands.region:region",
    example="hfa prove region --aircraft examples/pendulum.py:PENDULUM --degree 2",
    install=".[proof]",
    results=(
        "hfa_region.results:FoundSet",
        "hfa_region.results:CheckedSet",
        "hfa_boxes.results:FoundBoxes",
        "hfa_boxes.results:CheckedBoxes",
        "hfa.critic-check/1 hfa_region.results:WithRegion",
    ),
)
