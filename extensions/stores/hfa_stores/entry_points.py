"""Words of this extension in the help of commands."""

ABOUT_STORE = "a sweep larger than memory, by several processes or machines (--workers)"
