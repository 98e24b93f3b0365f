"""A critic to be checked: its value and gain, whatever file or object it comes from.

A network or other function of the state is linearized at the origin, with CasADi's exact
derivatives. V(z): P = ½ ∂²V/∂z², u = -½ R⁻¹B' ∂V/∂z. dV/dz: P = ½ ∂(dV/dz)/∂z, the same u. u(z): K
= -∂u/∂z."""

from __future__ import annotations

import ast
import operator
import re
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from controller.game.basis import Basis, basis
from controller.game.zero_sum import Game, shape_text
from controller.riccati.cost import is_moderate
from hfa_support.errors import BadInputError, numbers_in, shortened
from hfa_support.reporting.fields import Shown

if TYPE_CHECKING:
    from controller.game.user_files import StoredCritic

#: Suffixes of the files of networks.
NETWORK_FILES = (".onnx", ".pt", ".pth", ".pkl", ".safetensors", ".zip")
#: What a list of features may call and do, and its most letters.
_FUNCTIONS = ("sin", "cos", "tan", "tanh", "exp", "log", "sqrt", "fabs")
_OPERATIONS: Mapping[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_LONGEST = 20_000
#: W and P of one file may differ by this part, which is what printing six digits leaves.
TOGETHER = 1e-6


class Nonlinear(NamedTuple):
    """A critic as a function of the state. z: (n,) symbols; of them V, F = ∂V/∂z (n,) and u (m,),
    None where unknown.

    output: which of `network_file.OUTPUTS` the network has. precision: of its weights. constant:
    V(0). variants: the same network read otherwise, what is different -> candidate, to recognize a
    mistake."""

    z: Any
    V: Any
    F: Any
    u: Any
    output: str
    precision: str = "float64"
    constant: float = 0.0
    variants: Mapping[str, Callable[[], Candidate]] = {}

    def policy(self, game: Game) -> Any:
        """u, (m,), of the symbols z."""
        return ca.DM(-0.5 * game.R_inverse_B_transposed) @ self.F if self.u is None else self.u


@dataclass(frozen=True, eq=False, repr=False)
class Candidate(Shown):
    """A critic's policy u = -K z at the origin, its value z'Pz or V = W'ψ(z), as much as is known
    of it.

    K: (m, n), gain at the origin. P: (n, n), value matrix, None when only a gain is known. weights:
    (M,), V = W'ψ(z) in `functions`, None when it did not come as weights. nonlinear: None where P,
    K or W are all of it. derived: whether K follows from P."""

    K: np.ndarray
    P: np.ndarray | None
    functions: Basis
    weights: np.ndarray | None = None
    nonlinear: Nonlinear | None = None
    derived: bool = True

    @property
    def finite(self) -> bool:
        """Whether K and P consist of numbers with which can be computed: P S P may not overflow."""
        return is_moderate(self.K) and (self.P is None or is_moderate(self.P))


def from_weights(
    game: Game,
    weights: np.ndarray,
    functions: Basis | str | ca.Function = "quadratic",
    constant: float = 0.0,
    precision: str = "float64",
) -> Candidate:
    """V = W'ψ(z) + constant, u = -½ R⁻¹B' (∂ψ/∂z)'W (paper Eq. 28).

    functions: a basis, its name, or functions of your own, a CasADi Function z (n,) -> ψ(z) (M,).
    BadInputError when W has another length than the basis, or is complex."""
    weights, n = numbers_in("W", weights), len(game.A)
    if isinstance(functions, ca.Function):
        count, takes = functions.numel_out(0), functions.numel_in(0)
        if takes != n or weights.shape != (count,):
            raise BadInputError(
                f"there are {weights.size} weights and {n} states; the features are {count} functions of {takes} states"
            )
        z = ca.SX.sym("z", n)
        return linearized(
            game, z, {"V": ca.DM(weights).T @ ca.vec(functions(z)) + constant}, precision
        )
    psi = basis(functions, n) if isinstance(functions, str) else functions
    if weights.shape != (psi.size,):
        of = f"basis {psi.name!r} on {psi.states} states has {psi.size}"
        raise BadInputError(
            f"there are {weights.size} weights; {of}: name the basis of these weights"
        )
    P = psi.matrix(weights)
    return Candidate(game.gain(P), P, psi, weights)


def from_value(game: Game, P: np.ndarray) -> Candidate:
    """V = z'Pz, u = -R⁻¹B'P z. BadInputError when P has another shape than A, or is complex."""
    P = numbers_in("P", P)
    if P.shape != game.A.shape:
        n = len(game.A)
        raise BadInputError(
            f"P is {shape_text(P.shape)}; on a plant with {n} states it must be {n} x {n}"
        )
    return Candidate(game.gain(P), P, basis("quadratic", len(P)))


def from_gain(game: Game, K: np.ndarray) -> Candidate:
    """u = -K z. BadInputError when K has another shape than B', or is complex."""
    return Candidate(game.checked_gain(K), None, basis("quadratic", len(game.A)), derived=False)


def from_stored(game: Game, stored: StoredCritic, functions: Basis | ca.Function) -> Candidate:
    """The candidate of a file, each matrix as stored: missing P and K follow from W, or else from
    P.

    BadInputError for a wrong shape, and when W and P are not of one value, but for 1e-6: printing
    six digits leaves it."""
    found = None if stored.P is None else from_value(game, stored.P)
    if stored.W is not None:
        of_W = from_weights(game, stored.W, functions)
        if found is not None and found.P is not None and of_W.P is not None:
            sizes = np.sqrt(np.abs(np.diag(found.P)))
            if not np.all(np.abs(found.P - of_W.P) <= TOGETHER * np.outer(sizes, sizes)):
                raise BadInputError("W and P are of different values; leave one of them out")
        found = of_W
    if stored.K is None:
        assert found is not None
        return found
    gain = from_gain(game, stored.K)
    return gain if found is None else replace(found, K=gain.K, derived=False)


def features_of(text: str, states: int, names: tuple[str, ...] = ()) -> ca.Function:
    """z (n,) -> the functions of the list, as "x1**2, x1*x2, sin(alpha)": numbers, x1 ... xn or the
    names of the states, + - * / **, and the functions in `_FUNCTIONS`. BadInputError, one line,
    names anything else; nothing is executed."""
    z = ca.SX.sym("z", states)
    known = {f"x{place + 1}": z[place] for place in range(states)}
    known |= {name: z[place] for place, name in enumerate(names)}

    def made(node: ast.AST) -> Any:
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, int | float)
            and not isinstance(node.value, bool)
        ):
            return ca.SX(float(node.value))
        if isinstance(node, ast.Name) and node.id in known:
            return known[node.id]
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATIONS:
            return _OPERATIONS[type(node.op)](made(node.left), made(node.right))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
            return -made(node.operand) if isinstance(node.op, ast.USub) else made(node.operand)
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and node.func.id in _FUNCTIONS
        ):
            return getattr(ca, node.func.id)(*map(made, node.args))
        said, can = (
            shortened(ast.unparse(node)),
            f"x1 to x{states}, + - * / ** and {', '.join(_FUNCTIONS)}",
        )
        raise BadInputError(f"features: {said!r} is not known; use {can}")

    try:
        tree = ast.parse(f"({text[:_LONGEST]},)", mode="eval").body
        assert isinstance(tree, ast.Tuple)
        return ca.Function("features", [z], [ca.densify(ca.vertcat(*map(made, tree.elts)))])
    except BadInputError:
        raise
    except Exception as error:  # the parser, Python's floats and CasADi each have their own
        said = f"features: {shortened(text)!r} is no list of expressions, as in 'x1**2, x1*x2'"
        raise BadInputError(said) from error


