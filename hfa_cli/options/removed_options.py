"""Options that earlier versions had: given today, they are answered with what to do instead."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from hfa_model.support.errors import BadInputError


def add_removed(parser: argparse.ArgumentParser, option: str, instead: str) -> None:
    """An option that is not in the help; with or without a word, it is refused with `instead`."""

    class Refuse(argparse.Action):
        def __call__(self, *_: Any, **__: Any) -> NoReturn:
            raise BadInputError(f"{option} is no longer there: {instead}")

    parser.add_argument(option, nargs="?", action=Refuse, default=argparse.SUPPRESS, help=argparse.SUPPRESS)
