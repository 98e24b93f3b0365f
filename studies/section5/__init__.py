"""Section 5 of the paper, re-simulated: what it says, what is measured, and whether the two agree."""
