"""What a solution means: cost, saddle point, gain, margins."""
