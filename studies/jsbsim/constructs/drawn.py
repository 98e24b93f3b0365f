"""Random constructs of nested functions, chains of components, switches, axes or properties.

The random numbers include special values such as 0, 1 and the smallest value taken as true.
"""

from __future__ import annotations

import numpy as np

from studies.jsbsim.constructs.jet import (
    SLOTS,
    coefficient,
    component,
    function,
    pitching,
    slope,
)

_SIGNALS = (
    *("aero/alpha-rad", "aero/beta-rad", "velocities/q-rad_sec", "velocities/p-aero-rad_sec"),
    *("fcs/elevator-cmd-norm", "fcs/aileron-cmd-norm", "velocities/mach", "attitude/phi-rad"),
    *("aero/bi2vel", "atmosphere/sigma", "fcs/flap-cmd-norm", "inertia/cg-x-in"),
)
_NUMBERS = (0.0, -1.0, 1.0, 0.5, -0.3, 1e-10, -1e-10, 2.0, 0.05, 1e-9, -2.5, 3e-9)
_ONE = (
    *("abs", "sin", "cos", "tan", "asin", "acos", "atan", "exp", "ln", "log2", "log10", "sqrt"),
    *("floor", "ceil", "integer", "fraction", "sign", "toradians", "todegrees", "roundmultiple"),
)
_TWO = ("quotient", "pow", "fmod", "atan2", "lt", "le", "gt", "ge", "eq", "nq", "difference")
_MANY = ("sum", "product", "avg", "min", "max")


