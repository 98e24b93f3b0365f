"""The commands, each a function with its options (`Command`); `hfa.main.GROUPS` says which module
has which."""
