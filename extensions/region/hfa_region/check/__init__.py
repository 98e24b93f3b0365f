"""The checker of a region: it uses only numbers of the search."""
