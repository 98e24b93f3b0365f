"""Matrices in a .mat file of MATLAB 4 to 7, read without trust: every length is checked before it is used.

SciPy's `loadmat` follows the lengths in a damaged file out of its memory, which ends the process. What is read here
is what a plant or a critic consists of: real and complex matrices, full and sparse, text, cells of text, and single
structures of all these. Anything else (other cells, arrays of structures, objects) is an entry whose value is not
looked at. The formats: "MAT-File Format", The MathWorks.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from hfa_support.files import LARGEST

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _CHAR, _SPARSE, _OPAQUE = 1, 2, 4, 5, 17
#: Structures within structures; a file of a plant has two.
_DEEPEST = 8
_COMPLEX = 0x0800
#: Type of stored numbers, and class of an array -> NumPy's type.
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
#: Type of stored text -> encoding.
_TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
#: MATLAB 4: third digit of the type.
_OLD_STORED = ("f8", "f4", "i4", "i2", "u2", "u1")


class Element(NamedTuple):
    """A piece of a file: what it is, and its bytes."""

    kind: int
    data: memoryview


def read_mat(content: bytes) -> dict[str, Any]:
    """Name -> matrix (rows, columns), text (rows,), cells of text (cells,), structure, or an empty object for the rest.

    ValueError says what is wrong with the file.
    """
    if 0 in content[:4]:
        return dict(_old_matrices(memoryview(content)))
    if len(content) < _HEADER or content[126:128] not in (b"IM", b"MI"):
        raise ValueError("it has no MATLAB header; write it by save -v7")
    order = "<" if content[126:128] == b"IM" else ">"
    version = struct.unpack(f"{order}H", content[124:126])[0] >> 8
    if version != 1:
        raise NotImplementedError("MATLAB 7.3") if version == 2 else ValueError("its version is not known")
    return {name: value for name, value in _matrices(memoryview(content)[_HEADER:], order, LARGEST) if name}


def _matrices(data: memoryview, order: str, room: int) -> Iterator[tuple[str, Any]]:
    """The named arrays of a file; room: bytes that may yet be unpacked."""
    for kind, piece in _elements(data, order):
        if kind == _COMPRESSED:
            unpacking = zlib.decompressobj()
            plain = unpacking.decompress(piece, room + 1)
            room -= len(plain)
            if room < 0:
                raise ValueError(f"it unpacks to more than {LARGEST >> 20} MiB")
            if not unpacking.eof:
                raise ValueError("a packed entry ends early")
            for inner in _elements(memoryview(plain), order):
                if inner.kind == _MATRIX:
                    yield _matrix(inner.data, order)
        elif kind == _MATRIX:
            yield _matrix(piece, order)


def _elements(data: memoryview, order: str) -> Iterator[Element]:
    """The pieces one after the other. A tag is (type, bytes), four bytes each, or two each before up to four bytes."""
    while len(data):
        if len(data) < 8:
            raise ValueError("it ends within a tag")
        first, size = struct.unpack(f"{order}II", data[:8])
        if first >> 16:
            kind, size, begin, end = first & 0xFFFF, first >> 16, 4, 8
            if size > 4:
                raise ValueError(f"a short entry has {size} bytes")
        else:
            kind, begin, end = first, 8, 8 + size
            if kind != _COMPRESSED:
                end += -size % 8
        if begin + size > len(data):
            raise ValueError("it ends within an entry")
        yield Element(kind, data[begin : begin + size])
        data = data[end:]


def _matrix(data: memoryview, order: str, depth: int = 0) -> tuple[str, Any]:
    parts = _elements(data, order)
    flags = _part(parts, order)
    if not flags.size:
        raise ValueError("an entry has no flags")
    kind, is_complex = int(flags[0]) & 0xFF, bool(int(flags[0]) & _COMPLEX)
    if kind == _OPAQUE:
        return _text(_piece(parts)), _unread()
    shape = tuple(_part(parts, order).tolist())
    name = _text(_piece(parts))
    if kind == _CELL:
        return name, _texts_of_cells(parts, shape, order)
    if kind == _STRUCT:
        return name, _structure(parts, shape, order, depth + 1)
    if kind == _CHAR:
        return name, _rows_of_text(_piece(parts), shape, order)
    if kind == _SPARSE:
        rows, begins = _part(parts, order), _part(parts, order)
        return name, _from_columns(shape, rows, begins, _sparse_values(parts, order, is_complex, rows.size))
    if kind not in _CLASSES:
        return name, _unread()
    values = _number(parts, order, is_complex)
    if is_complex:
        return name, _shaped(values, shape)
    return name, _shaped(values.astype(_CLASSES[kind]), shape)


def _texts_of_cells(parts: Iterator[Element], shape: tuple[int, ...], order: str) -> np.ndarray:
    """One text a cell, column after column; not looked at where a cell holds something else."""
    cells = [piece.data for piece in parts if piece.kind == _MATRIX]
    if min(shape, default=-1) < 0 or math.prod(shape) != len(cells):
        raise ValueError("a cell array has another number of cells than it says")
    texts = [_cell_text(cell, order) for cell in cells]
    return _unread() if not texts or None in texts else np.array(texts, dtype=str)


def _cell_text(cell: memoryview, order: str) -> str | None:
    """The one row of text in a cell, "" where it is empty; None for anything else."""
    parts = _elements(cell, order)
    flags, shape = _part(parts, order), tuple(_part(parts, order).tolist())
    if not flags.size or int(flags[0]) & 0xFF != _CHAR:
        return None
    _piece(parts)  # the name, which a cell does not have
    if math.prod(shape) == 0:
        return ""
    rows = _rows_of_text(_piece(parts), shape, order)
    return str(rows[0]) if rows.dtype.kind == "U" and rows.size == 1 else None


def _structure(parts: Iterator[Element], shape: tuple[int, ...], order: str, depth: int) -> Any:
    """Field -> value of a single structure; not looked at where there are many, or too deep."""
    width, names = _part(parts, order), bytes(_piece(parts).data)
    if math.prod(shape) != 1 or depth > _DEEPEST:
        return _unread()
    if width.size != 1 or width[0] < 1 or len(names) % int(width[0]):
        raise ValueError("the fields of a structure have no names")
    size = int(width[0])
    fields = [names[i : i + size].split(b"\0")[0].decode("latin-1") for i in range(0, len(names), size)]
    values = [piece.data for piece in parts if piece.kind == _MATRIX]
    if len(values) != len(fields):
        raise ValueError("a structure has another number of fields than it says")
    return {
        name: _matrix(value, order, depth)[1] if len(value) else np.empty((0, 0))
        for name, value in zip(fields, values, strict=True)
    }


def _piece(parts: Iterator[Element]) -> Element:
    piece = next(parts, None)
    if piece is None:
        raise ValueError("an entry ends early")
    return piece


def _part(parts: Iterator[Element], order: str) -> np.ndarray:
    """The numbers of the next piece, (count,)."""
    piece = _piece(parts)
    if piece.kind not in _STORED:
        raise ValueError(f"numbers are stored as type {piece.kind}, which is not known")
    return _numbers(piece.data, order + _STORED[piece.kind])


def _number(parts: Iterator[Element], order: str, is_complex: bool) -> np.ndarray:
    real = _part(parts, order)
    return _complex(real, _part(parts, order)) if is_complex else real


def _complex(real: np.ndarray, imaginary: np.ndarray) -> np.ndarray:
    """By its parts: a sum would make nan of what is infinite."""
    values = np.empty(real.shape, dtype=complex)
    values.real, values.imag = real, imaginary
    return values


def _sparse_values(parts: Iterator[Element], order: str, is_complex: bool, count: int) -> np.ndarray:
    piece = _piece(parts)
    if len(piece.data) == count and not is_complex:  # true and false: one byte each, whatever the type says
        return _numbers(piece.data, "u1")
    return _number(chain((piece,), parts), order, is_complex)


def _numbers(data: memoryview, kind: str) -> np.ndarray:
    stored = np.dtype(kind)
    if len(data) % stored.itemsize:
        raise ValueError("an entry ends within a number")
    return np.frombuffer(data, stored).astype(stored.newbyteorder("="))


def _shaped(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Columns one after the other, as a matrix."""
    if len(shape) < 2 or min(shape) < 0 or math.prod(shape) != values.size:
        raise ValueError("a matrix has another number of entries than it says")
    return values.reshape(shape, order="F")


