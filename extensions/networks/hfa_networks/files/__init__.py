"""The files of networks as policies and values of a critic."""
