"""`python -m hfa_cli`: the command `hfa` without its script."""

import sys

try:
    from hfa_cli.main import main
except ImportError as error:
    print(f"hfa: {error} (a file here with the name of one of our packages hides it)", file=sys.stderr)
    sys.exit(2)

sys.exit(main())
