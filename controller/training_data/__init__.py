"""The recorded data that the laws learn from, and the Bellman residual on it."""
