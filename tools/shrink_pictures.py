"""Write PNG files again with few colors: python tools/shrink_pictures.py FILE.png ..."""

import sys

from PIL import Image

#: Pages have few colors: these are enough, if they cover all (method 1).
COLORS = 64

for path in sys.argv[1:]:
    Image.open(path).convert("RGB").quantize(COLORS, 1).save(path, optimize=True)
