"""`hfa.learn(data=...)`: the exact solution from recorded data, bands, and refusals by cause."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.io
from cli import answer, hfa as hfa_command
from game_samples import game_models

import hfa
from controller import minimum_delta
from hfa import BadInputError, learn, solve
from hfa.main import DONE
from hfa_aircraft.readers.matrices_file import NAME_KEYS
from hfa_aircraft.signals import PlantNames
from verification import relative_error

RNG = np.random.default_rng(0)
pytestmark = pytest.mark.usefixtures("folder")


def random_game(seed, n=3, **of_time):
    """Return a random game with cross weights, two inputs and one disturbance."""
    rng = np.random.default_rng(seed)
    A, B, E = (rng.standard_normal((n, size)) for size in (n, 2, 1))
    A *= 1.1 / np.abs(np.linalg.eigvals(A)).max()
    N = 0.1 * rng.standard_normal((n, 2))
    return hfa.Game(A, B, E=E, Q=np.eye(n), R=np.eye(2), N=N, **of_time)


STEPS = random_game(1, dt=0.1, discount=0.97)
RATES = random_game(2)


def recorded(game, count=80, noise=0.0, seed=0):
    """Return data of a game: next states in discrete time, else rates, at random states."""
    rng = np.random.default_rng(seed)
    n, m = game.B.shape
    x, u = rng.normal(size=(count, n)), rng.normal(size=(count, m))
    ends = x @ game.A.T + u @ game.B.T + noise * rng.normal(size=(count, n))
    return {"x": x, "u": u, "x_next" if game.is_discrete else "x_rate": ends}


def blind(game):
    """Return the game with A = 0 and B = 0, which data replace."""
    return replace(game, A=0.0 * game.A, B=0.0 * game.B)


def assert_exact(game, run, largest=1e-9):
    """Assert that P and K of a run are those of `solve(game)`, up to a relative error."""
    exact = solve(game)
    assert relative_error(run.P, exact.P) < largest
    assert relative_error(run.K, exact.K) < largest


@pytest.mark.parametrize("game", [STEPS, RATES, *game_models().values()])
@pytest.mark.parametrize("margin", [np.inf, 1.2])
def test_exact_data_give_the_exact_solution_without_a_and_b(game, margin):
    """Transitions without noise determine P and K of a game that is given with A = 0 and B = 0.

    Without recorded disturbances d, E of the game is used. With them, E is given as 0 and determined,
    too. The delta is infinite, or 1.2 times the smallest one.
    """
    if np.isfinite(margin):
        game = game.with_delta(margin * minimum_delta(game).value)
    data = recorded(game)
    assert_exact(game, learn(blind(game), data=data))
    key = "x_next" if game.is_discrete else "x_rate"
    d = RNG.normal(size=(80, game.E.shape[1]))
    with_d = {**data, "d": d, key: data[key] + d @ game.E.T}
    blind_to_d = replace(blind(game), E=0.0 * game.E)
    run = learn(blind_to_d, data=with_d)
    assert_exact(game, run)
    noted = f"E of the game is replaced by that of {d.shape[1]} recorded disturbances"
    assert (noted in run.data.notes) is (game.delta < np.inf)


def trajectory(game, count, seed=0, probing=1.0):
    """Return successive states (count + 1, n) and inputs (count, m), those of K x and random ones."""
    rng = np.random.default_rng(seed)
    n, m = game.B.shape
    K, x, u = solve(game).K, [rng.normal(size=n)], []
    for _ in range(count):
        u.append(probing * rng.normal(size=m) - K @ x[-1])
        x.append(game.A @ x[-1] + game.B @ u[-1])
    return np.array(x), np.array(u)


NAMED = replace(
    STEPS,
    names=PlantNames(("alpha", "q", "h"), ("left", "right"), ("rad", "rad/s", "m"), ("N", "N")),
)
#: Factors from the units of NAMED to those of the columns.
FACTORS = np.array([180.0 / np.pi, 180.0 / np.pi, 1.0])


def in_columns():
    """Return data of NAMED by columns, "alpha [deg]" -> values: inputs, next states and states."""
    data = recorded(STEPS)
    columns = dict(zip(("left [N]", "right [N]"), data["u"].T, strict=True))
    for key, ending in (("x_next", "_next"), ("x", "")):
        heads = (f"alpha{ending} [deg]", f"q{ending} [deg/s]", f"h{ending} [m]")
        columns |= zip(heads, (FACTORS * data[key]).T, strict=True)
    return columns


def csv_file(columns):
    """Write columns with all digits, and return the path."""
    rows = np.column_stack([*columns.values()])
    np.savetxt("data.csv", rows, "%.17g", ",", header=",".join(columns), comments="")
    return "data.csv"


def test_the_command_learns_from_data_with_and_without_a_plant():
    """`hfa learn --data` with the plant in rad gives the verdict, and the condition of states and inputs.

    Without a plant, Q is in the units of the data, degrees, R is required, and no verdict is given. The
    written critic passes `hfa verify` for the plant in rad.
    """
    path = csv_file(in_columns())
    plant = {"A": STEPS.A, "B": STEPS.B, "Q": STEPS.Q, "R": STEPS.R, "dt": 0.1}
    np.savez("plant.npz", **plant, **{key: getattr(NAMED.names, key) for key in NAME_KEYS})
    told = answer("learn", "--model", "plant.npz", "--data", path)
    assert told["converged"]
    data = recorded(STEPS)
    columns = np.hstack([data["x"], data["u"]])
    columns -= columns.mean(axis=0)
    condition = np.linalg.cond(columns / columns.std(axis=0))
    assert told["data"]["rank"] == 5
    assert told["data"]["condition"] == pytest.approx(condition)

    Q_in_degrees = ",".join(map(repr, (1.0 / FACTORS**2).tolist()))
    words = ("learn", "--data", path, "--Q", Q_in_degrees)
    assert "give R" in hfa_command(*words).err
    assert "not compared" in hfa_command(*words, "--R", "1,1", "-o", "own.json").out
    assert hfa_command("verify", "--model", "plant.npz", "--weights", "own.json").code == DONE
    sizes = "alpha=2,q=1,h=3,left=2,right=1"
    P = answer("learn", "--data", path, "--sizes", sizes)["P"]
    weighted = "0.25,1,0.1111111111111111"
    assert np.allclose(P, answer("learn", "--data", path, "--Q", weighted, "--R", "0.25,1")["P"])


@pytest.mark.parametrize(
    ("game", "hold"),
    [(STEPS, None), (RATES.with_delta(9.0), 0.1)],
)
def test_bands_contain_the_exact_entries_in_95_percent(game, hold):
    """The 95 % bands of P and K from 40 noisy records contain 90 to 99 % of the exact entries: the
    entries of a record are correlated, so that their share scatters.

    The mean half-width of the bands agrees with the standard deviation over the records, and the
    stated noise with that of the data.
    """
    exact, runs = solve(game), []
    for seed in range(40):
        noise = 0.02 * (hold or 1.0)
        data = recorded(game.sampled(hold) if hold else game, 60, noise, seed)
        runs.append(learn(blind(game), data=data | ({"dt": hold} if hold else {})))
    for name in "PK":
        found = np.array([getattr(run, name) for run in runs])
        bands = np.array([getattr(run, f"{name}_band") for run in runs])
        assert 0.90 < np.mean(np.abs(found - getattr(exact, name)) <= bands) < 0.99
        # 2.005: half-width of 95 % by Student's t with 54 degrees of freedom, of 60 rows.
        ratio = bands.mean(axis=0) / (2.005 * found.std(axis=0))
        assert 0.9 < ratio.mean() < 1.15
    assert 0.3 * noise < runs[-1].data.noise.mean() < 2.0 * noise


@pytest.mark.parametrize("hold", [None, 0.1])
def test_noise_and_bands_in_other_units(hold):
    """The noise is that of NumPy's fit with a constant, per degree of freedom, and the condition, P, K and
    their bands are the same in states and inputs of other units.
    """
    game = (RATES if hold else STEPS).with_delta(np.inf)
    data = recorded(game.sampled(hold) if hold else game, 20, 1e-3)
    data |= {"dt": hold} if hold else {}
    run = learn(blind(game), data=data)
    columns = np.hstack([data["x"], data["u"], np.ones((20, 1))])
    _, squares, *_ = np.linalg.lstsq(columns, data["x_next"], rcond=None)
    np.testing.assert_allclose(run.data.noise, np.sqrt(squares / (20 - 6)))
    z, v = np.array([1e-4, 1.0, 1e5]), np.array([1e3, 1e-2])
    Q, R, N = game.Q / np.outer(z, z), game.R / np.outer(v, v), game.N / np.outer(z, v)
    other = replace(blind(game), Q=Q, R=R, N=N)
    scaled = data | {"x": data["x"] * z, "u": data["u"] * v, "x_next": data["x_next"] * z}
    found = learn(other, data=scaled)
    assert found.data.condition == pytest.approx(run.data.condition)
    for name, units in (("P", 1 / np.outer(z, z)), ("K", np.outer(v, 1 / z))):
        for each in (name, f"{name}_band"):
            expected = getattr(run, each) * units
            np.testing.assert_allclose(getattr(found, each) / units, expected / units, rtol=1e-5)


def test_a_state_that_ends_where_it_began_is_fitted():
    """The next value of the second state is always 3: its row of A and B is 0, without noise."""
    game = hfa.Game([[0.5, 1.0], [0.0, 0.0]], [[1.0], [0.0]], Q=np.eye(2), R=np.eye(1), dt=0.1)
    data = recorded(game)
    assert_exact(game, learn(blind(game), data=data | {"x_next": data["x_next"] + [0.0, 3.0]}))


def test_rows_that_do_not_fit_are_named():
    """Wrong rows of noisy data are named, with the misfit of the others, and there are no bands."""
    data = recorded(STEPS, 200, noise=1e-3)
    right = learn(STEPS, data=data)
    for rows in ([5], [40, 5], list(range(25))):
        wrong = data | {"x_next": data["x_next"].copy()}
        wrong["x_next"][rows] += 3.0
        run = learn(STEPS, data=wrong)
        (note,) = run.data.notes
        assert run.P_band is run.K_band is None
        named = ", ".join(str(row + 1) for row in sorted(rows))
        assert note.startswith(f"{len(rows)} of 200 rows do not fit the others ({named}): without")
        without = float(note.partition("misfit is ")[2].partition(" %")[0])
        assert without == pytest.approx(100.0 * right.data.misfit, rel=0.2)
        assert run.data.misfit > 10.0 * right.data.misfit


def test_notes_name_what_contradicts_a_linear_plant():
    """Notes tell noise of the sensors that measure the states, and data without the units that the
    plant has. Independent noise of the next states, and other trims, which a linear plant may have,
    give no note, and a trim changes no result.
    """
    data = recorded(STEPS, noise=1e-3)
    assert learn(STEPS, data=data).data.notes == ()
    shifted = data | {"x": data["x"] + 1.0, "x_next": data["x_next"] + 2.0, "u": data["u"] - 3.0}
    about_trim, run = learn(STEPS, data=shifted), learn(STEPS, data=data)
    assert about_trim.data.notes == ()
    assert np.allclose(about_trim.K_band, run.K_band, rtol=1e-6)
    assert np.allclose(about_trim.K, run.K, rtol=1e-6)
    x, u = trajectory(STEPS, 400)
    measured = {"x": x + 0.05 * RNG.normal(size=x.shape), "u": u}
    assert "noise of sensors" in " ".join(learn(STEPS, data=measured).data.notes)
    assert "without a unit, taken in that of the plant: alpha in rad" in " ".join(
        learn(NAMED, data=data).data.notes
    )


def spoiled(key, value, row=16):
    """Return data in which a row of a matrix has another value."""
    data = recorded(STEPS)
    data[key][row] = value
    return data


X, U = trajectory(STEPS, 60, probing=0.0)
TIMES = {"x": X, "u": U, "time": 0.1 * np.arange(61)}
#: Data -> words of the refusal; a pair has another game.
REFUSED = {
    "x is 80 x 2; give 80 x 3, a row for each sample": recorded(STEPS) | {"x": np.ones((80, 2))},
    "row 17: u1 has no number": spoiled("u", np.nan),
    "x does not consist of rows of equal length": {"x": [[1.0, 2.0], [1.0]], "u": U},
    "have 1 transitions; record at least 7": recorded(STEPS, 1),
    "row 1: x1 has no next value, in an episode of one row": {
        "x": np.ones((1, 3)),
        "u": np.ones((1, 2)),
    },
    "not equally spaced: 0 s at row 4": TIMES | {"time": 0.1 * np.r_[:3, 2:60]},
    "not equally spaced: -3 s at row 31": TIMES | {"time": 0.1 * np.r_[1:31, 0:31]},
    "row 5: time has no number": TIMES | {"time": 0.1 * np.where(np.arange(61) == 4, np.nan, 1)},
    "not equally spaced: 0.2 s at row 31": TIMES | {"time": 0.1 * np.r_[:30, 31:62]},
    "data is 0.2 s, but that of the game is 0.1": recorded(STEPS) | {"dt": 0.2},
    "sample time of the data is not known": (RATES, recorded(STEPS)),
    "x_rate is of continuous time": recorded(RATES),
    "u1, u2 is a policy u = -K x": TIMES,
    "u2 is the same in every row": recorded(STEPS) | {"u": recorded(STEPS)["u"] * [1, 0] + 0.1},
    "is 3 of 5: some are combinations": recorded(STEPS)
    | {"x": RNG.normal(size=(80, 1)) * [1.0, 2, 3]},
    "there is no u": {"x": X, "x_next": X},
    "x has 2 columns; give 3": {"states": ["a", "b"], "x": X[:, :2], "u": U},
    "remove one of them": recorded(STEPS) | {"x_rate": np.ones((80, 3))},
    "neither x and u nor columns of all states and inputs (there is no x2, x3": {"x1": [1.0, 2.0]},
    "there is no column h_next; add it": (
        NAMED,
        {key: each for key, each in in_columns().items() if key != "h_next [m]"},
    ),
    "has a unit, but its state has none": (
        STEPS,
        {
            f"x{i}{end}{unit}": X[:, 0]
            for i in (1, 2, 3)
            for end, unit in (("", ""), ("_next", " [m]"))
        }
        | {"u1": X[:, 0], "u2": X[:, 0]},
    ),
    "the columns differ in length": recorded(STEPS) | {"episode": np.ones(70)},
    "the episodes differ in sample time or in disturbances": [
        recorded(STEPS),
        recorded(STEPS) | {"d": np.ones((80, 1))},
    ],
    "that of their dt is 0.2 s": TIMES | {"dt": 0.2},
    "there is no data": [],
    "alpha is in furlong; give it in rad": (
        NAMED,
        recorded(STEPS) | {"state_units": ["furlong", "rad/s", "m"]},
    ),
    "show no effect of u1 in 95 % bands, with a misfit of 98 %;": recorded(STEPS, noise=100.0),
    "u1, u2 is a policy u = -K x of the states, up to rounding": {
        key: np.round(each, 4) for key, each in TIMES.items()
    },
    "u1, u2 is a policy u = -K x of the states, up": {
        key: np.round(100.0 * each, -0) if key != "time" else each for key, each in TIMES.items()
    },
    "changes its sign every 0.1 s": (
        replace(RATES, dt=None),
        recorded(replace(STEPS, A=-STEPS.A)) | {"dt": 0.1},
    ),
}


@pytest.mark.parametrize("said", REFUSED)
def test_unusable_data_are_refused_with_the_cause(said):
    """Data with wrong shapes, times, units or names, and data that do not determine the plant, such
    as inputs that are a policy of the states, are refused in one line with the cause.
    """
    data = REFUSED[said]
    game, data = data if isinstance(data, tuple) else (STEPS, data)
    with pytest.raises(BadInputError) as refused:
        learn(game, data=data)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_episodes_are_read_in_each_layout():
    """Three episodes of 30 steps, as sources, arrays (E, T, n), rows with numbers or flags of their
    last rows, and with the names of D4RL and Minari, in a .mat file too, give the exact solution. Rewards are no inputs.
    """
    parts = [trajectory(STEPS, 30, seed) for seed in range(3)]
    x, u = (np.array(each) for each in zip(*parts, strict=True))  # (3, 31, 3) and (3, 30, 2)
    last = np.tile(np.arange(30) == 29, (3, 1))
    rows = {"observations": x[:, :-1].reshape(-1, 3), "actions": u.reshape(-1, 2)}
    rows |= {"rewards": np.zeros(90), "terminals": np.zeros(90, bool)}
    numbered = {"episode": np.repeat([7, 8, 9], 30), "time": np.tile(0.1 * np.arange(30), 3)}
    ends = {"next_observations": x[:, 1:].reshape(-1, 3)}
    scipy.io.savemat("rows.mat", rows | ends | {"dt": 0.1})
    for steps, data in {
        90: [
            [{"x": x, "u": u} for x, u in parts],
            {"x": x, "u": u},
            {"x": x, "u": u, "terminals": last},
            {f"episode_{k}": {"obs": x[k], "action": u[k], "done": last[k]} for k in range(3)},
            rows | ends,
            "rows.mat",
        ],
        87: [rows | numbered, rows | {"timeouts": last.ravel()}],
    }.items():
        for each in data:
            run = learn(blind(STEPS), data=each)
            assert_exact(STEPS, run)
            assert (run.data.rows, run.data.episodes) == (steps, 3)


def test_a_record_about_its_trim_that_begins_at_rest():
    """A flight of a plant with pitch and pitch_rate begins at rest, about a trim, with time in ms."""
    names = PlantNames(("pitch", "pitch_rate"), ("elevator",), ("rad", "rad/s"), ("rad",))
    plant = hfa.Game([[0, 1], [-4, -1]], [[0], [2]], Q=np.eye(2), R=np.eye(1), names=names)
    step = plant.sampled(0.05)
    x, u = [np.zeros(2)], RNG.normal(size=(80, 1))
    for each in u[:-1]:
        x.append(step.A @ x[-1] + step.B @ each)
    pitch, rate = np.transpose(x)
    columns = {"Time [ms]": 50.0 * np.arange(80), "pitch [deg]": np.degrees(pitch) + 5.0}
    columns |= {"pitch_rate": rate, "elevator": u[:, 0] - 0.1, "reward": u[:, 0], "weather": "dry"}
    run = learn(blind(plant), data=columns)
    assert_exact(plant, run)
    (unused,) = (note for note in run.data.notes if "without a unit" not in note)
    assert unused.endswith("as no state or input of the plant: reward, weather")
    for game in (plant, blind(plant)):
        with pytest.raises(BadInputError, match="the rate of pitch in the data is not pitch_rate"):
            learn(game, data=columns | {"Time [ms]": 1e3 * np.arange(80)})


def test_samples_that_are_slower_than_a_mode():
    """Samples of a mode of 20 rad/s every 0.2 s have the step of one of 11.4 rad/s. They are refused
    beside the plant, and without it the first line says what is assumed. Faster samples are right.
    """
    plant = hfa.Game([[0, 1], [-400, -1]], [[0], [2]], Q=np.eye(2), R=np.eye(1))
    slow = recorded(plant.sampled(0.2)) | {"dt": 0.2}
    with pytest.raises(BadInputError, match="a mode of 20 rad/s, and samples every"):
        learn(plant, data=slow)
    run = learn(blind(plant), data=slow)
    assert relative_error(run.K, solve(plant).K) > 0.1
    assert run.outcome == "settled; assumed: no mode faster than 15.7 rad/s"
    assert_exact(plant, learn(plant, data=recorded(plant.sampled(0.1)) | {"dt": 0.1}))
