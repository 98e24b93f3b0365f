"""The commands of the core, each a function with declared options (`Command`).

`hfa.entry_points.COMMANDS` lists the commands.
"""
