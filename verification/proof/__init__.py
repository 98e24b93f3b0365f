"""Statements about every angle of an interval, proved with ball arithmetic."""
