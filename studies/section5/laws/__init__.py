"""Learning laws of Section 5 of the paper, which learn while an aircraft flies."""
