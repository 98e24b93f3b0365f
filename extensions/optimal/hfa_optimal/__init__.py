"""The best flight found of a nonlinear aircraft from a start to its trim: proposed, then flown."""
