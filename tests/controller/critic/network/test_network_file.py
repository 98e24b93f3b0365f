"""State dicts as networks, from files of torch, safetensors, .npz and .json."""

import json
import os
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
from network_files import refusal, safetensors_file, square_layers, torch_file

from hfa import BadInputError, read_critic

X = np.random.default_rng(0).normal(size=(7, 6))
pytestmark = pytest.mark.usefixtures("folder")


# Order of layers.


def json_file(path, layers):
    content = {name: rows.tolist() for name, rows in layers.items()}
    Path(path).write_text(json.dumps(content), encoding="utf-8")


def npz_file(path, layers):
    np.savez(path, **layers)


@pytest.mark.parametrize(
    ("path", "write"),
    [("a.pt", torch_file), ("a.safetensors", safetensors_file), ("a.npz", npz_file),
     ("a.json", json_file)],
)  # fmt: skip
def test_layers_are_evaluated_in_the_order_of_their_numbers(game, path, write):
    """V is that of layers 0, 2, 10, 12, although all files but torch's contain 10 and 12 before 2.

    A network that the file does not name is refused.
    """
    layers = square_layers("0", "2", "10", "12")
    names = list(layers) if write is torch_file else sorted(layers)
    write(path, {name: layers[name] for name in names})
    critic = read_critic(path, game, activation="tanh")
    first, second, third, last = layers.values()
    inside = np.tanh(third @ np.tanh(second @ np.tanh(first @ X[0])))
    assert float(critic.value(X[0])) == pytest.approx((last @ inside).item(), rel=1e-12)
    with pytest.raises(BadInputError, match="named 'policy'; this is a single network"):
        read_critic(path, game, activation="tanh", network="policy")


# Refused files.


class Evil:
    """Object whose unpickling makes the folder executed/."""

    def __reduce__(self):
        return os.mkdir, ("executed",)


@pytest.mark.parametrize("packed", [True, False])
def test_a_pickle_with_code_is_not_executed(packed):
    """A pickle that would run code is refused, and its code is not executed."""
    content = pickle.dumps({"0.weight": Evil()})
    for path in map(Path, ("evil.pkl", "evil.pt", "evil.pth")):
        if packed:
            with zipfile.ZipFile(path, "w") as archive:
                archive.writestr("evil/data.pkl", content)
        else:
            path.write_bytes(content)
        assert "mkdir, which is refused (no code was run); save state_dict()" in refusal(path)
        assert not Path("executed").exists()
    pickle.loads(content)  # as torch.load without weights_only
    assert Path("executed").exists()


@pytest.mark.parametrize(
    ("member", "said"),
    [
        ("archive/tensors/0", "was not written by torch.save"),
        ("archive/data.pkl", "refers to data outside the file"),
    ],
)
def test_a_zip_without_the_storages_of_torch_is_refused(member, said):
    """A zip without data.pkl, and one with data.pkl but without its numbers, are refused."""
    torch_file("a.pt", {"weight": np.ones((4, 6))})
    with zipfile.ZipFile("a.pt") as archive:
        of_tensors = archive.read("critic/data.pkl")  # without its storages
    with zipfile.ZipFile("odd.zip", "w") as archive:
        archive.writestr(member, of_tensors)
    assert said in refusal("odd.zip")


ONE = np.zeros((1, 6), "float32")
OF_FOUR = {"0.weight": np.ones((4, 6)), "3.weight": np.ones((1, 4))}
#: What is said of a state dict, in a file of torch or of another suffix.
WRONG = {
    "has 10 inputs": {"weight": np.zeros((1, 10))},
    "not finite": {"weight": ONE + np.nan},
    "'conv.weight' (3, 1, 1) is not a weight or": {
        "0.weight": ONE,
        "conv.weight": np.zeros((3, 1, 1)),
    },
    "have more than 4194304 entries": {"weight": np.zeros((700_000, 6))},
    "has the input size 6, but layer '0' before": {"0.weight": ONE, "1.weight": ONE},
    "'1.weight' (4,)": OF_FOUR | {"1.weight": np.ones(4), "1.bias": np.zeros(4)},
    "'1.running_mean'": OF_FOUR | {"1.running_mean": np.zeros(4)},
    "'1.weight_ih_l0'": OF_FOUR | {"1.weight_ih_l0": np.ones((4, 4))},
    "its bias is (4,); save its transpose (4, 6)": OF_FOUR
    | {"0.weight": np.ones((6, 4)), "0.bias": np.zeros(4)},
    "'fc1' is stored after 'fc2'": square_layers("fc2", "fc1", "out"),
}


@pytest.mark.parametrize("said", WRONG)
def test_wrong_state_dicts_are_refused(said):
    """Layers that are no chain from the 6 states, and other tensors that may act, are refused."""
    assert said in refusal(torch_file("wrong.pt", WRONG[said]), activation="tanh")


def test_layers_of_unknown_order_are_refused():
    """Only a file of torch stores the order of layers whose names have no numbers."""
    path = safetensors_file("a.safetensors", square_layers("hidden", "embed", "out"))
    assert "does not store their order" in refusal(path, activation="tanh")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.pt", b"PK\3\4", "is not a readable zip file"),
        ("b.pt", b"text", "was not written by torch.save"),
        ("c.safetensors", b"\xff" * 20, "is damaged or has another format"),
        ("d.pkl", b"", "was not written by torch.save"),
    ],
)
def test_damaged_and_foreign_files_are_refused(name, content, said):
    """Files that are no zip, no pickle or no safetensors are refused in one line with the path."""
    Path(name).write_bytes(content)
    assert said in refusal(name)


def test_a_file_above_the_largest_size_is_refused():
    """A file of 512 MiB is refused before it is read."""
    with Path("large.pt").open("wb") as stream:
        stream.truncate(2**29)
    assert "larger than 256 MiB" in refusal("large.pt")


def test_a_program_of_torchscript_is_refused():
    """A zip with code/ and constants.pkl is a TorchScript program."""
    with zipfile.ZipFile("script.pt", "w") as archive:
        for name in ("script/data.pkl", "script/constants.pkl", "script/code/__torch__.py"):
            archive.writestr(name, b"")
    assert "the file is a TorchScript program" in refusal("script.pt")
