"""Results as xarray datasets."""

import pytest
from own_models import F16

import hfa

pytest.importorskip("xarray")


def test_a_sweep_is_an_xarray_dataset():
    """A sweep over a grid becomes a dataset with the dimensions of the grid, and a sweep over a list one with
    the dimension "point". An entry of A is selected by values of the axes and names of states.

    Axes, states, inputs, rates and eigenvalues have units.
    """
    axes = {"speed": [500.0, 400.0], "xcg": [0.3, 0.32, 0.35]}
    grid = hfa.sweep(F16, axes)
    dataset = grid.to_xarray()
    assert dataset.A.dims == ("speed", "xcg", "rate", "linear_state")
    assert (dataset.speed.values.tolist(), dataset.speed.attrs["units"]) == (axes["speed"], "ft/s")
    assert dataset.mode.values.tolist() == list(grid.mode_names)
    single = dataset.sel(speed=400.0, xcg=0.32, rate="alpha", linear_state="pitch_rate")
    names = grid.model.linear
    A = grid.A[1 * 3 + 1]  # of the second of 2 speeds and the second of 3 xcg
    assert float(single.A) == A[names.index("alpha"), names.index("pitch_rate")]
    # Units of entries are coordinates; the unit of an entry of A is the quotient of two of them.
    units = {
        "state_unit": {"state": "altitude"},
        "input_unit": {"input": "elevator"},
        "linear_state_unit": {"linear_state": "pitch_rate"},
        "rate_unit": {"rate": "speed"},
    }
    found = {unit: str(dataset[unit].sel(where).item()) for unit, where in units.items()}
    assert found == dict(zip(units, ("ft", "deg", "rad/s", "ft/s^2"), strict=True))
    assert dataset.A.attrs["units_of"] == "rate_unit / linear_state_unit"
    assert dataset.eigenvalues.attrs["units"] == "1/s"
    listed = hfa.sweep(F16, {"speed": [400.0, 500.0], "xcg": [0.3, 0.35]}, listed=True).to_xarray()
    assert listed.B.dims == ("point", "rate", "input")
    assert listed.xcg.values.tolist() == [0.3, 0.35]
