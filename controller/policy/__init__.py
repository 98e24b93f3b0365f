"""What flies a plant: policies, their signals, gains scheduled over a variable."""
