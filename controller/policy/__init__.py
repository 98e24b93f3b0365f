"""What flies a plant: policies, their signals, gains scheduled over the dihedral."""
