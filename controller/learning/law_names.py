"""Names of the learning laws, for help texts that load no law."""

#: The first is that of `learn` by default.
LAW_NAMES = ("policy-iteration", "published")
DEFAULT_LAW = LAW_NAMES[0]
