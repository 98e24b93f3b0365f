"""Classes of printed answers."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from printed_samples import printed_sample

from hfa import (
    BadInputError,
    NoSolutionError,
    from_gain,
    from_value,
    from_weights,
    read_critic,
    verify,
)
from studies.published.classes import rounding_used
from studies.published.comparison import compare
from studies.published.exact_answer import (
    Plant,
    answer_change,
    answer_of,
    certified_value,
    weights_of,
)
from studies.published.printed_file import load_printed, read_block
from studies.published.verdict import check_printed

#: Game in discrete time with a missing digit in A21. Its K and L belong to A21 = 0.0741349.
MULTIPLAYER = '''
time = "discrete"
[plant]
A = """
0.906488 0.0816012 -0.0005
0.074349 0.90121 -0.000708383
0 0 0.132655
"""
B = """
-0.00150808 0.00951892 -0.00563451
-0.0096 0.00038373 -0.08962
0.867345 0 0.356478
"""
E = "0.0123956; 0.068; -0.05673"
Q = "diag 5 5 5"
R = "diag 1 1 1"
gamma = "1"
[printed]
K = """
0.5665 0.7300 0.1098
0.4271 0.2752 0.0009
-2.2643 -2.8476 0.0329
"""
L = "2.2925 2.6572 0.0032"
'''
#: A turbocharged diesel engine, P and K to four decimals.
DIESEL = '''
time = "continuous"
[plant]
A = """
-0.4125 -0.0248 0.0741 0.0089 0 0
101.5873 -7.2651 2.7608 2.8068 0 0
0.0704 0.0085 -0.0741 -0.0089 0 0.0200
0.0878 0.2672 0 -0.3674 0.0044 0.3962
-1.8414 0.0990 0 0 -0.0343 -0.0330
0 0 0 -359 187.5364 -87.0316
"""
B = """
-0.0042 0.0064
-1.0360 1.5849
0.0042 0
0.1261 0
0 -0.0168
0 0
"""
Q = "diag 100 0 0 0 0 100"
R = "diag 1 1"
[printed]
P = """
766.7586 1.4020 97.3265 119.0937 -111.2549 0.6265
1.4020 0.1032 -0.6581 3.9893 -1.8221 0.0150
97.3265 -0.6581 71.6915 -1.3767 -29.0678 0.0230
119.0937 3.9893 -1.3767 233.8101 -126.0952 -1.1828
-111.2549 -1.8221 -29.0678 -126.0952 88.0775 0.5859
0.6265 0.0150 0.0230 -1.1828 0.5859 0.5687
"""
K = """
10.7537 0.3875 0.4006 24.8446 -13.6677 -0.1672
8.9983 0.2031 0.0681 9.2032 -5.0796 0.0180
"""
'''
#: K = (√5, √(1 + 2√5)) = (2.236068, 2.339259), with further digits cut off.
INTEGRATOR = """
time = "continuous"
[plant]
A = "0 1; 0 0"
B = "0; 1"
Q = "5 0; 0 1"
R = "1"
[printed]
K = "2.23606 2.33925"
"""
#: Plant with four decimals, completed with its right answer.
SMALL = """
time = "continuous"
[plant]
A = "-1.0189 0.9051; 0.8223 -1.0774"
B = "0.3127; 1.4586"
Q = "1 0; 0 2"
R = "1"
[printed]
P = "{P}"
K = "{K}"
"""


@pytest.fixture
def verdict_of(tmp_path):
    """Return a function from the text of a file to its verdict."""

    def check(text):
        path = tmp_path / "printed.toml"
        path.write_text(text)
        return check_printed(path)

    return check


def printed(matrix, decimals):
    """Return a matrix as text with a number of decimals."""
    return "; ".join(" ".join(f"{value:.{decimals}f}" for value in row) for row in matrix)


def small_case(decimals=5):
    """Return the text of the file SMALL with its exact answer, rounded to a number of decimals."""
    plant = Plant(
        A=np.array([[-1.0189, 0.9051], [0.8223, -1.0774]]),
        B=np.array([[0.3127], [1.4586]]),
        E=np.zeros((2, 0)),
        N=np.zeros((2, 1)),
        Q=np.diag([1.0, 2.0]),
        R=np.eye(1),
        gamma=np.inf,
    )
    answer = answer_of(plant, certified_value(plant))
    return SMALL.format(P=printed(answer["P"], decimals), K=printed(answer["K"], decimals))


def test_a_digit_dropped_in_the_plant_is_named(verdict_of):
    """A missing digit in the plant is found, with the range of values that explain the answer."""
    verdict = verdict_of(MULTIPLAYER)
    assert verdict.classified.name == "the answer belongs to another plant"
    (entry,) = verdict.classified.changed
    assert (str(entry.position), float(entry.value)) == ("A21", 0.0741349)
    assert entry.lowest == pytest.approx(0.0741338, abs=1e-7)
    assert entry.highest == pytest.approx(0.0741351, abs=1e-7)
    interval = f"A21 in {entry.lowest:.8g} to {entry.highest:.8g} makes every printed digit right"
    assert interval in verdict.report().parts
    assert verdict.classified.comparison.errors.max() == pytest.approx(131.0, abs=0.5)


@pytest.mark.parametrize(
    ("right", "typed", "name"),
    [
        ("0.8223", "0.8232", "A21"),
        ("-1.0774", "1.0774", "A22"),
        ("0.3127", "0.317", "B11"),
        ("1.4586", "14.586", "B21"),
    ],
)
def test_a_planted_misprint_is_named(verdict_of, right, typed, name):
    """A planted misprint in the plant is named with its correct value."""
    verdict = verdict_of(small_case().replace(right, typed, 1))
    assert verdict.classified.name == "the answer belongs to another plant"
    (entry,) = verdict.classified.changed
    assert str(entry.position) == name
    assert float(entry.value) == float(right)


def test_a_misprint_in_the_answer_is_named(verdict_of):
    """A misprint in one entry of the answer is named with the exact value."""
    verdict = verdict_of(DIESEL.replace("24.8446", "24.8464"))
    assert verdict.classified.name == "one entry of the answer"
    for named in ("K14", "24.8464", "24.844586"):
        assert named in verdict.classified.reason
    off = verdict.entries[-9]
    exact = verdict.classified.comparison.exact[-9]
    assert off == {
        **{"block": "K", "row": 1, "column": 4, "printed": 24.8464, "half_unit": 5e-5},
        **{"exact": exact, "half_units_off": pytest.approx((24.8464 - exact) / 5e-5)},
    }
    farthest = sorted(verdict.entries, key=lambda entry: -entry["half_units_off"])[:12]
    table, note = verdict.report().parts[-2:]
    assert "12 of 48" in note
    names = {f"{entry['block']}{entry['row']}{entry['column']}" for entry in farthest}
    assert {row[0] for row in table.rows} == names
    (row,) = (row for row in table.rows if row[0] == "K14")
    numbers = [24.8464, exact, off["half_units_off"]]
    assert [float(text) for text in row[1:]] == pytest.approx(numbers, rel=1e-2)
    verdict = verdict_of(small_case(16))
    assert {entry["half_unit"] for entry in verdict.entries} == {5e-17}
    comparison = verdict.classified.comparison
    for block in "PK":
        of_block = [position.block == block for position in comparison.positions]
        floor = 1e-12 * np.abs(comparison.exact[of_block]).max()
        assert comparison.allowed[of_block] == pytest.approx(floor)


def test_a_learned_answer_is_close(verdict_of):
    """A learned answer with small errors has the class `close`, and no entry of the plant is named."""
    text = "learned = true\n" + small_case(4)
    block = re.search(r'K = "(.*)"', text)[1]
    moved = read_block("K", block).values * [1.0031, 0.9988]
    text = text.replace(f'K = "{block}"', f'K = "{printed(moved, 4)}"')
    text = re.sub(r'P = ".*"\n', "", text)
    verdict = verdict_of(text)
    assert verdict.classified.name == "close"
    assert verdict.classified.changed == ()
    assert 0.0 < verdict.cost_lost < 0.01
    assert not verdict.ok


def test_a_rounded_plant_leaves_the_class_undecided(verdict_of):
    """With a plant declared as rounded, the class is `not decided`.

    Without this declaration, the class is `wrong`.
    """
    text = small_case(6).replace("0.8223", "0.82", 1).replace("-1.0774", "-1.08", 1)
    assert verdict_of("plant_rounded = true\n" + text).classified.name == "not decided"
    assert verdict_of(text).classified.name == "wrong"


def test_a_misprinted_gamma_without_answer_is_named(verdict_of):
    """If no answer exists because of a misprint in gamma, the error names the misprint."""
    plant = Plant(
        A=np.array([[-1.0, 0.9], [0.8, -1.1]]),
        B=np.array([[0.0], [1.0]]),
        E=np.array([[1.0], [0.0]]),
        N=np.zeros((2, 1)),
        Q=np.eye(2),
        R=np.eye(1),
        gamma=5.2,
    )
    answer = answer_of(plant, certified_value(plant))
    text = f"""
