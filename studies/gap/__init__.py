"""How far policies of the usual algorithms are from the best flight found, on seven aircraft."""
