"""What this extension offers to the command `hfa`."""

from hfa.entry_points import CommandEntry

CHECK = CommandEntry(
    "proof",
    "verify a certificate of one of the following: hfa prove --check FILE",
    "hfa_proof.commands.check:prove",
    example="hfa prove --check certificate.json",
    install=".[proof]",
    results=("hfa_proof.search.results:ProofData", "hfa_proof.search.results:CertificateData"),
)
SCHEDULE = CommandEntry(
    "proof",
    "a gain schedule stabilizes at every angle of an interval",
    "hfa_proof.commands.schedule:schedule",
    example="hfa prove schedule --dihedral 14:14.5 -o certificate.json",
    install=".[proof]",
)
MODELS = CommandEntry(
    "proof",
    "the fewest linear models that interpolate within a tolerance",
    "hfa_proof.commands.models:models",
    example="hfa prove models --dihedral 14:14.5 --limit-error 0.05",
    install=".[proof]",
    results=("hfa_proof.search.results:InterpolatedModels",),
)
SOLUTION = CommandEntry(
    "proof",
    "a game has one stabilizing solution, within a radius of P",
    "hfa_proof.commands.games:solution",
    example="hfa prove solution --dihedral 15",
    install=".[proof]",
)
CRITIC = CommandEntry(
    "proof",
    "the distance of a critic from the exact solution",
    "hfa_proof.commands.games:critic",
    example="hfa prove critic learned.npz --dihedral 15",
    install=".[proof]",
)
