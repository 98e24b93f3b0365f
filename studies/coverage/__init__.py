"""Coverage of the confidence bands of `hfa identify` on simulated records, and planted faults."""
