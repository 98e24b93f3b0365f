"""Files of gains in deployments, and effects of the actions of a deployed gain."""

import numpy as np
import pytest
from policy_cases import GTM, gtm_deployment, model_of

from hfa import BadInputError, assess


def assessed(folder, entries):
    """Return the assessment of a gain of the GTM, in a file with further entries."""
    np.savez(folder / "K.npz", K=0.01 * np.ones((2, 4)), **entries)
    deployment = gtm_deployment({"file": str(folder / "K.npz")})
    return assess(model_of(GTM), deployment, [45.0], samples=0)


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        ({"states": ["alpha", "speed", "pitch_rate", "pitch"]}, "of the states alpha, speed"),
        ({"inputs": ["throttle", "elevator"]}, "of the inputs throttle, elevator"),
        ({"dt": 0.05}, "for dt = 0.05 s"),
        ({"state_units": ["m/s", "deg", "rad/s", "rad"]}, "give scale = 0.0174533"),
        ({"input_units": ["deg", "1"]}, 'give map = "trim'),
    ],
)
def test_a_deployment_that_contradicts_the_file_of_its_gain_is_refused(tmp_path, entries, said):
    """The file may state other states, inputs, units or another sample time than the deployment. The
    message has the remedy.
    """
    with pytest.raises(BadInputError) as caught:
        assessed(tmp_path, entries)
    assert said in str(caught.value)
