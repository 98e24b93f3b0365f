"""`hfa solve --order`, and the files that it writes."""

import json

import numpy as np
import pytest
from cli import hfa
from known_models import game_at, model_at

import hfa as package
from hfa import expand, solve


@pytest.mark.slow
def test_the_written_file_is_a_critic_with_the_values_of_the_expansion(tmp_path):
    """The file of `hfa solve --order 3` has the radii of V2 and of V, and is read as a critic.

    V and policy of the critic are those of the expansion at ten random states.
    """
    written = tmp_path / "cubic.json"
    assert hfa("solve", "--dihedral", "15", "--order", "3", "-o", str(written)).code == 0
    game = game_at(15.0)
    expansion = expand(model_at(15.0), solve(game), order=3)
    data = json.loads(written.read_text())
    assert (data["order"], data["basis"]) == (3, "cubic")
    assert data["error"] <= 1e-12
    sizes = [(each["degree"], each["c"], *each["extents"]) for each in data["radii"]]
    known = [(each.degree, each.c, *each.extents) for each in expansion.radii]
    assert sizes == [pytest.approx(each, rel=1e-6) for each in known]
    critic = package.read_critic(written, game)
    z = np.linalg.solve(expansion.root.T, np.random.default_rng(1).standard_normal((6, 10)))
    assert np.array(critic.value(z)) == pytest.approx(np.array(expansion.V(z)), rel=1e-8)
    assert critic.u(z.T) == pytest.approx(np.array(expansion.policy(z)).T, rel=1e-8)
