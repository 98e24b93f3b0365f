"""Evaluation of networks for all flights at once, and flights that end early."""

from dataclasses import replace
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from policy_cases import AIRCRAFT, aircraft, gtm_deployment, stored_deployment, trims
from tolerances import SAME_FORMULA

from controller.critic.network.activations import ACTIVATIONS
from controller.critic.network.row_network import ROW_ACTIVATIONS
from hfa_aircraft.march.ending import PATIENCE
from hfa_aircraft.march.march import march
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_policy.assessor import Assessor
from hfa_policy.flights import SampledRows
from hfa_policy.outcomes import PlacedFlights, seeded_starts
from hfa_policy.trims import trims_of


def wide_file(path, width, seed=0):
    """Write a state dict with two hidden layers and random weights, and return its path.

    width: number of units of each hidden layer
    """
    random = np.random.default_rng(seed)
    sizes = (4, width, width, 2)
    arrays = {}
    for index, (n, k) in enumerate(pairwise(sizes)):
        arrays[f"{index}.weight"] = random.normal(size=(k, n)) / np.sqrt(n)
        arrays[f"{index}.bias"] = 0.1 * random.normal(size=k)
    arrays["2.weight"] *= 0.02
    arrays["2.bias"] *= 0.02
    np.savez(path, **arrays)
    return str(path)


