"""What decides whether a region is proved; it takes nothing of the search but numbers."""
