"""The commands of the core, each a function with its options (`Command`).

`hfa.entry_points.CORE` lists them."""
