"""What `hfa.assess` tells of several trims, in its report, table and file, of a plant in closed form."""

import math
import re
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from held_inputs import over_hold
from scipy.linalg import solve_discrete_are
from scipy.stats import binom

import hfa
from hfa_aircraft.batch_simulation import IntegrationError
from hfa_flight.judge.flight_costs import cost_ratio
from trim.linear.delays import Delays

DT, GAIN, R = 0.05, 2.0, 0.3
GROWTHS = (0.5, 1.0, 3.0)


def drifting(gain, growths, samples=4, schedule="growth", delay=0.0, **options):
    """Return the assessment of f = -gain v, held for DT, for v' = growth v + f with |v| <= 4 m/s, at some
    values of the parameter growth, 1/s, or at the first one without a scheduling variable. The cost is
    4 v² + R f² a second, of the output 2 v.
    """
    model = hfa.Model(
        "drifting",
        {"v": hfa.Signal("m/s", 2.0, -4.0, 4.0)},
        {"f": hfa.Signal("m/s^2", 5.0, -40.0, 40.0)},
        lambda x, u, p, w: ({"v": p.growth * x.v + u.f}, {"twice": 2.0 * x.v}),
        outputs={"twice": hfa.Signal("m/s")},
        parameters={"growth": hfa.Signal("1/s", start=growths[0])},
        trim={"v": 0.0},
        schedule=schedule,
    )
    o = ca.SX.sym("o")
    deployment = hfa.Deployment(
        policy={"file": ca.Function("policy", [o], [-gain * o])},
        observation={"v": {}},
        action={"f": {}},
        timing={"dt": DT, "delay": delay},
        cost={"Q": {"twice": 1.0}, "R": {"f": R}},
    )
    return hfa.assess(model, deployment, growths if schedule else None, samples, **options)


def closed_form(growth, delay=0.0):
    """Return the ratio of the cost of the loop from v = 1 m/s to that of the LQR, by Gauss quadrature."""
    one = np.eye(1)
    F, G, W_x, N, W_u = over_hold(growth * one, one, 4.0 * one, R * one, DT)
    P = solve_discrete_are(F, G, W_x, W_u, s=N).item()
    whole, rest = divmod(delay, DT)
    pieces = [over_hold(growth * one, one, 4.0 * one, R * one, part) for part in (rest, DT - rest)]
    v, cost, commands = 1.0, 0.0, [0.0] * (int(whole) + 1)
    for _ in range(round(60.0 / DT)):
        commands.append(-GAIN * v)
        older, newer = commands[-2 - int(whole)], commands[-1 - int(whole)]
        for (F, G, W_x, N, W_u), f in zip(pieces, (older, newer), strict=True):
            cost += (W_x * v**2 + 2.0 * N * v * f + W_u * f**2).item()
            v = (F * v + G * f).item()
    return cost / P


@pytest.fixture(scope="module")
def told():
    return drifting(GAIN, GROWTHS)


def test_the_table_has_the_figures_of_each_trim(told):
    """Each row has the value of the parameter, and radius and ratio of costs in closed form. From the
    unstable trim all flights leave, and there is no margin.
    """
    table = told.report().records
    for growth, values, point in zip(GROWTHS, table.rows, told.points, strict=True):
        row = dict(zip(table.header, values, strict=True))
        F, G = math.exp(growth * DT), math.expm1(growth * DT) / growth
        radius = F - G * GAIN
        stays = radius < 1.0
        ratio = closed_form(growth) if stays else math.inf
        assert (row["growth [1/s]"], row["holds"]) == (growth, "yes" if stays else "no")
        assert row["radius"] == pytest.approx(radius, rel=1e-9)
        assert row["unstable at [s]"] == point.delays.limit
        counts = [row[name] for name in ("flown", "converge", "leave", "disturbed")]
        assert counts == [4, 4 * stays, 4 * (not stays), 4 * stays]
        for name in ("over LQR", "least", "most"):
            assert row[name] == pytest.approx(ratio, rel=1e-6)
        assert (row["margin"] == "") is not stays
        assert not stays or row["margin"] == point.margins.disk.disk
        of_loop, of_flights = re.findall(rf"^{growth:g} +(.*)", str(told), re.M)
        assert of_loop.split()[1] == f"{radius:.5g}"
        assert of_flights.split()[:4] == list(map(str, counts))
    first = {row["growth"]: row for row in told.report().data["points"]}[0.5]
    assert first["equilibrium"] == {"v": 0.0}
    assert first["equilibrium_inputs"] == {"f": 0.0}
    assert first["costs"] == told.points[0].costs._asdict()
    assert np.array(first["K"]).item() == pytest.approx(GAIN)
    (of_input,), margins = first["input_margins"], told.points[0].margins.inputs[0]
    limits = np.array([-1.0, 1.0]) + math.exp(0.5 * DT)  # of G GAIN times a factor
    limits /= GAIN * math.expm1(0.5 * DT) / 0.5
    assert (of_input["gain_low"], of_input["gain_high"]) == pytest.approx(tuple(limits))
    assert of_input["phase_deg"] == margins.phase


