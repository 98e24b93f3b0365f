"""Outputs of commands, stored as a net under changes that must leave them alone.

`python tests/support/stored_outputs.py` in the project's folder stores them anew.
"""

import contextlib
import hashlib
import io
import json
import platform
import sys
import tempfile
import tomllib
from pathlib import Path

import casadi as ca
import numpy as np
import scipy
from json_places import leaves, replaced
from sealed_certificate import sealed

from hfa_support.origin import toolchain

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "tests" / "nets"
#: Entries that name the program, the date or the machine.
_UNSTORED = {"provenance", "made_by", "seconds", "version", "path", "file", "files", "command"}
#: Number of leaves of a statement, and of a witness, that are changed in turn.
_LEAVES = 40
#: Longest list that is stored whole; of longer ones of numbers size, ends and norm are stored.
_LONGEST = 8


def cases():
    """Return the stored commands: kind -> name -> words."""
    content = tomllib.loads((FOLDER / "commands.toml").read_text("utf-8"))
    return {kind: {name: line.split() for name, line in of.items()} for kind, of in content.items()}


def prepare(folder):
    """Write the input files of the commands into a folder."""
    values = np.random.default_rng(5)
    A = np.array([[0.0, 1.0], [2.0, -0.3]])
    B = np.array([[0.0], [1.0]])
    np.savez(folder / "plant.npz", A=A, B=B, Q=np.eye(2), R=np.eye(1))
    steps = {"A": [[1.0, 0.1], [0.0, 0.9]], "B": [[0.0], [0.1]], "Q": [[1, 0], [0, 1]], "R": [[1]]}
    (folder / "steps.json").write_text(json.dumps({**steps, "time": "discrete"}))
    layers = {"0.weight": np.array([[0.2, 0.1]]), "2.weight": np.array([[-22.0]])}
    np.savez(folder / "tanh.npz", **layers)
    first, last = values.normal(size=(8, 6)) * 0.1, values.normal(size=(5, 8)) * 0.01
    np.savez(folder / "network.npz", **{"0.weight": first, "2.weight": last})
    for name, words in cases()["inputs"].items():
        code, _ = run(words, folder)
        assert code == 0, f"{name}: {words}"
    K = np.load(folder / "solution.npz")["K"]
    np.savez(folder / "K.npz", K=K)
    np.savez(folder / "bent.npz", K=K * [1, *[np.pi / 180] * 5])


def run(words, folder):
    """Return exit code and output of `hfa WORDS` in a folder; paths examples/... in the words and in
    the output are those of the project.
    """
    from hfa.main import main

    placed = [word.replace("examples/", f"{ROOT}/examples/") for word in words]
    out = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(out):
        code = main(placed)
    return code, out.getvalue().replace(f"{ROOT}/", "")


def summary(content, path=""):
    """Yield path and value of each leaf of a JSON output. Long lists of numbers are summarized."""
    if isinstance(content, dict):
        for key, value in content.items():
            if key not in _UNSTORED:
                yield from summary(value, f"{path}.{key}" if path else key)
    elif isinstance(content, list):
        yield from _list_summary(content, path)
    else:
        yield path, content


def _list_summary(content, path):
    """Yield path and value of each leaf of a list; of a long one of numbers both ends and the norm."""
    with contextlib.suppress(TypeError, ValueError):
        array = np.asarray(content, dtype=float)
        if array.size > _LONGEST:
            numbers = [array.ravel()[0], array.ravel()[-1], np.sqrt(np.nansum(array**2))]
            yield f"{path}[{'x'.join(map(str, array.shape))}]", [float(each) for each in numbers]
            return
    if not content:
        yield path, []
    shown = range(len(content)) if len(content) <= _LONGEST else [0, 1, len(content) - 1]
    for index in shown:
        yield from summary(content[index], f"{path}[{index}]")


def json_of(words, folder):
    """Return the exit code and the leaves of the JSON output of a command."""
    code, out = run([*words, "--json"], folder)
    return {"exit": code, **dict(summary(json.loads(out) if out.strip() else {}))}


def flight_of(words, folder):
    """Return hash and last row of each array of the file that a flight writes."""
    code, _ = run([*words, "-o", "flight.npz"], folder)
    stored = {"exit": code}
    with np.load(folder / "flight.npz") as arrays:
        for name in sorted(arrays.files):
            array = arrays[name]
            if array.dtype.kind == "f" and array.size > 1:
                digest = hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()
                last = [float(each).hex() for each in np.atleast_1d(array[-1]).ravel()[:3]]
                stored[name] = {"sha256": digest, "shape": list(array.shape), "last": last}
    (folder / "flight.npz").unlink()
    return stored


def help_of(words, folder):
    """Return the help text of a command."""
    with contextlib.suppress(SystemExit):
        return run(words, folder)[1]
    return ""


def certificate_of(words, folder):
    """Return whether a stored certificate, and each changed copy of it, is accepted by a check.

    words: name of the file in certificates/, then the options that give the subject
    """
    name, *subject = words
    content = json.loads((FOLDER / "certificates" / name).read_text("utf-8"))
    check = ["prove", "--check", "changed.json", *subject]
    content["toolchain"] = toolchain()
    found = {"unchanged": _exit_of(content, check, folder)}
    for part in ("statement", "witness"):
        entries = list(leaves({part: content[part]}))
        for path, entry in entries[:: max(1, len(entries) // _LEAVES)]:
            changed = replaced(content, path, _changed(entry))
            found["/".join(map(str, path))] = _exit_of(changed, check, folder)
    return found


def _exit_of(content, check, folder):
    """Return the exit code of a check of a certificate with this content, sealed anew."""
    (folder / "changed.json").write_text(sealed(content), "utf-8")
    with contextlib.redirect_stderr(io.StringIO()):
        return run(check, folder)[0]


def _changed(leaf):
    """Return another value of the type of a leaf."""
    if isinstance(leaf, bool):
        return not leaf
    if isinstance(leaf, str):
        return f"{leaf}x"
    return 0.5 if leaf is None else 1.01 * leaf + 0.001


OUTPUTS = {"json": json_of, "flights": flight_of, "help": help_of, "certificates": certificate_of}


def machine():
    """Return what the last bits of a flight depend on: processor and libraries."""
    processor = platform.processor() or platform.machine()
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
        processor = next(line.split(":")[1].strip() for line in lines if "model name" in line)
    libraries = f"numpy {np.__version__}, scipy {scipy.__version__}, casadi {ca.__version__}"
    return f"{processor}, {libraries}"


def stored(kind):
    """Return the stored outputs of a kind, by name of the command."""
    return json.loads((FOLDER / f"{kind}.json").read_text("utf-8"))


def main(kinds):
    """Store the outputs of the commands of each kind."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        for kind in kinds or OUTPUTS:
            outputs = {"machine": machine()} if kind == "flights" else {}
            for case, words in cases()[kind].items():
                outputs[case] = OUTPUTS[kind](words, folder)
            path = FOLDER / f"{kind}.json"
            path.write_text(json.dumps(outputs, indent=1) + "\n", "utf-8")
            print(f"wrote {path.relative_to(ROOT)}")


if __name__ == "__main__":
    main(sys.argv[1:])
