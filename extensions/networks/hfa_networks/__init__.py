"""Critics that are neural networks: their files, the search for errors, and bounds on errors."""
