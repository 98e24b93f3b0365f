"""Search for a large region and its proof. The checker does not rely on it."""
