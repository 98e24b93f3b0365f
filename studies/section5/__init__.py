"""Section 5 of the paper, re-simulated: its statements, the measured numbers, and whether they
agree."""
