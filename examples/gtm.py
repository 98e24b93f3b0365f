"""Longitudinal motion of the NASA Generic Transport Model, a 5.5 % scale airliner, as polynomials.

Units: m, s, rad. The throttle is in percent. Source: A. Chakraborty, P. Seiler, G. J. Balas,
Nonlinear region of attraction analysis for flight control verification and validation, Control
Engineering Practice 19 (2011) 335-345, doi:10.1016/j.conengprac.2010.12.001. The coefficients are
taken from two public copies: PolynomialGTM.jl (J. Carpinelli) and the examples of CaSoS (iFR-ACSO).

The copies differ in two terms. The constant of the speed equation is .4282 (used here) or .4284,
which changes the throttle by 0.004 %. A term with coefficient 2.410e-74 is omitted here. The trim
of CaSoS at 45 m/s is alpha .04924, elevator .04892, throttle 14.33. The trim here is .04888,
.04920, 14.30.

    hfa linearize --aircraft examples/gtm.py:GTM --hold speed=45
    hfa fly --aircraft examples/gtm.py:GTM --hold speed=40 --policy none --gust 100:3
    hfa prove schedule --aircraft examples/gtm.py:GTM --at 30:60
"""

import re
from dataclasses import replace

import casadi as ca

from hfa import Model, Signal

#: Terms of the rates of V, alpha, q: a coefficient and powers of V (speed), a (alpha),
#: q (pitch rate), h (pitch), d (elevator) and T (throttle).
SPEED = """
1.233e-8V4q2 4.853e-9a3T3 3.705e-5V3aq -2.184e-6V3q2 0.02203V2a3 -2.836e-6a3T2 3.885e-7a2T3
-1.069e-6V3q -0.04517V2a2 -0.00214V2ad -0.003282V2aq -0.0008901V2d2 9.677e-5V2q2 -0.0002037a3T
-0.000227a2T2 -2.912e-8aT3 0.001591V2a -0.0004077V2d 9.475e-5V2q -1.637a3 -0.01631a2T 4.903a2h
-4.903ah2 1.702e-5aT2 -7.771e-7T3 1.634h3 -0.0004319V2 -0.2142a2 0.001222aT 0.0004541T2 9.823a
0.03261T -9.807h 0.4282
"""
ALPHA = """
-3.709e-11V5q2 6.869e-11Va3T3 7.957e-10V4aq 9.86e-9V4q2 1.694e-5V3a3 -4.015e-8Va3T2 -7.722e-12Va2T3
-6.086e-9a3T3 -2.013e-8V4q -5.18e-5V3a2 -2.72e-6V3ad -1.41e-7V3aq 7.352e-7V3d2 -8.736e-7V3q2
-0.001501V2a3 -2.883e-6Va3T 4.513e-9Va2T2 -4.121e-10VaT3 3.557e-6a3T2 6.841e-10a2T3 4.151e-5V3a
3.648e-6V3d 3.566e-6V3q 6.246e-6V2aq 0.004589V2a2 -6.514e-5V2d2 2.58e-5V2q2 -3.787e-5Va3
3.241e-7Va2T 2.409e-7VaT2 1.544e-11VT3 0.0002554a3T -3.998e-7a2T2 3.651e-8aT3 4.716e-7V3
-0.003677V2a -0.0003231V2d -0.0001579V2q 0.002605Va2 1.73e-5VaT -0.005201Vah -9.026e-9VT2
0.002601Vh2 0.003355a3 -2.872e-5a2T -2.134e-5aT2 -1.368e-9T3 -4.178e-5V2 0.0002272Va -6.483e-7VT
-0.2308a2 -0.001532aT 0.4608ah -0.2304h2 7.997e-7T2 -0.00521V -0.02013a 5.744e-5T 1q 0.4616
"""
PITCH_RATE = """
-6.573e-9V5q3 1.747e-6V4q3 -0.0001548V3q3 -0.003569V2a3 0.004571V2q3 4.953e-5V3q 0.009596V2a2
0.02049V2ad -0.02431V2a -0.03063V2d -0.004388V2q -2.594e-7T3 0.002461V2 0.0001516T2 0.01089T 0.143
"""


