"""Run the command `hfa` by `python -m hfa`."""

import sys

from hfa.entry import main

sys.exit(main())
