"""Studies: questions answered with the packages, as a user would. Not installed; nothing installed
imports them."""
