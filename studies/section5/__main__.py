"""Simulates Section 5 of the paper: figures 3 to 23 anew, and every claim with its number, law by law.

Writes FOLDER/SECTION/ with figure-NN.png, figure-NN.npz and result.json, and FOLDER/claims.json and claims.md. A claim
that is not confirmed is a result, not a failure. Takes a minute and a half of computing, which the cores share.
"""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from hfa_model import default_parameters
from hfa_model.provenance import Provenance, parameter_hash
from hfa_support import BadInputError, NoSolutionError
from hfa_support.files import write_texts
from hfa_support.jsonable import records_text
from studies.section5.configuration import SECTIONS, section5_configuration
from studies.section5.reproduction import experiments, reproduce
from studies.section5.setting import MATRICES, make_setting
from studies.section5.tables import claims_markdown, claims_text


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code 0: every flight was simulated. 1: a law of this project lost the aircraft. 2: bad usage."""
    parser = argparse.ArgumentParser("python -m studies.section5", description=__doc__)
    parser.add_argument("section", nargs="?", default="all", choices=("all", *SECTIONS), help="default: all")
    parser.add_argument("-o", type=Path, default=Path("out/section5"), metavar="FOLDER", help="default: %(default)s")
    about = "where A and B come from: trimmed and linearized here (default), or the paper's four decimals"
    parser.add_argument("--matrices", choices=MATRICES, default=MATRICES[0], help=about)
    parser.add_argument("--resume", action="store_true", help="keep the sections that are finished in FOLDER")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), metavar="N", help="default: one a core")
    arguments = parser.parse_args(argv)
    command = shlex.join(["python", "-m", "studies.section5", *(sys.argv[1:] if argv is None else argv)])
    identified = default_parameters()
    origin = Provenance(command, "published", identified.name, parameter_hash(identified.values))
    try:
        setting = make_setting(section5_configuration(), arguments.matrices)
        arguments.o.mkdir(parents=True, exist_ok=True)
        table = reproduce(
            experiments(arguments.section),
            setting,
            arguments.o,
            origin,
            resume=arguments.resume,
            processes=arguments.workers,
        )
    except (BadInputError, NoSolutionError) as error:
        print(f"section5: {error}", file=sys.stderr)
        return 2 if isinstance(error, BadInputError) else 1
    written = claims_markdown(table) + f"\n{origin.text()}\n"
    write_texts(arguments.o, {"claims.json": records_text(table), "claims.md": written})
    print(claims_text(table))
    return 1 if table["own_failures"] else 0


if __name__ == "__main__":
    sys.exit(main())
