"""The recorded data, the learning laws and the runner that ticks them."""
