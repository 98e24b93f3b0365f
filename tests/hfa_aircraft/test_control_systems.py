"""Conversion of models to nonlinear systems of python-control."""

import numpy as np
from project import ROOT

import hfa
from hfa_aircraft import to_control


def test_a_model_is_a_system_of_python_control():
    """The system has the names, rates and outputs of the model, also with another parameter."""
    model = hfa.load_model(f"{ROOT}/examples/uav.toml")
    system = to_control(model)
    point = hfa.trim(model)
    x, u = np.array(point.states) + 0.01, np.array(point.inputs)
    heavy = {"mass": 20.0}
    loaded = model.with_parameters(**heavy)
    rates, outputs = (dict(each) for each in (loaded.rates_at(x, u), loaded.outputs_at(x, u)))
    assert system.output_labels == [*model.states, *model.outputs]
    np.testing.assert_allclose(system.dynamics(0.0, x, u, params=heavy), [*rates.values()])
    np.testing.assert_allclose(
        system.output(0.0, x, u, params=heavy), [*x, *outputs.values()], rtol=1e-12
    )
