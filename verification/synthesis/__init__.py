"""The certified controllers of a design at every angle: loops, feedforward, corners and a search for their weights."""
