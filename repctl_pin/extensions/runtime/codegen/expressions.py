"""Symbolic expressions, simplified when created and written as straight-line C.

Equal expressions are one object, so that common subexpressions are computed once.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import reduce
from operator import attrgetter
from typing import Any

from .text import number

_SNAP = 1e-15
"""Tolerance within which constants are rounded to 0, 1 or −1, as for cosines of right angles in a
URDF."""


class Expression:
    """Number, input, sine, cosine, negative, sum or product, created by a :class:`Graph`."""

    __slots__ = ("graph", "kind", "order", "parts", "value")

    def __init__(
        self,
        graph: Graph,
        kind: str,
        parts: tuple[Expression, ...],
        value: float | str,
        order: int,
    ) -> None:
        self.graph, self.kind, self.parts, self.value, self.order = (
            graph,
            kind,
            parts,
            value,
            order,
        )

    def __add__(self, other: Expression) -> Expression:
        return self.graph.sum(self, other)

    def __sub__(self, other: Expression) -> Expression:
        return self.graph.sum(self, -other)

    def __neg__(self) -> Expression:
        return self.graph.negative(self)

    def __mul__(self, other: Expression) -> Expression:
        return self.graph.product(self, other)


class Graph:
    """Factory of expressions, in which equal expressions are one object."""

    def __init__(self) -> None:
        self._made: dict[tuple[Any, ...], Expression] = {}

    def number(self, value: float) -> Expression:
        """Create a constant, rounded to 0, 1 or −1 if it is within 1e-15 of it."""
        near = min((0.0, 1.0, -1.0), key=lambda known: abs(value - known))
        return self._make(
            "number", (), near if abs(value - near) <= _SNAP else float(value)
        )

    def input(self, text: str) -> Expression:
        """Create an input variable of the C code, such as ``q[0]``."""
        return self._make("input", (), text)

    def function(self, name: str, angle: Expression) -> Expression:
        """Create ``sin(angle)`` or ``cos(angle)``."""
        if angle.kind == "number":
            return self.number(getattr(math, name)(float(angle.value)))
        return self._make(name, (angle,), "")

    def negative(self, a: Expression) -> Expression:
        """Create ``−a``."""
        if a.kind == "number":
            return self.number(-float(a.value))
        if a.kind == "negative":
            return a.parts[0]
        return self._make("negative", (a,), "")

    def sum(self, a: Expression, b: Expression) -> Expression:
        """Create ``a + b``."""
        if a.kind == "number" and b.kind == "number":
            return self.number(float(a.value) + float(b.value))
        for one, other in ((a, b), (b, a)):
            if one.kind == "number" and one.value == 0.0:
                return other
        if self.negative(a) is b:
            return self.number(0.0)
        return self._make("sum", (a, b), "")

    def product(self, a: Expression, b: Expression) -> Expression:
        """Create ``a b``, with signs moved outward."""
        if a.kind == "number" and b.kind == "number":
            return self.number(float(a.value) * float(b.value))
        for one, other in ((a, b), (b, a)):
            if one.kind == "number" and one.value in (0.0, 1.0, -1.0):
                return {0.0: self.number(0.0), 1.0: other, -1.0: self.negative(other)}[
                    float(one.value)
                ]
            if one.kind == "number" and float(one.value) < 0:
                return self.negative(self.product(self.negative(one), other))
        if a.kind == "negative":
            return self.negative(self.product(a.parts[0], b))
        if b.kind == "negative":
            return self.negative(self.product(a, b.parts[0]))
        return self._make("product", tuple(sorted((a, b), key=attrgetter("order"))), "")

    def total(self, terms: Iterable[Expression]) -> Expression:
        """Create the sum of several terms."""
        return reduce(self.sum, terms, self.number(0.0))

    def _make(
        self, kind: str, parts: tuple[Expression, ...], value: float | str
    ) -> Expression:
        key = (kind, *map(id, parts), value)
        if key not in self._made:
            self._made[key] = Expression(self, kind, parts, value, len(self._made))
        return self._made[key]


def assignments(targets: dict[str, Expression], indent: str = "    ") -> str:
    """Write C assignments of expressions to targets, with constants for common subexpressions.

    Parameters
    ----------
    targets
        Expressions by the C variable that they are assigned to, such as ``J[0][1]``.
    """
    uses: dict[int, int] = {}
    order: list[Expression] = []

    def visit(expression: Expression) -> None:
        uses[id(expression)] = uses.get(id(expression), 0) + 1
        if uses[id(expression)] == 1:
            for part in expression.parts:
                visit(part)
            order.append(expression)

    for expression in targets.values():
        visit(expression)
    names: dict[int, str] = {}
    lines = []
    for expression in order:
        cheap = expression.kind in ("number", "input", "negative")
        if not cheap and (
            uses[id(expression)] > 1 or expression.kind in ("sin", "cos")
        ):
            text = _text(expression, names)
            names[id(expression)] = f"t{len(names)}"
            lines.append(f"{indent}const double {names[id(expression)]} = {text};")
    lines += [
        f"{indent}{target} = {_text(expression, names)};"
        for target, expression in targets.items()
    ]
    return "\n".join(lines)


def _text(expression: Expression, names: dict[int, str]) -> str:
    if id(expression) in names:
        return names[id(expression)]
    if expression.kind == "number":
        return number(float(expression.value))
    if expression.kind == "input":
        return str(expression.value)
    parts = [_text(part, names) for part in expression.parts]
    if expression.kind in ("sin", "cos"):
        return f"{expression.kind}({parts[0]})"
    if expression.kind == "product":
        return " * ".join(_factor(part, names) for part in expression.parts)
    if expression.kind == "negative":
        inner = expression.parts[0]
        return f"-{_text(inner, names) if inner.kind == 'product' else _factor(inner, names)}"
    a, b = parts
    return (
        f"{a} - {b[1:]}"
        if b.startswith("-") and _is_single(expression.parts[1], names)
        else f"{a} + {b}"
    )


def _factor(expression: Expression, names: dict[int, str]) -> str:
    """Write a factor of a product, or the operand of a minus, in parentheses if necessary."""
    text = _text(expression, names)
    bare = id(expression) in names or expression.kind in ("input", "sin", "cos")
    return (
        text
        if bare or (expression.kind == "number" and not text.startswith("-"))
        else f"({text})"
    )


def _is_single(expression: Expression, names: dict[int, str]) -> bool:
    """Test whether a minus at the beginning of an expression's text applies to all of it."""
    return expression.kind in ("number", "negative") and id(expression) not in names
