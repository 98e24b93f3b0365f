"""Fixtures that several test files share."""

import pytest
from known_models import exact_gain, game_at, model_at
from project import ROOT

import hfa
from hfa.paper import default_parameters
from hfa_model import VARIANTS


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Create an empty folder, run the test in it, and return its path."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def parameter_set():
    """Return the identified parameters with their covariance."""
    return default_parameters()


@pytest.fixture(scope="session")
def parameters(parameter_set):
    """Return the values of the identified parameters."""
    return parameter_set.values


@pytest.fixture(scope="session", params=sorted(VARIANTS))
def aircraft(request, parameters):
    """Return the identified aircraft. The test runs once for each dynamics."""
    return hfa.aircraft(request.param, parameters)


@pytest.fixture(scope="session")
def published_aircraft(parameters):
    """Return the identified aircraft with the paper's dynamics."""
    return hfa.aircraft("published", parameters)


@pytest.fixture(scope="session")
def point():
    """Return the trim at a dihedral angle of 15 deg."""
    return model_at(15.0).point


@pytest.fixture(scope="session")
def game():
    """Return the paper's game at a dihedral angle of 15 deg."""
    return game_at(15.0)


@pytest.fixture(scope="session")
def elevator_game():
    """Return the game in which the two elevators alone move: verdicts take a third of the time."""
    return game_at(15.0).select(("elevator_center", "elevator_outer")).with_delta(1000.0)


@pytest.fixture(scope="session")
def gain():
    """Return K of the exact solution of the paper's game at 15 deg."""
    return exact_gain(15.0)


@pytest.fixture(scope="session")
def uav(tmp_path_factory):
    """Return the path of the small aircraft with a largest lift coefficient."""
    path = tmp_path_factory.mktemp("uav") / "uav.toml"
    text = (ROOT / "examples/uav.toml").read_text("utf-8")
    path.write_text(f"CL_max = 1.0\n{text}", "utf-8")
    return str(path)
