"""Search for a large region and for its proof. The checker imports nothing from the search."""