def terms(text):
    """Return (coefficient, [(variable, power), ...]) for each term in a string like "1.5V2a"."""
    found = []
    for term in text.split():
        number, powers = re.fullmatch(r"([-.\d]+(?:e-\d+)?)(.*)", term).groups()
        variables = re.findall(r"([VaqhdT])(\d?)", powers)
        found.append((float(number), [(name, int(power or 1)) for name, power in variables]))
    return found


RATES = {"speed": terms(SPEED), "alpha": terms(ALPHA), "pitch_rate": terms(PITCH_RATE)}


def polynomial(terms, values):
    """Return the polynomial with these terms at the given values of its variables."""
    total = 0
    for number, powers in terms:
        product = number
        for name, power in powers:
            product = product * values[name] ** power
        total = total + product
    return total


def variables(x, u):
    """Return the value of each symbol in the polynomials, such as V for the speed."""
    return {
        "V": x.speed,
        "a": x.alpha,
        "q": x.pitch_rate,
        "h": x.pitch,
        "d": u.elevator,
        "T": u.throttle,
    }


def outputs(x, rates):
    """Return the flight-path angle gamma and the load factor n.

    The load factor follows from V gamma' = g (n - cos gamma).
    """
    gamma = x.pitch - x.alpha
    load_factor = ca.cos(gamma) + x.speed / 9.807 * (x.pitch_rate - rates["alpha"])
    return {"gamma": gamma, "load_factor": load_factor}


def equations(x, u, p, w):
    """Return the state derivatives and the outputs."""
    values = variables(x, u)
    rates = {name: polynomial(terms, values) for name, terms in RATES.items()}
    rates["pitch"] = x.pitch_rate
    return rates, outputs(x, rates)


GTM = Model(
    name="GTM",
    states={
        "speed": Signal("m/s", nominal=45.0, min=25.0, max=75.0, start=45.0, rate=9.8),
        "alpha": Signal("rad", nominal=0.1, min=-0.1, max=0.5, start=0.05),
        "pitch_rate": Signal("rad/s", nominal=0.1, min=-3.5, max=3.5, rate=1.0),
        "pitch": Signal("rad", nominal=0.1, min=-1.0, max=1.0, start=0.05),
    },
    inputs={
        "elevator": Signal("rad", nominal=0.1, min=-0.5, max=0.35),
        "throttle": Signal("%", nominal=10.0, min=0.0, max=100.0, start=15.0),
    },
    outputs={"gamma": Signal("rad", nominal=0.1), "load_factor": Signal()},
    equations=equations,
    trim={"speed": 45.0, "gamma": 0.0, "pitch_rate": 0.0},
    replaced={"pitch": "gamma"},
    schedule="speed",
    modes={"short period": ("alpha", "pitch_rate"), "phugoid": ("speed", "pitch")},
)

#: Factor -> (rate, variables that its terms contain, variables that they do not contain).
FACTORS = {
    "thrust_power": ("speed", "T", ""),
    "lift_slope": ("alpha", "a", "qd"),
    "pitch_stiffness": ("pitch_rate", "a", "qd"),
    "pitch_damping": ("pitch_rate", "q", ""),
    "elevator_power": ("pitch_rate", "d", ""),
}


def factor(rate, powers, p):
    """Return the uncertain factor on a term of a state equation, or 1 if the term is certain.

    rate: name of the state
    powers: pairs (variable, power) of the term
    p: parameters, which include the factors
    """
    present = {name for name, _ in powers}
    for name, (changed, has, lacks) in FACTORS.items():
        if rate == changed and present >= {*has} and not present & {*lacks}:
            return getattr(p, name)
    return 1


def uncertain_equations(x, u, p, w):
    """Return the state derivatives and the outputs. Some terms of the derivatives have uncertain
    factors.
    """
    values = variables(x, u)
    rates = {}
    for rate, listed in RATES.items():
        rates[rate] = 0
        for number, powers in listed:
            term = polynomial([(number, powers)], values)
            rates[rate] += factor(rate, powers, p) * term
    rates["pitch"] = x.pitch_rate
    return rates, outputs(x, rates)


#: The aircraft with these factors as parameters, nominally 1, for `hfa identify`.
UNCERTAIN_GTM = replace(
    GTM,
    name="GTM with factors",
    parameters={name: Signal(nominal=1.0, start=1.0, min=0.2, max=5.0) for name in FACTORS},
    equations=uncertain_equations,
)
