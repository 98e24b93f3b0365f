"""Reasons why a critic is wrong: the mistake, or another game, that explains its numbers."""