@pytest.mark.parametrize("name", [name for name in ROW_ACTIVATIONS if name])
def test_activations_on_rows_equal_the_graph(name):
    """Each activation has the same values on NumPy rows as in a graph of CasADi scalars."""
    values = np.linspace(-45.0, 45.0, 31)
    graph = [float(entry) for entry in ACTIVATIONS[name](values)]
    np.testing.assert_allclose(ROW_ACTIVATIONS[name](values.copy()), graph, rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("name", AIRCRAFT)
def test_networks_on_rows_equal_the_graph(name):
    """The actors of the test policies give equal outputs on NumPy rows and as CasADi functions.

    The observations are not changed.
    """
    actor = stored_deployment(name).actor
    observations = np.random.default_rng(1).normal(size=(601, actor.function.numel_in(0)))
    kept = observations.copy()
    graph = np.array(actor.function(observations.T)).T
    np.testing.assert_allclose(actor.rows(observations), graph, rtol=SAME_FORMULA, atol=1e-12)
    np.testing.assert_array_equal(observations, kept)


@pytest.mark.parametrize(
    ("activation", "width", "nearness"), [("gelu", 100, 1e-12), ("selu", 160, 1e-5)]
)
def test_networks_of_any_width_are_evaluated_on_rows(tmp_path, activation, width, nearness):
    """On NumPy rows, a network of any width and activation has the outputs of its CasADi function.

    nearness: largest permitted difference
    """
    deployment = gtm_deployment(
        {"file": wide_file(tmp_path / "wide.npz", width), "activation": activation}
    )
    observations = np.random.default_rng(1).normal(size=(20, 4))
    graph = np.array(deployment.actor.function(observations.T)).T
    np.testing.assert_allclose(deployment.actor.rows(observations), graph, rtol=0, atol=nearness)


def test_a_wide_onnx_graph_is_evaluated_on_rows(tmp_path):
    """A wide ONNX graph evaluated on rows agrees with the CasADi function of the graph."""
    onnx = pytest.importorskip("onnx")
    random = np.random.default_rng(0)
    sizes = {
        "first": (4, 100),
        "gain": (100,),
        "bias": (100,),
        "second": (100, 100),
        "last": (100, 2),
    }
    weights = [
        onnx.numpy_helper.from_array(random.normal(size=size) / 10.0, name)
        for name, size in sizes.items()
    ]
    make = onnx.helper.make_node
    nodes = [
        make("MatMul", ["o", "first"], ["a"]),
        make("LayerNormalization", ["a", "gain", "bias"], ["b"]),
        make("MatMul", ["b", "second"], ["c"]),
        make("Gelu", ["c"], ["d"]),
        make("Add", ["d", "b"], ["e"]),
        make("MatMul", ["e", "last"], ["raw"]),
    ]
    describe = onnx.helper.make_tensor_value_info
    taken = [describe("o", onnx.TensorProto.DOUBLE, [1, 4])]
    given = [describe("raw", onnx.TensorProto.DOUBLE, [1, 2])]
    graph = onnx.helper.make_graph(nodes, "actor", taken, given, weights)
    onnx.save(onnx.helper.make_model(graph), tmp_path / "wide.onnx")
    actor = gtm_deployment({"file": str(tmp_path / "wide.onnx")}).actor
    observations = random.normal(size=(20, 4))
    expected = np.array(actor.function(observations.T)).T
    np.testing.assert_allclose(actor.rows(observations), expected, rtol=0, atol=1e-12)


def test_flight_at_another_equilibrium_ends_early():
    """A flight that settles at another equilibrium ends early, with the outcome of the full
    duration.
    """
    o = ca.SX.sym("o", 4)
    another = 0.064 * (1.0 + ca.tanh(200.0 * (o[3] - 0.06)))
    raw = ca.vertcat(0.8 * o[3] + 0.6 * o[2] - another, -2.0 * o[0])
    deployment = gtm_deployment({"file": ca.Function("two", [o], [raw])})
    assessor = Assessor(Deployed(deployment, aircraft("ppo_gtm")), trims("ppo_gtm")[1:2])
    flight = assessor.flight()
    places = assessor.places(flight)
    ends = []
    for patience in (PATIENCE, replace(PATIENCE, standing=1000)):
        flown = flights_of(flight, places[0], 24, patience)
        flown.fly(60.0, flight.compiled(24, 60.0))
        ends.append((flown.times.max(), flown.outcomes(0)))
    (early, outcome), (late, to_the_end) = ends
    assert early < 45.0 < late
    assert 0 < outcome.elsewhere == to_the_end.elsewhere
    assert outcome.returned == to_the_end.returned
    pitch = to_the_end.elsewhere_at["pitch"]
    assert outcome.elsewhere_at["pitch"] == pytest.approx(pitch, abs=1e-3)


def flights_of(flight, place, count, patience=PATIENCE):
    starts, pushes = seeded_starts(place, count, 0, False)
    owners = np.zeros(count, dtype=int)
    return PlacedFlights(flight, [place], owners, starts, pushes, patience)


@pytest.mark.parametrize(
    ("name", "delay"),
    [
        ("ppo_gtm", 0.05),
        pytest.param("td3_gtm", 0.0, marks=pytest.mark.slow),
    ],
)
def test_flights_simulated_together_equal_single_flights(name, delay):
    """Several flights simulated together over a window have the states of each flight alone.

    Each flight alone is simulated sample by sample.
    """
    late = stored_deployment(name).changed(timing={"dt": 0.02, "delay": delay})
    assessor = Assessor(Deployed(late, aircraft(name)), trims(name)[:1], samples=0)
    flight = assessor.flight()
    (place,) = assessor.places(flight)
    starts, pushes = seeded_starts(place, 5, 0, True)
    trim = assessor.deployed.trim_vector(place.point)
    count = flight.samples_in_window
    trims_of_all = np.tile(trim, (5, 1))
    states = flight.start(starts, trims_of_all)
    loop = SampledRows(flight.compiled(5, 1.0), states, trims_of_all, pushes, pulse=1.0)
    together = march(loop, count)[0].states[:, -1]
    state = ca.MX.sym("state", together.shape[1])
    push = ca.MX.sym("push", pushes.shape[1])
    raw = assessor.deployed.deployment.actor.function(flight.entering()(state, trim))
    after = flight.tick()(state, ca.vertcat(ca.vec(raw), trim, push))
    alone = ca.Function("alone", [state, push], [after]).mapaccum(count)
    for end, start, pulse in zip(together, starts, pushes, strict=True):
        begun = flight.start(start[None], trim[None])[0]
        path = np.array(alone(begun, np.tile(pulse[:, None], (1, count))))
        np.testing.assert_allclose(end, path[:, -1], rtol=SAME_FORMULA, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("width", "activation"), [(64, "tanh"), (256, "relu")])
def test_networks_of_common_sizes_are_assessed(tmp_path, width, activation):
    """Networks of common sizes are assessed, and their gains agree with central differences of the
    command.
    """
    file = wide_file(tmp_path / "wide.npz", width)
    deployed = Deployed(
        gtm_deployment({"file": file, "activation": activation}), aircraft("ppo_gtm")
    )
    (point,) = Assessor(deployed, trims_of(deployed.model, [45.0]), samples=2).assessed()
    assert np.isfinite(point.radius)
    assert point.flights.starts == 2
    equilibrium = point.equilibrium
    step = 1e-6 * np.array([1.0, 0.1, 0.1, 0.1])
    columns = [list(point.point.model.states).index(name) for name in point.point.model.linear]
    commanded = deployed.command
    trim = deployed.trim_vector(point.point)
    for number, column in enumerate(columns):
        moved = np.zeros(len(equilibrium.states))
        moved[column] = step[number]
        ahead, behind = (
            np.array(commanded(equilibrium.states + sign * moved, equilibrium.inputs, trim)).ravel()
            for sign in (1.0, -1.0)
        )
        slope = (ahead - behind) / (2.0 * step[number])
        inputs = [list(point.point.model.inputs).index(name) for name in ("elevator", "throttle")]
        np.testing.assert_allclose(-equilibrium.K[:, number], slope[inputs], rtol=1e-4, atol=1e-6)