time = "continuous"
[plant]
A = "-1.0 0.9; 0.8 -1.1"
B = "0; 1"
E = "1; 0"
Q = "diag 1 1"
R = "1"
gamma = "0.52"
[printed]
P = "{printed(answer["P"], 5)}"
"""
    assert verdict_of(text.replace("0.52", "5.2")).classified.name == "as printed"
    with pytest.raises(
        NoSolutionError, match=r"with gamma = 5\.2, not 0\.52 \(the decimal point\)"
    ):
        verdict_of(text)


def test_an_unrelated_answer_has_no_class(verdict_of):
    """A gain without P that no single misprint explains has the class `cannot tell`."""
    text = re.sub(r'P = ".*"\nK = ".*"', 'K = "71.123 -38.71"', small_case())
    assert verdict_of(text).classified.name == "cannot tell"


def test_an_opposite_gain_sign_is_named(verdict_of):
    """A gain with the opposite sign is "wrong", and the reason names the sign.

    If the file declares u = K x, the answer is "as printed".
    """
    text = small_case()
    gain = read_block("K", re.search(r'K = "(.*)"', text)[1])
    opposite = re.sub(r'K = ".*"', f'K = "{printed(-gain.values, 5)}"', text)
    verdict = verdict_of(opposite)
    assert verdict.classified.name == "wrong"
    assert verdict.classified.reason == "K has the opposite sign"
    declared = opposite + 'K_sign = "u = K x"\n'
    assert verdict_of(declared).classified.name == "as printed"


def test_a_missing_factor_is_recognized_despite_noise(verdict_of):
    """A missing factor 2 in a learned W is recognized in spite of noise of up to 0.3 %."""
    text = small_case()
    P = read_block("P", re.search(r'P = "(.*)"', text)[1]).values
    weights = P[np.triu_indices(2)] * [1.003, 0.998, 1.001]
    answer = f'W = "{printed(weights[None, :], 5)}"'
    verdict = verdict_of("learned = true\n" + re.sub(r'P = ".*"\nK = ".*"', answer, text))
    assert verdict.classified.name == "wrong"
    assert verdict.classified.reason.startswith("W lacks the factor 2 on products; an error")


#: Plant of three states, with or without a disturbance, whose answer has misprints of convention.
THIRD = Plant(
    A=np.array([[0.2, 1.0, 0.3], [-1.0, 0.1, 0.5], [0.4, 0.2, -0.7]]),
    B=np.array([[0.0, 0.4], [1.0, 0.0], [0.3, 1.0]]),
    E=np.array([[0.2], [0.1], [0.3]]),
    N=np.zeros((3, 2)),
    Q=np.diag([1.0, 2.0, 3.0]),
    R=np.diag([1.0, 2.0]),
    gamma=5.0,
)


def third_file(answer: dict[str, np.ndarray], plant: Plant = THIRD, more: str = "") -> str:
    """Return the file of a plant, as formulas, with an answer to five decimals."""
    typed = "\n".join(f'{name} = "{printed(getattr(plant, name), 2)}"' for name in "ABENQR")
    typed = re.sub(r"([\d.]+)", r"(\1)", typed)  # no misprint is searched for in a formula
    blocks = "\n".join(f'{name} = "{printed(matrix, 5)}"' for name, matrix in answer.items())
    time = "discrete" if plant.is_discrete else "continuous"
    return (
        f'time = "{time}"\n{more}[plant]\n{typed}\ngamma = "{plant.gamma}"\n[printed]\n{blocks}\n'
    )


def exact_third(is_discrete: bool = False) -> dict[str, np.ndarray]:
    plant = replace(THIRD, is_discrete=is_discrete)
    return answer_of(plant, certified_value(plant))


@pytest.mark.parametrize(
    ("name", "order", "factor", "reason"),
    [
        ("K", [0, 1, 2], -1.0, "K has the opposite sign"),
        ("L", [0, 1, 2], -1.0, "L has the opposite sign"),
        ("W", [0, 1, 3, 2, 4, 5], 1.0, "W is stored column by column"),
        ("W", [0, 3, 5, 1, 2, 4], 1.0, "W is stored with the squares first"),
        *((name, None, 2.0, f"{name} is twice the value") for name in "PKWH"),
        *((name, None, 0.5, f"{name} is half the value") for name in "PKWH"),
        ("K", [1, 0, 2], 1.0, "states 1 and 2 are interchanged"),
        ("L", [2, 1, 0], 1.0, "states 1 and 3 are interchanged"),
    ],
)
def test_a_mistake_of_convention_is_named(verdict_of, name, order, factor, reason):
    """A sign, a factor, an order of weights or of states explains every digit, and is named."""
    is_discrete = name == "H"
    exact = exact_third(is_discrete)[name]
    wrong = factor * (exact if order is None else exact[:, order])
    verdict = verdict_of(third_file({name: wrong}, replace(THIRD, is_discrete=is_discrete)))
    assert verdict.classified.name == "wrong"
    assert verdict.classified.reason == reason
    assert not verdict.ok
    right = verdict_of(third_file({name: exact}, replace(THIRD, is_discrete=is_discrete)))
    assert (right.ok, right.classified.name) == (True, "as printed")


def test_interchanged_states_permute_value_and_weights(verdict_of):
    """P and W of states in another order are named like the gains."""
    order = [0, 2, 1]
    P = exact_third()["P"][np.ix_(order, order)]
    for wrong in ({"P": P}, {"W": weights_of(P)}):
        verdict = verdict_of(third_file(wrong))
        assert "states 2 and 3" in verdict.classified.reason


def test_weights_are_those_of_the_products():
    """x'P x = W'(x1², x1 x2, ..., xn²)."""
    P = exact_third()["P"]
    x = np.array([1.3, -0.7, 2.1])
    row, column = np.triu_indices(3)
    assert (weights_of(P) @ (x[row] * x[column])).item() == pytest.approx(x @ P @ x, rel=1e-14)


@pytest.mark.parametrize(
    ("shift", "used"), [(0.62, 0.62), (-0.62, 0.62), (-1.42, 1.42), (0.0, 0.0)]
)
def test_the_rounding_used_is_that_of_the_planted_plant(tmp_path, shift, used):
    """The answer of a plant with A12 off by a share of half a unit needs this share of rounding."""
    text = """time = "continuous"
