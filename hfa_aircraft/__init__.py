"""Declaration, loading and unit conversion of aircraft models, used by all packages."""
