"""Files of printed answers for random plants: right, with planted misprints, and learned."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hfa import NoSolutionError
from studies.published.exact_answer import Plant, answer_of, certified_value

Texts = dict[str, list[list[str]]]
SLIPS = ("sign", "interchanged", "dropped", "added", "changed", "point")


class Slip(NamedTuple):
    """Planted misprint of an entry.

    entry: the entry, such as "A21".
    right: right text.
    typed: printed text.
    """

    entry: str
    right: str
    typed: str


class PrintedSample(NamedTuple):
    """Printed plant and its exact answer.

    texts: the plant as printed
    is_discrete: whether time is discrete
    answer: name -> exact block
    decimals: number of decimals of the printed answer
    """

    texts: Texts
    is_discrete: bool
    answer: dict[str, np.ndarray]
    decimals: int

    def file(self, *, learned: bool = False) -> str:
        """Return the sample as the text of a file.

        learned: whether the file states that the answer was learned
        """
        rows = {name: "; ".join(map(" ".join, block)) for name, block in self.texts.items()}
        plant = "\n".join(f'{name} = "{row}"' for name, row in rows.items())
        printed = "\n".join(
            f'{name} = "{"; ".join(" ".join(f"{x:.{self.decimals}f}" for x in row) for row in matrix)}"'
            for name, matrix in self.answer.items()
        )
        time = "discrete" if self.is_discrete else "continuous"
        flag = "learned = true\n" if learned else ""
        return f'time = "{time}"\n{flag}[plant]\n{plant}\n[printed]\n{printed}\n'

    def noisy(self, size: float, rng: np.random.Generator) -> PrintedSample:
        """Return the sample with relative noise in each entry of the answer, and a symmetric P.

        size: standard deviation of the noise
        """
        answer = {}
        for name, matrix in self.answer.items():
            noise = rng.standard_normal(matrix.shape)
            if name == "P":
                noise = np.triu(noise) + np.triu(noise, 1).T
            answer[name] = matrix * (1.0 + size * noise)
        return self._replace(answer=answer)

    def with_slip(self, kind: str, rng: np.random.Generator) -> tuple[PrintedSample, Slip]:
        """Return the sample with a misprint in a random entry of A, B or E, and the misprint.

        kind: kind of the misprint
        """
        while True:
            name = str(rng.choice([name for name in ("A", "B", "E") if name in self.texts]))
            block = self.texts[name]
            row = int(rng.integers(len(block)))
            column = int(rng.integers(len(block[0])))
            right = block[row][column]
            typed = _slipped(right, kind, rng)
            if typed is not None and float(typed) != float(right):
                changed = [list(texts) for texts in block]
                changed[row][column] = typed
                slip = Slip(f"{name}{row + 1}{column + 1}", right, typed)
                return self._replace(texts=self.texts | {name: changed}), slip


def printed_sample(index: int, rng: np.random.Generator) -> PrintedSample:
    """Return a random LQR problem or game, with 2 to 4 states, in continuous or discrete time.

    The plant has 4 to 6 digits. The printed answer is P, K or both, with 3 to 6 decimals.

    index: determines the type of problem
    """
    is_discrete = index % 2 == 1
    while True:
        n = int(rng.integers(2, 5))
        A = rng.normal(size=(n, n))
        if is_discrete:
            A *= rng.uniform(0.5, 1.1) / np.abs(np.linalg.eigvals(A)).max()
        digits = int(rng.integers(4, 7))
        texts = {"A": _texts(A, digits), "B": _texts(rng.normal(size=(n, 1)), digits)}
        if index % 4 >= 2:
            texts["E"] = _texts(0.4 * rng.normal(size=(n, 1)), digits)
            texts["gamma"] = [["7.5"]]
        texts["Q"] = [["diag", *rng.choice(["1", "2", "5", "10", "15"], n)]]
        texts["R"] = [["1"]]
        try:
            plant = _plant(texts, is_discrete)
            answer = answer_of(plant, certified_value(plant))
        except NoSolutionError:
            continue
        printed = (("P", "K"), ("P",), ("K",))[int(rng.integers(3))]
        if np.abs(answer["P"]).max() < 1e5 and (printed != ("K",) or n > 2):
            answer = {name: answer[name] for name in printed}
            return PrintedSample(texts, is_discrete, answer, int(rng.integers(3, 7)))


def _texts(matrix: np.ndarray, digits: int) -> list[list[str]]:
    decimals = digits - 1 - np.floor(np.log10(np.abs(matrix))).astype(int)
    return [
        [f"{value:.{places}f}" for value, places in zip(row, counts, strict=True)]
        for row, counts in zip(matrix, decimals, strict=True)
    ]


def _plant(texts: Texts, is_discrete: bool) -> Plant:
    n = len(texts["A"])
    matrices: dict[str, Any] = {"E": np.zeros((n, 0)), "gamma": np.inf, "N": np.zeros((n, 1))}
    for name, block in texts.items():
        if name == "Q":
            matrices[name] = np.diag([float(text) for text in block[0][1:]])
        elif name == "gamma":
            matrices[name] = float(block[0][0])
        else:
            matrices[name] = np.array([[float(text) for text in row] for row in block])
    return Plant(**matrices, is_discrete=is_discrete)


def _slipped(text: str, kind: str, rng: np.random.Generator) -> str | None:
    """Return a printed number with a misprint in its digits, or None if the misprint is not
    possible.

    kind: kind of the misprint
    """
    sign = "-" if text.startswith("-") else ""
    digits = text.removeprefix("-")
    first = next(index for index, digit in enumerate(digits) if digit in "123456789")
    places = [index for index in range(first, len(digits)) if digits[index] != "."]
    place = int(rng.choice(places[:-1]))
    if kind == "sign":
        return digits if sign else f"-{digits}"
    if kind == "interchanged":
        after = places[places.index(place) + 1]
        between = digits[place + 1 : after]
        swapped = f"{digits[after]}{between}{digits[place]}"
        digits = f"{digits[:place]}{swapped}{digits[after + 1 :]}"
    elif kind == "dropped":
        digits = digits[:place] + digits[place + 1 :]
    elif kind == "added":
        digits = f"{digits[:place]}{rng.integers(10)}{digits[place:]}"
    elif kind == "changed":
        digits = f"{digits[:place]}{rng.integers(10)}{digits[place + 1 :]}"
    else:
        whole, decimals = digits.split(".")
        digits = f"{whole[:-1]}.{whole[-1]}{decimals}"
    return f"{sign}0{digits}" if digits.startswith(".") else f"{sign}{digits}"
