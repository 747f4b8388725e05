"""A section over a cell as C: its potentials h(q), and its inverse kinematic function q = F(x; c)."""

from __future__ import annotations

import numpy as np

from ..section import InverseFunction
from ..section.chart import Chart
from .text import filled, pose, row, table, whole


def section_potentials(chart: Chart, name: str, number: int) -> str:
    """Write ``h(q) = n_ref(u)ᵀ (q − q_ref(u))`` and its gradient as a C function, and the tables that it reads.

    Parameters
    ----------
    chart
        q_ref and n_ref.
    name, number
        What all names begin with, and the function's own number.
    """
    kind = chart.cell.task.kind
    rates = f"rates_{kind if kind in ('pose', 'axis') else 'position'}.c"
    return filled("section.c", name, {"number": number, "rates": filled(rates, name, {}), **_tables(chart)})


def function_code(function: InverseFunction, name: str) -> str:
    """Write F as a C function; its limits are infinite where it does not keep them."""
    task = function.task
    lower, upper = (task.lower, task.upper) if function.keep_limits else (np.full(task.n, s * np.inf) for s in (-1, 1))
    return filled("function.c", name, {"lower": row(lower), "upper": row(upper), **_tables(function.chart)})


def _tables(chart: Chart) -> dict[str, object]:
    cell, monomials = chart.cell, chart.monomials
    return {
        "k": cell.k,
        "count": monomials.size,
        "middle": pose(cell.placement),
        "widths": row(cell.widths),
        "moved": whole(np.flatnonzero(cell.widths)),
        "parents": whole(monomials.parent),
        "factors": whole(monomials.variable),
        "weights": table(chart.coefficients.reshape(monomials.size, -1)),
    }
