"""Helpers for tests of exported C: compile, load by ctypes, and measure the size."""

import ctypes
import shutil
import subprocess
from functools import cache

import pytest

COMPILER = shutil.which("gcc")
FLAGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror")
needs_gcc = pytest.mark.skipif(COMPILER is None, reason="there is no gcc")


def compiled(folder, *words):
    """Compile C files in a folder with `FLAGS`; a warning is an error."""
    subprocess.run([str(COMPILER), *FLAGS, *words, "-lm"], cwd=folder, check=True)


def written(folder, texts, source):
    """Write C files to a folder, compile one of them to library.so, and return the folder.

    texts: file name -> content
    source: name of the file to compile
    """
    for name, text in texts.items():
        (folder / name).write_text(text, "utf-8")
    compiled(folder, "-shared", "-fPIC", source, "-o", "library.so")
    return folder


@cache
def loaded(folder):
    """Return the library.so of a folder, loaded once."""
    return ctypes.CDLL(str(folder / "library.so"))


def called(folder, name, *values):
    """Call a C function of library.so in a folder with numbers and pointers to arrays; return its
    int.
    """

    def passed(value):
        return (
            ctypes.c_double(value)
            if isinstance(value, float)
            else value.ctypes.data_as(ctypes.c_void_p)
        )

    return int(getattr(loaded(folder), name)(*map(passed, values)))
