"""Search for a large region and its proof, independent of the checker."""
