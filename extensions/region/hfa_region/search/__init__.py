"""Search for a large region and its proof. The checker does not depend on it."""
