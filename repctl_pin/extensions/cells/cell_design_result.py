"""Result of designing an inverse function over a cell, a box of poses.

The result has the function q = F(x), its evaluation, maps over slices of the cell, and a problem
with a closed path through the cell. A sector is a cell in cylindrical coordinates: radius, angle
and height about an axis, two tilts of the tool, and its spin. A coordinate of a sector is symmetric
if a single joint moves the frame along it. u are the coordinates of a pose in the cell, from −1 to
1. A chart consists of polynomials in u: q_ref approximates a configuration at the pose, n_ref the
null space of J there. s is the position along the self-motion of the pose, measured from q_ref. The
controller of the function holds s constant; a leaf is the set of configurations with one value of
s. G_d is the desired inverse, such as J⁺. Extra joint speed is the joint speed relative to that of
G_d, minus 1. Held-out poses are poses that the fit did not use. Letters: n joints, r components of
s, k coordinates u.

``Chart`` is coordinates (u, s) of configurations: u gives the pose, the label s (r,) the position
along its self-motion. ``FailureReason`` is one reason why a function fails at some poses of its
cell: cause, share of the poses, worst pose. ``Evaluation`` is the figures of a function over a
cell: its cost, joint speeds and margins. ``Slice`` is a map of a function's limit margin and joint
speed over two coordinates of its cell. ``ClosedPath`` is a closed path as a function of s, which
goes from 0 to 1 in a cycle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import combinations
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import Array, ratio_in_percent, read_only, unwritable
from ...base.certificate import CELL_THEOREM, Proof, fingerprint, own_proof, proved_words
from ...design.proof_fingerprint import rounded, task_parts
from ...model.bodies import bodies_of
from ...model.task import Task
from ...motion.fitting_circle import fitting_circle
from ...paths import ClosedPath, TaskPath
from ...strategies import RepeatableInverse
from ...strategies.strategy import Inverse
from ...studies.choose_start import PathOf
from ...studies.problem import Problem
from .chart.chart import Chart
from .evaluate.cell_evaluation import Evaluation, sampled
from .evaluate.cell_failures import FailureReason
from .evaluate.margins import CandidateFunction
from .evaluate.symmetric_coordinates import Turn, turn_at
from .function import InverseFunction
from .geometry.cell import Cell
from .geometry.ranges import range_rows
from .geometry.sector import Sector

_WAVES, _POINTS, _REACH = 3, 721, 0.9
"""Number of waves of a random path, of its points that are compared, and the largest coordinate."""

_REMEMBERED = 4096
"""Number of points of a random path that are kept: position and rotation, velocity and angular
velocity are asked for separately, by each strategy that follows the path."""

NO_EXTRA_SPEED = 1e-5
"""Extra joint speed below which it is written as 0."""

_NO_BODIES = "no collision bodies"
"""Text for the body distance of a robot without bodies to compare."""


def joint_values(names: Sequence[str], values: Sequence[float]) -> str:
    """Write joints with their values, rad or m: ``arm_3_joint at 0.00 and arm_4_joint at 1.57``."""
    pairs = zip(names, values, strict=True)
    return " and ".join(f"{name} at {round(value, 2) + 0.0:.2f}" for name, value in pairs)


@dataclass(frozen=True, eq=False)
@read_only
class CellDesign:
    """An inverse kinematic function q = F(x) over a cell of poses, and its evaluation.

    Attributes
    ----------
    function : InverseFunction
        The result: ``q = F(x)``.
    desired : Inverse
        Desired inverse G_d, such as J⁺, to which ∂F/∂x is near.
    posture : (n,) array
        Configuration F in the middle of the cell, rad (m for prismatic joints).
    evaluation : Evaluation
        All figures, on held-out poses; the main ones are attributes of the design as well.
    degrees : tuple of (degree, cost)
        Degrees of the polynomial s(u) that were tried, each with the cost that it attained on the
        fit nodes; the last degree is used.
    samples, held_out : int
        Numbers of fit nodes, which are the poses of the fit, and of held-out poses.
    seed : int
        Random seed of the fit nodes and of the held-out poses.
    steps : int
        Gauss–Newton steps taken.
    requested_limit_margin, requested_body_distance, requested_sigma_min : float
        Requested minima of the limit margin, rad or m, the body distance, m, and the smallest
        singular value σ_min of J; 0 if none was requested.
    proof : Proof, optional
        Certificate, if one was added: ``dataclasses.replace(found, proof=rp.prove(found))``. It is
        saved with the design. A certificate for another design is dropped with a warning.

    Examples
    --------
    >>> found.coverage  # share of the cell
    1.0
    >>> found.extra_speed < 0.05  # joint speed above the pseudoinverse's
    True
    """

    function: InverseFunction
    desired: Inverse
    posture: Array
    evaluation: Evaluation
    degrees: tuple[tuple[int, float], ...]
    samples: int
    held_out: int
    seed: int
    steps: int
    requested_limit_margin: float
    requested_body_distance: float
    requested_sigma_min: float
    proof: Proof | None = None

    def __post_init__(self) -> None:
        proof = own_proof(self.proof, lambda: self.subject, CELL_THEOREM)
        object.__setattr__(self, "proof", proof)

    @classmethod
    def of(cls, desired: Inverse, chart: Chart, evaluation: Evaluation, **how: Any) -> CellDesign:
        """Make a design from a chart, in which the function is s = 0, and from its evaluation.

        ``desired`` is the inverse G_d that ∂F/∂x approximates. ``how`` has the other attributes of
        the design, by name.
        """
        u, shift = chart.cell._split(np.zeros((1, chart.cell.whole.k)))
        middle = chart.solve(u)
        function = function_of(chart, evaluation)
        return cls(function, desired, middle.Q[0] + shift[0], evaluation, **how)

    @property
    def task(self) -> Task:
        """Task that the function inverts."""
        return self.function.task

    @property
    def subject(self) -> str:
        """Fingerprint of all that a certificate depends on; a valid certificate has the same.

        The fingerprint covers the joint chain, the joint limits, the cell and the polynomials.
        """
        chart = self.function.chart
        parts = chart.monomials.degree, chart.coefficients, *_cell_parts(chart.cell)
        return fingerprint("cell", task_parts(self.task), *parts)

    @property
    def cell(self) -> Cell:
        """The cell: set of poses over which the function is designed."""
        return self.function.cell

    @property
    def inverse(self) -> RepeatableInverse:
        """Controller ``q̇ = ∂F/∂x ẋ``; it holds s constant, and its leaf s = 0 is q = F(x)."""
        return self.function.inverse

    @property
    def cost(self) -> float:
        """Mean of ``‖∂F/∂x − G_d(F)‖_F²`` over the held-out poses that the function F covers.

        Only velocities along the coordinates of the cell count, not those along task coordinates
        that the cell holds constant.
        """
        return self.evaluation.cost

    @property
    def extra_speed(self) -> float:
        """Rms joint speed over the cell relative to that of the desired inverse, minus 1.

        The mean is over the held-out poses that the function covers, and over all directions of ẋ.
        Both speeds are evaluated at the configurations of the function.
        """
        return self.evaluation.extra_speed

    @property
    def extra_speed_worst(self) -> float:
        """Extra joint speed, rms over all directions of ẋ, at the worst pose found by a search.

        The speed is relative to that of the desired inverse.
        """
        return self.evaluation.extra_speed_worst

    @property
    def extra_speed_direction(self) -> float:
        """Extra joint speed in the worst direction of ẋ, at the worst pose found by a search.

        The speed is relative to that of the desired inverse. :attr:`extra_speed_worst`, in
        contrast, is an rms value over all directions of ẋ.
        """
        return self.evaluation.extra_speed_direction

    @property
    def limit_margin(self) -> float:
        """Minimum distance of a joint from its limit on the held-out poses, rad or m.

        The margin is negative if a limit is violated, and infinite if no joint has limits. A joint
        is left out if it moves the frame along a coordinate of the range ``"all"``.
        """
        return self.evaluation.limit_margin

    @property
    def limit_margin_worst(self) -> float:
        """Limit margin at the worst pose found by a search over the cell, rad or m.

        It is at most :attr:`limit_margin`, which has the same meaning on the held-out poses alone.
        """
        return self.evaluation.limit_margin_worst

    @property
    def leaf_margin(self) -> float:
        """Minimum leaf margin ``σ_min(Nᵀ V̂)``; 1 is best, 0 is an algorithmic singularity.

        The minimum is the smallest that a search found over the poses that the function covers. The
        columns of N and V̂ are orthonormal: N spans the null space of J, V̂ the gradients of the
        potentials that the controller holds constant. NaN in designs of older versions.
        """
        return self.evaluation.leaf_margin

    @property
    def coverage(self) -> float:
        """Fraction of the held-out poses that the function covers, 0 to 1.

        The function covers a pose if it has a configuration inside the limits there, and no fold of
        its leaf lies between the pose and the middle of the cell.
        """
        return self.evaluation.coverage

    @property
    def failures(self) -> tuple[FailureReason, ...]:
        """Reasons why the function fails at some poses of the cell; empty if none was found."""
        return self.evaluation.failures

    @property
    def body_distance(self) -> float:
        """Minimum distance between two links, or between a link and the surroundings, m.

        It is negative in a collision. The minimum is over the first 1024 held-out poses and the
        corners of the cell, where the function covers them. If no bodies collide at these poses,
        the minimum includes poses at which a search finds each pair of bodies nearest. The distance
        is infinite if there are no collision bodies, and NaN if the bodies have changed since the
        design was saved.
        """
        return self.evaluation.body_distance

    def figures(self) -> dict[str, str]:
        """Return the figures of merit as text, by their display names.

        The table of ``repctl cell`` and the page of the design show them.
        """
        j = self.evaluation
        sigma = f"{j.smallest_singular_value:.3g}"
        sigma += _unmet(j.smallest_singular_value, self.requested_sigma_min)
        leaf = (
            "not known: evaluated by an older version"
            if np.isnan(j.leaf_margin)
            else f"{j.leaf_margin:.3g} at the worst pose"
        )
        cost = f"{j.cost:.4g} ± {j.cost_error:.1g}"
        return {
            **self._ranges(),
            "middle": self.cell.where(np.zeros(self.cell.k)),
            **self._symmetry(),
            **self._locked_joints(),
            "posture": ", ".join(f"{v:.4g}" for v in np.round(self.posture, 4) + 0.0)
            + f" {self.task._joint_unit}",
            **self._degree(),
            "extra joint speed": self._speed_words(),
            "mean ‖∂F − G_d‖²": f"{cost} (on {self.held_out} held-out poses)",
            "limit margin": self._limit_margin_words(),
            "body distance": self._with_unchecked(self._body_distance_words()),
            "σ_min(J)": sigma,
            "leaf margin": f"{leaf}, {proved_words(self.proof)}",
            "residual": f"{j.residual:.1g} m or rad",
            "coverage": j.covered,
        } | ({"stopped": "\n".join(map(str, j.failures))} if j.failures else {})

    def _limit_margin_words(self) -> str:
        """Write the limit margins at the worst pose found by search and at the worst held-out pose.

        After each margin, in brackets, is the largest limit margin that was found along the
        self-motion of the same pose.
        """
        j, unit = self.evaluation, self.task._joint_unit
        if not np.isfinite(j.limit_margin):
            return "no limits"
        most = (
            "best possible there by self-motion:"
            if self.task.r == 1
            else "best found there on other leaves:"
        )
        return (
            f"{j.limit_margin_worst:.3g} {unit} at the worst pose found by search "
            f"({most} {j.attainable_margin_worst:.3g})"
            f"{_unmet(j.limit_margin_worst, self.requested_limit_margin)}\n"
            f"{j.limit_margin:.3g} {unit} at the worst held-out pose "
            f"({most} {j.attainable_margin:.3g})"
            f"{_unmet(j.limit_margin, self.requested_limit_margin)}"
            f"{_left_out(self.function.chart.cell.excepted, j.turns)}"
        )

    def _body_distance_words(self) -> str:
        """Write the minimum body distance, such as ``3.2 mm, link5 and link7``."""
        j, near = self.evaluation, self.body_distance
        if np.isnan(near):
            return "not known: the bodies have changed since it was evaluated"
        if np.isinf(near):
            return _NO_BODIES
        length = f"{1e3 * near:.3g} mm" if abs(near) < 0.01 else f"{100 * near:.3g} cm"
        bodies = " and ".join(j.nearest_bodies)
        return f"{length}, {bodies}{_unmet(near, self.requested_body_distance)}"

    def _with_unchecked(self, bodies: str) -> str:
        """Return ``bodies``, a text on body distances, with a note on bodies not checked."""
        unchecked = bodies_of(self.task).not_checked
        if unchecked and bodies == _NO_BODIES:
            return f"not checked: {unchecked}"
        return f"{bodies}\nnot checked: {unchecked}" if unchecked else bodies

    def _speed_words(self) -> str:
        """Write the extra joint speed, such as ``1.2 % on average, 3 % at the worst pose``.

        Two further lines give, if known, the extra joint speed in the worst direction, and its
        proved bound.
        """
        j = self.evaluation
        every = [j.extra_speed, j.extra_speed_worst]
        every += [j.extra_speed_direction] if np.isfinite(j.extra_speed_direction) else []
        proved = f"\nproved: {self.proof.extra_speed_words}" if self.proof else ""
        if max(every) < NO_EXTRA_SPEED:
            return f"0{proved}"
        mean, worst, *direction = map(ratio_in_percent, every)
        error = f" ± {100 * j.extra_speed_error:.1g}" if j.extra_speed > NO_EXTRA_SPEED else ""
        text = f"{mean}{error} on average, {worst} at the worst pose"
        for one in direction:
            text += f"\n{one} at most in a single task direction"
        return text + proved

    def _ranges(self) -> dict[str, str]:
        """Return the ranges of the coordinates as text, by display name.

        A box has one row, a sector one row per coordinate. After the range of a symmetric
        coordinate, the row also states the range that the function reaches.
        """
        rows = range_rows(self.cell)
        for turn in self.evaluation.turns:
            asked = rows.get(turn.coordinate)
            rows[turn.coordinate] = f"{asked}\n{turn}" if asked else str(turn)
        return rows

    def _symmetry(self) -> dict[str, str]:
        """Return the symmetries in use as text, by display name.

        In a sector, one joint can turn the whole arm about the axis, or the tool about its z axis.
        For other cells the dictionary is empty.
        """
        sector = self.function.chart.cell
        return {"symmetry": sector.symmetry()} if isinstance(sector, Sector) else {}

    @property
    def locked(self) -> str:
        """Joints that the function keeps constant, and their values; empty for other functions."""
        names, joints = self.task.joint_names, self.function.chart.locked
        return joint_values([names[j] for j in joints], [self.posture[j] for j in joints])

    def _degree(self) -> dict[str, str]:
        """Return the degree of the fit and the number of its terms as text, by display name.

        The dictionary is empty if the function keeps joints constant: then nothing was fitted.
        """
        terms = self.function.chart.monomials.size
        degree = f"{self.degrees[-1][0]}, evaluated from {terms} terms"
        return {} if self.locked else {"degree": degree}

    def _locked_joints(self) -> dict[str, str]:
        """Return the joints that the function keeps constant as text, by display name."""
        return {"locked joints": self.locked} if self.locked else {}

    def summary(self) -> str:
        """Return the figures of merit as text, one per line, under the name of the robot.

        If a figure has several lines, only the first begins with its name.
        """
        task = self.task
        lines = [
            f"  {'' if i else name:17}  {line}"
            for name, text in self.figures().items()
            for i, line in enumerate(text.split("\n"))
        ]
        shape = "sector" if isinstance(self.cell, Sector) else "cell"
        return "\n".join([f"one function for a {shape} of {task.robot.name} {task}", *lines])

    def __repr__(self) -> str:
        return (
            f"<CellDesign for {self.task.robot.name} {self.task.frame}, {self.cell.size()}: "
            f"+{ratio_in_percent(self.extra_speed)} joint speed, "
            f"limit margin {self.limit_margin_worst:.3g}, "
            f"covered: {self.evaluation.covered}>"
        )


def function_of(chart: Chart, evaluation: Evaluation) -> InverseFunction:
    """Make the function q = F(x) of a chart, with a check of joint limits if necessary.

    A check costs time at every call. For s = 0, the function checks limits only in two cases: some
    evaluated pose has no configuration inside the limits, or a coordinate of the sector has the
    range ``"all"``, which ends only at the joint limits. For other positions s along the
    self-motion, it always checks limits.
    """
    ends_at_limits = bool(chart.cell.free) or not evaluation.everywhere
    return InverseFunction(chart, keep_limits=ends_at_limits)


def _cell_parts(cell: Cell) -> tuple[Any, ...]:
    """List the numbers that define a cell, and the symmetries of the arm that its design uses.

    :attr:`CellDesign.subject` hashes the list, to show whether a certificate is for this cell.
    """
    box = rounded(cell.placement.homogeneous), cell.widths
    if not isinstance(cell, Sector):
        return "box", *box
    used = [(one.coordinate, one.joint, one.sign) for one in cell.removed]
    profile = [np.array(cell.profile)] if cell.profile.degree else []
    return "sector", *box, rounded(cell.axis), cell.free, used, cell.spin_middle, *profile


def _left_out(joints: Sequence[str], turns: Sequence[Turn]) -> str:
    """Write which joints the limit margin leaves out, as lines to append to the text of the margin.

    ``joints`` are the names of these joints, and ``turns`` the ranges of symmetric coordinates. One
    line names the joints whose limits end a range. A joint that makes a full turn within its limits
    has a line of its own, with its distance from the limits, rad.
    """
    full = {turn.joint: turn.left for turn in turns if turn.left}
    bounded = [name for name in joints if name not in full]
    text = f"\nwithout {', '.join(bounded)}, whose limits bound the range" if bounded else ""
    whole = [f"\n{full[name]:.3g} rad of {name}, a full turn" for name in joints if name in full]
    return text + "".join(whole)


def _unmet(found: float, asked: float) -> str:
    """Write ``; the requested 0.1 is not met`` if ``found`` < ``asked``, else an empty text.

    ``found`` is the minimum that was found, and ``asked`` the requested one; 0 stands for none.
    """
    return f"; the requested {asked:g} is not met" if found < asked and asked else ""


@dataclass(frozen=True, eq=False)
@read_only
class Slice:
    """Maps of a function over two coordinates of its cell; all other coordinates are 0.

    The maps are evaluated on a grid of C × C poses.

    Attributes
    ----------
    axes : (int, int)
        Indices of the first and the second coordinate in u, from 0.
    u : (C,) array
        Grid values of either coordinate, from −1 to 1.
    limit_margin, extra_speed : (C, C) arrays
        Smallest joint-limit margin, rad or m, and extra joint speed relative to the desired inverse
        G_d; NaN where the function has no value. Rows are values of the second coordinate, columns
        of the first.
    turn : (C, C) array or None
        Full width, rad, of the range of a sector's angle at each pose of the grid, in the same
        order. Within this range, the joint that turns the arm stays within its limits at every
        tilt. None for a box, for a sector without tilts, or if the symmetry of the angle is not
        used.
    """

    axes: tuple[int, int]
    u: Array
    limit_margin: Array
    extra_speed: Array
    turn: Array | None = None


def slices(design: CellDesign, count: int = 33) -> list[Slice]:
    """Evaluate the limit margin and the extra joint speed over pairs of a cell's coordinates.

    The figures of a cell show these maps. There are at most three pairs. They consist of
    translational coordinates, or of any coordinates if fewer than two are translational. Each map
    has ``count`` grid points along both coordinates of the pair; all other coordinates are 0. The
    list is empty if the cell has a single coordinate.
    """
    cell, chart = design.function.chart.cell, design.function.chart
    places = [i for i, unit in enumerate(cell.units) if unit == "m"]
    pairs = list(combinations(places if len(places) > 1 else range(cell.k), 2))[:3]
    u = np.linspace(-1, 1, count)
    made = []
    for first, second in pairs:
        U = np.zeros((count * count, cell.k))
        U[:, second], U[:, first] = (grid.ravel() for grid in np.meshgrid(u, u, indexing="ij"))
        at = sampled(design.desired, CandidateFunction.zero(chart), U)
        margin = np.where(at.ok, at.limit_margin, np.nan)
        extra = np.sqrt(at.ratio) - 1
        # without tilts, the angle goes equally far at every radius and height
        turn = turn_at(chart, U) if isinstance(cell, Sector) and cell.tilted else None
        made.append(
            Slice(
                (first, second),
                u,
                margin.reshape(count, count),
                extra.reshape(count, count),
                None if turn is None else turn.reshape(count, count),
            )
        )
    return made


def _problem_of_cell(
    design: CellDesign,
    start: ArrayLike | None,
    path: str | ClosedPath | PathOf | Literal[False] | None,
    plane: str | None,
) -> Problem:
    """Create a problem, which is a start with a closed path, inside the cell of a design.

    ``repctl follow`` uses it for a saved cell. ``start`` (n,), ``path`` and ``plane`` are the
    arguments of :class:`Problem`; None selects the default, and the path False gives a problem
    without a path. The default path is a circle that fits in the cell, or a random path through a
    sector. The default start is the configuration that the function gives for the first pose of the
    path or, without a path, in the middle of the cell.
    """
    begin = design.posture if start is None else start
    inside = partial(fitting_circle, control=design.inverse, region=design.cell)
    draw = inside if path is None and plane is None else path
    if draw is inside and isinstance(design.cell, Sector):
        draw = tour(design.cell)  # the orientation turns with the angle, which no circle does
    problem = Problem(design.task, start=begin, path=draw, plane=plane)._with(region=design.cell)
    if start is not None or path is False:
        return problem
    q0 = design.function(problem.cycle.placement(0.0))
    name = "the configuration that the function gives where the path begins"
    return problem._with(start=q0, start_is=name, moved=(), region=design.cell)


PROBLEM = (CellDesign, _problem_of_cell)
"""The part that :func:`repctl_pin.base.plugins.parts` gives for the place ``problem``."""


def tour(cell: Cell) -> TaskPath:
    r"""Make a smooth closed sample path through a cell, to show its function in motion.

    Its coordinates in the cell are ``u_i(s) = Σ_j a_ij cos 2πjs + b_ij sin 2πjs``, where s is the
    path parameter from 0 to 1. a and b are drawn from a fixed random seed, and scaled so that the
    maximum of every |u_i| is 0.9.
    """
    k, a, b = _waves(cell.k)
    moved = cell.moved

    def at(s: float) -> Array:
        """Evaluate the coordinates u (1, k) of the sample path at s, from 0 to 1 in a cycle."""
        return np.asarray(a @ np.cos(k * s) + b @ np.sin(k * s), float)[None]

    def twists(U: Array) -> Array:
        """Evaluate the frame's velocities (v, ω), base axes, at the coordinates U (1, k): (6, k).

        Column i is the velocity while only the i-th coordinate of the cell changes, per m or rad of
        this coordinate: not per unit of u_i, which is scaled to [−1, 1].
        """
        return cell._frame_twists(cell.spread(U))[0][:, moved]

    @lru_cache(_REMEMBERED)
    def twist(s: float) -> Array:
        """Evaluate the frame's velocity (v, ω), base axes, per unit of the path parameter: (6,)."""
        du = b @ (k * np.cos(k * s)) - a @ (k * np.sin(k * s))
        return unwritable(np.asarray(twists(at(s)) @ (cell.widths[moved] * du), float))

    @lru_cache(_REMEMBERED)
    def placed(s: float) -> tuple[Array, Array]:
        """Evaluate the frame's position (3,), m, and rotation (3, 3) at the path parameter s."""
        p, R = cell.placements(at(s))
        return unwritable(p[0]), unwritable(R[0])

    turns = cell.task.kind.turns and bool(twists(np.zeros((1, cell.k)))[3:].any())
    return TaskPath(
        "tour 0 of the cell",
        lambda s: placed(s)[0],
        lambda s: twist(s)[:3],
        (lambda s: placed(s)[1]) if turns else cell.placement.rotation,
        spin=(lambda s: twist(s)[3:]) if turns else None,
    )


def _waves(count: int) -> tuple[Array, Array, Array]:
    """Draw J waves: wave numbers 2πj (J,), and cosine and sine coefficients a and b (count, J).

    j is from 1 to J. The ``count`` coordinates of the sample path are the sums
    ``Σ_j a_ij cos 2πjs + b_ij sin 2πjs``. The random numbers are always the same.
    """
    rng = np.random.default_rng(0)
    k: Array = np.asarray(2 * np.pi * np.arange(1, _WAVES + 1))
    a, b = rng.normal(size=(2, count, _WAVES)) / np.arange(1, _WAVES + 1)
    s = np.linspace(0, 1, _POINTS)[:, None]
    most = np.abs(np.cos(k * s) @ a.T + np.sin(k * s) @ b.T).max(axis=0)[:, None]
    return k, _REACH * a / most, _REACH * b / most
