"""Entry points of this extension for the help of commands."""

ABOUT_STORE = "store of a sweep larger than memory, or by several processes or machines (--workers)"
