"""Certificate of a design or of a cell's function: the bounds that were proved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arguments import Array, read_only

THEOREM = 4
"""Version of the theorem of docs/theory.md, "Proved, not sampled"."""


@dataclass(frozen=True, eq=False)
@read_only
class Proof:
    """Lower bounds that are proved over a whole region or cell, or the box that prevented a proof.

    ``bool(proof)`` is :attr:`proved`.

    Attributes
    ----------
    what : str
        Description of the design or the cell's function.
    proved : bool
        True if everything that was asked for is proved.
    leaf_margin : float
        Lower bound of the leaf margin over the whole region or cell; 0 if none was found.
    limit_margin : float
        Lower bound of every joint's distance to its limits, rad or m; infinite without limits.
    sigma_min : float
        Lower bound of the smallest singular value of J, in base axes, m and rad.
    boxes : int
        Number of boxes evaluated.
    worst, half : (n,) or (k,) arrays
        Centre and half-widths of the box that could not be decided; if all were decided, of the box
        with the smallest bound. In rad or m; for a cell, in its coordinates u.
    reason : str
        Reason for an early end of the proof, in words; empty without one.
    asked_leaf_margin, asked_limit_margin : float or None
        Bounds that were to be proved, the second in rad or m; None to find the largest bound that
        can be proved in the available time.
    theorem : int
        Version of the theorem (:data:`THEOREM`) that was used.

    Examples
    --------
    >>> proof = rp.prove(design, margin=0.5)
    >>> bool(proof), proof.leaf_margin >= 0.5
    (True, True)
    """

    what: str
    proved: bool
    leaf_margin: float
    limit_margin: float
    sigma_min: float
    boxes: int
    worst: Array
    half: Array
    reason: str
    asked_leaf_margin: float | None = None
    asked_limit_margin: float | None = None
    theorem: int = THEOREM

    def __post_init__(self) -> None:
        for name in ("worst", "half"):
            array = np.array(getattr(self, name), float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __bool__(self) -> bool:
        return self.proved

    def summary(self) -> str:
        """Describe in a few lines what is proved."""
        state = "proved" if self.proved else "NOT proved"
        place = ", ".join(f"{v:.4g}" for v in np.round(self.worst, 4) + 0.0)
        wide = (
            f"{self.half.min():.2g} to {self.half.max():.2g}" if len(self.half) else "0"
        )
        lines = [
            f"{state}: {self.what}",
            f"  leaf margin   > {below(self.leaf_margin)}{_asked(self.asked_leaf_margin)}",
            f"  limit margin  > {below(self.limit_margin)}{_asked(self.asked_limit_margin)}",
            f"  σ_min(J)      > {below(self.sigma_min)}",
            f"  boxes         {self.boxes} (theorem {self.theorem})",
            f"  least at      ({place}), in a box of half-widths {wide}",
        ]
        return "\n".join(lines + [f"  ended early   {self.reason}"] * bool(self.reason))

    def __repr__(self) -> str:
        state = "proved" if self.proved else "not proved"
        leaf = f"leaf margin > {below(self.leaf_margin)}"
        return f"<Proof: {state}, {leaf}, limit margin > {below(self.limit_margin)}>"


def below(value: float) -> str:
    """Format a lower bound with three digits, rounded down."""
    if not np.isfinite(value) or value == 0:
        return f"{value:g}"
    step = 10.0 ** (np.floor(np.log10(abs(value))) - 2)
    return f"{np.floor(value / step) * step:.3g}"


def proved_words(proof: Proof | None) -> str:
    """Write whether a leaf margin is proved, with its bound, or only found by a search."""
    return f"proved > {below(proof.leaf_margin)}" if proof else "found, not proved"


def _asked(value: float | None) -> str:
    return "" if value is None else f" (asked: {value:g})"