class Draw:
    """Generator of random constructs from one stream of random numbers."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def construct(self) -> dict[str, str]:
        """Return the slots of a random construct as a dictionary slot -> XML."""
        kinds = (self.of_function, self.of_chain, self.of_switch, self.of_axes, self.of_property)
        weights = (0.35, 0.35, 0.15, 0.05, 0.1)
        return kinds[int(self._rng.choice(len(kinds), p=weights))]()

    def number(self) -> str:
        """Return a random number as text. Half of the numbers are special values."""
        if self._rng.random() < 0.5:
            return str(self._one(_NUMBERS))
        return f"{self._rng.uniform(-2.0, 2.0):.3g}"

    def _one(self, choices: tuple[object, ...]) -> object:
        return choices[int(self._rng.integers(len(choices)))]

    def _signal(self) -> str:
        sign = "-" if self._rng.random() < 0.2 else ""
        return f"{sign}{self._one(_SIGNALS)}"

    def _value(self) -> str:
        """Return the text of a random number or property, for the input of a component."""
        return self.number() if self._rng.random() < 0.5 else self._signal()

    def term(self, depth: int) -> str:
        """Return the XML of a random term of a function.

        depth: largest number of levels of terms inside this term
        """
        kind = self._rng.random()
        if depth == 0 or kind < 0.1:
            if self._rng.random() < 0.4:
                return f"<v>{self.number()}</v>"
            return f"<p>{self._signal()}</p>"
        inner = [self.term(depth - 1) for _ in range(4)]
        if kind < 0.4:
            return self._operation(str(self._one(_ONE)), inner[:1])
        if kind < 0.6:
            return self._operation(str(self._one(_TWO)), inner[:2])
        if kind < 0.75:
            name = str(self._one(_MANY))
            return self._operation(name, inner[: int(self._rng.integers(1, 5))])
        test = self._operation(str(self._one(("lt", "ge", "eq", "not"))), inner[:2])
        if "<not>" in test[:6]:
            test = self._operation("not", [self._operation("gt", inner[:2])])
        if kind < 0.85:
            return self._operation("ifthen", [test, *inner[2:]])
        if kind < 0.9:
            return self._operation(str(self._one(("and", "or"))), [test, f"<v>{self.flag()}</v>"])
        points = [f"<v>{self._rng.uniform(-1.0, 1.0):.3g}</v> {part}" for part in inner[:3]]
        if kind < 0.95:
            return self._operation("interpolate1d", [inner[3], *points])
        return self._table()

    def flag(self) -> str:
        """Return a random number that serves as a truth value, some close to JSBSim's limit, as
        text.
        """
        return str(self._one((0, 1, 1e-10, 2e-9, -1, -1e-12)))

    def _operation(self, name: str, arguments: list[str]) -> str:
        return f"<{name}> {' '.join(arguments)} </{name}>"

    def _table(self) -> str:
        """Return the XML of a random table with one or two arguments."""
        rows = np.sort(self._rng.uniform(-1.0, 1.0, 4))
        if self._rng.random() < 0.5:
            data = "\n".join(f"{row:.4f} {self._rng.uniform(-1, 1):.3f}" for row in rows)
            head = f"<independentVar>{self._one(_SIGNALS)}</independentVar>"
        else:
            columns = np.sort(self._rng.uniform(-1.0, 1.0, 3))
            data = " ".join(f"{column:.4f}" for column in columns)
            for row in rows:
                values = " ".join(f"{value:.3f}" for value in self._rng.uniform(-1, 1, 3))
                data += f"\n{row:.4f} {values}"
            head = f'<independentVar lookup="row">{self._one(_SIGNALS)}</independentVar>'
            head += f'<independentVar lookup="column">{self._one(_SIGNALS)}</independentVar>'
        return f"<table> {head} <tableData>\n{data}\n</tableData> </table>"

    def _bounded(self, text: str) -> str:
        return f"<min> <v>2</v> <max> <v>-2</v> {text} </max> </min>"

    def of_function(self) -> dict[str, str]:
        """Return the slots of a random function.

        The function is part of the pitching moment, or it is in another section and the moment
        refers to it.
        """
        body = self._bounded(self.term(3))
        place = self._rng.random()
        if place < 0.6:
            return function(body)
        slot = str(self._one(("air", "wheels", "control", "mass", "propulsion")))
        named = f'<function name="own/f"> {body} </function>'
        return {slot: _kept(slot) + named, "pitch": pitching("own/f")}

    def of_chain(self) -> dict[str, str]:
        """Return the slots of a chain of one to three components, sometimes in reversed order."""
        count = int(self._rng.integers(1, 4))
        source = self._signal()
        parts = []
        for number in range(count):
            name = "fcs/probe" if number == count - 1 else f"fcs/stage{number}"
            parts.append(self._component(name, source))
            source = ("-" if self._rng.random() < 0.2 else "") + name
        if self._rng.random() < 0.2:
            parts.reverse()
        return component(" ".join(parts))

    def _clip(self) -> str:
        if self._rng.random() < 0.5:
            return ""
        low, high = self._value(), self._value()
        kind = ' type="cyclic"' if self._rng.random() < 0.05 else ""
        return f"<clipto{kind}> <min>{low}</min> <max>{high}</max> </clipto>"

    def _component(self, name: str, source: str) -> str:
        """Return the XML of a random component with output limits."""
        given = f"<input>{source}</input>"
        extra = ""
        kind = str(
            self._one(
                (
                    *("pure_gain", "summer", "deadband", "aerosurface_scale", "kinematic"),
                    *("scheduled_gain", "fcs_function", "actuator", "sensor", "lag_filter", "pid"),
                    *("lead_lag_filter", "second_order_filter", "washout_filter", "integrator"),
                )
            )
        )
        rate = abs(float(self.number())) + 0.5
        if kind == "pure_gain":
            extra = f"<gain>{self._value()}</gain>"
        elif kind == "summer":
            extra = f"<input>{self._signal()}</input> <bias>{self.number()}</bias>"
        elif kind == "deadband":
            extra = f"<width>{self._value()}</width> <gain>{self.number()}</gain>"
        elif kind == "aerosurface_scale":
            low, high, least, most = self._rng.uniform(-2.0, 2.0, 4)
            extra = f"<domain> <min>{low:.3f}</min> <max>{high:.3f}</max> </domain>"
            extra += f"<range> <min>{least:.3f}</min> <max>{most:.3f}</max> </range>"
            extra += str(self._one(("", "<zero_centered>false</zero_centered>")))
        elif kind == "kinematic":
            detents = self._rng.uniform(-1.0, 1.0, 3)
            if self._rng.random() < 0.8:
                detents = np.sort(detents)
            settings = [
                f"<setting> <position>{detent:.3f}</position> <time>0.5</time> </setting>"
                for detent in detents
            ]
            extra = f"<traverse> {' '.join(settings)} </traverse>"
            extra += str(self._one(("", "<noscale/>")))
        elif kind == "scheduled_gain":
            extra = f"{self._table()} <gain>{self.number()}</gain>"
        elif kind == "fcs_function":
            extra = f"<function> {self._bounded(self.term(2))} </function>"
        elif kind == "actuator":
            extra = f"<lag>{rate + 2.0:.3g}</lag> <bias>{self.number()}</bias>"
            extra += f"<deadband_width>{self.number()}</deadband_width>"
        elif kind == "sensor":
            extra = f"<gain>{self.number()}</gain> <bias>{self.number()}</bias>"
        elif kind in ("lag_filter", "washout_filter"):
            extra = f"<c1>{rate + 2.0:.3g}</c1>"
        elif kind == "lead_lag_filter":
            extra = (
                f"<c1>{self.number()}</c1> <c2>{self.number()}</c2> <c3>1</c3> <c4>{rate + 2}</c4>"
            )
        elif kind == "second_order_filter":
            extra = f"<c1>0</c1> <c2>{self.number()}</c2> <c3>{self.number()}</c3>"
            extra += "<c4>1</c4> <c5>6</c5> <c6>9</c6>"
        elif kind == "pid":
            extra = f"<kp>{self._value()}</kp> <kd>0.1</kd>"
        elif kind == "integrator":
            extra = f"<c1>{self.number()}</c1>"
        return f'<{kind} name="{name}"> {given} {extra} {self._clip()} </{kind}>'

    def of_switch(self) -> dict[str, str]:
        """Return the slots of a switch with one to three tests."""
        tests = [self._test(self._rng.random() < 0.9) for _ in range(int(self._rng.integers(1, 4)))]
        default = f'<default value="{self._value()}"/>' if self._rng.random() < 0.8 else ""
        text = f'<switch name="fcs/probe"> {default} {" ".join(tests)} {self._clip()} </switch>'
        return component(text)

    def _test(self, has_value: bool) -> str:
        value = f'value="{self._value()}"' if has_value else ""
        logic = str(self._one(("", 'logic="AND"', 'logic="OR"', 'logic="OR"')))
        lines = "\n".join(self._condition() for _ in range(int(self._rng.integers(1, 4))))
        nested = ""
        if self._rng.random() < 0.2:
            nested = f'<test logic="OR"> {self._condition()}\n{self._condition()} </test>'
        return f"<test {logic} {value}>\n{lines}\n{nested} </test>"

    def _condition(self) -> str:
        blank = "\t" if self._rng.random() < 0.05 else " "
        sign = self._one(("lt", "GT", "le", "GE", "eq", "NE", "&lt;", "==", "!=", ">="))
        return blank.join((self._signal(), str(sign), self._value()))

    def of_axes(self) -> dict[str, str]:
        """Return the slots of forces and moments in random frames, some at the center of
        gravity.
        """
        force = str(self._one(("WIND", "BODY", "STABILITY", "")))
        slots = {}
        names: tuple[str, ...] = ("Z", "X", "Y")
        if self._rng.random() < 0.3:
            names, force = ("NORMAL", "AXIAL", "SIDE"), ""
        if self._rng.random() < 0.2:
            names = ("LIFT", "DRAG", "SIDE")
        attribute = f' frame="{force}"' if force else ""
        for slot, name in zip(("lift_axis", "drag_axis", "side_axis"), names, strict=True):
            slots[slot] = f'name="{name}"{attribute}'
        moment = str(self._one(("WIND", "BODY", "STABILITY", "")))
        slots["moment_frame"] = f' frame="{moment}"' if moment else ""
        term = coefficient(slope(0.2, "aero/alpha-rad"))
        if self._rng.random() < 0.5:
            slots["lift"] = term.replace("<function>", '<function apply_at_cg="true">', 1)
        if self._rng.random() < 0.3:
            slots["pitch"] = term.replace("<function>", '<function apply_at_cg="true">', 1)
        return slots

    def of_property(self) -> dict[str, str]:
        """Return the slots of a function that writes a property of JSBSim or a component."""
        name = str(
            self._one(
                (
                    *("fcs/probe/malfunction/fail_zero", "fcs/probe/malfunction/fail_hardover"),
                    *(
                        "fcs/probe/malfunction/fail_stuck",
                        "fcs/flap-pos-norm",
                        "gear/gear-pos-norm",
                    ),
                    *("fcs/elevator-pos-rad", "fcs/rudder-cmd-norm", "fcs/throttle-pos-norm"),
                    *("propulsion/tank[0]/contents-lbs", "aero/alpha-max-rad", "metrics/Sw-sqft"),
                    *("inertia/empty-weight-lbs", "metrics/aero-rp-x-in", "fcs/mixture-cmd-norm"),
                    *("atmosphere/delta-T", "propulsion/engine[0]/bleed-factor", "ic/vt-fps"),
                    *("fcs/pitch-trim-cmd-norm", "velocities/vt-fps", "fcs/elevator-pos-deg"),
                )
            )
        )
        value = f"{self._rng.uniform(0.0, 1.0):.3g}" if self._rng.random() < 0.8 else "0"
        writer = f'<fcs_function name="own/w"> <function> <v>{value}</v> </function>'
        writer += f" <output>{name}</output> </fcs_function>"
        probe = '<actuator name="fcs/probe"> <input>fcs/elevator-cmd-norm</input>'
        probe += " <clipto> <min>-0.5</min> <max>0.5</max> </clipto> </actuator>"
        parts = (writer, probe) if self._rng.random() < 0.5 else (probe, writer)
        return component(" ".join(parts))


def _kept(slot: str) -> str:
    """Return the default content of a slot of the jet."""
    return SLOTS[slot]


def drawn(count: int, seed: int) -> dict[str, dict[str, str]]:
    """Return the slots of `count` random constructs by name, for the seeds seed, seed + 1, ..."""
    return {f"drawn: {seed + number}": Draw(seed + number).construct() for number in range(count)}
