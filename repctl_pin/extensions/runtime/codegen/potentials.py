"""C code of potentials h(q) and their gradients, by tables and loops."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....arguments import Array
from ....errors import InputError
from ....potentials.basis import Potentials
from ....potentials.fourier import FourierMap
from ....potentials.maps import PartialMap, SumMap
from ....potentials.polynomial import PolynomialMap
from ...cells.cell import EDGE, TURNED
from ...cells.cell_potentials import CellPotentials
from ...cells.chart import Chart
from ...cells.sector import Sector
from ...cells.symmetry import Symmetry
from .text import filled, integer, number, pose, row, table

_Powers = tuple[int, ...]
_Written = PolynomialMap | FourierMap | CellPotentials


def potential_functions(potentials: Potentials, n: int, name: str) -> list[str]:
    """Write the C functions ``name_potential_0``, …, which evaluate h (r,) and Vᵀ = ∂h/∂q (r, n).

    Each function adds one term of a sum of potentials to h and to Vᵀ.

    Parameters
    ----------
    potentials
        Polynomials, Fourier series, and sums and parts of them; or the potentials of a cell
        function.
    n
        Number of joints.
    name
        Prefix of all names.

    Raises
    ------
    InputError
        If the potentials are user-defined functions, which cannot be written as C.
    """
    written = []
    for index, (part, joints) in enumerate(_flat(potentials, list(range(n)))):
        common = {"number": index, "k": len(joints), "joints": integer(joints)}
        if isinstance(part, CellPotentials):
            file, parts = "cell.c", _cell(part.chart, name)
        elif isinstance(part, PolynomialMap):
            file, parts = "polynomial.c", _polynomial(part)
        else:
            file, parts = "fourier.c", _fourier(part)
        written.append(filled(file, name, common | parts))
    return written


def _flat(
    potentials: Potentials, joints: Sequence[int]
) -> list[tuple[_Written, Sequence[int]]]:
    """Split sums of potentials into their terms, each with the joints that it depends on."""
    if isinstance(potentials, SumMap):
        return [found for part in potentials.maps for found in _flat(part, joints)]
    if isinstance(potentials, PartialMap):
        return _flat(potentials.part, [joints[int(v)] for v in potentials.variables])
    if isinstance(potentials, _Written):
        return [(potentials, joints)]
    raise InputError(
        f"potentials of type {type(potentials).__name__} cannot be written as C, "
        "because they contain Python functions; use polynomials, Fourier series or their sums"
    )


def _polynomial(potentials: PolynomialMap) -> dict[str, object]:
    """Write the tables of r polynomials of degree d for the template ``polynomial.c``.

    With a factor z_0 = 1, h is homogeneous in ``z = (1, q − center)``. Its derivatives ``w_i =
    ∂h/∂z_i`` are sums over monomials u^β of degree at most d − 1, with ``u = (q − center) /
    scale``. By Euler's theorem ``h = Σ_i w_i z_i / d``, so one table serves values and gradient.
    """
    d, k = potentials.degree, len(potentials.center)
    r = len(next(iter(potentials.terms.values())))
    shares: dict[_Powers, Array] = {}  # weights of u^β in w (r, k + 1)

    def add(beta: _Powers, i: int, share: Array) -> None:
        if share.any():
            shares.setdefault(beta, np.zeros((r, k + 1)))[:, i] += share

    for beta, coefficient in potentials.terms.items():
        add(beta, 0, coefficient * (d - sum(beta)))
        for i in map(int, np.flatnonzero(beta)):
            add(
                (*beta[:i], beta[i] - 1, *beta[i + 1 :]),
                i + 1,
                coefficient * beta[i] / potentials.scale[i],
            )
    monomials, parents, factors = _monomials(shares, k)
    return {
        "degree": number(d),
        "count": len(monomials),
        "width": r * (k + 1),
        "center": row(potentials.center),
        "scale": row(1 / potentials.scale),
        "parents": integer(parents),
        "factors": integer(factors),
        "weights": table(
            shares.get(beta, np.zeros((r, k + 1))).ravel() for beta in monomials
        ),
    }


def _monomials(
    expected: dict[_Powers, Array], k: int
) -> tuple[list[_Powers], list[int], list[int]]:
    """Order monomials so that each is an earlier one (its parent) times a variable.

    Monomials of k variables that are needed as parents are added to the ``expected`` ones. Returns
    for each monomial its powers, the index of its parent, and the index of the variable.
    """
    needed = {(0,) * k}
    for beta in expected:
        while any(beta):
            needed.add(beta)
            beta, _ = _lower(beta)
    order = sorted(
        needed, key=lambda beta: (sum(beta), tuple(-power for power in beta))
    )
    place = {beta: a for a, beta in enumerate(order)}
    made_of = [_lower(beta) for beta in order[1:]]
    return (
        order,
        [0, *(place[beta] for beta, _ in made_of)],
        [0, *(i for _, i in made_of)],
    )


def _lower(beta: _Powers) -> tuple[_Powers, int]:
    """Divide a monomial by its last variable: the remaining powers, and the variable's index."""
    last = max(i for i, power in enumerate(beta) if power)
    return (*beta[:last], beta[last] - 1, *beta[last + 1 :]), last


