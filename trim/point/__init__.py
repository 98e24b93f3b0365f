"""Single operating points: condition, solution and report."""
