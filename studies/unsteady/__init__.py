"""Validity of servo designs and gust limits on the `unsteady` dynamics."""
