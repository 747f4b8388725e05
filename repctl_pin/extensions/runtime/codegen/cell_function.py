"""C code of cell functions q = F(x; c): one version for a single pose, one for a batch of poses.

The batch version evaluates several poses at a time, one per lane of the vector unit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ....arguments import Array
from ....model.task import Task
from ...cells.chart import Chart
from ...cells.function import InverseFunction
from ...cells.sector import Sector
from .kinematics import ChainExpressions
from .potentials import cell_tables
from .text import filled, row, table

LANES = 8
"""Number of poses (lanes) that the batch version evaluates at a time."""


def function_code(function: InverseFunction, name: str) -> str:
    """Write the C code of an inverse kinematic function F."""
    task, chart = function.task, function.chart
    removed = chart.cell.removed if isinstance(chart.cell, Sector) else ()
    shifts = [
        f"    shift[{x.joint}] = {x.sign}.0 * y[{x.coordinate}];\n" for x in removed
    ]
    limits = {
        "lower": row(task.lower),
        "upper": row(task.upper),
        "keep": int(function.keep_limits),
    }
    parts = limits | {"lanes": LANES, "turned": "".join(shifts), **cell_tables(chart)}
    lanes = [_lanes(chart, name, count) for count in (1, LANES)]
    return "".join(
        [
            filled("nearest.c", name, {}),
            _polynomials(chart, name),
            *lanes,
            filled("function.c", name, parts),
        ]
    )


def _lanes(chart: Chart, name: str, lanes: int) -> str:
    """Write the C code of Newton's method at ``lanes`` poses, which starts from the polynomials."""
    task = chart.cell.task
    chain = ChainExpressions(task, lanes=True)
    rows, columns = elimination_order(chart)
    row_of, column_of = np.argsort(rows).tolist(), np.argsort(columns).tolist()
    angle, here, whole = chain.lane_code(row_of, column_of)
    parts = {
        "lanes": lanes,
        "angles": len(chain.angles) + len(chain.angles) % 2 or 2,
        "angle": angle,
        "placement": here,
        "whole": whole,
        "labels": _labels(task, row_of, column_of),
        "keep": "2e-5" if lanes == 1 else "0.0",
        "counters": "i, j, k" if lanes > 1 else "i",
        "factors": _factors(task.n, lanes, _filled(chain, row_of, column_of)),
        "error": _errors(task, row_of),
        "solution": _solution(task.n),
        "steps": _steps(column_of, lanes),
    }
    return filled("lanes.c", name, parts)


def elimination_order(chart: Chart) -> tuple[list[int], list[int]]:
    """Order rows and columns of J_V by complete pivoting in the middle of the cell.

    Returns the indices of the rows, and of the columns, in their new order, in which the C code
    eliminates without pivoting.
    """
    q, V = chart.coefficients[0, :, 0], chart.coefficients[0, :, 1:]
    A = np.concatenate([chart.cell.task.jacobian(q), V.T])
    n = len(A)
    rows, columns = list(range(n)), list(range(n))
    for k in range(n):
        i, j = np.unravel_index(int(np.argmax(np.abs(A[k:, k:]))), (n - k, n - k))
        for order, B, at in ((rows, A, k + int(i)), (columns, A.T, k + int(j))):
            order[k], order[at] = order[at], order[k]
            B[[k, at]] = B[[at, k]]
        if A[k, k] == 0.0:
            break
        A[k + 1 :] -= np.outer(A[k + 1 :, k] / A[k, k], A[k])
    return rows, columns


