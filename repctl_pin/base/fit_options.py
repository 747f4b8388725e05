"""Options of a fit: nodes, random seed and stopping.

Nodes are the configurations at which a fit evaluates its cost. Held-out nodes are others, at which
the result is evaluated.
"""

from __future__ import annotations

from dataclasses import dataclass

from .arguments import as_int, freeze, positive, require_type
from .errors import InputError

_MOST_RESTARTS = 1000


@dataclass(frozen=True)
class FitOptions:
    """Options of a fit, for :func:`nearest_repeatable` and :func:`nearest_inverse_function`.

    Attributes
    ----------
    samples : int, optional
        Number of nodes of the fit. By default :func:`nearest_repeatable` takes the larger of 16384
        and 32 U / m, for U unknown coefficients and m task coordinates.
        :func:`nearest_inverse_function` takes the smallest power of 2 that is at least 256, and at
        least 3 times the number of polynomial terms.
    held_out : int, optional
        Number of held-out nodes; by default 16384, and 8192 for a cell.
    seed : int
        Random seed of the fit nodes and of the held-out nodes; for a cell, of the search for a
        start configuration, too.
    restarts : int
        Number of additional descents, each from randomly changed start coefficients; the best
        descent is used. Only :func:`nearest_repeatable` uses ``restarts`` and ``tolerance``.
    tolerance : float
        The optimiser stops when a step is predicted to lower the cost by at most this fraction, or
        when three steps in a row change the cost by at most this fraction each.

    Raises
    ------
    InputError
        If a number is out of its range; the message names the option.

    Examples
    --------
    >>> options = rp.FitOptions(samples=512, held_out=512, seed=1)
    >>> box = rp.Box(q0, 0.4)
    >>> rp.nearest_repeatable(control, None, box, degree=1, options=options).seed
    1
    """

    samples: int | None = None
    held_out: int | None = None
    seed: int = 0
    restarts: int = 0
    tolerance: float = 1e-5

    def __post_init__(self) -> None:
        for name in ("samples", "held_out"):
            if getattr(self, name) is not None:
                freeze(self, **{name: as_int(getattr(self, name), name, 1)})
        freeze(
            self,
            seed=as_int(self.seed, "seed"),
            restarts=as_int(self.restarts, "restarts", 0, _MOST_RESTARTS),
            tolerance=positive(self.tolerance, "the tolerance"),
        )

    def require_only(self, names: tuple[str, ...], by: str) -> None:
        """Raise InputError if an option other than ``names`` differs from its default.

        ``by`` is the name of the function that uses only these options, for the message.
        """
        defaults = vars(FitOptions())
        for name, value in vars(self).items():
            if name not in names and value != defaults[name]:
                raise InputError(f"{by} has no option {name}; omit {name}= from FitOptions")


def fit_options(given: FitOptions | None) -> FitOptions:
    """Check the given options of a fit; return the defaults for None.

    InputError is raised for another type, such as a dictionary.
    """
    if given is None:
        return FitOptions()
    return require_type(
        given, FitOptions, "options", "rp.FitOptions, such as rp.FitOptions(seed=1)"
    )
