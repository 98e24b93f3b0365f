"""What this extension offers to the command `hfa`."""

from hfa.entry_points import CommandEntry

ASSESS = CommandEntry(
    "critic",
    "whether a policy flies as it is deployed: sampled, normalized, late",
    "hfa_policy.commands.assess:assess",
    example="hfa assess examples/gtm_policy/late.toml --aircraft examples/gtm.py:GTM --at 48",
    results=("hfa_policy.assessment_report:Assessment", "hfa_policy.comparison:Comparison"),
)
