"""`--draws`: the spread of results over the aircraft that uncertain parameters allow."""
