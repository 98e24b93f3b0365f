"""Printed answers: numbers in a paper or manual, compared with their plant's exact solution."""
