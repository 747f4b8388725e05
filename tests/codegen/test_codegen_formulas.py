"""Inside the room: expressions, and the order of elimination. What no exported file shows."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from cell_functions import CELLS, function_of

from repctl_pin.extensions.runtime.codegen import cell_function, expressions


def test_expressions_simplify_and_write_what_they_mean() -> None:
    graph = expressions.Graph()
    x, y, one, zero = (
        graph.input("x"),
        graph.input("y"),
        graph.number(1.0 - 1e-16),
        graph.number(-1e-17),
    )
    assert (
        one * x is x
        and (zero * x).value == 0.0
        and x + zero is x
        and graph.negative(-x) is x
        and (x - x).value == 0.0
    )
    assert x * y is y * x and graph.function("cos", zero).value == 1.0
    three = graph.number(-3.0)
    sine = graph.function("sin", x)
    text = expressions.assignments(
        {"a": -(x * three) - (y - x) * y, "b": sine * (x + three) - sine}
    )
    given: dict[str, Any] = {"x": 0.7, "y": -1.3, "sin": np.sin}
    exec(re.sub(r" *(?:const double )?(\w+ = .*);", r"\1", text), given)
    assert given["a"] == pytest.approx(2.1 + 2.0 * -1.3) and given[
        "b"
    ] == pytest.approx(np.sin(0.7) * -3.3)
    assert (
        expressions.number(-0.0) == "0.0"
        and float(expressions.number(0.1 + 0.2)) == 0.1 + 0.2
    )


@pytest.mark.parametrize("name", CELLS)
def test_the_order_of_elimination_needs_no_exchanges(name: str) -> None:
    """In the middle, the pivots in this order are those of complete pivoting: they fall slowly."""
    chart = function_of(name).chart
    q, V = chart.coefficients[0, :, 0], chart.coefficients[0, :, 1:]
    A = np.concatenate([chart.cell.task.jacobian(q), V.T])
    rows, columns = cell_function.elimination_order(chart)
    assert sorted(rows) == sorted(columns) == list(range(len(A)))
    A = A[np.ix_(rows, columns)]
    for k in range(len(A)):
        assert np.abs(A[k:, k:]).max() == pytest.approx(abs(A[k, k]))
        A[k + 1 :] -= np.outer(A[k + 1 :, k] / A[k, k], A[k])
