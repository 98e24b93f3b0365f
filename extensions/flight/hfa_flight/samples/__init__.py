"""Many flights with random differences."""
