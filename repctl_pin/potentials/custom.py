"""User-defined potentials: plain functions of q.

A potential is a function of the configuration q. A repeatable controller keeps r potentials h(q)
constant, weighted sums of the N potentials of a basis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import Array, as_configurations, evaluated, list_of_names, require_type
from ..base.errors import InputError
from .basis import PotentialBasis

_Function = Callable[[Array], float]
_Gradient = Callable[[Array], ArrayLike]

_STEP = 1e-5
"""Step, rad or m, of the differences for a missing gradient; their error is about 1e-10 h."""


class CustomPotentials(PotentialBasis):
    """Basis of user-defined potentials h_1(q) … h_N(q).

    Parameters
    ----------
    functions : sequence
        Functions q (n,) → h, a number, or pairs of such a function and its gradient q → ∇h (n,). A
        missing gradient is computed by central differences; :attr:`numerical` and :attr:`names`
        show for which potentials.
    names : sequence of str, optional
        Names of the potentials; by default the functions' own names.

    Raises
    ------
    InputError
        If there is no function, or an entry is neither a function nor such a pair. Also at an
        evaluation, if a value or a gradient is not finite.

    Examples
    --------
    >>> functions = [lambda q: q[0] + q[1] ** 2, lambda q: np.sin(q[2])]
    >>> potentials = rp.CustomPotentials(functions, names=["a", "b"])
    >>> potentials.values(q0[None]).round(3)
    array([[0.94 , 0.717]])
    >>> potentials.numerical  # their gradients are differences
    (True, True)
    """

    def __init__(
        self,
        functions: Sequence[_Function | tuple[_Function, _Gradient]],
        *,
        names: Sequence[str] | None = None,
    ) -> None:
        require_type(
            functions, Sequence, "functions", "a list of functions q → h, or of pairs (h, gradient)"
        )
        pairs = [f if isinstance(f, tuple) else (f, None) for f in functions]
        if not pairs:
            raise InputError("CustomPotentials requires at least one function q → h")
        for i, pair in enumerate(pairs):
            if (
                len(pair) != 2
                or not callable(pair[0])
                or not (pair[1] is None or callable(pair[1]))
            ):
                raise InputError(
                    f"potential {i + 1} must be a function q → h, "
                    "or a pair of such a function and its gradient"
                )
        self._functions = [pair[0] for pair in pairs]
        self._gradients = [pair[1] for pair in pairs]
        given = () if names is None else list_of_names(names, "names", "one name per potential")
        if names is not None and len(given) != len(pairs):
            raise InputError(
                f"names= has {len(given)} names for {len(pairs)} potentials",
                remedy="give one name per potential",
            )
        own = [getattr(f, "__name__", "h") for f in self._functions]
        own = [f"h_{i + 1}" if name in ("<lambda>", "h") else name for i, name in enumerate(own)]
        self._names = given or tuple(own)

    @property
    def size(self) -> int:
        """N, the number of potentials."""
        return len(self._functions)

    @property
    def numerical(self) -> tuple[bool, ...]:
        """For each of the N potentials, True if its gradient is computed by differences.

        Differences are less accurate and slower than a given gradient.
        """
        return tuple(g is None for g in self._gradients)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each potential, with a note if its gradient is computed by differences."""
        return tuple(
            f"{name} (gradient by differences)" if numerical else name
            for name, numerical in zip(self._names, self.numerical, strict=True)
        )

    def values(self, Q: ArrayLike) -> Array:
        """Evaluate the N potentials of the basis at every row of Q (K, n): (K, N)."""
        Q = as_configurations(Q, None, "this basis")
        return np.array([[self._value(j, q) for j in range(self.size)] for q in Q]).reshape(
            len(Q), self.size
        )

    def gradients(self, Q: ArrayLike) -> Array:
        """Evaluate the gradients ∇h_j of the N potentials at Q (K, n): (K, n, N), per rad or m.

        Entry ``[k, i, j]`` is ∂h_j/∂q_i at row k.
        """
        Q = as_configurations(Q, None, "this basis")
        D = np.empty((*Q.shape, self.size))
        for k, q in enumerate(Q):
            for j in range(self.size):
                D[k, :, j] = self._gradient(j, q)
        return D

    def _value(self, j: int, q: Array) -> float:
        what = f"potential {self._names[j]}"
        return float(evaluated(self._functions[j], q, (), what))

    def _gradient(self, j: int, q: Array) -> Array:
        given = self._gradients[j]
        if given is not None:
            what = f"the gradient of potential {self._names[j]}"
            return evaluated(given, q, q.shape, what)
        differences = [
            self._value(j, q + d) - self._value(j, q - d) for d in _STEP * np.eye(len(q))
        ]
        return np.array(differences) / (2 * _STEP)

    def __str__(self) -> str:
        count = sum(self.numerical)
        how = f", {count} with gradients by differences" if count else ""
        return f"{super().__str__()} given as functions{how}"
