"""Numbers with proof: balls, Taylor models of them, and functions run on them; the prover and the checker share it."""
