"""What this extension adds to the command line."""

from hfa.doors import CommandEntry

ASSESS = CommandEntry(
    group="critic",
    about="whether a policy flies as it is deployed",
    command="hfa_policy.commands.assess:assess",
    example="hfa assess card.toml",
    extra="",
)
