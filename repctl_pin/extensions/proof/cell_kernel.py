"""Bounds on the margins of a cell's function F over boxes of poses; their kernel cell_bounds.c."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array, read_only
from ...native import CELL, MARGINS, PROBLEM, filled_struct
from ..cells.monomials import Monomials
from .chain import FREE
from .commutator import slides_of, tips
from .taylor import ORDER, space_of
from .taylor_chain import TURNED, basis


@dataclass(frozen=True, eq=False)
@read_only
class CellBounds:
    """Bounds on the margins of F over K boxes of poses.

    Attributes
    ----------
    leaf_margin, sigma_min, limit_margin : (K,) arrays
        Lower bounds on each box of the leaf margin ``σ_min(Nᵀ n̂_ref)``, of σ_min(J), and of the
        distance to the joint limits, rad or m; 0, 0 and −inf where F was not shown to exist.
    split : (K,) array of int
        Index of the coordinate along which to halve each box.
    """

    leaf_margin: Array
    sigma_min: Array
    limit_margin: Array
    split: NDArray[np.int32]


class Kernel:
    """The C kernel for one :class:`CellProof`, whose numbers it holds in C structs."""

    def __init__(self, proof: Any, native: ctypes.CDLL) -> None:
        self._run = native.cell_bounds
        self._run.restype = ctypes.c_int
        chain = proof.chain
        row, column = np.nonzero(chain.S)
        self._chain = filled_struct(
            PROBLEM,
            {
                "revolute": chain.revolute,
                "level": chain.level,
                "first": np.searchsorted(row, np.arange(len(chain.S) + 1)),
                "column": column,
            },
            {
                name: getattr(chain, name)
                for name in ("R", "p", "a", "shift", "reach", "o")
            }
            | {"S": chain.S[row, column]},
            {"P": len(chain.S), "k": chain.middle, "n": chain.n, "N": chain.N}
            | {"r": chain.N - 6, "eps": proof.eps},
        )
        poses, parts = proof.poses, proof.polynomials
        k, terms, kind = proof.cell.k, proof.chart.monomials.size, proof.task.kind
        slide = slides_of(chain, proof.farthest)
        monomials = Monomials(k, max(proof.chart.monomials.degree, ORDER))
        self._space = space_of(k)
        self._cell = filled_struct(
            CELL,
            {
                "parent": monomials.parent,
                "variable": monomials.variable,
                "used": parts.used,
                "fourth": [np.repeat(np.arange(k), row) for row in parts.fourth],
            },
            {
                "parts": np.moveaxis(parts.parts, 1, 0),
                "rest": parts.rest,
                "blur": proof.blur,
                "near": proof.near,
                "lower": proof.lower,
                "upper": proof.upper,
                "farthest": proof.farthest,
                "bases": [basis(axis) for axis in chain.a],
                "tips": tips(chain, slide),
            }
            | {name: getattr(poses, name) for name in type(poses).__dataclass_fields__},
            {"w": proof.blur.size, "terms": terms, "F": len(parts.fourth)}
            | {"turning": int(poses.Omega.any()), "angled": int(poses.angle.any())}
            | {"spun": int(poses.spin.any()), "tool": proof.tool}
            | {"turned": TURNED.get(kind, 3)}
            | {"slides": sum(1 << "xyz".index(axis) for axis in FREE[kind][0])}
            | {"columns": float(np.abs(chain.S).sum(axis=0).max())}
            | {"chain": ctypes.addressof(self._chain[0]), "space": self._space[0]},
        )

    def bounds(self, Uc: Array, half: Array) -> tuple[CellBounds, Array, Array]:
        """Bound the margins of F over boxes Uc ± half, (K, k) each.

        Returns the bounds, and the centres and the half-widths of boxes of joints that contain F,
        (K, n) each, as :meth:`CellProof.enclosed` does.
        """
        K, n = len(Uc), self._chain[0].n
        leaf, sigma, limit = np.zeros((3, K))
        Q, reach = np.full((2, K, n), np.nan)
        split = np.zeros(K, np.int32)
        arrays = (leaf, sigma, limit, Q, reach, split)
        out = MARGINS(*(array.ctypes.data for array in arrays))
        Uc, half = np.ascontiguousarray(Uc, float), np.ascontiguousarray(half, float)
        done = self._run(
            ctypes.byref(self._cell[0]),
            ctypes.c_long(K),
            ctypes.c_void_p(Uc.ctypes.data),
            ctypes.c_void_p(half.ctypes.data),
            ctypes.byref(out),
        )
        if not done:
            raise MemoryError("no memory for the Taylor models of a cell")
        return CellBounds(leaf, sigma, limit, split), Q, reach
