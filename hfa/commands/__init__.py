"""The commands of the core, each a function with its options (`Command`); `hfa.doors.CORE` lists
them."""
