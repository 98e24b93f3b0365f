"""Long work: chunks on workers, stores that are resumed, and what an interruption leaves."""
