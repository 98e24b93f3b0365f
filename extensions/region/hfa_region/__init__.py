"""From which states a nonlinear loop with saturated inputs returns to its trim: proved, checked."""