def is_network(path: Path) -> bool:
    """Whether a file is one of a network: by its suffix, or an .npz whose arrays are named like
    layers."""
    if path.suffix.lower() == ".npz":
        try:
            with zipfile.ZipFile(path) as archive:
                return any(re.search(r"(^|\.)weight\.npy$", name) for name in archive.namelist())
        except Exception:  # damaged in whatever way: who reads its arrays names the fault
            return False
    return path.suffix.lower() in NETWORK_FILES


def linearized(
    game: Game,
    z: Any,
    outputs: Mapping[str, Any],
    precision: str,
    variants: Mapping[str, Callable[[], Candidate]] | None = None,
) -> Candidate:
    """The critic of which these outputs, of `network_file.OUTPUTS` but the last, are functions of
    the symbols z."""
    n = len(game.A)
    V, u = outputs.get("V"), outputs.get("policy")
    F = ca.gradient(V, z) if V is not None else outputs.get("gradient")
    constant = 0.0 if V is None else float(ca.Function("V", [z], [V])(np.zeros(n)))

    def slope(of: Any) -> np.ndarray:
        w = ca.SX.sym("w", of.numel())
        rows = ca.Function("rows", [z, w], [ca.jtimes(of, z, w, True)])
        return np.array(rows(np.zeros((n, of.numel())), np.eye(of.numel()))).T

    P = None if F is None else slope(F) / 2.0
    K = game.gain(P) if u is None and P is not None else -slope(u)
    about = Nonlinear(z, V, F, u, " and ".join(outputs), precision, constant, variants or {})
    return Candidate(K, P, basis("quadratic", n), None, about, derived=u is None)
