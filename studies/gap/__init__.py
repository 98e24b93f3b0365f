"""Cost of trained policies above the best flight found, for seven aircraft and four algorithms."""
