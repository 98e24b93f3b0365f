"""Commands of the optimization extension."""
