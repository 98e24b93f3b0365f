"""The learning laws and the runner that ticks them."""
