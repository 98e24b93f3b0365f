"""Hash of a model. The hash covers imported local modules and data that the model reads."""

import pickle
import sys

from hfa import load_model

MODEL = """
from hfa import Model, Signal
from {helper} import gain
PLANT = Model(
    name="plant",
    states={{"x": Signal()}},
    inputs={{"u": Signal()}},
    equations=lambda x, u, p, w: ({{"x": u.u - gain * x.x}}, {{}}),
)
"""


def hashes_of(name, inner):
    """Return three hashes of a model: at first, after its module `inner` is written again with the same
    text, and after a comment is added to it.
    """
    hashes = []
    for content in ("two = 2.0\n", "two = 2.0\n", "two = 2.0  # measured\n"):
        inner.write_text(content)
        hashes.append(load_model(f"{name}:PLANT").source.digest)
    for loaded in [loaded for loaded in sys.modules if "of_plant" in loaded]:
        sys.modules.pop(loaded)
    return hashes


def test_a_changed_module_of_the_enclosing_package_changes_the_hash(tmp_path, monkeypatch):
    """A comment that is added to a module of the outer package changes the hash of a model in an inner
    package that imports it. The same text, written again, does not.
    """
    monkeypatch.syspath_prepend(str(tmp_path))
    outer = tmp_path / "outer_of_plant"
    folder = outer / "models"
    folder.mkdir(parents=True)
    (folder / "helper_of_plant.py").write_text("from ..inner_of_plant import two as gain\n")
    (folder / "plant.py").write_text(MODEL.format(helper=".helper_of_plant"))
    first, written_again, commented = hashes_of(
        "outer_of_plant.models.plant", outer / "inner_of_plant.py"
    )
    assert first == written_again != commented


def test_a_file_imports_the_modules_beside_it(tmp_path, monkeypatch):
    """A file imports modules and packages of its folder, also if another folder has such names.

    The folder is not the working folder. A changed module is imported again, and a pickled copy
    has the same equations. The search path is unchanged, and no compiled files are written.
    """
    monkeypatch.chdir(tmp_path)
    before = list(sys.path)
    for name, gain in (("one", 2.0), ("two", 3.0), ("one", 4.0)):  # the last is a changed module
        folder = tmp_path / name
        (folder / "tables_of_plant").mkdir(parents=True, exist_ok=True)
        (folder / "tables_of_plant" / "inner.py").write_text(f"value = {gain}\n")
        (folder / "beside_plant.py").write_text("from tables_of_plant.inner import value as gain\n")
        (folder / "plant.py").write_text(MODEL.format(helper="beside_plant"))
        model = load_model(f"{name}/plant.py:PLANT")
        assert float(model.at([1.0], [0.0]).f[0]) == -gain
        again = pickle.loads(pickle.dumps(model))
        assert float(again.at([1.0], [0.0]).f[0]) == -gain
    assert sys.path == before
    assert not list(tmp_path.rglob("*.pyc"))
    for name in [name for name in sys.modules if "_plant" in name]:
        sys.modules.pop(name)


def test_the_hash_covers_a_neighboring_table(tmp_path):
    """The hash covers numbers that the equations or the limits read from a .csv file.

    Models with the same hash share their equations.
    """
    (tmp_path / "plant.py").write_text(
        "import pathlib\nimport hfa\n"
        "gain, most = map(float, pathlib.Path(__file__).with_name('a.csv').read_text().split(','))\n"
        "PLANT = hfa.Model('plant', {'a': hfa.Signal(max=most)}, {'u': hfa.Signal()},\n"
        "    lambda x, u, p, w: ({'a': u.u - gain * x.a}, {}))\n"
    )
    models = []
    for table in ("1.0,2.0", "1.0,2.0", "1.5,2.0", "1.0,2.5"):
        (tmp_path / "a.csv").write_text(table)
        models.append(load_model(f"{tmp_path / 'plant.py'}:PLANT"))
    hashes = [model.source.digest for model in models]
    assert hashes[0] == hashes[1]
    assert len({*hashes}) == 3
    assert models[0].equations is models[1].equations
    assert len({model.equations for model in models}) == 3
    rates = [float(model.at([1.0], [0.0]).f[0]) for model in models]
    assert rates == [-1.0, -1.0, -1.5, -1.0]
