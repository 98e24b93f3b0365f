"""Section 5 of the paper, flown again: what it says, what is measured, and whether the two agree."""
