"""Critics that are networks: reading of their files, search and proof of their errors."""
