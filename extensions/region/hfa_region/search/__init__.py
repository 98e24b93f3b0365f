"""Search for a large region and its proof; the checker does not rely on it."""
