"""Study of the provers of regions of attraction."""
