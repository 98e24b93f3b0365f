"""Commands of the identification extension."""
