"""Comparison of JSBSim constructs between this project and JSBSim.

Each construct must give equal results, be refused, or be named in a note. The exit code is 1 if a
result differs without a note or this project fails with a traceback. All constructs are compared,
or those whose names contain a given text. `--drawn N [SEED]` compares N random constructs instead,
with seeds from SEED on.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

from studies.jsbsim.constructs.drawn import drawn
from studies.jsbsim.constructs.judge import ALL, compare_constructs


def main(words: list[str]) -> int:
    """Compare the selected constructs and print the verdicts.

    Return 1 if a construct differs without a note or causes a traceback, otherwise 0.
    """
    constructs = ALL
    if words[:1] == ["--drawn"]:
        constructs = drawn(int(words[1]), int(words[2]) if len(words) > 2 else 0)
        words = []
    names = [name for name in constructs if not words or any(word in name for word in words)]
    with tempfile.TemporaryDirectory() as folder:
        judgements = compare_constructs(names, Path(folder), constructs)
    for judgement in judgements:
        print(f"{judgement.verdict:9} {judgement.name}: {judgement.why}")
    counts = Counter(judgement.verdict for judgement in judgements)
    print(len(judgements), "constructs:", *(f"{n} {verdict}" for verdict, n in counts.items()))
    return 1 if counts["silent"] or counts["traceback"] else 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
