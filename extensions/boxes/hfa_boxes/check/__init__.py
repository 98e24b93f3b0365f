"""What decides whether an inequality holds; it takes nothing of the search but numbers."""
