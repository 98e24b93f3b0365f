"""Learning of critics from recorded data: the data, the laws and the runner of their ticks."""