@pytest.mark.parametrize("delay", [0.02, 0.07, 0.1])
def test_the_cost_of_late_commands_is_that_of_gauss_quadrature(delay):
    (point,) = drifting(GAIN, [0.5], delay=delay).points
    expected = (closed_form(0.5, delay),) * 3
    assert point.costs[:3] == pytest.approx(expected, rel=1e-6)


def test_findings_name_the_trims_that_they_concern_and_the_worst(told):
    """With flights the unstable loop is a warning, beside the failure of the flights; without, it is the
    failure. The smallest limit of the delay is the worst of those where the policy holds.
    """
    limits = [1e3 * point.delays.limit for point in told.points]
    radius = math.exp(3.0 * DT) - math.expm1(3.0 * DT) / 3.0 * GAIN
    of_loop = f"at 3 1/s: unstable at its equilibrium (spectral radius {radius:.5f})"
    of_delay = f"at 1 1/s: unstable with {limits[1]:.4g} ms of delay (worst of 2 trims)"
    assert limits[1] < limits[0]
    expected = [("warning", of_loop), ("note", of_delay)]
    assert [each for each in told.findings if each in expected] == expected
    severities = [severity for severity, _ in told.findings]
    assert severities == ["failure", "failure", "warning", "note", "note"]
    first = told.first_line
    assert first.startswith("FAIL: holds at 2 of 3 trims at 20 Hz")
    assert "not at 3 1/s: 16 of 24 flights converge; the median cost is not finite" in first
    linear = drifting(GAIN, GROWTHS, samples=0)
    assert linear.findings[0] == ("failure", of_loop)
    assert linear.first_line.startswith("FAIL: linear loop holds at 2 of 3 trims")
    assert linear.first_line.endswith("not at 3 1/s; no flight was simulated")
    assert "A flight converges if" not in str(linear)
    assert "Assessment of the deployment on drifting" in str(linear)


@pytest.fixture(scope="module")
def holding():
    """Return an assessment that holds at five trims."""
    return drifting(4.0, [0.5, 1.0, 1.5, 2.0, 2.5])


def flown(point, **changes):
    return replace(point, flights=replace(point.flights, **changes))


def at_equilibrium(point, **changes):
    return replace(
        point,
        case=replace(point.case, equilibrium=replace(point.case.equilibrium, **changes)),
    )


