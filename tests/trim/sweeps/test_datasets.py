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


def test_trims_and_linear_models_are_datasets(tmp_path):
    """Entries of an operating point, a linear model, and the linear models of two conditions, which
    are read from a Zarr store, are selected by name and have units.
    """
    import xarray

    model = hfa.aircraft()
    point = hfa.trim(model)
    linear = point.linearize()
    dataset = linear.to_xarray()
    assert float(dataset.A.sel(rate="speed", state="pitch")) == linear.A["speed", "pitch"]
    assert float(dataset.U0.sel(input="throttle")) == point["throttle"]
    assert dataset.state.attrs["units"][:2] == ["ft/s", "rad"]
    (tmp_path / "two.csv").write_text("name,dihedral [deg]\nlow,5\nhigh,10\n")
    models = hfa.conditions(model, str(tmp_path / "two.csv"))
    models.save(tmp_path / "models.zarr")
    with xarray.open_zarr(tmp_path / "models.zarr", consolidated=False) as stored:
        entry = stored.A.sel(condition="high", rate="alpha", state="pitch_rate")
        assert float(entry) == models.linear[1].A["alpha", "pitch_rate"]
