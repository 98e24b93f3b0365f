"""`python -m hfa`: the command `hfa` without its script."""

import sys

from hfa.entry import main

sys.exit(main())
