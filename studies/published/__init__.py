"""Answers that others have printed, judged digit by digit."""
