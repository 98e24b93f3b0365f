"""The parameters behind the printed matrices, and how far they can be trusted."""
