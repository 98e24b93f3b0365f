"""The checker of an inequality on boxes: it uses only numbers of the search."""
