"""Trims and linear models of many points: grids, lists and stores."""
