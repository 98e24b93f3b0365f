"""What flies a plant: policies, the signals they are told, gains scheduled over the dihedral."""
