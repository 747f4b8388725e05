"""Certificate of a design or of a cell's function: the bounds that were proved.

A design is a controller for a region Ω of joint space; a cell is a box of poses covered by one
function from poses to configurations. The controller holds potentials h(q) constant. Their values c
are the levels; a leaf is a set h(q) = c, on which the arm then stays. The leaf margin σ_min(Nᵀ V̂)
is the distance from an algorithmic singularity, at which the controller fails; N spans the null
space of J, and V̂ the gradients of h. G is the matrix of the controller, q̇ = G ẋ, and J⁺ the
pseudoinverse of J. Samples cannot exclude a singularity between them. A proof divides Ω into boxes,
and bounds the margins over each whole box. A tube is a region Ω around a motion: all configurations
near it.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arguments import Array, as_matrices, freeze, read_only
from .errors import InputError, printable

_THEOREM = 4
"""Version of the theorem of docs/theory.md, "Proved, not sampled"."""

CELL_THEOREM = 5
"""Theorem version of a cell. Versions up to 4 bound σ_min(Nᵀ n̂_ref), above the leaf margin."""

CHECKED_BEFORE = 100
"""Value of :attr:`ClosingRadius.checked` in older files, which do not contain it."""

_LEAST_RADIUS = 1e-3
"""Smallest closing radius, m, that is reported; a smaller one counts as none."""

SAME_LEAF = 1e-6
"""Maximum difference of two levels h(q) = c that count as equal."""

_SAME_ANGLE = 1e-7
"""Maximum rotation error, rad, of a commanded pose that counts as one of constant orientation."""


@dataclass(frozen=True, eq=False)
@read_only
class ClosingRadius:
    """Distance from a start pose, or from a path, within which motions on closed paths close.

    A path closes if its motion ends in the configuration it began in. A radius around a start is
    for closed paths whose poses are all within :attr:`metres` **and** :attr:`radians` of the start
    pose. Each such path closes, however long it is, if the arm first moves from the start pose to
    the path along a straight line. The motion then stays in Ω, the region of joint space that was
    proved.

    A radius around a path, here called the central path, is for closed paths whose pose at each
    moment is within :attr:`metres` and :attr:`radians` of the central path's pose at the same
    moment. They close if the central path closes. If :attr:`checked` is 0, the central path is
    proved to close; else it was followed, and closing was checked at that many points. Where the
    central path crosses itself, paths that switch to its other branch are not covered.

    ``bool(radius)`` tells whether a radius of at least 1 mm is proved.

    Attributes
    ----------
    metres : float
        Maximum distance of the positions, m.
    radians : float or None
        Maximum angle of the rotations, rad; for an axis task, of the tool axis. 0 for paths of
        constant orientation, None for a task without orientation.
    around : str
        What the radius is around: ``"start"``, the start pose, or ``"path"``.
    kind : str
        Kind of task, such as ``pose``; of several frames, joined by ``" + "``.
    start : (n,) array
        Start configuration, rad or m; the radius is valid on the leaf through it.
    positions, rotations : (K, 3) and (K, 3, 3) arrays
        Positions, m, and rotation matrices of the frame, in the base frame: at the start pose
        (K = 1), or at K poses along the path. With F frames: (K, 3 F) and (K, 3 F, 3), those of the
        first frame first.
    boxes : int
        Number of boxes of the region that were bounded.
    complete : bool
        False if the processor time ran out before every box was decided, unless a requested radius
        was proved by then. If False, more time can prove a larger radius.
    reason : str
        Why the radius is not larger.
    checked : int
        Number of points of the path, if closing of the path itself was checked and not proved. 0 if
        it is proved, or if the radius is around a start.
    leaf : float
        Maximum change of each level h(q) from its value at :attr:`start`. If above 0, the proof
        also covers motions that change the levels, and so move the elbow: if the pose and the
        levels at the end are those at the beginning, so is the configuration.

    Examples
    --------
    >>> closes = rp.prove(design).closes
    >>> closes.metres > 0.05
    True
    >>> closes.contains(design.task.placement(closes.start))
    True
    """

    metres: float
    radians: float | None
    around: str
    kind: str
    start: Array
    positions: Array
    rotations: Array
    boxes: int
    complete: bool
    reason: str
    checked: int = 0
    leaf: float = 0.0

    def __post_init__(self) -> None:
        for name in ("start", "positions", "rotations"):
            freeze(self, **{name: np.array(getattr(self, name), float)})
        if self.around == "start":
            freeze(self, checked=0)

    def __bool__(self) -> bool:
        return self.metres >= _LEAST_RADIUS

    def __repr__(self) -> str:
        return f"<ClosingRadius: {self.words}>"

    def contains(self, placement: Any) -> bool:
        """Test whether a pose of the frame is within the radius of the start or of a path's pose.

        For a radius around a path, True means that the pose is near any of the K poses of the path,
        at whatever moment. A path through a pose outside may close, too, but this is not proved.
        The radius is valid only on the leaf h(q) = c of :attr:`start`, or at levels that differ by
        at most :attr:`leaf` from those at the start. The pose alone does not show the levels; see
        :meth:`RepeatableInverse.same_leaf`.

        Parameters
        ----------
        placement : pinocchio.SE3 or (4, 4) array
            Placement of the frame in the base frame, m, such as ``task.placement(q)``; for several
            frames, a list of one per frame, such as ``task.placements(q)``.

        Raises
        ------
        InputError
            If ``placement`` is not a placement, or not a list of one per frame.
        """
        kinds = self.kind.split(" + ")
        several = isinstance(placement, tuple) or len(kinds) > 1
        if several and not isinstance(placement, (tuple, list, np.ndarray)):
            raise InputError(
                f"must be {len(kinds)} placements, one per frame", argument="placement"
            )
        given = list(placement) if several else [placement]
        if len(given) != len(kinds):
            raise InputError(
                f"must be {len(kinds)} placements, one per frame, not {len(given)}",
                argument="placement",
            )
        near = np.ones(len(self.positions), bool)
        for f, (kind, each) in enumerate(zip(kinds, given, strict=True)):
            T = getattr(each, "homogeneous", each)
            (T,) = as_matrices(("the placement", T, "4 4"), exact=True)
            near &= self._near(kind, T, slice(3 * f, 3 * f + 3))
        return bool(near.any())

    def _near(self, kind: str, T: Array, frame: slice) -> NDArray[np.bool_]:
        """Test, for K poses of one frame, whether a placement T is within the radius: (K,) bool.

        The K poses are those of :attr:`positions` and :attr:`rotations`; ``frame`` selects the
        frame's entries along the second axis of both. T (4, 4) is in the base frame, m. ``kind`` is
        the kind of the frame's task: only coordinates that the task controls are compared.
        """
        away = T[:3, 3] - self.positions[:, frame]
        if len(kind) == 2:
            away = away[:, ["xyz".index(c) for c in kind]]
        near = (away**2).sum(axis=1) <= self.metres**2
        if self.radians is None or kind not in ("pose", "axis"):
            return np.asarray(near)
        turned = T[:3, :3] - self.rotations[:, frame]
        if kind == "axis":
            chord = (turned[:, :, 2] ** 2).sum(axis=1)
        else:
            chord = (turned**2).sum(axis=(1, 2)) / 2
        return np.asarray(near & (chord <= self.squared_chord))

    @property
    def squared_chord(self) -> float:
        """Squared chord ``(2 sin(α/2))²`` of the angle α = :attr:`radians`; 0 without orientation.

        Two orientations R and R₀ are at most α apart if ``‖R − R₀‖²_F / 2`` is at most this number,
        and two tool axes z and z₀ if ``‖z − z₀‖²`` is. The number is computed for α + 1e-7 rad, at
        most π, so that rounding errors do not exclude a pose at the radius.
        """
        if self.radians is None:
            return 0.0
        return float(4 * np.sin(min(self.radians + _SAME_ANGLE, np.pi) / 2) ** 2)

    @property
    def path_proved(self) -> bool:
        """True if the radius is around a path, and this path is proved to close."""
        return self.around == "path" and not self.checked

    @property
    def words(self) -> str:
        """Proved statement as text: ``closed paths within 6 cm and 11° of the start close``.

        The summary of a proof and exported code quote it. Below 1 mm, it states why nothing is
        proved.
        """
        if not self:
            return f"no closing radius above 1 mm is proved: {self.reason}"
        paths = "closed paths of constant orientation" if self.radians == 0 else "closed paths"
        where = "path at each moment" if self.around == "path" else self.around
        if self.leaf:
            paths = f"{paths} of hand and elbow"
            where = f"{where} and {below(self.leaf)} of its levels"
        said = f"{paths} within {self.size} of the {where} close"
        if self.around == "start" or self.path_proved:
            return said
        return f"{said}, if the path itself closes (checked at {self.checked} points)"

    @property
    def size(self) -> str:
        """The radius with two digits, rounded down: ``6.4 cm and 11°``."""
        size = length_below(self.metres)
        if self.radians:
            size += f" and {below(np.degrees(self.radians), 2)}°"
        return size


def beyond(closes: ClosingRadius, inverse: Any, q: Array) -> bool:
    """Test whether the configuration q (n,) is outside a proved closing radius.

    The result is True if the levels h(q) differ from those of the start by more than the radius
    allows, or if the pose at q is outside the radius; closed paths are then not proved to close.
    ``inverse`` is the repeatable inverse that was proved. A control loop calls the function at each
    step.
    """
    off = np.abs(inverse.leaf(q) - inverse.leaf(closes.start)).max()
    if not off <= max(closes.leaf, SAME_LEAF):
        return True
    return not closes.contains(inverse.task.placements(q))


@dataclass(frozen=True, eq=False)
@read_only
class Proof:
    """Lower bounds that are proved over a whole region or cell, or the box that prevented a proof.

    ``bool(proof)`` is :attr:`proved`. A proof belongs to one design: to its chain, limits, region
    or cell, potentials and coefficients. Any other design drops the proof, with a warning.

    Attributes
    ----------
    what : str
        Description of the design or of the cell's function, the first line of the summary.
    proved : bool
        True if everything that was requested is proved.
    leaf_margin : float
        Lower bound of the leaf margin over the whole region or cell; 0 if none was found.
    limit_margin : float
        Lower bound of every joint's distance to its limits, rad or m; infinite without limits, −∞
        if none was found. Joints of :attr:`excepted` are left out.
    sigma_min : float
        Lower bound of the smallest singular value of J, the Jacobian of the task in base axes, m
        and rad; 0 if none was found.
    boxes : int
        Number of boxes that were bounded.
    worst, half : (n,) or (k,) arrays
        Centre and half-widths of the box at which the proof failed; otherwise, of the box with the
        smallest bound of the leaf margin. In rad or m; for a cell, in its k coordinates u, from −1
        to 1.
    reason : str
        Reason for an early end of the proof, in words; empty without one.
    asked_leaf_margin, asked_limit_margin : float or None
        Bounds that were to be proved, the second in rad or m; None to find the largest bound that
        can be proved in the available time.
    theorem : int
        Version of the theorem with which the bounds were proved. docs/theory.md has it, under
        "Proved, not sampled".
    excepted : tuple of str
        Names of the joints that are left out of the limit margin. Each moves the frame along an
        angle of the cell with the range ``"all"``, which ends only at the limits of this joint.
    closes : ClosingRadius, optional
        Distance from the start, or the path, within which closed paths end in the configuration
        they began in. None if it was not requested, or for a tube without a path.
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
    closes: ClosingRadius | None = None
    subject: str = ""
    seal: str = ""

    def __post_init__(self) -> None:
        for name in ("worst", "half"):
            freeze(self, **{name: np.array(getattr(self, name), float)})
        freeze(self, excepted=tuple(map(str, self.excepted)))
        if self.seal and self.seal != self._fingerprint():
            raise InputError(
                "a proof cannot be changed in part: its bounds hold only together; "
                "prove again with rp.prove"
            )

    def __bool__(self) -> bool:
        return self.proved

    @property
    def extra_speed_direction(self) -> float:
        """Upper bound of the extra joint speed over J⁺, for any ẋ: ``‖G ẋ‖ / ‖J⁺ ẋ‖ − 1``.

        The bound is ``1 / leaf_margin − 1``, since ``‖G J‖₂ = ‖I − G J‖₂`` is the inverse of the
        leaf margin. It is infinite if no leaf margin is proved.
        """
        return 1 / self.leaf_margin - 1 if self.leaf_margin > 0 else np.inf

    def sealed(self, subject: str) -> Proof:
        """Return a copy of the proof that is bound to one design and protected against changes.

        ``subject`` is the fingerprint, a hash, of the design. The copy also has a seal, a hash of
        all its values. With both, a proof of another design and a changed proof are refused.
        """
        bound = replace(self, subject=subject, seal="")
        return replace(bound, seal=bound._fingerprint())

    def _fingerprint(self) -> str:
        """Compute the fingerprint of all fields but the seal; any change of a field alters it."""
        names = [n for n in self.__dataclass_fields__ if n not in ("seal", "closes")]
        own = [getattr(self, name) for name in names]
        if self.closes is not None:
            inner = [n for n in self.closes.__dataclass_fields__ if n not in ("checked", "leaf")]
            own.append([getattr(self.closes, name) for name in inner])
            # files of older versions keep their fingerprint
            own += [self.closes.checked] * (self.closes.checked not in (0, CHECKED_BEFORE))
            own += ["the path closes"] * self.closes.path_proved
            own += ["hand and elbow", self.closes.leaf] * (self.closes.leaf > 0)
        return fingerprint(*own)

    def summary(self) -> str:
        """Describe in a few lines what is proved.

        The bounds are those of the leaf margin, the joint-limit margin, σ_min(J) and the extra
        joint speed.
        """
        state = "proved" if self.proved else "NOT proved"
        place = ", ".join(f"{v:.4g}" for v in np.round(self.worst, 4) + 0.0)
        wide = f"{self.half.min():.2g} to {self.half.max():.2g}" if len(self.half) else "0"
        lines = [
            f"{state}: {self.what}",
            f"  leaf margin   {self._leaf_words}{_asked(self.asked_leaf_margin)}",
            f"  limit margin  {self._limit_words}{_asked(self.asked_limit_margin)}",
            f"  extra speed   {self.extra_speed_words}",
            f"  σ_min(J)      {self._words(self.sigma_min)}",
            *([] if self.closes is None else [f"  closing       {self.closes.words}"]),
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
        """Text of the bound of the extra joint speed, such as ``< 5 % over J⁺ at every pose …``.

        It is rounded up. The extra joint speed compares the controller with J⁺, the inverse of
        minimum joint speed. Without a bound, the text is ``no bound``.
        """
        if not np.isfinite(self.extra_speed_direction):
            return "no bound"
        percent = np.ceil(1e4 * self.extra_speed_direction) / 100
        return f"< {percent:g} % over J⁺ at every pose, in every direction"

    @property
    def _leaf_words(self) -> str:
        return self._words(self.leaf_margin)

    @property
    def _limit_words(self) -> str:
        """Text of the bound of the limit margin: ``> 0.05 (without joint1)`` or ``no bound``.

        The joints in brackets are left out of the margin, see :attr:`excepted`.
        """
        words = "no bound" if self.limit_margin == -np.inf else self._above(self.limit_margin)
        return f"{words} (without {', '.join(self.excepted)})" if self.excepted else words

    def _words(self, value: float) -> str:
        """Format a bound of a quantity that is never negative, such as ``> 0.12``.

        If the proof failed, a bound of 0 states nothing, and the text is ``no bound``.
        """
        return self._above(value) if self.proved or value > 0 else "no bound"

    @staticmethod
    def _above(value: float) -> str:
        return f"> {below(value)}"


def own_proof(proof: Proof | None, subject: Callable[[], str], theorem: int = 0) -> Proof | None:
    """Return the proof if it is of the given subject; else warn, and return None.

    So a changed design never shows the proof of another one. ``subject`` computes the fingerprint
    of the design, and ``theorem`` is the lowest version of the theorem that is accepted. If
    ``proof`` is None, the result is None without a warning.
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
    """Hash nested plain data to a text: numbers, texts, None, arrays, and sequences of these.

    Equal numbers give the same hash: 1 and 1.0 do, and so do 0 and −0.
    """
    pieces: list[str] = []
    _describe(parts, pieces)
    text = "".join(f"{piece}\0" for piece in pieces)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _describe(part: Any, pieces: list[str]) -> None:
    """Append to ``pieces`` the texts that describe a part of a fingerprint, in order.

    A part is a number, a text, None, an array, or a sequence of parts. An array or a sequence gives
    ``[``, the texts of its entries, and ``]``. Equal numbers of different types give the same text.
    """
    if isinstance(part, np.ndarray) and part.ndim and part.dtype == float:
        _describe_numbers((part + 0.0).tolist(), part.ndim, pieces)
    elif isinstance(part, (np.ndarray, np.generic)):
        _describe(part.tolist(), pieces)
    elif isinstance(part, (list, tuple)):
        pieces.append("[")
        for one in part:
            _describe(one, pieces)
        pieces.append("]")
    elif isinstance(part, (int, float)) and not isinstance(part, bool):
        pieces.append(repr(float(part) + 0.0))
    else:
        pieces.append(f'"{printable(part)}' if isinstance(part, str) else repr(part))


def _describe_numbers(numbers: list[Any], depth: int, pieces: list[str]) -> None:
    """Append to ``pieces`` the texts that describe nested lists of floats, ``depth`` levels deep.

    The texts are the numbers, as ``repr`` writes them, and brackets around each list.
    """
    pieces.append("[")
    if depth == 1:
        pieces += map(repr, numbers)
    else:
        for row in numbers:
            _describe_numbers(row, depth - 1, pieces)
    pieces.append("]")


def below(value: float, digits: int = 3) -> str:
    """Format a lower bound with ``digits`` significant digits, rounded down."""
    if not np.isfinite(value) or value == 0:
        return f"{value:g}"
    step = 10.0 ** (np.floor(np.log10(abs(value))) - digits + 1)
    return f"{np.floor(value / step) * step:.{digits}g}"


def length_below(value: float) -> str:
    """Format a length, m, with two digits, rounded down, in m, cm or mm, such as ``6.4 cm``."""
    for unit, size in (("m", 1.0), ("cm", 1e-2)):
        if value >= size:
            return f"{below(value / size, 2)} {unit}"
    return f"{below(value / 1e-3, 2)} mm"


def degrees_below(angle: float, digits: int = 0) -> str:
    """Format an angle, rad, in degrees, rounded down to ``digits`` decimals, such as ``302``."""
    scale = 10**digits
    return f"{np.floor(scale * np.degrees(angle) + 1e-6) / scale:g}"


def proved_words(proof: Proof | None) -> str:
    """State whether a leaf margin is proved, with its bound, or only found by a search.

    If the proof reached all that was requested, the text has the bound: ``proved > 0.12``.
    Otherwise, or without a proof (None), it is ``found, not proved``: the design's leaf margin is
    then the smallest that a search found, and a smaller one may exist.
    """
    return f"proved > {below(proof.leaf_margin)}" if proof else "found, not proved"


def _asked(value: float | None) -> str:
    return "" if value is None else f" (asked: {value:g})"
