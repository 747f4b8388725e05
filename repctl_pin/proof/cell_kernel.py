"""Bounds over boxes of poses in C: cell_bounds.c, compiled together with leaf_margin_bounds.c."""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Mapping, Sequence
from importlib.resources import files
from itertools import combinations_with_replacement, permutations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import Array
from ..c_library import NoCompilerError, loaded_library
from .cell_bounds import CellBounds
from .leaf_margin_bounds import Bounds, _Problem


class _Cell(ctypes.Structure):
    """The struct Cell of cell_bounds.c."""

    _fields_ = (
        [("chain", ctypes.c_void_p)]
        + [
            (name, ctypes.c_int)
            for name in ("k", "w", "terms", "places", "terms1", "terms2", "terms3")
        ]
        + [(name, ctypes.c_double) for name in ("tool", "columns")]
        + [
            (name, ctypes.c_void_p)
            for name in (
                *("parent", "variable", "pair", "triple", "on", "C", "C1", "C2", "C3", "M4"),
                *("widths", "p0", "R0", "near", "blur", "lower", "upper", "only"),
                *("n_size", "beta_size", "n1_size"),
            )
        ]
    )


class _Out(ctypes.Structure):
    """The struct Out of cell_bounds.c."""

    _fields_ = [
        (name, ctypes.c_void_p)
        for name in (
            *("leaf", "center", "sigma", "limit", "center_limit", "Q", "reach"),
            *("split", "found"),
        )
    ]


_loaded: list[ctypes.CDLL | None] = []


def library() -> ctypes.CDLL | None:
    """Compile the kernel once; without a compiler, return None and warn once."""
    if not _loaded:
        folder = files(__package__)
        names = ("leaf_margin_bounds.c", "cell_bounds.c")
        source = "\n".join(folder.joinpath(name).read_text(encoding="ascii") for name in names)
        try:
            _loaded.append(ctypes.CDLL(loaded_library(source)))
        except (NoCompilerError, OSError) as error:
            warnings.warn(
                f"proofs of cells run in NumPy, many times slower: {error}",
                UserWarning,
                stacklevel=4,
            )
            _loaded.append(None)
    return _loaded[0]


class Kernel:
    """A cell's numbers in the memory of the C kernel."""

    def __init__(self, proof: Any, library: ctypes.CDLL) -> None:
        self._run = library.cell_bounds
        chain, n = proof.chain, proof.chain.n
        row, column = np.nonzero(chain.S)
        ints = {
            "revolute": chain.revolute,
            "level": chain.level,
            "first": np.searchsorted(row, np.arange(len(chain.S) + 1)),
            "column": column,
        }
        reals = {name: getattr(chain, name) for name in ("R", "p", "a", "shift", "reach", "o")}
        self._chain = _filled(
            _Problem,
            ints,
            reals | {"S": chain.S[row, column]},
            {"P": len(chain.S), "k": chain.middle, "n": n, "N": chain.N, "r": chain.N - 6}
            | {"eps": proof.eps},
        )
        polynomials, cell = proof.polynomials, proof.cell
        chart, monomials, k = proof.chart, proof.chart.monomials, proof.cell.k
        w = n * (1 + chain.N - 6)
        pairs = list(combinations_with_replacement(range(k), 2))
        triples = list(combinations_with_replacement(range(k), 3))
        low = [int(monomials.starts[max(monomials.degree - order, 0) + 1]) for order in range(4)]
        C1, C2, C3 = (polynomials.coefficients[order] for order in (1, 2, 3))
        lower, upper, _ = proof.task.joint_limits
        most = polynomials.most
        self._cell = _filled(
            _Cell,
            {
                "parent": monomials.parent,
                "variable": monomials.variable,
                "pair": _table(pairs, k, 2),
                "triple": _table(triples, k, 3),
                "on": proof.on,
            },
            {
                "C": chart.coefficients,
                "C1": C1[:, : low[1]],
                "C2": np.array([C2[pair][: low[2]] for pair in pairs]),
                "C3": np.array([C3[triple][: low[3]] for triple in triples]),
                "M4": np.array([most[4][triple] for triple in triples]),
                "widths": cell.widths,
                "p0": cell.placement.translation,
                "R0": cell.placement.rotation,
                "near": proof.near,
                "blur": proof.blur,
                "lower": lower,
                "upper": upper,
                "only": proof.commutator,
                "n_size": proof.sizes[0],
                "beta_size": proof.sizes[1],
                "n1_size": proof.sizes[2],
            },
            {"k": k, "w": w, "terms": monomials.size, "places": proof.places}
            | {f"terms{order}": low[order] for order in (1, 2, 3)}
            | {"tool": proof.tool, "columns": float(np.abs(chain.S).sum(axis=0).max())}
            | {"chain": ctypes.addressof(self._chain[0])},
        )

    def bounds(self, Uc: Array, half: Array) -> tuple[CellBounds, Array, Array]:
        """Bound the margins of F over boxes; and give its centre and its half-widths (K, n)
        each."""
        K, n = len(Uc), self._chain[0].n
        leaf, center, sigma, limit, center_limit = np.zeros((5, K))
        Q, reach = np.full((2, K, n), np.nan)
        split, found = np.zeros((2, K), np.int32)
        arrays = (leaf, center, sigma, limit, center_limit, Q, reach, split, found)
        out = _Out(*(array.ctypes.data for array in arrays))
        Uc, half = np.ascontiguousarray(Uc, float), np.ascontiguousarray(half, float)
        self._run(
            ctypes.byref(self._cell[0]),
            ctypes.c_long(K),
            ctypes.c_void_p(Uc.ctypes.data),
            ctypes.c_void_p(half.ctypes.data),
            ctypes.byref(out),
        )
        bounds = CellBounds(Bounds(leaf, center, sigma, split), limit, center_limit, found > 0)
        return bounds, Q, reach


def _table(rows: Sequence[tuple[int, ...]], k: int, order: int) -> NDArray[np.int32]:
    """Number the derivatives of an order, the same for all orders of differentiation."""
    table = np.zeros((k,) * order, np.int32)
    for number, row in enumerate(rows):
        for one in permutations(row):
            table[one] = number
    return table


def _filled(
    struct: type[ctypes.Structure],
    ints: Mapping[str, ArrayLike],
    reals: Mapping[str, ArrayLike],
    scalars: Mapping[str, float],
) -> tuple[Any, list[NDArray[np.generic]]]:
    """Fill a struct with pointers to arrays, which are kept beside it."""
    held: dict[str, NDArray[np.generic]] = {}
    held |= {name: np.ascontiguousarray(values, np.int32) for name, values in ints.items()}
    held |= {name: np.ascontiguousarray(values, float) for name, values in reals.items()}
    pointers = {name: values.ctypes.data for name, values in held.items()}
    return struct(**scalars, **pointers), list(held.values())
