"""Studies: questions answered with the packages, as a user of them would. Not installed; nothing installed imports them."""
