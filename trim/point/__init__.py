"""A single operating point: condition, solution and report."""
