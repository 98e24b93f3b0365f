"""Cost of policies of the usual algorithms above the best flight found, on seven aircraft."""