def _fourier(potentials: FourierMap) -> dict[str, object]:
    """Write the tables of a Fourier series for the template ``fourier.c``: waves and coefficients.

    Waves whose coefficients are all 0 are left out.
    """
    used = ((potentials.sines != 0) | (potentials.cosines != 0)).any(axis=1)
    used[0] |= not used.any()
    weights = np.stack(
        [potentials.sines[used], potentials.cosines[used]], axis=-1
    )  # (waves, r, 2)
    return {
        "count": len(weights),
        "waves": table(potentials.waves[used]),
        "weights": table(weights.reshape(len(weights), -1)),
    }


def _cell(chart: Chart, name: str) -> dict[str, object]:
    """Write the tables of ``h(q) = n_ref(u)ᵀ (q − q_ref(u))`` for the template ``cell.c``.

    They include the C code that computes u and its rate.
    """
    cell, tables = chart.cell, cell_tables(chart)
    if isinstance(cell, Sector):
        return tables | {
            "coordinates": _sector(cell, name, tables),
            "rates": "",
            "shift": "".join(_unwound(one, cell.task.r) for one in cell.removed),
            "along": "".join(_slope(one, cell.task.r) for one in cell.removed),
        }
    kind = cell.task.kind if cell.task.kind in ("pose", "axis") else "position"
    return tables | {
        "coordinates": filled("box.c", name, tables),
        "rates": filled(f"rates_{kind}.c", name, {}),
        "shift": "",
        "along": "",
    }


_ANGULAR = {
    "pose": "    for (i = 0; i < 3; i++)\n"
    "        d[3 + i] = R[3 * i] * g[0] + R[3 * i + 1] * g[1] + R[3 * i + 2] * g[2];\n",
    "axis": "    d[3] = g[0];\n    d[4] = g[1];\n",
}
"""C lines that write the angular entries of a gradient d from g, by the kind of the task."""

_TILTS = (
    "    {0}_cell_tilts(pose->R, radius > 0.0 ? x[0] / radius : 1.0,\n"
    "                   radius > 0.0 ? x[1] / radius : 0.0, all + 3);\n"
)
"""C call that computes the tilts and the spin, from the cosine and the sine of the angle."""

_NEAR_MIDDLE = "    all[5] -= {1} * rint((all[5] - ({0})) / {1});\n"
"""C line that makes the spin differ from its middle by at most half a turn."""


def _sector(cell: Sector, name: str, tables: dict[str, object]) -> str:
    """Write the C functions of a sector's coordinates, with its axis, middle and bounds."""
    bounds = np.where(cell.widths == 0, TURNED, cell.widths * (1 + EDGE))
    bounds[list(cell.free)] = np.inf
    places = min(3, cell.task.m)
    parts = {
        "origin": row(cell.axis[0]),
        "basis": row(cell.directions.ravel()),
        "turn": row((cell.directions @ cell.placement.rotation).ravel()),
        "at": row(cell.middle),
        "bounds": row(bounds),
        "places": places,
        "rows": integer(cell.task.rows[:places]),
        "angular": _ANGULAR.get(cell.task.kind, ""),
        "functions": "",
        "tilts": "",
    }
    if cell.task.kind in ("pose", "axis"):
        parts["functions"] = filled("sector_tilts.c", name, {})
        near = _NEAR_MIDDLE.format(number(cell.spin_middle), number(2 * np.pi))
        parts["tilts"] = _TILTS.format(name) + near * bool(cell.spin_middle)
    return filled("sector.c", name, tables | parts)


def _unwound(one: Symmetry, r: int) -> str:
    """Write the C lines that shift q_ref of a symmetry's joint: by ± y, then by whole turns.

    The whole turns make q_ref the nearest to q.
    """
    q_ref, turn = f"both[{(1 + r) * one.joint}]", number(2 * np.pi)
    turns = f"rint((q[{one.joint}] - {q_ref}) / {turn})"
    shift = f"    {q_ref} += {one.sign}.0 * y[{one.coordinate}];\n"
    return f"{shift}    {q_ref} += {turn} * {turns};\n"


def _slope(one: Symmetry, r: int) -> str:
    """Write the C line that adds ∂h/∂y for the coordinate y that a symmetry removes from u.

    F is linear in y, so ∂h/∂y is ``−sign · n_ref`` at the symmetry's joint.
    """
    n = f"both[{(1 + r) * one.joint + 1} + j]"
    return f"        d[{one.coordinate}] -= {one.sign}.0 * {n};\n"


def cell_tables(chart: Chart) -> dict[str, object]:
    """Write the tables of a chart: the cell, the monomials, and the weights of q_ref and n_ref."""
    cell, monomials = chart.cell, chart.monomials
    return {
        "k": cell.k,
        "count": monomials.size,
        "middle": pose(cell.placement),
        "widths": row(cell.widths),
        "moved": integer(cell.moved),
        "scale": row(1 / cell.widths[cell.moved]),
        "parents": integer(monomials.parent),
        "factors": integer(monomials.variable),
        "weights": table(chart.coefficients.reshape(monomials.size, -1)),
    }