def _polynomials(chart: Chart, name: str) -> str:
    """Write the C function that evaluates q_ref and n_ref at u, and its tables of coefficients.

    Entries whose polynomials have one degree share a loop, which compilers vectorise: its length is
    even. The polynomials of n_ref mostly have a lower degree than those of q_ref.
    """
    k, exponents = chart.cell.k, chart.monomials.exponents
    weights = chart.coefficients.reshape(len(exponents), -1)
    at = {tuple(powers): i for i, powers in enumerate(exponents.tolist())}
    degrees = [int(exponents[w != 0].sum(axis=1).max(initial=0)) for w in weights.T]
    tables, lines = "", [f"const double u{j} = u[{j}];" for j in range(k)]
    for degree in sorted(set(degrees)):
        group = [i for i, d in enumerate(degrees) if d == degree]
        order, terms, total = _horner(k, degree)
        size, rows = len(group) + len(group) % 2, [at[powers] for powers in order]
        values = np.pad(weights[np.ix_(rows, group)], ((0, 0), (0, size - len(group))))
        array = f"{name}_chart_{degree}"
        tables += f"static const double {array}[{len(rows)}][{size}] = {{\n{table(values)}}};\n"
        sums = ", ".join(f"s{j}" for j in range(k - 1))
        lines += [
            "{",
            f"    const double (*w)[{size}] = {array};",
            f"    double sum[{size}];",
            f"    for (i = 0; i < {size}; i++) {{",
            *([f"        double {sums};"] if sums else []),
            *(f"        {term}" for term in terms),
            f"        sum[i] = {total};",
            "    }",
            *(f"    both[{entry}][0] = sum[{j}];" for j, entry in enumerate(group)),
            "}",
        ]
    return filled("chart.c", name, {"tables": tables, "k": k, "sums": _lines(lines)})


def _horner(
    variables: int, degree: int
) -> tuple[list[tuple[int, ...]], list[str], str]:
    """Write a polynomial of several variables in C by Horner's rule, one variable inside another.

    Returns the powers of its monomials in the order of their coefficients ``w[0][i]``, ``w[1][i]``,
    …; the C statements; and the C expression of the polynomial after them.
    """
    order: list[tuple[int, ...]] = []
    lines: list[str] = []

    def inner(powers: tuple[int, ...]) -> str:
        """Write the factor of u_0^α_0 u_1^α_1 …, a polynomial of the remaining variables."""
        j, highest, total = len(powers), degree - sum(powers), ""
        for power in range(highest, -1, -1):
            if j + 1 < variables:
                term = inner((*powers, power))
                before = f"s{j} * u{j} + " if power < highest else ""
                lines.append(f"s{j} = {before}{term};")
                total = f"s{j}"
            else:
                order.append((*powers, power))
                term = f"w[{len(order) - 1}][i]"
                total = f"({total} * u{j} + {term})" if total else term
        return total

    total = inner(())
    return order, lines, total


def _labels(task: Task, row_of: Sequence[int], column_of: Sequence[int]) -> str:
    """Write the C lines that fill the last r rows of J_V, in the array A, with n_refᵀ."""
    return _lines(
        (
            f"A[{row_of[task.m + j]}][{column_of[i]}][l] = both[{(1 + task.r) * i + 1 + j}][l];"
            for j in range(task.r)
            for i in range(task.n)
        ),
        4,
    )


def _errors(task: Task, row_of: Sequence[int]) -> str:
    """Write the C lines that fill b, the right-hand side of the linear system of a Newton step.

    Its entries are the task error, from f(q) to the target, and the error c − h(q) of the level. In
    the task error, sines stand for the angles: for a pose, half of the skew part of R* Rᵀ, with R*
    of the target and R of the frame; for an axis, its sines about the tool's x and y. They vanish
    with the rotation error. ``cosine_left`` gets the sign of the cosine of the rotation error.
    """
    g, h = ([f"{what}[{i}][l]" for i in range(12)] for what in ("goal", "here"))
    e = [f"{g[axis]} - {h[axis]}" for axis in task.rows if axis < 3]
    lines = []

    def dot(a: Iterable[str], b: Iterable[str]) -> str:
        return " + ".join(f"{x} * {y}" for x, y in zip(a, b, strict=True))

    if task.kind == "pose":
        G, R = ([x[3 + 3 * i : 6 + 3 * i] for i in range(3)] for x in (g, h))
        e += [
            f"0.5 * ({dot(G[k], R[j])} - ({dot(G[j], R[k])}))"
            for j, k in ((1, 2), (2, 0), (0, 1))
        ]
        lines = [
            f"cosine_left = {' + '.join(dot(G[i], R[i]) for i in range(3))} - 1.0;"
        ]
    elif task.kind == "axis":
        aim = [g[5], g[8], g[11]]
        x, y, z = ([h[3 + k], h[6 + k], h[9 + k]] for k in range(3))
        e += [f"-({dot(y, aim)})", dot(x, aim)]
        lines = [f"cosine_left = {dot(z, aim)};"]
    for j in range(task.r):
        terms = (
            f"both[{at + 1 + j}][l] * (both[{at}][l] - x[{i}][l])"
            for i, at in enumerate(range(0, (1 + task.r) * task.n, 1 + task.r))
        )
        e.append(f"level[{j}][l] + {' + '.join(terms)}")
    return _lines(
        [*lines, *(f"b[{row}][l] = {x};" for row, x in zip(row_of, e, strict=True))], 3
    )


