"""Files as a bad disk, a broken transfer or a slip of the hand leaves them."""

from __future__ import annotations

import numpy as np

#: Characters and bytes that parsers care about.
_TELLING = b'\x00\x1b\xff"[]{}=,.:-+#9eE\n'


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """The content after one to four of: a bit flipped, a byte replaced, bytes removed or doubled, the end cut."""
    result = bytearray(content)
    for _ in range(rng.integers(1, 5)):
        if not result:
            break
        at, length = int(rng.integers(len(result))), int(rng.integers(1, 33))
        match int(rng.integers(5)):
            case 0:
                result[at] ^= 1 << int(rng.integers(8))
            case 1:
                result[at] = _TELLING[rng.integers(len(_TELLING))]
            case 2:
                del result[at : at + length]
            case 3:
                result[at:at] = result[at : at + length]
            case _:
                del result[at:]
    return bytes(result)
