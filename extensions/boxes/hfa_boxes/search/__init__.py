"""Search for regions and cost bounds that the checker proves."""
