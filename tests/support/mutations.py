"""Small mistakes that can be made in a source, one at a time: what `make mutants` plants."""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

_COMPARISONS: dict[type, tuple[type, ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_ARITHMETIC: dict[type, type] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
}
#: Functions of the libraries whose two arguments are of one type and not exchangeable.
_OF_TWO = {"arctan2", "atan2", "solve", "lstsq", "subtract", "divide", "kron", "matmul", "cross", "mtimes"}
#: Whether they are there is seen only by who looks on, or is a guard against what cannot be.
_SEEN_ONLY = {"progress", "print"}
_GUARDS = {"strict", "repr"}
#: Of another type than a number: an operator between them is no arithmetic.
_NO_NUMBERS = (ast.JoinedStr, ast.List, ast.Tuple, ast.Dict, ast.Set, ast.ListComp)


class Mutation(NamedTuple):
    """Bytes `start` to `end` of a source, which are on `line`, replaced by `new`."""

    kind: str
    line: int
    start: int
    end: int
    new: str

    def applied(self, source: str) -> str:
        """The source with the mistake."""
        content = source.encode()
        return (content[: self.start] + self.new.encode() + content[self.end :]).decode()


def same_types(sources: Iterable[str]) -> frozenset[str]:
    """Names of the functions whose first two parameters are annotated alike, in every definition of that name."""
    agree: dict[str, bool] = {}
    for source in sources:
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.FunctionDef):
                first = [each for each in node.args.posonlyargs + node.args.args if each.arg not in {"self", "cls"}][:2]
                types = {ast.unparse(each.annotation) for each in first if each.annotation}
                agree[node.name] = agree.get(node.name, True) and len(first) == 2 and len(types) == 1
    return frozenset(name for name, yes in agree.items() if yes) | _OF_TWO


def mutations(source: str, alike: frozenset[str] = frozenset(_OF_TWO)) -> list[Mutation]:
    """Every mistake that the operators make in what the source computes, in its order.

    Left out: docstrings, annotations, decorators, what only type checkers read, f-strings and what an error says;
    progress; the bounds of comparisons with tolerances, which no number meets exactly.
    """
    starts = [0]
    for text in source.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(text))

    found = []
    for node in _computing(ast.parse(source)):
        for kind, old, new in _mistakes(node, alike):
            start, end = starts[old.lineno - 1] + old.col_offset, starts[old.end_lineno - 1] + old.end_col_offset
            text = ast.unparse(new)
            found.append(Mutation(kind, old.lineno, start, end, f"({text})" if isinstance(new, ast.expr) else text))
    return found


def _computing(node: ast.AST) -> Iterator[ast.AST]:
    """The nodes below one that decide what is computed."""
    if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
        return
    yield node
    if isinstance(node, (ast.JoinedStr, ast.Raise, ast.Assert, ast.Import, ast.ImportFrom)):
        return
    if isinstance(node, ast.Call) and ast.unparse(node.func) in _SEEN_ONLY:
        return
    if isinstance(node, ast.keyword) and node.arg in _GUARDS:
        return
    for field, value in ast.iter_fields(node):
        if field not in {"annotation", "returns", "decorator_list", "bases"}:
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from _computing(child)


def _changed(node: Any, **fields: object) -> Any:
    other = copy.copy(node)
    for name, value in fields.items():
        setattr(other, name, value)
    return other


def _mistakes(node: ast.AST, alike: frozenset[str]) -> Iterator[tuple[str, Any, ast.AST]]:
    """The kind of a mistake, what it is made in, and what stands there then."""
    match node:
        case ast.Compare(ops=[*ops]):
            for index, each in enumerate(ops):
                bound = 1 if any(map(_has_tolerance, [node.left, *node.comparators][index : index + 2])) else 0
                for other in _COMPARISONS[type(each)][bound:]:
                    yield "comparison", node, _changed(node, ops=[*ops[:index], other(), *ops[index + 1 :]])
        case ast.BinOp(left, ast.MatMult(), right):
            yield "arithmetic", node, _changed(node, left=right, right=left)
        case ast.BinOp(left, op, right) if type(op) in _ARITHMETIC and _is_number(left) and _is_number(right):
            yield "arithmetic", node, _changed(node, op=_ARITHMETIC[type(op)]())
        case ast.AugAssign(_, op, value) if type(op) in _ARITHMETIC and _is_number(value):
            yield "arithmetic", node, _changed(node, op=_ARITHMETIC[type(op)]())
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            yield "sign or not removed", node, operand
        case ast.BoolOp(op):
            yield "and, or", node, _changed(node, op=ast.Or() if isinstance(op, ast.And) else ast.And())
        case ast.Constant(bool(value)):
            yield "constant", node, ast.Constant(not value)
        case ast.Constant(int(value) | float(value)):
            yield "constant", node, ast.Constant(value + 1 if abs(value) < 10 else value * 2)
        case ast.Call(func, [first, second], []) if ast.unparse(func).rpartition(".")[2] in alike:
            yield "arguments swapped", node, _changed(node, args=[second, first])
        case ast.If(test) | ast.While(test) | ast.IfExp(test) if not isinstance(test, (ast.Compare, ast.UnaryOp)):
            yield "condition negated", test, ast.UnaryOp(ast.Not(), test)
        case ast.comprehension(ifs=tests):
            for test in tests:
                if not isinstance(test, (ast.Compare, ast.UnaryOp)):
                    yield "condition negated", test, ast.UnaryOp(ast.Not(), test)
    match node:
        case ast.Expr(ast.Call(ast.Name(name))) if name in _SEEN_ONLY:
            return
        case (
            ast.Assign(targets=[ast.Attribute() | ast.Subscript()])
            | ast.Expr(ast.Call())
            | (ast.AugAssign() | ast.Raise() | ast.Continue() | ast.Break() | ast.Delete())
        ):
            yield "statement removed", node, ast.Pass()


def _is_number(node: ast.expr) -> bool:
    return not isinstance(node, _NO_NUMBERS) and not (isinstance(node, ast.Constant) and isinstance(node.value, str))


def _has_tolerance(node: ast.expr) -> bool:
    """Whether there is a fraction in it, or a product with a constant by name."""
    for each in ast.walk(node):
        if isinstance(each, ast.Constant) and isinstance(each.value, float) and not each.value.is_integer():
            return True
        if isinstance(each, ast.BinOp) and any(
            isinstance(one, ast.Name) and one.id.isupper() for one in (each.left, each.right)
        ):
            return True
    return False
