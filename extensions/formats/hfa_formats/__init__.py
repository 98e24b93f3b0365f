"""The published formats of outputs: a JSON Schema, derived from the classes of results."""
