"""Why the paper's update law, Eq. (46), overflows; and a learning law written by a user of the
packages."""
