"""Trims and linear models at many points: grids, lists and stores."""
