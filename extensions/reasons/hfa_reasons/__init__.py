"""Reasons why a critic is wrong: the mistake, or the other game, that explains its numbers."""
