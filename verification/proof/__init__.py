"""Statements that hold for every place of an interval: found in doubles, proved in balls."""
