"""Commands that prove and check regions."""