def _filled(
    chain: ChainExpressions, row_of: Sequence[int], column_of: Sequence[int]
) -> Array:
    """Find the entries of J_V, in the order of elimination, that are not always 0: (n, n)."""
    filled = np.ones((len(row_of), len(column_of)), bool)
    for a, entries in enumerate(chain.J):
        for i, entry in enumerate(entries):
            filled[row_of[a], column_of[i]] = (
                entry.kind != "number" or entry.value != 0.0
            )
    return filled


def _factors(n: int, lanes: int, filled: Array) -> str:
    """Write the C lines of the LU factorisation of J_V, in the array A, without pivoting.

    The diagonal of A then holds 1 / U. For one pose, the loops are unrolled, without the entries
    that are always 0.
    """
    small = "if (!(fabs({0}) > 1e-6)) state[l] = -1.0;"
    if lanes > 1:
        each = f"for (l = 0; l < {lanes}; l++)"
        return _lines(
            [
                f"for (k = 0; k < {n}; k++) {{",
                f"    {each} {small.format('A[k][k][l]')}",
                f"    {each} A[k][k][l] = 1.0 / A[k][k][l];",
                f"    for (i = k + 1; i < {n}; i++) {{",
                f"        {each} A[i][k][l] *= A[k][k][l];",
                f"        for (j = k + 1; j < {n}; j++)",
                f"            {each} A[i][j][l] -= A[i][k][l] * A[k][j][l];",
                "    }",
                "}",
            ],
            3,
        )
    lines = []
    for k in range(n):
        lines += [
            small.format(f"A[{k}][{k}][l]"),
            f"A[{k}][{k}][l] = 1.0 / A[{k}][{k}][l];",
        ]
        across = [j for j in range(k + 1, n) if filled[k, j]]
        for i in (i for i in range(k + 1, n) if filled[i, k]):
            filled[i, across] = True
            lines.append(f"A[{i}][{k}][l] *= A[{k}][{k}][l];")
            lines += [
                f"A[{i}][{j}][l] -= A[{i}][{k}][l] * A[{k}][{j}][l];" for j in across
            ]
    return _lines(["l = 0;", *lines], 3)


def _solution(n: int) -> str:
    """Write the C lines that solve for the Newton step, in b, with the LU factors in A."""
    lines = [
        f"b[{i}][l] -= {' + '.join(f'A[{i}][{k}][l] * b[{k}][l]' for k in range(i))};"
        for i in range(1, n)
    ]
    for i in reversed(range(n)):
        terms = "".join(
            f" - A[{i}][{k}][l] * b[{k}][l]" for k in reversed(range(i + 1, n))
        )
        lines.append(f"b[{i}][l] = (b[{i}][l]{terms}) * A[{i}][{i}][l];")
    return _lines(lines, 3)


def _steps(column_of: Sequence[int], lanes: int) -> str:
    """Write the C lines that add the Newton step to the joints, and find its largest entry.

    Where several poses are solved at once, those that are solved already stay as they are.
    """
    lines = []
    for i, k in enumerate(column_of):
        step = f"b[{k}][l]" if lanes == 1 else f"state[l] == 0.0 ? b[{k}][l] : 0.0"
        lines.append(f"x[{i}][l] += {step};")
        lines.append(f"most = fabs(b[{k}][l]) > most ? fabs(b[{k}][l]) : most;")
    return _lines(lines, 3)


def _lines(lines: Iterable[str], depth: int = 1) -> str:
    return "\n".join("    " * depth + line for line in lines)


def native_files(inverse: object, region: object) -> tuple[list[str], list[str]]:
    """Return the headers and sources of native/ that the potentials or the region need."""
    return [], []
