"""Files of networks that represent the policy or the value of a critic."""
