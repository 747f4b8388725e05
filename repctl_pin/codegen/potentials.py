"""Potentials h(q), their gradients, and a cell's function q = F(x; c) as C: tables of numbers, and loops over them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arguments import Array
from ..errors import InputError
from ..fields.field import FieldMap
from ..fields.fourier import FourierMap
from ..fields.joined import PartialMap, SumMap
from ..fields.polynomial import PolynomialMap
from ..section import InverseFunction
from ..section.chart import Chart
from ..section.field import SectionField
from .expressions import number
from .text import filled, pose, row, table, whole

Powers = tuple[int, ...]
Written = PolynomialMap | FourierMap | SectionField


def field_functions(field: FieldMap, n: int, name: str) -> list[str]:
    """Write C functions ``name_potential_0``, …: each adds a part of h (r,) and of Vᵀ = ∂h/∂q (r, n) to what is there.

    Parameters
    ----------
    field
        Polynomials, Fourier series, and sums and parts of them; or a section over a cell.
    n
        Joints of the arm.
    name
        What all names begin with.

    Raises
    ------
    InputError
        If the potentials are user-defined functions, which cannot be written down.
    """
    written = []
    for index, (part, joints) in enumerate(_flat(field, list(range(n)))):
        common = {"number": index, "k": len(joints), "joints": whole(joints)}
        if isinstance(part, SectionField):
            file, parts = "section.c", _section(part.chart, name)
        elif isinstance(part, PolynomialMap):
            file, parts = "polynomial.c", _polynomial(part)
        else:
            file, parts = "fourier.c", _fourier(part)
        written.append(filled(file, name, common | parts))
    return written


def _flat(field: FieldMap, joints: Sequence[int]) -> list[tuple[Written, Sequence[int]]]:
    """Take sums and parts apart: plain potentials, each with the joints that it is a function of."""
    if isinstance(field, SumMap):
        return [found for part in field.maps for found in _flat(part, joints)]
    if isinstance(field, PartialMap):
        return _flat(field.part, [joints[int(v)] for v in field.variables])
    if isinstance(field, Written):
        return [(field, joints)]
    raise InputError(
        f"potentials of the kind {type(field).__name__} cannot be written as C, for they hold functions; polynomials, "
        "Fourier series and their sums can"
    )


def _polynomial(field: PolynomialMap) -> dict[str, object]:
    """Tabulate r polynomials of degree d, made homogeneous by a factor z_0 = 1.

    The derivatives ``w_i = ∂h/∂z_i`` are sums over monomials u^β of degree d − 1 at most, and by Euler's theorem
    ``h = Σ_i w_i z_i / d``: one table serves values and gradient.
    """
    d, k = field.degree, len(field.center)
    r = len(next(iter(field.terms.values())))
    shares: dict[Powers, Array] = {}  # what u^β counts for in w (r, k + 1)

    def add(beta: Powers, i: int, share: Array) -> None:
        if share.any():
            shares.setdefault(beta, np.zeros((r, k + 1)))[:, i] += share

    for beta, coefficient in field.terms.items():
        add(beta, 0, coefficient * (d - sum(beta)))
        for i in map(int, np.flatnonzero(beta)):
            add((*beta[:i], beta[i] - 1, *beta[i + 1 :]), i + 1, coefficient * beta[i] / field.scale[i])
    monomials, parents, factors = _monomials(shares, k)
    return {
        "degree": number(d),
        "count": len(monomials),
        "width": r * (k + 1),
        "center": row(field.center),
        "scale": row(1 / field.scale),
        "parents": whole(parents),
        "factors": whole(factors),
        "weights": table(shares.get(beta, np.zeros((r, k + 1))).ravel() for beta in monomials),
    }


def _monomials(wanted: dict[Powers, Array], k: int) -> tuple[list[Powers], list[int], list[int]]:
    """Order monomials so that each is an earlier one times a variable: their powers, that one, that variable."""
    needed = {(0,) * k}
    for beta in wanted:
        while any(beta):
            needed.add(beta)
            beta, _ = _lower(beta)
    order = sorted(needed, key=lambda beta: (sum(beta), tuple(-power for power in beta)))
    place = {beta: a for a, beta in enumerate(order)}
    made_of = [_lower(beta) for beta in order[1:]]
    return order, [0, *(place[beta] for beta, _ in made_of)], [0, *(i for _, i in made_of)]


def _lower(beta: Powers) -> tuple[Powers, int]:
    """Take one factor out of a monomial: what is left, and which variable it was."""
    last = max(i for i, power in enumerate(beta) if power)
    return (*beta[:last], beta[last] - 1, *beta[last + 1 :]), last


def _fourier(field: FourierMap) -> dict[str, object]:
    """Tabulate waves and coefficients; waves that no potential uses are left out."""
    used = ((field.sines != 0) | (field.cosines != 0)).any(axis=1)
    used[0] |= not used.any()
    weights = np.stack([field.sines[used], field.cosines[used]], axis=-1)  # (waves, r, 2)
    return {
        "count": len(weights),
        "waves": table(field.waves[used]),
        "weights": table(weights.reshape(len(weights), -1)),
    }


def _section(chart: Chart, name: str) -> dict[str, object]:
    """Tabulate ``h(q) = n_ref(u)ᵀ (q − q_ref(u))``, and write how u changes with q."""
    kind = chart.cell.task.kind
    return {"rates": filled(f"rates_{kind if kind in ('pose', 'axis') else 'position'}.c", name, {}), **_tables(chart)}


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
