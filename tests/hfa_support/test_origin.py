"""Origin of results: what is computed of something else, or by other code, is another result."""

import shutil
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from project import ROOT

import hfa
from hfa_aircraft.about import Domain
from hfa_support.origin import PACKAGES, code, fingerprint


def model(rate=-1.0, output=1.0, **more):
    """Return x' = rate x + u, y = output x."""
    return hfa.Model(
        "lag",
        {"x": hfa.Signal("m", min=-2.0, max=2.0)},
        {"u": hfa.Signal("N")},
        lambda x, u, p, w: ({"x": rate * x.x + p.k * u.u}, {"y": output * x.x}),
        **{
            "parameters": {"k": hfa.Signal("1", start=1.0)},
            "outputs": {"y": hfa.Signal("m")},
            "trim": {"x": 0.0},
            **more,
        },
    )


def test_models_that_differ_in_one_thing_have_different_fingerprints():
    """Rates, outputs, values and limits of parameters, units, nominal values and declarations decide
    results; a model that is declared again with the same ones is the same.
    """
    limited = model().states["x"]._replace(max=3.0)
    parameter = {"k": hfa.Signal("1", start=2.0)}
    others = [
        model(rate=np.nextafter(-1.0, 0.0)),
        model(output=1.5),
        model(parameters=parameter),
        model(outputs={"y": hfa.Signal("m", max=1.0)}),
        model(trim={"x": 0.5}),
        model(trim={"u": 0.0}),
        model(schedule="k"),
        model(domain=Domain(range={"x": (-1.0, 1.0, "data")})),
        replace(model(), states={"x": limited}),
        replace(model(), states={"x": limited._replace(nominal=0.1, max=2.0)}),
        replace(model(), inputs={"u": hfa.Signal("lbf")}),
    ]
    found = [each.fingerprint for each in (model(), *others)]
    assert len({*found}) == len(found)
    assert model().fingerprint == found[0]


def test_a_fingerprint_is_that_of_the_same_value_in_another_process():
    """Equal aircraft, and functions of this program, have equal fingerprints in two processes; those
    of a user's function differ.
    """
    program = (
        "import hfa; from hfa_support.origin import fingerprint as of\n"
        "print(of(hfa.aircraft()), of(hfa.trim), of([1, 2.5, {'a': None}]), of(lambda x: x))"
    )
    run = partial(subprocess.run, capture_output=True, text=True, check=True)
    first, second = (run([sys.executable, "-c", program]).stdout.split() for _ in range(2))
    assert first[:3] == second[:3]
    assert first[0] == fingerprint(hfa.aircraft())
    assert first[3] != second[3]


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ([2**60], [2**60 + 1]),
        ([1, [2]], [1, 2]),
        (["ab", "c"], ["a", "bc"]),
        ({"a": 1.0}, {"b": 1.0}),
        (np.eye(2), np.eye(2).ravel()),
        (np.zeros(2), np.zeros(2) + 5e-324),
        (None, "None"),
        (partial(hfa.trim, dihedral=0.1), partial(hfa.trim, dihedral=0.2)),
    ],
)
def test_fingerprints_of_neighbours_differ(one, other):
    """Values that differ in a digit, their order or their kind have different fingerprints."""
    assert fingerprint(one) != fingerprint(other)
    assert fingerprint(one) == fingerprint(one)


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """Return a folder with a copy of all packages."""
    folder = tmp_path_factory.mktemp("copy")
    ignored = shutil.ignore_patterns("__pycache__")
    for package in PACKAGES:
        top = Path(ROOT) / package
        source = top if top.is_dir() else next(Path(ROOT).glob(f"extensions/*/{package}"))
        shutil.copytree(source, folder / package, ignore=ignored)
    return folder


def run_in(folder, program):
    """Return what a program prints that imports the packages of a folder."""
    command = [sys.executable, "-P", "-c", program]
    environment = {"PYTHONPATH": str(folder), "PATH": ""}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_the_code_is_what_can_be_imported(copy):
    """Copies of an editor, links that lead nowhere and line ends do not change the identity of the code;
    an edited module does.
    """
    program = "from hfa_support.origin import code; print(code())"
    module = copy / "trim/linear/modes.py"
    (copy / "trim/modes.py~").write_text("x")
    (copy / "trim/link.py").symlink_to("nowhere")
    text = module.read_bytes()
    module.write_bytes(text.replace(b"\n", b"\r\n"))
    assert run_in(copy, program) == [code()]
    module.write_bytes(text + b"#\n")
    assert run_in(copy, program) != [code()]
    module.write_bytes(text)


def test_code_that_changes_under_a_process_is_named_as_such(copy):
    """A process whose files are changed while it runs computes by neither the old code nor the new:
    before the change it has another identity than after it.
    """
    program = (
        "from hfa_support.origin import code; import pathlib, trim; print(code())\n"
        "file = pathlib.Path(trim.__file__).parent / 'sweeps/store.py'; text = file.read_bytes()\n"
        "file.write_bytes(text + b'#'); print(code()); file.write_bytes(text); print(code())"
    )
    before, changed, again = run_in(copy, program)
    assert ("changed" in before, "changed" in changed, changed) == (False, True, again)
