"""Exit codes of the command."""

DONE = 0
#: A check failed, or no solution exists.
FAILED = 1
#: Bad usage or input.
BAD_INPUT = 2
#: The run was ended by Ctrl-C, SIGTERM or SIGHUP.
INTERRUPTED = 130
TERMINATED = 143
