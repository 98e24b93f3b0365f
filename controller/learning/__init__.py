"""Learning of critics from recorded data: the data, the learning laws, and the loop that runs them."""
