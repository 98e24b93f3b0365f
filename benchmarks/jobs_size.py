"""Cost and memory of streamed jobs against their size."""

from __future__ import annotations

from benchmarks.report import Row, Size, value_text
from benchmarks.sized import sized
from benchmarks.timing import Comparison

#: A row of the largest job may cost this much more than one of the cheapest smaller one, and need as much memory.
_LINEAR = 0.8
#: The memory of the largest size is compared with that of the one before, of a few chunks.
_SIZES = (1_000, 10_000, 100_000, 300_000, 1_000_000)
_QUICK = (1, 3)
#: A job of more rows takes minutes and is run once.
_THRICE = 100_000


def rows(quick: bool = False) -> list[Row]:
    """Sweeps and Monte Carlos, each size in a process of its own."""
    sizes = _QUICK if quick else _SIZES
    return [
        row
        for job, name in (("sweep", "points of a sweep into a store"), ("members", "members of 0.1 s into a store"))
        for row in growth(name, [_median(job, count, 1 if quick or count > _THRICE else 3) for count in sizes])
    ]


def growth(name: str, sizes: list[Size]) -> list[Row]:
    """Time and memory of the largest size against the best smaller one."""
    *smaller, largest = sizes
    cheapest = min(size.seconds for size in smaller)
    memory = smaller[-1].memory
    return [
        Row(
            f"{largest.rows} {name}, per row",
            "the cheapest smaller size",
            Comparison(largest.seconds, cheapest, cheapest / largest.seconds),
            _LINEAR,
            "; ".join(f"{size.rows}: {value_text(size.seconds, 's')}, {size.memory:.0f} MB" for size in sizes),
            sizes=tuple(sizes),
        ),
        Row(
            f"{largest.rows} {name}, memory",
            f"{smaller[-1].rows} of them",
            Comparison(largest.memory, memory, memory / largest.memory),
            _LINEAR,
            unit="MB",
        ),
    ]


def _median(job: str, rows: int, repeats: int) -> Size:
    """The run of median time."""
    runs = sorted((sized(job, rows) for _ in range(repeats)), key=lambda run: run.seconds)
    return runs[len(runs) // 2]
