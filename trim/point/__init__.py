"""One operating point: its condition, its solution, its report."""