def _from_columns(shape: tuple[int, ...], rows: np.ndarray, begins: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A full matrix. rows, values: entries, column after column; begins: (columns + 1,) where each column begins."""
    if len(shape) != 2 or min(shape) < 0 or begins.size != shape[1] + 1:
        raise ValueError("a sparse matrix has no valid size")
    counts = np.diff(begins)
    if begins[0] != 0 or np.any(counts < 0) or begins[-1] > min(rows.size, values.size):
        raise ValueError("the columns of a sparse matrix are not valid")
    count = int(begins[-1])
    return _filled(shape, rows[:count], np.repeat(np.arange(shape[1]), counts), values[:count])


def _filled(shape: tuple[int, ...], rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A matrix of zeros but for the entries named by row and column; those that are named twice add up."""
    if 8 * shape[0] * shape[1] > LARGEST:
        raise ValueError(f"a sparse matrix has {shape[0]} x {shape[1]} entries")
    for index, size in ((rows, shape[0]), (columns, shape[1])):
        if index.size and not 0 <= index.min() <= index.max() < size:
            raise ValueError("an entry of a sparse matrix lies outside of it")
    full = np.zeros(shape, dtype=complex if np.iscomplexobj(values) else float)
    np.add.at(full, (rows, columns), values)
    return full


def _text(piece: Element) -> str:
    return bytes(piece.data).rstrip(b"\0").decode("latin-1")


def _rows_of_text(piece: Element, shape: tuple[int, ...], order: str) -> np.ndarray:
    encoding = _TEXTS.get(piece.kind, "")
    if not encoding:
        raise ValueError(f"text is stored as type {piece.kind}, which is not known")
    if len(piece.data) > LARGEST >> 10:
        return _unread()  # no name is as long, and each letter takes a Python object
    encoding += {"<": "-le", ">": "-be"}[order] if encoding in ("utf-16", "utf-32") else ""
    letters = np.array(list(bytes(piece.data).decode(encoding, "replace")), dtype="U1")
    return _joined(letters, shape)


def _joined(letters: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    if len(shape) != 2 or letters.size != shape[0] * shape[1] or shape[0] > letters.size + 1:
        return _unread()  # MATLAB counts in UTF-16; text of several pages has no rows, that without columns no end
    return np.array(["".join(row) for row in letters.reshape(shape, order="F")])


def _unread() -> np.ndarray:
    return np.empty((1, 1), dtype=object)


def _old_matrices(data: memoryview) -> Iterator[tuple[str, Any]]:
    """MATLAB 4: (type, rows, columns, imaginary part, length of the name), four bytes each; name; numbers."""
    order = "<" if len(data) < 4 or 0 <= struct.unpack("<i", data[:4])[0] < 5000 else ">"
    while len(data):
        if len(data) < 20:
            raise ValueError("it ends within the head of an entry")
        kind, rows, columns, imaginary, letters = struct.unpack(f"{order}5i", data[:20])
        stored, form = kind // 10 % 10, kind % 10
        if not (0 <= kind < 5000 and kind // 100 % 10 == 0 and stored < len(_OLD_STORED) and form < 3):
            raise ValueError("it has no MATLAB header; write it by save -v7")
        if min(rows, columns, letters) < 0 or imaginary not in (0, 1):
            raise ValueError("the head of an entry is not valid")
        name = bytes(data[20 : 20 + letters]).rstrip(b"\0").decode("latin-1")
        dtype = order + _OLD_STORED[stored]
        size = rows * columns * np.dtype(dtype).itemsize
        end = 20 + letters + size * (1 + imaginary)
        if end > len(data):
            raise ValueError("it ends within an entry")
        values = _numbers(data[20 + letters : 20 + letters + size], dtype)
        if imaginary:
            values = _complex(values, _numbers(data[20 + letters + size : end], dtype))
        data = data[end:]
        yield name, _old_value(form, values, (rows, columns))


def _old_value(form: int, values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Full (0), text (1), or sparse (2): rows of (row, column, value[, imaginary part]), the last with the size."""
    matrix = values.reshape(shape, order="F")
    if form == 0:
        return matrix
    if form == 1:
        codes = matrix.real
        valid = np.isfinite(codes).all() and np.all((codes >= 0) & (codes < 256))
        return _joined(np.array([chr(int(code)) for code in codes.ravel(order="F")]), shape) if valid else _unread()
    if shape[0] < 1 or shape[1] not in (3, 4) or np.iscomplexobj(matrix) or not np.isfinite(matrix[:, :2]).all():
        raise ValueError("a sparse matrix is not valid")
    index = np.clip(matrix[:, :2], -1, 2**62).astype(np.int64)
    entries = _complex(matrix[:-1, 2], matrix[:-1, 3]) if shape[1] == 4 else matrix[:-1, 2]
    rows, columns = index[:-1, 0] - 1, index[:-1, 1] - 1
    return _filled((int(index[-1, 0]), int(index[-1, 1])), rows, columns, entries)