LEFT = "{} of 4 flights leave the envelope"
STAYS = "{} of 4 flights do not converge within 60 s"
#: Change of a trim by a size above 0, severity, and the finding with the size.
KINDS = {
    "left": (lambda p, n: flown(p, left_envelope=n, converged=4 - n), "failure", LEFT),
    "stay": (lambda p, n: flown(p, converged=4 - n), "failure", STAYS),
    "stay with the share": (
        lambda p, n: replace(flown(p, converged=4 - n), share=0.1),
        *("warning", STAYS),
    ),
    "box": (
        lambda p, n: replace(p, box=1.0 - 0.2 * n),
        *("warning", "flights begin in {4} % of the initial-condition box, the largest in which "),
    ),
    "exact": (
        lambda p, n: replace(p, costs=p.costs._replace(exact_left=n)),
        *("warning", "{} of 4 flights of the exact gain leave"),
    ),
    "delay": (
        lambda p, n: replace(p, delays=Delays((), 0.04 / n, 0.1)),
        *("note", "unstable with {5:.4g} ms of delay"),
    ),
    "error": (
        lambda p, n: flown(p, end={"v": -0.5 * n}),
        *("warning", "steady-state v error -{6:g} m/s, so that its cost grows with time"),
    ),
    "normalizer": (
        lambda p, n: at_equilibrium(p, clipped_observations=("v", "w")),
        *("warning", "the normalizer clips v, w at the equilibrium"),
    ),
    "step": (
        lambda p, n: replace(p, integration=IntegrationError(0.01, 0.2 * n, "the end")),
        *("warning", "Not resolved: with half the integration step of 10 ms, the end changes by"),
    ),
    "saturated": (
        lambda p, n: at_equilibrium(p, clips=("f at 40", "g")),
        *("warning", "saturated at the equilibrium: f at 40 and g"),
    ),
    "beyond": (
        lambda p, n: at_equilibrium(p, states=np.array([4.0 + n])),
        *("warning", "at the equilibrium, v is"),
    ),
    "none": (
        lambda p, n: replace(p, case=replace(p.case, equilibrium=None)),
        *("warning", "no equilibrium near the trim"),
    ),
    "remark": (lambda p, n: replace(p, remarks=("no costs",)), "note", "no costs"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_finding_has_its_size_severity_and_trims(holding, kind):
    """A finding at all trims alike names none. Of two sizes, the larger one is told, with its trim and the
    number of all. Trims are a range only where all between have the finding.
    """
    change, severity, text = KINDS[kind]
    key = max(re.split(r"{.*?}", text), key=len)

    def found(*sizes):
        points = [change(p, n) if n else p for p, n in zip(holding.points, sizes, strict=True)]
        told = replace(holding, points=tuple(points))
        (own,) = (each for each in told.findings if key in each.text)
        return own, told

    def said(n):
        return text.format(n, 0, 0, 0, f"{100 - 20 * n}", 40.0 / n, 0.5 * n)

    everywhere, told = found(1, 1, 1, 1, 1)
    assert everywhere.severity == severity
    assert everywhere.text.startswith(said(1))
    assert told.ok is (severity != "failure")
    assert " ".join(str(told).split()).count(everywhere.text) == 1
    for sizes, where in (
        ((0, 1, 1, 0, 0), "from 1 to 1.5 1/s: "),
        ((1, 0, 0, 1, 0), "at 0.5, 2 1/s: "),
        ((1, 1, 0, 1, 1), "at 0.5, 1, 2 1/s and 1 more: "),
        ((0, 0, 0, 0, 1), "at 2.5 1/s: "),
    ):
        some, _ = found(*sizes)
        assert some.text.startswith(where + said(1))
    if said(1) != said(2):
        some, _ = found(0, 1, 0, 2, 0)
        assert some.text.startswith("at 2 1/s: " + said(2))
        assert "(worst of " in some.text


def test_an_unmet_requirement_is_the_failure_of_a_policy_that_holds(holding):
    """The first line tells it, with the number of trims."""
    wanting = replace(holding, needs={"margin": 1.0})
    failing = sum(point.margins.disk.disk < 1.0 for point in holding.points)
    text = f"the disk margin is not at least 1 at {failing} of 5 trims"
    assert 0 < failing < 5
    assert wanting.first_line.startswith(f"FAIL: {text};")
    assert wanting.findings[0] == ("failure", text)
    assert (wanting.ok, wanting.holds, bool(wanting)) == (False, True, False)
    for needs, count in (
        ({"delay": 0.01, "margin": 0.01, "cost": 1e3}, 0),
        ({"delay": 9.0, "margin": 9.0, "cost": 0.01}, 3),
    ):
        assert len(replace(holding, needs=needs).unmet) == count
    one = replace(wanting, points=holding.points[-1:])
    assert one.unmet == ["the disk margin is not at least 1"]


@pytest.mark.parametrize("growth", [-0.5, -0.02, -0.001])
def test_a_flight_takes_four_time_constants_from_one_minute_to_five(growth):
    """Of a policy that does nothing, the slowest mode is that of the plant."""
    (point,) = drifting(0.0, [growth], samples=1).points
    expected = min(max(60.0, -4.0 / growth), 300.0)
    assert point.flights.seconds == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("count", [1, 4, 6, 25, 100])
def test_the_band_of_a_median_has_the_share_of_its_order_statistics(count):
    """The true median is below the order statistic number r with the probability of r or more heads of
    `count` coins. The ends are the innermost ones with 2.5 % on each side. A flight that leaves has an
    infinite ratio, but none where the exact gain leaves, too.
    """
    random = np.random.default_rng(count)
    costs, exact = random.uniform(1.0, 2.0, (2, count))
    found = cost_ratio(costs, exact, 60.0)
    ratios = sorted(costs / exact)
    below = sum(binom.cdf(r, count, 0.5) < 0.025 for r in range(count))
    rank = max(below - 1, 0)
    assert (found.low, found.high) == (ratios[rank], ratios[count - 1 - rank])
    assert found.median == np.median(ratios)
    assert (", 95 %" in found.text()) is (count > 5)
    exact[0] = costs[-1] = np.inf
    mixed = cost_ratio(costs, exact, 60.0)
    ratios = [0.0, *sorted(costs[1:-1] / exact[1:-1]), np.inf][:count]
    assert mixed.exact_left == 1
    assert mixed.median == np.median(ratios)
