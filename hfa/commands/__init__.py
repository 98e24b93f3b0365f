"""The commands of the core, each a function with declared options (`Command`).

`hfa.entry_points.CORE` lists the commands.
"""
