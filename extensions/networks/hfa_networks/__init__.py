"""Critics that are neural networks: their files, and the search for and proof of their errors."""
