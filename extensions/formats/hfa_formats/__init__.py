"""The published formats of outputs: a JSON Schema, made from the classes of results."""
