"""Many operating points at once: grids, chunks, stores."""
