"""The commands, each a function with its options (`Command`); `hfa_cli.main.GROUPS` says which module has which."""
