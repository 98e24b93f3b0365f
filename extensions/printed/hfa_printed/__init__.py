"""Printed answers: numbers of a paper or a manual, compared with the exact answer of its plant."""
