"""Declaration, loading and conversion of aircraft models, used by every package."""
