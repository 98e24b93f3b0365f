"""Blocks of a matrix, in the order of a plant."""

from __future__ import annotations

from itertools import chain

from hfa_support.errors import BadInputError, shortened


def blocks_in_order(
    names_or_blocks: tuple[str, ...], blocks: dict[str, tuple[str, ...]]
) -> list[int]:
    """Return the places in H of the signals of a plant, block by block.

    names_or_blocks: H_signals of a file: names of the signals of H, or of its blocks, in its order
    blocks: block, such as "x" -> names of its signals, in the order of the plant. Blocks that H
        lacks are left out

    Raises BadInputError for other names.

    >>> blocks_in_order(("u", "beta", "alpha"), {"x": ("alpha", "beta"), "u": ("e",)})
    [2, 1, 0]
    """
    in_matrix = [signal for word in names_or_blocks for signal in blocks.get(word, (word,))]
    present = [signals for signals in blocks.values() if set(signals) & set(in_matrix)]
    in_plant = list(chain.from_iterable(present))
    if sorted(in_matrix) != sorted(in_plant):
        signals = ", ".join(chain.from_iterable(blocks.values()))
        raise BadInputError(
            f"H_signals lists {shortened(', '.join(names_or_blocks), 200)}; give the blocks "
            f"{', '.join(blocks)}, or their signals ({shortened(signals, 200)}), each of them once"
        )
    return [in_matrix.index(signal) for signal in in_plant]
