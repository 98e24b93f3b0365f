"""Rows of flights: the closed loop, its integration, and one flight."""
