"""The parameters determined by the printed matrices, and their accuracy."""
