"""`python -m hfa_cli`: the command `hfa` without its script."""

import sys

from hfa_cli.entry import main

sys.exit(main())
