"""`python -m hfa_formats` prints the schema."""

import json
import sys

from hfa_formats.formats import formats

sys.stdout.write(json.dumps(formats(), indent=1, ensure_ascii=False) + "\n")
