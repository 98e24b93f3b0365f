"""The search for regions and bounds that the checker proves."""
