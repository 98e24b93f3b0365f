"""Results of many rows: stores of Zarr, and the processes that fill them."""
