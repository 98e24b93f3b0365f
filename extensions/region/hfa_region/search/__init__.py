"""How large a region and its proof are found; nothing here is believed."""
