"""Answers printed by others, judged digit by digit."""
