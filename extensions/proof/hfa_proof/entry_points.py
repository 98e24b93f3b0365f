"""Commands and file formats of this extension."""

from hfa.entry_points import CommandEntry

CHECK = CommandEntry(
    "proof",
    "verify a certificate of the commands below: --check FILE",
    "hfa_proof.commands.check:prove",
    example="hfa prove --check certificate.json",
    install=".[proof]",
    results=("hfa_proof.search.results:ProofData", "hfa_proof.search.results:CertificateData"),
)
SCHEDULE = CommandEntry(
    "proof",
    "stability of a gain schedule at every point of an interval",
    "hfa_proof.commands.schedule:schedule",
    example="hfa prove schedule --dihedral 14:14.5 -o certificate.json",
    install=".[proof]",
)
MODELS = CommandEntry(
    "proof",
    "fewest linear models for a bounded interpolation error",
    "hfa_proof.commands.models:models",
    example="hfa prove models --dihedral 14:14.5 --limit-error 0.05",
    install=".[proof]",
    results=("hfa_proof.search.results:InterpolatedModels",),
)
SOLUTION = CommandEntry(
    "proof",
    "existence and uniqueness of a game's solution, near P",
    "hfa_proof.commands.games:solution",
    example="hfa prove solution --dihedral 15",
    install=".[proof]",
)
CRITIC = CommandEntry(
    "proof",
    "distance of a critic from the exact solution",
    "hfa_proof.commands.games:critic",
    example="hfa prove critic learned.npz --dihedral 15",
    install=".[proof]",
)