plant_rounded = true
[plant]
A = "-1 0.500000; -1 -2"
B = "1; 1"
Q = "2 0; 0 1"
R = "1"
[printed]
P = "{P}"
"""
    path = tmp_path / "rounded.toml"
    path.write_text(text.format(P="1 0; 0 1"))
    plant = load_printed(path).plant
    other = certified_value(plant.with_entry("A", 0, 1, 0.5 + 5e-7 * shift))
    path.write_text(text.format(P=printed(other, 10)))
    file = load_printed(path)
    P = certified_value(file.plant)
    assert rounding_used(file, P, compare(file, file.plant, P)) == pytest.approx(used, abs=5e-3)
    classified = check_printed(path).classified
    expected = "as printed" if not shift else "not decided" if used < 1.0 else "cannot tell"
    assert classified.name == expected
    exact = text.replace("0.500000", "1/2").format(P=printed(other, 10))
    path.write_text(exact)
    file = load_printed(path)
    compared = compare(file, file.plant, P)
    assert rounding_used(file, P, compared) == math.inf  # a formula has no rounding


def test_digits_are_cut_off_only_toward_zero(verdict_of):
    """One digit too large, or two units too small, is not cut off; a negative entry may be."""
    assert verdict_of(INTEGRATOR).classified.name == "cut off"
    assert verdict_of(INTEGRATOR.replace("2.23606", "2.23605")).classified.name != "cut off"
    assert verdict_of(INTEGRATOR.replace("2.23606", "2.23608")).classified.name != "cut off"
    negative = INTEGRATOR.replace("2.23606 2.33925", "-2.23606 -2.33925")
    declared = negative.replace("[printed]", '[printed]\nK_sign = "u = K x"')
    assert verdict_of(declared).classified.name == "cut off"


def test_an_incomplete_plant_or_asymmetric_value_gives_no_class(verdict_of):
    """One number for Q is an assumption; a P that is not symmetric in two pairs is no value."""
    exact = exact_third()
    wrong = exact["P"].copy()
    wrong[0, 1] += 0.01
    assert verdict_of(third_file({"P": wrong})).classified.name == "one entry of the answer"
    wrong[0, 2] += 0.01
    asymmetric = verdict_of(third_file({"P": wrong})).classified
    assert asymmetric.name == "cannot tell"
    assert "P is not symmetric" in asymmetric.reason
    learned = verdict_of(third_file({"P": wrong}, more="learned = true\n")).classified
    assert learned.name == "close"
    assumed = small_case().replace('Q = "1 0; 0 2"', 'Q = "1"')
    verdict = verdict_of(assumed).classified
    assert verdict.name == "cannot tell"
    assert verdict.reason.startswith("Q ")


def of_file(game, H):
    np.savez("H.npz", H=H)
    return read_critic("H.npz", game)


def test_a_close_answer_costs_what_its_policy_costs(verdict_of, folder):
    """The cost is that of the printed K, or of the gain of P, W or H."""
    for is_discrete, names in ((False, ("K", "P", "W")), (True, ("K", "P", "W", "H"))):
        plant = replace(THIRD, is_discrete=is_discrete)
        exact = exact_third(is_discrete)
        game = plant.game()
        makers = {"K": from_gain, "P": from_value, "W": from_weights, "H": of_file}
        for name in names:
            wrong = 1.01 * exact[name] if name in "KH" else exact[name] * 1.01
            if name == "H":
                wrong[0, 1] += 1e-5  # one unit of the last digit
            if name in "PW":
                wrong = exact[name] + 0.02 * np.abs(exact[name])
            text = third_file({name: wrong}, plant, more="learned = true\n")
            verdict = verdict_of(text)
            file = verdict.file.answer[name].values
            given = file.ravel() if name == "W" else (file + file.T) / 2.0 if name == "H" else file
            assert verdict.classified.name == "close"
            expected = verify(game, makers[name](game, given)).cost_lost
            assert verdict.cost_lost == pytest.approx(expected, rel=1e-6)
            assert verdict.cost_lost > 0.0
            if name == "K":
                opposite = third_file({"K": -wrong}, plant, more="learned = true\n")
                opposite = opposite.replace("[printed]", '[printed]\nK_sign = "u = K x"')
                assert verdict_of(opposite).cost_lost == verdict.cost_lost


def test_one_wrong_entry_of_a_learned_answer_must_exceed_the_noise(verdict_of):
    """One entry that is off by less than ten times what the others may hide is noise."""
    gain = exact_third()["K"]
    for off, name in ((4e-5, "close"), (4e-3, "one entry of the answer")):
        wrong = gain.copy()
        wrong[0, 0] += off
        verdict = verdict_of(third_file({"K": wrong}, more="learned = true\n"))
        assert verdict.classified.name == name


@pytest.mark.parametrize("is_discrete", [False, True])
@pytest.mark.parametrize("name", ["A", "B", "E", "N", "Q", "R", "gamma"])
def test_derivatives_of_the_answer_equal_differences(name, is_discrete):
    """Derivatives of the answer with respect to each matrix equal central differences."""
    generator = np.random.default_rng(3)
    plant = Plant(
        A=0.3 * generator.normal(size=(3, 3)),
        B=generator.normal(size=(3, 2)),
        E=0.2 * generator.normal(size=(3, 2)),
        N=0.1 * generator.normal(size=(3, 2)),
        Q=np.diag([1.0, 2.0, 3.0]),
        R=np.diag([1.0, 2.0]),
        gamma=3.0,
        is_discrete=is_discrete,
        discount=0.9 if is_discrete else 1.0,
    )
    row, column = (0, 0) if name == "gamma" else (1, 0)
    value = plant.gamma if name == "gamma" else getattr(plant, name)[row, column]
    step = 1e-5
    around = []
    for moved in (value - step, value + step):
        other = plant.with_entry(name, row, column, moved)
        around.append(answer_of(other, certified_value(other)))
    before, after = around
    change = answer_change(plant, certified_value(plant), name, row, column)
    assert change.keys() >= {"P", "K", "L", "W"}
    for block, slope in change.items():
        difference = (after[block] - before[block]) / (2 * step)
        np.testing.assert_allclose(difference, slope, atol=1e-5 * np.abs(slope).max() + 1e-9)


def test_formulas_and_common_factors_are_evaluated():
    """Formulas of parameters and a common factor are evaluated in a block of numbers."""
    parameters = {"m": 0.5, "g": 9.81}
    block = read_block("A", "m*g/2 -160/3 sqrt(m**2); 1.50 -(m+1) 2", parameters)
    expected = [[0.5 * 9.81 / 2, -160 / 3, 0.5], [1.5, -1.5, 2.0]]
    np.testing.assert_allclose(block.values, expected, rtol=1e-15)
    assert block.half_units[0].tolist() == [0.0, 0.0, 0.0]
    assert block.roundings.tolist() == [[0.0, 0.0, 0.0], [0.005, 0.0, 0.0]]
    scaled = read_block("P", "1.0e+04 *\n 1.2345 0\n 0 -0.0020")
    assert scaled.values.tolist() == [[12345.0, 0.0], [0.0, -20.0]]
    assert scaled.half_units == pytest.approx(0.5 * np.ones((2, 2)))
    assert scaled.roundings.tolist() == [[0.5, 0.0], [0.0, 0.5]]
    with pytest.raises(BadInputError, match="P: '1/3' is not a decimal number, as scale requires"):
        read_block("P", "1.0e+04 *\n 1/3")


def test_parameters_and_common_factors_are_as_printed(verdict_of):
    """A correct answer is "as printed" if the plant uses parameters or the answer a common
    factor.
    """
    text = small_case()
    parametrized = text.replace("[plant]", '[parameters]\na = "0.8223"\n[plant]').replace(
        "0.8223 -1.0774", "a -1.0774"
    )
    assert verdict_of(parametrized).classified.name == "as printed"
    P = read_block("P", re.search(r'P = "(.*)"', small_case(9))[1]).values
    answer = f'scale = "1.0e-03"\nP = "{printed(1e3 * P, 4)}"'
    assert verdict_of(re.sub(r'P = ".*"\nK = ".*"', answer, text)).classified.name == "as printed"


def test_time_that_fits_every_digit_is_proposed(verdict_of):
    """If every digit is right for the other kind of time, the reason proposes this kind.

    If a file states no kind of time, the error proposes the kind that fits every digit. If no kind
    fits, the error asks for the kind.
    """
    question = 'every printed digit fits time = "continuous"; did you mean that?'
    text = small_case()
    verdict = verdict_of(text.replace('"continuous"', '"discrete"'))
    assert verdict.classified.name == "wrong"
    assert verdict.classified.reason == question
    with pytest.raises(BadInputError, match=re.escape(question)):
        verdict_of(text.replace('time = "continuous"', ""))
    with pytest.raises(BadInputError, match='time is missing; give time = "continuous" or'):
        verdict_of(text.replace('time = "continuous"', "").replace("0.8223", "0.7"))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.8223", "0.82x3", "A, row 2: '0.82x3' is not a number"),
        (
            '"0.3127; 1.4586"',
            '"0.3127"',
            "B, row 2: B is 1 x 1; give 2 x 1, as this plant requires",
        ),
        ("0.8223 -1.0774", "0.8223", "A, row 2: the length is 1, but row 1 has length 2"),
        (
            'R = "1"',
            'R = "1"\nE = "1; 0"',
            "the plant has no gamma; give both E and gamma, or neither",
        ),
        (
            'R = "1"',
            "R = 1.0",
            "R is not text; write the numbers in quotes, with the printed digits",
        ),
        ("0.8223", "0x82", "A, row 2: '0x82' is not a number"),
        ("0.8223", "0.1-0.2", "A, row 2: '0.1-0.2' is not a number"),
        ("0.8223", "m*g", "A, row 2: 'm' is not supported; use numbers, + - * / ** and sin"),
        ("0.8223", "1/0", "A, row 2: the value of '1/0' is inf; give an entry with a finite value"),
        ("[printed]", '[printed]\nscale = "4"', "scale is '4'; give a power of ten such as"),
        (
            'time = "continuous"',
            'discount = "0.9"',
            "discount applies only to discrete time; add time =",
        ),
        (
            'Q = "1 0; 0 2"',
            f'Q = "diag {"1 " * 401}"',
            "Q: the diagonal after diag has 401 numbers; give at most 400",
        ),
        ('Q = "1 0; 0 2"', "", "the plant has no Q"),
        ('Q = "1 0; 0 2"', 'Q = ""', "Q is empty; give the printed numbers"),
        ('Q = "1 0; 0 2"', 'Q = "diag"', "Q: no numbers follow diag"),
        ("[printed]", "[other]", "the table [printed] is missing"),
        ("time =", 'learned = "yes"\ntime =', "learned is 'yes'; give true or false"),
        ("time =", "parameters = 3\ntime =", "parameters is not a table"),
        ('R = "1"', 'R = "1"\nE = "1; 0"\ngamma = "1 2"', "gamma is 1 x 2; give one number"),
        ("[printed]", '[printed]\nH = "1"', "H applies only to discrete time"),
        ("[printed]", '[printed]\nL = "1 2"', "L is given, but the plant has no E"),
        ("[printed]", '[printed]\nW = "1 2"', "W, row 1: W has 2 numbers; give 3"),
        ('R = "1"', 'R = "1"\nE = "1; 0"\ngamma = "-2"', "gamma is -2.0; give a positive number"),
    ],
)
def test_errors_name_block_and_row(tmp_path, old, new, message):
    """A faulty entry is refused with its block and row."""
    path = tmp_path / "bad.toml"
    path.write_text(small_case().replace(old, new, 1))
    with pytest.raises(BadInputError, match=re.escape(f"{path}: {message}")):
        load_printed(path)


def test_one_wrong_entry_of_learned_answer_is_named(verdict_of):
    """One wrong entry of a learned answer is named.

    The entry is three times too large. The entry is named in at least 18 of 20 answers.
    """
    rng = np.random.default_rng(5)
    named = 0
    for index in range(20):
        sample = printed_sample(index, rng)
        name = next(iter(sample.answer))
        wrong = sample.answer[name].copy()
        wrong[0, 0] *= 3.0
        text = sample._replace(answer=sample.answer | {name: wrong}).file(learned=True)
        named += verdict_of(text).classified.name == "one entry of the answer"
    assert named >= 18
