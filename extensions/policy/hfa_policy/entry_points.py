"""Commands and formats that this extension adds."""

from hfa.entry_points import CommandEntry

ASSESS = CommandEntry(
    "critic",
    "assess a policy as deployed: sampled, normalized, delayed",
    "hfa_policy.commands.assess:assess",
    example="hfa assess examples/gtm_policy/late.toml --aircraft examples/gtm.py:GTM",
    results=("hfa_policy.assessment_report:Assessment", "hfa_policy.comparison:Comparison"),
)
