"""Learning of critics from recorded data: the data, the laws, and the loop that runs them."""
