"""Candidate and stable surfaces of an inverse that is not repeatable.

The defects of G, joint drift per area of a small loop (see :mod:`lie_bracket`), are stacked in the
function s(q). They can be 0 on a surface s(q) = 0 of joint space, the candidate. If motions of G
that begin on this surface also stay on it, the surface is stable, and these motions are repeatable,
although G is not. Numbers in parentheses are equations of the paper (docs/notation.md). An inverse
G of the Jacobian J has J G = I; J⁺ is the pseudoinverse. An argument ``strategy`` is the inverse G,
and ``function``, a ``_Surface``, evaluates s and its error. s has one defect (n,) per pair of
columns a < b of G. Its error, one number per configuration, is an estimate of the norm of its
numerical error. Letters: n joints, m task coordinates, K configurations; ``pairs`` is the number of
pairs of columns, and · stands for any number of points. The length of a joint motion is the norm of
its entries divided by the units of the joints, 1 rad or the arm length for a prismatic joint.

``Region`` is a part Ω of joint space, such as a box. ``Surfaces`` are the points found, with the
kind of each, and with the rate at which motions of G leave the surface.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import Array, read_only
from ..base.threads import one_blas_thread
from ..model.length import joint_scale
from ..redundancy.inverses import inverse_condition_number
from ..redundancy.nullspace import nullspace
from ..regions import Region
from ..strategies.pseudoinverse import WeightedInverse
from ..strategies.strategy import Inverse
from .derivative import SHORTEST_STEP, derivative, differentiate
from .lie_bracket import measure
from .repeatability import points_of

_STABLE, _CANDIDATE, _AT_SINGULARITY = "stable", "candidate", "singular"

_ON_SURFACE = 1e-11  # ‖s‖ that counts as 0 if the derivative is exact
_RANK = 1e-5  # singular values of ∂s/∂q below this share of the largest are dependent rows
_MAX_STEPS = 60
_LONGEST_STEP = 0.3  # of Newton's method, rad
_SINGULAR = 1e-3  # σ_min / σ_max of J below which a configuration counts as singular
_WALK, _WALK_STEPS = 0.2, 8  # length and steps of the walk that tests a surface, rad


@dataclass(frozen=True, eq=False)
@read_only
class Surfaces:
    """Points found on surfaces s(q) = 0, where s are the stacked defects of an inverse G.

    Defects are drift per area of a small loop. s is divided by the median of ‖s‖ over the start
    points of the search, so it has no unit.

    Attributes
    ----------
    points : (K, n) array
        Points in the region: on s = 0, or where the search ended at a singularity.
    kind : (K,) array of str
        Kind of each point. ``stable``: ``(∂s/∂q) G = 0`` (9) holds, and s stays 0 along motions of
        G; ``candidate``: s = 0 at the point, but motions of G leave the surface; ``singular``: J is
        singular at the point, so s is not defined, or a test motion from a point with s = 0 soon
        ended at a singularity.
    rate : (K,) array
        ``‖(∂s/∂q) G‖`` of (9), with the columns of G orthonormalised: bound on the change of s per
        unit length of a motion of G; nan where J is singular.
    tolerance : (K,) array
        Rate that the error of ∂s/∂q can produce where the exact rate is 0; nan where J is singular.
    residual : (K,) array
        ‖s‖ at the point; nan where J is singular.
    """

    points: Array
    kind: NDArray[np.str_]
    rate: Array
    tolerance: Array
    residual: Array

    def __repr__(self) -> str:
        return f"<{self.summary()}>"

    @property
    def stable(self) -> Array:
        """Points (·, n) on stable surfaces, which motions of G do not leave."""
        return self.points[self.kind == _STABLE]

    @property
    def candidate(self) -> Array:
        """Points (·, n) on candidate surfaces that motions of G leave."""
        return self.points[self.kind == _CANDIDATE]

    @property
    def singular(self) -> Array:
        """Points (·, n) at which J is singular, or from which G soon leads to a singularity."""
        return self.points[self.kind == _AT_SINGULARITY]

    def summary(self) -> str:
        """Summarise in one line how many points lie on stable and on candidate surfaces."""
        if not len(self.points):
            return "no candidate surface: no point with s(q) = 0 was found"
        if len(self.stable):
            return (
                f"stable surfaces: {len(self.stable)} of {len(self.points)} points on s = 0, "
                f"{len(self.candidate)} on candidate surfaces only, {len(self.singular)} near "
                "singularities"
            )
        return (
            f"no stable surface: all {len(self.candidate)} points found on s = 0 "
            "are on candidate surfaces only"
        )


_Surface = Callable[[Array], tuple[Array, Array]]


def _surface_function(strategy: Inverse, Q: Array) -> tuple[Array, Array]:
    """Evaluate s(q), the stacked defects of all pairs a < b: (K, pairs · n), and its error (K,).

    s consists of the relative defects, multiplied by ``det(BᵀB)`` with ``B = L⁻¹ G J M⁻¹ Jᵀ``. A
    relative defect is the drift per area of a loop, with the area computed from the lengths of the
    joint motions along its sides. L is the diagonal matrix of the joints' units, and M is the
    weight of a weighted inverse, else I. For J⁺, n = 3 and m = 2, B is Jᵀ and s is the paper's
    scalar (6) times the unit null vector n̂.

    Without the factor, s contains the unit normal of G's column space. On an arm whose prismatic
    travel differs much from 1 m, the unit normal reverses over a very short distance, which
    Newton's method steps across. With the factor, s is as smooth as J. The entries of s are
    dependent, because each defect lies in the null space of J.
    """
    found = measure(strategy, Q)
    task = strategy.task
    B: NDArray[np.floating] = np.swapaxes(found.J, 1, 2)
    if isinstance(strategy, WeightedInverse):
        B = np.linalg.solve(strategy._weights(Q), B)  # M⁻¹ Jᵀ = G J M⁻¹ Jᵀ is as smooth as J
    B = found.G @ found.J @ B / joint_scale(task, Q[0])[:, None]
    size = np.linalg.det(np.swapaxes(B, 1, 2) @ B)
    a, b = np.triu_indices(task.m, 1)
    return size[:, None] * found.relative[:, a, b].reshape(len(Q), -1), size * found.error


def _scaled_surface_function(strategy: Inverse, Q: Array) -> _Surface:
    """Create the function s(q), the stacked defects of an inverse, divided by the median of ‖s‖.

    The median is over those rows of Q (K, n) at which J is not singular. So the same tolerances of
    s hold for arms of any size. The function maps configurations (·, n) to s (·, pairs · n) and its
    error (·,).
    """
    regular = _dexterity(strategy, Q) > _SINGULAR
    unit = 1.0
    if regular.any():
        unit = (
            float(np.median(np.linalg.norm(_surface_function(strategy, Q[regular])[0], axis=1)))
            or 1.0
        )

    def s(P: Array) -> tuple[Array, Array]:
        values, error = _surface_function(strategy, P)
        return values / unit, error / unit

    return s


@one_blas_thread()
def stable_surface(
    strategy: Inverse, region: Region, *, samples: int = 128, seed: int = 0
) -> Surfaces:
    """Find points on surfaces s(q) = 0, and test which surfaces are stable (9).

    s(q) are the stacked defects of the inverse: its drift per area of small loops along all pairs
    of task coordinates. A motion of G that begins on a stable surface stays on it, and is
    repeatable.

    A point of s = 0 is on a stable surface if ``(∂s/∂q) G = 0`` there, within the error of ∂s/∂q,
    *and* s is still 0 after a motion of up to 0.2 rad along G in every task direction. The second
    test decides cases that the first cannot: motions of G that only touch the surface at this
    point, or an s whose gradient vanishes on the surface.

    Parameters
    ----------
    strategy
        Any inverse, of any n and r.
    region
        Region Ω.
    samples
        Minimum number of start points of the search.
    seed
        Random seed of the start points.

    Returns
    -------
    Surfaces
        Points on s = 0 and the kind of each: stable, candidate or singular.

    Raises
    ------
    InputError
        If the region does not fit the task.
    SingularityError
        If G is singular where J is not.

    Examples
    --------
    >>> surfaces = rp.stable_surface(control, rp.Box(q0, 0.8), samples=16)
    >>> len(surfaces.stable)  # none: this arm has only candidates
    0
    """
    seeds = points_of(region, strategy, samples, seed)
    function = _scaled_surface_function(strategy, seeds)
    Q, singular = _search(strategy, function, region, seeds)
    points = np.vstack([Q, singular])
    on = slice(len(Q))
    rate, tolerance, residual = np.full((3, len(points)), np.nan)
    kind = np.full(len(points), _AT_SINGULARITY, dtype="U9")
    if len(Q):
        kind[on] = _CANDIDATE
        rate[on], tolerance[on] = _rates(strategy, function, Q)
        s, error = function(Q)
        residual[on] = np.linalg.norm(s, axis=1)
        tangent = np.flatnonzero(rate[on] <= tolerance[on])
        if len(tangent):
            left, walked = _departure(strategy, function, Q[tangent])
            stays = left <= 1e-7 + 100 * (residual[on] + error)[tangent]
            kind[tangent[stays]] = _STABLE
            kind[tangent[walked < 1 / 4]] = _AT_SINGULARITY
    return Surfaces(points, kind, rate, tolerance, residual)


def _search(strategy: Inverse, function: _Surface, region: Region, Q: Array) -> tuple[Array, Array]:
    """Move start points Q (K, n) to s = 0 by Gauss–Newton steps with a line search.

    ``function`` maps Q to s and its error. Return the points with s = 0, (·, n), and the points at
    which the search ended because J is singular, (·, n); both only inside the region. Start points
    from which no step reduces ‖s‖ any more are dropped.
    """
    task = strategy.task
    L = joint_scale(task, Q[0])
    found: list[Array] = []
    singular: list[Array] = []
    for _ in range(_MAX_STEPS):
        if not len(Q):
            break
        regular = _dexterity(strategy, Q) > _SINGULAR
        singular.append(Q[~regular])
        Q = Q[regular]
        if not len(Q):
            break
        s, error = function(Q)
        size = np.linalg.norm(s, axis=1)
        reached = size <= np.maximum(_ON_SURFACE, error)
        found.append(Q[reached])
        Q = Q[~reached]
        s = s[~reached]
        size = size[~reached]
        if not len(Q):
            break
        step = _newton_step(strategy, function, Q, s, L)
        Q = _improved(strategy, function, Q, step, size)
    points = np.vstack([np.empty((0, task.n)), *found])
    stuck = np.vstack([np.empty((0, task.n)), *singular])
    return points[region.ratio(points) <= 1 + 1e-9], stuck[region.ratio(stuck) <= 1 + 1e-9]


def _improved(strategy: Inverse, function: _Surface, Q: Array, step: Array, size: Array) -> Array:
    """Move each row of Q (K, n) by the fraction of its ``step`` (K, n) with the smallest ‖s‖.

    The fractions 1, 1/2, 1/4, 1/8 and 1/16 are tried. ``size`` (K,) is ‖s‖ at Q, and ``function``
    evaluates s. Return the moved rows (·, n), without those for which no fraction reduces ‖s‖.
    """
    trials = Q[:, None] + 0.5 ** np.arange(5)[:, None] * step[:, None]  # (K, 5, n)
    norms = _norms(strategy, function, trials.reshape(-1, Q.shape[1])).reshape(len(Q), -1)
    every, best = np.arange(len(Q)), norms.argmin(axis=1)
    return trials[every, best][norms[every, best] < size]


def _newton_step(strategy: Inverse, function: _Surface, Q: Array, s: Array, L: Array) -> Array:
    """Compute the shortest step (K, n) to s = 0 to first order, at most 0.3 rad long.

    ``s`` (K, pairs · n) are the values at Q (K, n), and L (n,) is the unit of each joint, 1 rad or
    the arm length in m. ∂s/∂q is by central differences of ``function``. s is first projected onto
    the null space of J, in which all defects lie, so that the equations are independent.
    """
    K, n = Q.shape
    h = 1e-4
    moves = h * np.diag(L)
    near = np.concatenate([Q[:, None] + moves, Q[:, None] - moves], axis=1)  # (K, 2 n, n)
    values = function(near.reshape(-1, n))[0].reshape(K, 2, n, -1, n)
    slope = (values[:, 0] - values[:, 1]) / (2 * h)  # (K, n, pairs, n), in units of L
    # s = N σ rotates with the null space; only a change of σ reduces it to 0.
    N = nullspace(strategy.task.jacobians(Q) * L)  # (K, n, r)
    slope = np.einsum("Kkpi,Kir->Kprk", slope, N).reshape(K, -1, n)
    sigma = np.einsum("Kpi,Kir->Kpr", s.reshape(K, -1, n), N).reshape(K, -1)
    step = -np.einsum("Kns,Ks->Kn", np.linalg.pinv(slope, rcond=_RANK), sigma)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return L * step * np.minimum(1.0, _LONGEST_STEP / np.maximum(length, 1e-300))


def _norms(strategy: Inverse, function: _Surface, Q: Array) -> Array:
    """Evaluate ``‖s(q)‖`` at every row of Q (K, n): (K,); inf where J is singular.

    ``function`` evaluates s. A line search rejects points with the norm inf.
    """
    norms = np.full(len(Q), np.inf)
    regular = _dexterity(strategy, Q) > _SINGULAR
    if regular.any():
        norms[regular] = np.linalg.norm(function(Q[regular])[0], axis=1)
    return norms


def _rates(strategy: Inverse, function: _Surface, Q: Array) -> tuple[Array, Array]:
    """Evaluate ``‖(∂s/∂q) G‖`` (9), per unit of joint motion, and its tolerance: (K,) each.

    Motions of G that begin at the rows of Q (K, n) leave s = 0 at this rate, which is 0 on a stable
    surface. The tolerance is the rate that the errors of s and of ∂s/∂q can produce. ``function``
    evaluates s and its error.
    """
    L = joint_scale(strategy.task, Q[0])
    slope, error = differentiate(lambda P: function(P)[0], Q, L)
    basis = np.linalg.qr(strategy.batch(Q) / L[:, None])[0]  # (K, n, m)
    along = (slope * L) @ basis  # (K, pairs · n, m)
    rate = np.linalg.norm(along, axis=(1, 2))
    size = np.linalg.norm(slope * L, axis=(1, 2))
    # The errors of the entries, the error of s, and the residual of s at the point.
    own = function(Q)[1] / SHORTEST_STEP
    return rate, np.sqrt(slope.shape[1]) * (error * L).sum(axis=1) + own + 1e-5 * size


def _departure(strategy: Inverse, function: _Surface, Q: Array) -> tuple[Array, Array]:
    """Start at points Q (K, n) on s = 0, follow G in every task direction, and evaluate ‖s‖.

    The directions are both directions of each task coordinate, and one in which all coordinates
    change equally. A motion is 0.2 rad long; where ``‖∂G/∂q‖ / ‖G‖`` is above 1 per rad, the length
    is divided by this ratio. A motion ends early at a singularity. Return two numbers per row of Q,
    (K,) each: the maximum ‖s‖ at the ends of these motions, which is 0 on a stable surface, and the
    completed fraction of the motion that ended earliest, 1 if none did. ``function`` evaluates s.
    """
    task = strategy.task
    L = joint_scale(task, Q[0])
    found = derivative(strategy, Q)
    G = found.G / L[:, None]
    dG = found.dG / L[:, None, None] * L
    turns = np.sqrt(np.sum(dG**2, axis=(1, 2, 3)) / np.sum(G**2, axis=(1, 2)))
    h = (_WALK / _WALK_STEPS / np.maximum(1.0, turns))[:, None]
    largest = np.zeros(len(Q))
    least = np.full(len(Q), np.inf)
    mixed = np.ones(task.m) / np.sqrt(task.m)
    for direction in (*np.eye(task.m), *-np.eye(task.m), mixed):
        P, way = _walked(strategy, Q, direction, h, L)
        largest = np.maximum(largest, np.where(way > 0, _norms(strategy, function, P), 0.0))
        least = np.minimum(least, way)
    return largest, least


def _walked(
    strategy: Inverse, Q: Array, direction: Array, h: Array, L: Array
) -> tuple[Array, Array]:
    """Follow G from Q (K, n) in one task direction by eight Runge–Kutta steps.

    ``direction`` (m,) is the direction, and ``h`` (K, 1) the length ‖Δq / L‖ of the joint motion in
    each step, rad, with ``L`` (n,) the unit of each joint, 1 rad or the arm length in m. Return the
    final configurations (K, n), and the fraction (K,) of the eight steps that was completed before
    a singularity.
    """

    def velocity(P: Array) -> Array:
        qdot = strategy.batch(P) @ direction
        return qdot / np.linalg.norm(qdot / L, axis=1, keepdims=True)

    P, way = Q.copy(), np.zeros(len(Q))
    for _ in range(_WALK_STEPS):
        # A point that approaches a singularity of J stops there.
        free = np.flatnonzero(_dexterity(strategy, P) > 0.05)
        p, step = P[free], h[free]
        if not len(p):
            break
        k1 = velocity(p)
        k2 = velocity(p + step / 2 * k1)
        k3 = velocity(p + step / 2 * k2)
        k4 = velocity(p + step * k3)
        P[free] = p + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        way[free] += 1 / _WALK_STEPS
    return P, way


def _dexterity(strategy: Inverse, Q: Array) -> Array:
    """Evaluate σ_min / σ_max of J at every row of Q (K, n): (K,).

    Prismatic joints are in arm lengths, which makes them comparable with revolute ones. The ratio
    is 0 at a singularity.
    """
    return inverse_condition_number(strategy.task.jacobians(Q) * joint_scale(strategy.task, Q[0]))
