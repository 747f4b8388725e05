"""Potentials as the tables of arm.h, of which C evaluates h and V."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arguments import Array
from ..errors import InputError
from ..native import PART, filled_struct
from .maps import PartialMap, Potentials, SumMap
from .polynomial import PolynomialMap

_Powers = tuple[int, ...]

_POLYNOMIALS = 0
"""Kind of these potentials in arm.h."""


def native_parts(potentials: Potentials, n: int) -> list[Any]:
    """Create the structs :data:`PART` of the terms of a sum of potentials of n joints.

    Other potentials than polynomials have a method ``_native_part`` that creates theirs.

    Raises
    ------
    InputError
        If a term is a function in Python.
    """
    parts = []
    for part, joints in _terms(potentials, list(range(n))):
        if isinstance(part, PolynomialMap):
            parts.append(_polynomial(part, joints))
        elif hasattr(part, "_native_part"):
            parts.append(part._native_part(joints))
        else:
            raise InputError(
                f"potentials of type {type(part).__name__} cannot be written as C, because they "
                "contain Python functions; use polynomials, Fourier series or their sums"
            )
    return parts


def _terms(potentials: Any, joints: list[int]) -> list[tuple[Any, list[int]]]:
    """Split sums of potentials into their terms, each with the joints that it depends on."""
    if isinstance(potentials, SumMap):
        return [term for part in potentials.maps for term in _terms(part, joints)]
    if isinstance(potentials, PartialMap):
        return _terms(potentials.part, [joints[int(v)] for v in potentials.variables])
    return [(potentials, joints)]


def _polynomial(potentials: PolynomialMap, joints: Sequence[int]) -> Any:
    """Create the tables of r polynomials of degree d.

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
    weight = [shares.get(beta, np.zeros((r, k + 1))) for beta in monomials]
    return filled_struct(
        PART,
        {"joint": joints, "parent": parents, "factor": factors},
        {
            "center": potentials.center,
            "scale": 1 / potentials.scale,
            "weight": np.array(weight),
        },
        {"kind": _POLYNOMIALS, "k": k, "count": len(monomials), "degree": d},
    )[0]


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
