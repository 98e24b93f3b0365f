"""Commands that prove and check regions on boxes."""
