"""Tables for the Taylor models of taylor.h: products of monomials, and a rotation per axis.

A Taylor model is a polynomial of degree 3 in k variables that approximates a function on a box,
with a bound on the error. Its monomials are those of :class:`.Monomials`, in that order.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...base.arguments import Array
from ...native import SPACE, filled_struct

ORDER = 3
"""Degree of the models."""


def space_of(k: int) -> Any:
    """Create the C struct SPACE: the table with which C multiplies Taylor models in k variables.

    The table has one row per pair of monomials whose product has a degree of at most 3: the indices
    of both factors. Rows are sorted by the index of the product, which is a monomial, too. The
    array ``first`` has the first row of each product, and ``starts`` the index of the first
    monomial of each degree. A copy of the struct does not keep its arrays alive, so keep the
    original.
    """
    from ..cells.chart.monomials import Monomials  # a study has no need of it

    monomials = Monomials(k, ORDER)
    at = {tuple(row): i for i, row in enumerate(monomials.exponents)}
    rows = [
        (at[tuple(a + b)], i, j)
        for i, a in enumerate(monomials.exponents)
        for j, b in enumerate(monomials.exponents)
        if a.sum() + b.sum() <= ORDER
    ]
    made, left, right = np.array(sorted(rows)).T
    first = np.searchsorted(made, np.arange(monomials.size + 1))
    ints = {"left": left, "right": right, "first": first, "starts": monomials.starts}
    return filled_struct(SPACE, ints, {}, {"k": k, "M": monomials.size})[0]


def basis(axis: Array) -> Array:
    """Create a rotation matrix (3, 3) whose third column is the unit vector ``axis``."""
    if axis[2] ** 2 > 1 - 1e-30:
        return np.diag([1.0, np.sign(axis[2]), np.sign(axis[2])])
    other = np.eye(3)[np.argmin(np.abs(axis))]
    x = np.cross(other, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)
