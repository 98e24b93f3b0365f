"""One operating point: what is imposed, how it is solved, what it says."""
