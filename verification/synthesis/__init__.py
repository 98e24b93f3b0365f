"""The certified controllers of a design at every angle: their loops, corners and the search for their weights."""
