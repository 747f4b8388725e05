"""Certificate of a design or of a cell's function: the bounds that were proved."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .arguments import Array, read_only
from .errors import InputError, printable

_THEOREM = 4
"""Version of the theorem of docs/theory.md, "Proved, not sampled"."""

CELL_THEOREM = 5
"""Version for a cell. Up to 4 it bounded σ_min(Nᵀ n̂_ref), which is no leaf margin: it is larger."""


@dataclass(frozen=True, eq=False)
@read_only
class Proof:
    """Lower bounds that are proved over a whole region or cell, or the box that prevented a proof.

    ``bool(proof)`` is :attr:`proved`. A proof belongs to one design: to its chain, limits, region
    or cell, potentials and coefficients. A design that is not the one drops it with a warning.

    Attributes
    ----------
    what : str
        Description of the design or the cell's function.
    proved : bool
        True if everything that was asked for is proved.
    leaf_margin : float
        Lower bound of the leaf margin over the whole region or cell; 0 if none was found.
    limit_margin : float
        Lower bound of every joint's distance to its limits, rad or m; infinite without limits, −∞
        if none was found. Joints of :attr:`excepted` are left out.
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
        Version of the theorem (:data:`_THEOREM`) that was used.
    excepted : tuple of str
        Joints left out of the limit margin: their limits end the range of a sector's angle or spin
        that is ``"all"``, so they come as near to them as that range goes.
    subject : str
        Fingerprint of all that is proved: ``design.subject`` of the design.
    seal : str
        Fingerprint of the subject and all bounds. A proof that was changed in part is refused.

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
    theorem: int = _THEOREM
    excepted: tuple[str, ...] = ()
    subject: str = ""
    seal: str = ""

    def __post_init__(self) -> None:
        for name in ("worst", "half"):
            array = np.array(getattr(self, name), float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "excepted", tuple(map(str, self.excepted)))
        if self.seal and self.seal != self._fingerprint():
            raise InputError(
                "a proof cannot be changed in part: its bounds hold together; "
                "prove again with rp.prove"
            )

    def __bool__(self) -> bool:
        return self.proved

    @property
    def extra_speed_direction(self) -> float:
        """Upper bound of the extra joint speed over J⁺, for any ẋ: ``‖G ẋ‖ / ‖J⁺ ẋ‖ − 1``.

        It is ``1 / leaf_margin − 1``, since ``‖G J‖₂ = ‖I − G J‖₂`` is the inverse of the leaf
        margin; infinite if no leaf margin is proved.
        """
        return 1 / self.leaf_margin - 1 if self.leaf_margin > 0 else np.inf

    def sealed(self, subject: str) -> Proof:
        """Bind the proof to what it proves, by its fingerprint; from then on it is unchangeable."""
        bound = replace(self, subject=subject, seal="")
        return replace(bound, seal=bound._fingerprint())

    def _fingerprint(self) -> str:
        names = [name for name in self.__dataclass_fields__ if name != "seal"]
        return fingerprint(*(getattr(self, name) for name in names))

    def summary(self) -> str:
        """Describe in a few lines what is proved."""
        state = "proved" if self.proved else "NOT proved"
        place = ", ".join(f"{v:.4g}" for v in np.round(self.worst, 4) + 0.0)
        wide = (
            f"{self.half.min():.2g} to {self.half.max():.2g}" if len(self.half) else "0"
        )
        lines = [
            f"{state}: {self.what}",
            f"  leaf margin   {self._leaf_words}{_asked(self.asked_leaf_margin)}",
            f"  limit margin  {self._limit_words}{_asked(self.asked_limit_margin)}",
            f"  extra speed   {self.extra_speed_words}",
            f"  σ_min(J)      {self._words(self.sigma_min)}",
            f"  boxes         {self.boxes} (theorem {self.theorem})",
            f"  least at      ({place}), in a box of half-widths {wide}",
        ]
        return "\n".join(lines + [f"  ended early   {self.reason}"] * bool(self.reason))

    def __repr__(self) -> str:
        state = "proved" if self.proved else "not proved"
        leaf = f"leaf margin {self._leaf_words}"
        return f"<Proof: {state}, {leaf}, limit margin {self._limit_words}>"

    @property
    def extra_speed_words(self) -> str:
        """Text of the bound of the extra joint speed, in per cent, rounded up."""
        if not np.isfinite(self.extra_speed_direction):
            return "no bound"
        percent = np.ceil(1e4 * self.extra_speed_direction) / 100
        return f"< {percent:g} % over J⁺ at every pose, in the worst direction"

    @property
    def _leaf_words(self) -> str:
        return self._words(self.leaf_margin)

    @property
    def _limit_words(self) -> str:
        """Text of the bound of the limit margin, with the joints that it leaves out."""
        words = (
            "no bound"
            if self.limit_margin == -np.inf
            else self._above(self.limit_margin)
        )
        return (
            f"{words} (without {', '.join(self.excepted)})" if self.excepted else words
        )

    def _words(self, value: float) -> str:
        """Write a bound of a quantity that is never negative: 0 states nothing of it."""
        return self._above(value) if self.proved or value > 0 else "no bound"

    @staticmethod
    def _above(value: float) -> str:
        return f"> {_below(value)}"


def own_proof(
    proof: Proof | None, subject: Callable[[], str], theorem: int = 0
) -> Proof | None:
    """Return a proof of the subject; None, with a warning, if it proves something else.

    ``subject`` computes the fingerprint of what the proof shall prove, and ``theorem`` is the
    lowest version of the theorem that bounds the same quantities.
    """
    if proof is None:
        return None
    if not proof.seal:
        why = "it has no fingerprint of what it proves"
    elif proof.theorem < theorem:
        why = (
            f"its theorem {proof.theorem} bounds another quantity than the leaf margin, "
            "a larger one"
        )
    elif proof.subject != subject():
        why = "its fingerprint is that of another design, arm or region"
    else:
        return proof
    warnings.warn(
        f"the certificate “{proof.what}” was dropped: {why}; prove again with rp.prove or "
        "repctl check --prove",
        UserWarning,
        stacklevel=6,
    )
    return None


def fingerprint(*parts: Any) -> str:
    """Hash nested plain data: numbers exactly, texts, arrays and sequences of them.

    Numbers that are equal give the same hash, whether they are integers, floats or 0 and −0.
    """
    digest = hashlib.sha256()
    for piece in _pieces(parts):
        digest.update(piece.encode("utf-8", "surrogatepass") + b"\0")
    return digest.hexdigest()


def _pieces(part: Any) -> Iterator[str]:
    """Yield the texts that describe a part, in order; brackets keep sequences apart."""
    if isinstance(part, (np.ndarray, np.generic)):
        part = part.tolist()
    if isinstance(part, (list, tuple)):
        yield "["
        for one in part:
            yield from _pieces(one)
        yield "]"
    elif isinstance(part, (int, float)) and not isinstance(part, bool):
        yield repr(float(part) + 0.0)
    else:
        yield f'"{printable(part)}' if isinstance(part, str) else repr(part)


def _below(value: float) -> str:
    """Format a lower bound with three digits, rounded down."""
    if not np.isfinite(value) or value == 0:
        return f"{value:g}"
    step = 10.0 ** (np.floor(np.log10(abs(value))) - 2)
    return f"{np.floor(value / step) * step:.3g}"


def proved_words(proof: Proof | None) -> str:
    """Write whether a leaf margin is proved, with its bound, or only found by a search."""
    return f"proved > {_below(proof.leaf_margin)}" if proof else "found, not proved"


def _asked(value: float | None) -> str:
    return "" if value is None else f" (asked: {value:g})"
