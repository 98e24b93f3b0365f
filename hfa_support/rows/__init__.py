"""Results of many rows: Zarr stores, and the processes that fill them."""
