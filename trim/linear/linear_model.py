"""Linear model at an operating point."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from hfa_aircraft.states_and_inputs import StatesAndInputs
from hfa_support.arguments import ArrayLike, checks_arguments
from hfa_support.entry_points import PARTS, part
from hfa_support.errors import BadInputError
from hfa_support.reporting.by_value import ByValue
from hfa_support.reporting.named_array import with_names
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result, Vector

if TYPE_CHECKING:
    import control
    from matplotlib.axes import Axes

    from hfa_aircraft.model import Model
    from hfa_support.reporting.by_name import ByName
    from trim.linear.mode import Mode
    from trim.point.operating_point import OperatingPoint


@checks_arguments
@dataclass(frozen=True, eq=False, repr=False)
class LinearModel(StatesAndInputs, ByValue, Result, Reported):
    """Linear model x' = A x + B u + E w, y - Y0 = C x + D u + F w (Eq. 9 of the paper).

    The deviations are x = X - X0 and u = U - U0.

    A: (n, n), ∂f/∂X, in units of the row's rate per unit of the column; can be indexed by names:
        A["pitch_rate", "alpha"].
    B: (n, m), ∂f/∂U, can be indexed by names.
    C: (k, n), ∂y/∂X, the identity if the outputs are the states.
    D: (k, m), ∂y/∂U.
    states: names of the states, in order; by default x1, x2, ...
    inputs: names of the inputs, in order; by default u1, u2, ...
    point: operating point, whose values are the offsets X0, U0; by default the origin.
    outputs: names of the outputs y, in order; by default the states.
    E: (n, l), ∂f/∂w; without columns if there are no disturbances.
    F: (k, l), ∂y/∂w.
    output_offsets: Y0, (k,).
    disturbances: names of the disturbances w.
    kinks: notes on entries of A and B that are means of two slopes, and on rates that jump.

    >>> import hfa
    >>> model = hfa.aircraft()
    >>> linear = hfa.linearize(model, hfa.trim(model))
    >>> type(linear) is hfa.LinearModel, linear.A.shape, linear.B.shape
    (True, (6, 6), (6, 5))
    >>> hfa.LinearModel([[0.0, 1.0], [-4.0, -0.4]], [[0.0], [1.0]], states=("x", "v")).A["v", "x"]
    np.float64(-4.0)
    """

    how_to_make: ClassVar[str] = "linearize(model, point), or of matrices hfa.LinearModel(A, B)"
    schema = "hfa.linear-model/1"
    made_by = "hfa linearize"
    json_keys = (
        "dihedral_deg?=point.dihedral_deg scheduled?=point.scheduled dynamics=point.dynamics "
        "operating_point=point states inputs state_units input_units state_offsets input_offsets "
        "A B outputs output_units C D disturbances? disturbance_units? E? F? output_offsets "
        "warnings modes"
    )

    A: Matrix
    B: Matrix
    C: Matrix = None  # type: ignore[assignment]  # completed with point
    D: Matrix = None  # type: ignore[assignment]
    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    point: OperatingPoint = None  # type: ignore[assignment]
    outputs: tuple[str, ...] = ()
    E: Matrix = None  # type: ignore[assignment]
    F: Matrix = None  # type: ignore[assignment]
    output_offsets: Vector = None  # type: ignore[assignment]
    disturbances: tuple[str, ...] = ()
    kinks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Complete missing names and matrices, and make A and B indexable by names."""
        if self.point is None:
            completed = part(PARTS, "linear.matrices", "LinearModel(A, B)")
            vars(self).update(completed(self))
        vars(self).update(
            A=with_names(self.A, self.states, self.states),
            B=with_names(self.B, self.states, self.inputs),
        )

    @property
    def model(self) -> Model:
        """Model of the aircraft."""
        return self.point.model

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states, equal to `states`."""
        return self.states

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, equal to `inputs`."""
        return self.inputs

    @property
    def output_units(self) -> tuple[str, ...]:
        """Units of the outputs, in order."""
        return self.model.units(self.outputs)

    @property
    def disturbance_units(self) -> tuple[str, ...]:
        """Units of the disturbances, in order."""
        return self.model.units(self.disturbances)

    @property
    def warnings(self) -> list[str]:
        """Notes on the operating point, omitted input dynamics, entries of A and B at kinks, and
        rates that jump.
        """
        signals = self.model.inputs
        moving = [signals[name].moving for name in self.inputs if signals[name].moving]
        return [*self.point.warnings, *moving, *self.kinks]

    @property
    def modes(self) -> ByName[Mode]:
        """Modes of A, fastest first, which can be indexed by number or name: modes["phugoid"]."""
        from hfa_support.reporting.by_name import ByName
        from trim.linear.modes import modes_of

        return ByName(modes_of(self.A, self.states, self.model.modes))

    @property
    def state_offsets(self) -> Vector:
        """Offsets X0 of the states, (n,)."""
        return np.array([self.point.values[name] for name in self.states])

    @property
    def input_offsets(self) -> Vector:
        """Offsets U0 of the inputs, (m,)."""
        return np.array([self.point.values[name] for name in self.inputs])

    def select(
        self,
        states: Sequence[str] | None = None,
        inputs: Sequence[str] | None = None,
        *,
        residualize: Sequence[str] = (),
    ) -> LinearModel:
        """Return the linear model with only the named states and inputs.

        Omitted states and inputs are constant at their offsets.

        states: names; by default all except `residualize`
        inputs: names; by default all
        residualize: states that follow the other states without delay, x2 = -A22⁻¹ (A21 x1 + B2 u +
            E2 w). Static gains are unchanged.

        Raises BadInputError if the model does not have such a name, a name is repeated, no state
        remains, or A22 is singular.
        """
        from trim.linear.reduction import reduced

        return reduced(self, states, inputs, residualize)

    def __getitem__(self, names: tuple[Any, Any]) -> LinearModel:
        """Return the linear model from named inputs to named outputs.

        The outputs are named first, as in linear["pitch_rate", "elevator_center"]. Inputs and
        outputs are each a name or a list of names.

        Raises BadInputError if the index is not a pair, the model does not have such a name, or a
        name is repeated.
        """
        from trim.linear.reduction import chosen

        match names:
            case (str() | list() | tuple() as outputs, str() | list() | tuple() as inputs):
                return chosen(self, inputs, outputs)
        raise BadInputError("the index is not a pair of names; write linear[outputs, inputs]")

    def __iter__(self) -> Iterator[np.ndarray]:
        """Yield A, B, C and D, for A, B, C, D = linear and control.ss(*linear)."""
        return map(np.asarray, (self.A, self.B, self.C, self.D))

    @property
    def eigenvalues(self) -> np.ndarray:
        """Eigenvalues of A, (n,) complex, 1/s, fastest first."""
        from trim.linear.modes import Eigenvalues, fastest_first

        return fastest_first(np.linalg.eigvals(self.A)).view(Eigenvalues)

    @property
    def eigenvectors(self) -> Any:
        """Eigenvectors of A, (n, n) complex, one column for each of `eigenvalues`."""
        from trim.linear.modes import order_fastest_first

        values, vectors = np.linalg.eig(self.A)
        return vectors[:, order_fastest_first(values)]

    @property
    def is_stable(self) -> bool:
        """True if every mode of A is stable."""
        return all(mode.stable for mode in self.modes)

    @property
    def is_controllable(self) -> bool:
        """True if the inputs affect every mode, within rounding: [A - λ I, B] has rank n."""
        return not self.zeros(outputs=()).size

    @property
    def is_observable(self) -> bool:
        """True if the outputs show every mode, within rounding: [A - λ I; C] has rank n."""
        return not self.zeros(inputs=()).size

    @checks_arguments
    def zeros(self, inputs: Any = None, outputs: Any = None) -> np.ndarray:
        """Return the transmission zeros from named inputs to named outputs, complex, 1/s.

        By default all inputs and outputs are used. With outputs=(), the zeros are the eigenvalues
        of the modes that no input affects. With inputs=(), the zeros are the eigenvalues of the
        modes that no output shows.
        """
        from trim.linear.frequency import zeros_of
        from trim.linear.reduction import chosen

        return zeros_of(chosen(self, inputs, outputs))

    @checks_arguments
    def step(
        self, time: float | ArrayLike | None = None, inputs: Any = None, outputs: Any = None
    ) -> control.TimeResponseData:
        """Return the responses of the outputs to a unit step of each input, (outputs, inputs, N).

        The outputs are deviations from the operating point.

        time: (N,), or the final time, s; by default chosen by python-control
        inputs, outputs: names; by default all
        """
        return _responses().response(self, "step", time, inputs, outputs)

    @checks_arguments
    def impulse(
        self, time: float | ArrayLike | None = None, inputs: Any = None, outputs: Any = None
    ) -> control.TimeResponseData:
        """Return the responses of the outputs to a unit impulse of each input, (outputs, inputs,
        N).

        The outputs are deviations from the operating point.

        time, inputs, outputs: as for `step`
        """
        return _responses().response(self, "impulse", time, inputs, outputs)

    @checks_arguments
    def simulate(
        self, u: Any = None, time: Any = None, *, initial: Any = None, dt: float | None = None
    ) -> control.TimeResponseData:
        """Return the outputs over time, (outputs, N), as deviations from the operating point.

        u: (m, N) or (N, m), or input -> number or N values; by default 0
        time: (N,), or the final time, s; by default chosen by python-control
        initial: state -> initial deviation, or all deviations (n,); by default 0
        dt: sample time of u or of the result, s; None if `time` is an array
        """
        return _responses().simulated(self, u, time, initial, dt)

    @checks_arguments
    def transfer_function(self, inputs: Any, outputs: Any) -> control.TransferFunction:
        """Return the python-control transfer function from one input to one output.

        Common poles and zeros are canceled. Raises BadInputError for several inputs or outputs.
        """
        return _responses().transfer_function(self, inputs, outputs)

    @checks_arguments
    def bode(self, inputs: Any = None, outputs: Any = None) -> np.ndarray:
        """Draw the Bode plots of the named inputs and outputs with pyplot, and return the Axes.

        Raises BadInputError if no input affects an output.
        """
        return _responses().bode(self, inputs, outputs)

    def plot(self) -> Axes:
        """Draw the poles and zeros with pyplot, and return the Axes."""
        return _responses().draw_poles(self)

    @checks_arguments
    def nyquist(self, inputs: Any = None, outputs: Any = None) -> Axes:
        """Draw the Nyquist plot from one input to one output with pyplot, and return the Axes."""
        return _responses().nyquist(self, inputs, outputs)

    def report(self) -> Report:
        """Return a report of the linear model, with A, B, the offsets and the modes."""
        from trim.linear.linear_report import linear_model_report

        return linear_model_report(self)

    def to_control(self) -> control.StateSpace:
        """Return the linear model as a python-control `StateSpace`, with the same signal names."""
        from trim.linear.exchange import state_space

        return state_space(self)

    def __dir__(self) -> list[str]:
        return [*object.__dir__(self), *dir(self.to_control())]


def _responses() -> Any:
    """Return the module that computes and draws responses, from the package that supplies it.

    Raises BadInputError if this package is not installed.
    """
    return part(PARTS, "notebook.responses", "a response of a linear model")
