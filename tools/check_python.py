"""End with an error unless this is Python 3.11 or newer."""

import sys

sys.exit("Python 3.11 or newer is needed; set PYTHON=..." if sys.version_info < (3, 11) else 0)
