"""Plant wrong lines and see whether the fast tests catch them: `make mutants`.

    python tests/mutants.py [LIST ...] [--own]

Each file tests/mutants/LIST.toml has entries `[[mutant]]` with the `file`, the text `before`, which
is in the file exactly once, the wrong text `after`, and `wrong`: what is then wrong for a user. An
entry that no test can catch says why in `equivalent`. One line after the other is planted in a copy
of the source tree. The test that caught it last time runs first, then the tests of the packages of
its list, then all others; with `--own`, these are left out. A test counts only if it passes on the
copy without the line. Results are stored in out/mutants.json: an interrupted run continues there.
PYTEST_ADDOPTS="-n 0" runs the tests in one process.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LISTS = ROOT / "tests" / "mutants"
RESULTS = ROOT / "out" / "mutants.json"
#: Seconds after which tests that do not end are stopped; the planted line is then caught.
LONGEST = 1800.0
NO_END = "no end of the tests"
#: It compares the lists with the source, and would find each planted line.
_OF_THE_LISTS = "tests/project/test_mutants.py"
#: Exit codes of pytest: all passed, a test failed, an error while tests are collected.
_PASSED, _FAILED, _INTERRUPTED = 0, 1, 2


@dataclasses.dataclass(frozen=True)
class Mutant:
    """A wrong line: the text `after` in place of `before` in a file."""

    list: str
    file: str
    before: str
    after: str
    wrong: str
    equivalent: str = ""

    def planted(self, text):
        """Return the text of the file with the wrong line.

        Raises ValueError if `before` is not in the text exactly once, or if nothing changes.
        """
        if (found := text.count(self.before)) != 1:
            raise ValueError(f"{self}: {self.before!r} is there {found} times, not once")
        if self.before == self.after:
            raise ValueError(f"{self}: `after` is `before`")
        return text.replace(self.before, self.after)

    def folders(self):
        """Return the folders of tests of the file's own folder and of its package, nearest first."""
        parts = Path(self.file).parts
        if parts[0] == "extensions":
            return [f"extensions/{parts[1]}/tests"]
        nearest = Path("tests", *parts[:-1])
        folders = [nearest, *nearest.parents[: len(parts) - 2]]
        return [str(folder) for folder in folders if (ROOT / folder).is_dir()]

    def __str__(self):
        return f"{self.file}: {self.wrong}"


def read_lists(names):
    """Return the mutants of the named lists, of all lists if none is named.

    Ends the process with exit code 2 if there is no list of a name.
    """
    paths = {path.stem: path for path in sorted(LISTS.glob("*.toml"))}
    for name in names:
        if name not in paths:
            print(f"mutants: no list {name!r}; choose from {', '.join(paths)}", file=sys.stderr)
            sys.exit(2)
    return [
        Mutant(name, **entry)
        for name in names or paths
        for entry in tomllib.loads(paths[name].read_text(encoding="utf-8"))["mutant"]
    ]


class Copy:
    """A copy of the files that git knows, as they are in the work tree."""

    def __init__(self, folder):
        self.folder = folder
        listed = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True
        )
        digest = hashlib.sha256()
        for name in sorted(filter(None, listed.stdout.decode().split("\0"))):
            if not (ROOT / name).is_file():
                continue  # deleted in the work tree
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
            digest.update(name.encode() + b"\0" + (ROOT / name).read_bytes())
        self.digest = digest.hexdigest()
        paths = [folder, *sorted((folder / "extensions").iterdir())]
        self.variables = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths))}

    def failure(self, tests):
        """Return the first test of these that fails, or None if all pass."""
        command = [
            *(sys.executable, "-m", "pytest", "-m", "not slow", "-x", "--tb=no", "-r", "fE"),
            *("-p", "no:cacheprovider", f"--ignore={_OF_THE_LISTS}", *tests),
        ]
        process = subprocess.Popen(
            command, cwd=self.folder, env=self.variables, text=True, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            output, _ = process.communicate(timeout=LONGEST)
        except subprocess.TimeoutExpired:
            return NO_END
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        if process.returncode not in (_FAILED, _INTERRUPTED):
            return None
        lines = [line for line in output.splitlines() if line.startswith(("FAILED ", "ERROR "))]
        if not lines:
            raise RuntimeError(f"pytest failed without naming a test:\n{output[-2000:]}")
        return lines[0].split(" ", 1)[1].split(" - ")[0]

    def caught_by(self, mutant, stages):
        """Return the test that fails with the line of a mutant and passes without it."""
        path = self.folder / mutant.file
        text = path.read_text(encoding="utf-8")
        _replace(path, mutant.planted(text))
        try:
            test = next(filter(None, map(self.failure, stages)), None)
        finally:
            _replace(path, text)
        if test not in (None, NO_END) and self.failure([test]):
            raise RuntimeError(f"{test} fails without a planted line")
        return test


def _replace(path, text):
    """Write a source file and remove its bytecode, which Python would keep for equal time and size."""
    path.write_text(text, encoding="utf-8")
    Path(importlib.util.cache_from_source(str(path))).unlink(missing_ok=True)


def stages_of(mutant, mutants, last, own):
    """Return the tests to run, one list after the other."""
    of_list = [
        folder for other in mutants if other.list == mutant.list for folder in other.folders()
    ]
    near = list(dict.fromkeys([*mutant.folders(), *of_list]))
    rest = ["tests", "extensions", *(f"--ignore={folder}" for folder in near)]
    first = [] if last in (None, NO_END) else [[last]]
    return [*first, near, *([] if own else [rest])]


def main(words):
    """Print which mutants are caught; return 1 if one is missed or cannot be planted."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # stops the tests, too
    own = "--own" in words
    mutants = read_lists([word for word in words if word != "--own"])
    stored = json.loads(RESULTS.read_text()) if RESULTS.is_file() else {}
    counts = dict.fromkeys(("caught", "missed", "equivalent", "error"), 0)
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copy = Copy(Path(folder))
        for number, mutant in enumerate(mutants, start=1):
            key = f"{mutant.file}: {mutant.before} -> {mutant.after}"
            last = stored.get(key, {})
            test = last.get("caught_by")
            try:
                if last.get("tree") != copy.digest or (test is None and last["own"] and not own):
                    test = copy.caught_by(mutant, stages_of(mutant, mutants, test, own))
                    stored[key] = {"tree": copy.digest, "caught_by": test, "own": own}
                    RESULTS.parent.mkdir(exist_ok=True)
                    RESULTS.write_text(json.dumps(stored, indent=1))
                if mutant.equivalent and test is not None:
                    raise ValueError("it is marked as equivalent, but a test catches it")
                outcome = "caught" if test else "equivalent" if mutant.equivalent else "missed"
            except (ValueError, RuntimeError) as error:
                outcome, test = "error", str(error)
            counts[outcome] += 1
            print(
                f"{number}/{len(mutants)} {outcome}: {mutant}" + (f" ({test})" if test else ""),
                flush=True,
            )
    print(", ".join(f"{count} {outcome}" for outcome, count in counts.items() if count))
    return 1 if counts["missed"] + counts["error"] else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
