"""Printed answers: numbers in a paper or a manual, compared with the exact solution of their plant."""
