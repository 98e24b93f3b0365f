"""Tests of the core in an environment without extensions: `make test-core`.

A new environment has the libraries of this one and the packages of the core. No module of the
folder extensions/ can be imported there, and no entry point is offered.
"""

import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_DEFAULT = ("-m", "not slow", "tests")
#: Folders of tests that are about the core and its extensions together.
_OF_ALL = ("project", "studies", "nets")
#: The folder itself is left out: `pip install .` leaves the names of the extensions in it.
_PATHS = ("-o", "pythonpath=tests/support")
METADATA = "Metadata-Version: 2.1\nName: hfa-toolchain\nVersion: 0\n"
SCRIPT = "#!{python}\nimport sys\nfrom hfa.entry import main\nsys.exit(main())\n"


def environment(folder):
    """Return the path of the Python interpreter in a new environment without extensions."""
    venv.create(folder, symlinks=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    libraries = [path for path in sys.path if Path(path).name == "site-packages"]
    (packages / "core.pth").write_text("\n".join([*libraries, str(ROOT)]) + "\n")
    # It hides what the same distribution offers in the environment of the libraries.
    metadata = packages / "hfa_toolchain-0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(METADATA)
    python = folder / "bin" / "python"
    script = folder / "bin" / "hfa"
    script.write_text(SCRIPT.format(python=python))
    script.chmod(0o755)
    return python


def main(words):
    """Run pytest with the arguments of the command line, by default on all tests of the core."""
    with tempfile.TemporaryDirectory() as folder:
        python = environment(Path(folder))
        tests = words or [*_DEFAULT, *(f"--ignore=tests/{name}" for name in _OF_ALL)]
        command = [str(python), "-m", "pytest", "-p", "no:cacheprovider", *_PATHS, *tests]
        # Python's own search begins in the environment, not in this folder.
        variables = {**os.environ, "PYTHONSAFEPATH": "1"}
        return subprocess.run(command, cwd=ROOT, env=variables, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
