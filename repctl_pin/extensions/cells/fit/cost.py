r"""Cost of a candidate for the inverse function over a cell, and its minimisation.

The function q = F(x) gives one configuration for each pose of the cell. The cost is the mean
squared distance of ∂F/∂x from G_d, the desired inverse, plus penalties on small margins. The label
s (r,) of a pose, a polynomial of its coordinates u (k,), is the position of F along the self-motion
there; its coefficients a are the unknowns. ∂F = ∂F/∂u, E = ∂x/∂u, and C = (EᵀE)^(−1/2) scales u to
unit task speed. All three also have columns for the l coordinates that symmetries of the arm remove
from u. Nodes are the poses at which the cost is evaluated. A chart consists of polynomials q_ref
and n_ref of u: q_ref approximates a configuration, from which s is measured, and n_ref the null
space.

Letters: n joints, r components of s, N monomials of u in which s is written, K nodes, L penalised
poses (the sum over all penalties), P margins of one kind per configuration. In arrays of K + L
rows, the nodes come first, then the poses of one penalty after the other. ``weight`` is the factor
of all penalties. The residual is ``(∂F − G_d E) C``. A hinge is max(0, asked − margin): the amount
by which a margin is below ``asked``, the value that its penalty requires.

``Chart`` is coordinates (u, s) of configurations: u gives the pose, the label s (r,) the position
along its self-motion. ``Penalty`` is a kind of margin that the cost penalises, and the poses at
which the margin is penalised. ``Monomials`` are all monomials ``u^α`` up to a degree in the
coordinates u, the constant 1 first. ``_Value`` is the cost of a candidate function, with the
configurations at which it was evaluated. ``Points`` are the configurations Q (K, n) of a function q
= F(u) at K poses, with the kinematics there. ``Descent`` is the result of a minimisation:
coefficients a, the cost with its configurations, and the number of steps. ``Point[_Value]`` is the
result of one evaluation by the minimiser: the cost as a number, and the ``_Value`` from which
gradient and Hessian are computed. ``Step`` is a damped Gauss–Newton step dx, with its predicted
decrease and its damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ....base.arguments import Array, read_only
from ....solvers import Damping, Point, Step, levenberg_marquardt
from ....strategies.strategy import Inverse
from ..chart.chart import Chart, Points
from ..chart.monomials import Monomials
from ..evaluate.margins import Margin
from ..geometry.kinematics import rows_of

_DIFFERENCE = 1e-5
"""Step of the label s, rad, in central differences of the residual along the self-motion."""

_MOST = 30
_ENOUGH = 1e-4

_REGULAR = 1e-10
"""Minimum damping, relative to the diagonal of H."""

_IDLE = 1e-6
"""Change of the cost per rad² or m² of a label, relative to ‖G_d‖², below which the label is
held."""

_RULES = Damping()
"""Parameters of the damping: a step that does not lower the cost is computed again with more
damping."""


@dataclass(frozen=True, eq=False)
@read_only
class _Value:
    """The cost of a candidate F, with the configurations at which it was evaluated.

    Attributes
    ----------
    cost : float
        ``nearness + weight · Σ mean Σ_i max(0, asked − margin_i)²``. The outer sum is over the
        penalties, one for each kind of margin. The mean is over the poses of the penalty, the inner
        sum over the P margins of that kind. If the nodes have weights, the mean in the nearness is
        replaced by a weighted mean. Infinite if F does not exist at some pose.
    nearness : float
        ``mean ‖(∂F − G_d E) C‖_F²`` over the nodes: the squared distance from G_d.
    desired_square : float
        ``mean ‖G_d E C‖_F²``. If G_d is J⁺, the extra joint speed is about
        ½ nearness / desired_square.
    points : Points
        Configurations of F at the K nodes, then at the L penalised poses.
    ds : (K + L, r, k) array
        ∂s/∂u at the points.
    excess : (K,) array
        ``‖(∂F − G_d E) C‖_F² / ‖G_d E C‖_F²`` at the nodes; empty if the cost is infinite. If G_d
        is J⁺, the extra joint speed at a node is ``(1 + excess)^½ − 1``.
    residual : (K, n, k + l) array
        ``(∂F − G_d E) C`` at the nodes; empty if the cost is infinite.
    B : (K, n, r) array
        ∂F/∂s at the nodes; empty if the cost is infinite.
    """

    cost: float
    nearness: float
    desired_square: float
    points: Points
    ds: Array
    excess: Array = field(default_factory=lambda: np.empty(0))
    residual: Array = field(default_factory=lambda: np.empty(0))
    B: Array = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True, eq=False)
@read_only
class Penalty:
    """A kind of margin that the cost penalises, and the poses at which it is penalised.

    Attributes
    ----------
    margin : Margin
        The kind of margin, such as joint limits.
    U : (L, k) array
        Poses at which the margin is penalised; here L counts the poses of this penalty only.
    asked : (L,) array
        Value at each of these poses below which the margin is penalised.
    """

    margin: Margin
    U: Array
    asked: Array


class Cost:
    r"""Cost of a candidate F: mean distance from the desired inverse, plus penalties on margins.

    As a function of the coefficients a of ``s = Σ_t a_t T_t(u)``, the cost is the mean over the
    cell of ``‖∂F/∂x − G_d(F)‖_F²``, plus penalties. A cell may have fewer coordinates than the
    task, so ∂F C takes the place of ∂F/∂x, and G_d E C that of G_d, with ``C = (EᵀE)^(−1/2)``.

    Parameters
    ----------
    desired
        G_d.
    chart
        The chart in which F is written.
    terms
        The N monomials T_t.
    U : (K, k) array
        Nodes over which the mean is taken.
    kept
        Penalties, one per kind of margin that is to be kept.
    weight
        Factor of all penalties.
    shares : (K,) array, optional
        Weights of the nodes in the cost; by default 1.
    """

    def __init__(
        self,
        desired: Inverse,
        chart: Chart,
        terms: Monomials,
        U: Array,
        kept: Sequence[Penalty] = (),
        *,
        weight: float = 0.0,
        shares: Array | None = None,
    ) -> None:
        self.shares = np.ones(len(U)) if shares is None else shares
        self.desired, self.chart, self.terms, self.weight = (desired, chart, terms, weight)
        self.U, self.inner = (np.concatenate([U, *(part.U for part in kept)]), slice(len(U)))
        ends = np.cumsum([len(U), *(len(part.U) for part in kept)])
        self.kept = [
            (part, slice(a, b)) for part, a, b in zip(kept, ends, ends[1:], strict=False) if b > a
        ]
        self.T = terms.values(self.U)  # (K, N)
        self.dT = terms.slopes(self.T)  # (K, N, k)
        self.rates = chart.rates(U)
        self.goals = chart.goals(self.U)
        self.r = chart.cell.task.r
        self._last: Array | None = None
        self._value: tuple[Array, _Value] | None = None
        self._model: tuple[_Value, tuple[Array, Array]] | None = None

    def value(self, a: Array) -> _Value:
        """Evaluate the cost at coefficients a (N, r), with the configurations of F.

        The cost is infinite if F does not exist at some node or penalised pose. The last result is
        cached, because a minimisation may begin at the coefficients of a previous call.
        """
        if self._value is None or not np.array_equal(self._value[0], a):
            self._value = a.copy(), self._evaluated(a)
        return self._value[1]

    def _evaluated(self, a: Array) -> _Value:
        """Evaluate the cost at coefficients a (N, r), as :meth:`value` does, without its cache."""
        s, ds = self.T @ a, np.einsum("KNk,Nr->Krk", self.dT, a)
        points = self.chart.solve(self.U, s, self._last, goals=self.goals)
        if not points.found.all():
            points = self.chart.solve(self.U, s, goals=self.goals)
        if not points.found.all():
            return _Value(np.inf, np.inf, np.nan, points, ds)
        own, desired, B = self._joint_speeds(rows_of(points, self.inner), ds[self.inner])
        residual = own - desired
        squares = (residual**2).sum(axis=(1, 2))
        nearness = float(squares.sum() / len(own))
        if not np.isfinite(nearness):
            return _Value(np.inf, np.inf, np.nan, points, ds)
        self._last = points.Q
        hinges = [_hinge(part, points.Q[at]) for part, at in self.kept]
        penalty = self.weight * sum(float((hinge**2).sum() / len(hinge)) for hinge in hinges)
        usual = (desired**2).sum(axis=(1, 2))
        cost = float((self.shares * squares).sum() / len(own)) + penalty
        excess, mean = squares / usual, float(usual.sum() / len(own))
        return _Value(cost, nearness, mean, points, ds, excess, residual, B)

    def model(self, at: _Value) -> tuple[Array, Array]:
        """Evaluate the gradient (N r,) and the Gauss–Newton Hessian (N r, N r) of the cost.

        ``at`` is the evaluated cost at the coefficients a (N, r). The residual (∂F − G_d E) C at a
        node depends on a only through s and ∂s/∂u there. The residual is linear in ∂s/∂u, with the
        matrix ∂F/∂s. The derivative of the residual with respect to s is computed by central
        differences. A margin depends on s only. The last result is cached.
        """
        if self._model is None or self._model[0] is not at:
            self._model = at, self._modelled(at)
        return self._model[1]

    def _modelled(self, at: _Value) -> tuple[Array, Array]:
        """Evaluate the gradient (N r,) and the Gauss–Newton Hessian (N r, N r) of the cost.

        ``at`` is the evaluated cost. :meth:`model` is the same with a cache.
        """
        r = self.r
        k = self.rates.C.shape[2]  # the coordinates removed by a symmetry count, too
        p = r * (1 + k)
        gram = np.zeros((len(self.U), p, p))
        slope = np.zeros((len(self.U), p))
        gram[self.inner], slope[self.inner] = self._nearness_terms(at)
        at_s = np.arange(r) * (1 + k)
        for part, where in self.kept:
            squares, slopes = self._penalty_terms(at, part, where)
            gram[where, at_s[:, None], at_s] = squares
            slope[where, at_s] = slopes
        features = self._features
        gradient = 2 * np.einsum(
            "KpN,Krp->Nr", features, slope.reshape(-1, r, 1 + k), optimize=True
        )
        L = np.linalg.cholesky(gram + 1e-12 * np.trace(gram, axis1=1, axis2=2).mean() * np.eye(p))
        return gradient.ravel(), 2 * _products(features, L, r)

    @cached_property
    def _features(self) -> Array:
        """Stack the monomials, then their slopes along the columns of C: (K + L, 1 + k + l, N).

        The K nodes come first, then the L penalised poses, where the slopes are 0. Multiplied by
        the coefficients a, the monomials give s, and the slopes give ∂s/∂u C at the nodes.
        """
        features = np.zeros((len(self.U), 1 + self.rates.C.shape[2], self.T.shape[1]))
        features[:, 0] = self.T
        onto = self.rates.C[:, : self.chart.cell.k]
        features[self.inner, 1:] = np.swapaxes(self.dT[self.inner] @ onto, 1, 2)
        return features

    def _nearness_terms(self, at: _Value) -> tuple[Array, Array]:
        """Evaluate MᵀM (K, p, p) and Mᵀ residual (K, p) at the K nodes, weighted as in the cost.

        Both are multiplied by the weight of the node, an entry of ``shares``, divided by K. M is
        the derivative of a node's residual with respect to p = r (1 + k + l) numbers. These are,
        for each component s_j of the label at the node, s_j itself and the k + l entries of
        ∂s_j/∂u C.
        """
        points, ds = rows_of(at.points, self.inner), at.ds[self.inner]
        residual, B = at.residual, at.B
        K, n, k = residual.shape
        M = np.zeros((K, n, k, self.r, 1 + k))
        M[..., 0] = self._slopes_along_s(points, ds, B)
        for c in range(k):
            M[:, :, c, :, 1 + c] = B
        flat = M.reshape(K, n * k, self.r * (1 + k))
        shares = self.shares / K
        slope = np.einsum("Kap,Ka->Kp", flat, residual.reshape(K, n * k))
        gram = np.swapaxes(flat, 1, 2) @ flat
        return gram * shares[:, None, None], slope * shares[:, None]

    def _slopes_along_s(self, points: Points, ds: Array, B: Array) -> Array:
        """Evaluate ∂(residual)/∂s_j (K, n, k + l, r) by central differences along the self-motion.

        B (K, n, r) is ∂F/∂s at the ``points``, and ``ds`` is ∂s/∂u there. The displaced
        configurations are first estimated along B, with an error of the order 1e-10. One Newton
        step then makes them exact to rounding.
        """
        s = np.einsum("Knr,Kn->Kr", points.n_ref, points.Q - points.q_ref)
        goals = rows_of(self.goals, self.inner)
        slopes = []
        for step in _DIFFERENCE * np.eye(self.r):
            up, down = (
                self.chart.solve(
                    points.U, s + w * step, points.Q + w * B @ step, goals=goals, iterations=1
                )
                for w in (1.0, -1.0)
            )
            change = self._residual(up, ds) - self._residual(down, ds)
            slopes.append(change / (2 * _DIFFERENCE))
        return np.stack(slopes, axis=-1)

    def _penalty_terms(self, at: _Value, part: Penalty, where: slice) -> tuple[Array, Array]:
        """Evaluate DᵀD (L, r, r) and Dᵀ hinge (L, r) of one penalty, weighted as in the cost.

        Here L counts the poses of this penalty. There are P hinges per pose, and D (L, P, r) are
        the derivatives of the hinges with respect to s. ``where`` selects the poses of this penalty
        from all poses of ``at``.
        """
        there = rows_of(at.points, where)
        hinge = _hinge(part, there.Q)
        onto = self.chart.derivative(there, at.ds[where])[1]
        D = -part.margin.slopes(there.Q, onto) * (hinge > 0)[:, :, None]
        share = self.weight / len(hinge)
        return share * np.swapaxes(D, 1, 2) @ D, share * np.einsum("KPr,KP->Kr", D, hinge)

    def _joint_speeds(self, points: Points, ds: Array) -> tuple[Array, Array, Array]:
        """Evaluate ∂F C and G_d E C (K, n, k + l) at nodes, and ∂F/∂s (K, n, r).

        The first two are the joint velocities of the function and of the desired inverse per unit
        of task speed. ``ds`` is ∂s/∂u at the nodes.
        """
        return self.chart.joint_speeds(self.desired, points, ds, self.rates)

    def _residual(self, points: Points, ds: Array) -> Array:
        """Evaluate the residual ``(∂F − G_d E) C`` at K nodes: (K, n, k + l).

        ``points`` are the configurations of F at the nodes, ``ds`` (K, r, k) is ∂s/∂u. The mean of
        the squared norm is the cost without penalties.
        """
        own, desired, _ = self._joint_speeds(points, ds)
        return own - desired


def _products(features: Array, L: Array, r: int) -> Array:
    """Evaluate ``Σ (Lᵀ f)ᵀ (Lᵀ f)`` over all poses, with f = blockdiag(features): (N r, N r).

    The result is half of the Hessian of the cost with respect to a. In this function, K is the
    number of all poses, K + L elsewhere, and k stands for k + l.

    Parameters
    ----------
    features : (K, 1 + k, N) array
        Monomials and their slopes, the same for each of the r components of the label s.
    L : (K, r (1 + k), r (1 + k)) array
        Per pose, the lower Cholesky factor of half of the Hessian with respect to s and ∂s/∂u C.
        The upper blocks of L are 0, so they are not multiplied.
    r
        Number of components of s.
    """
    p, N = features.shape[1:]
    rows = []
    for j in range(r):
        block = np.swapaxes(L[:, j * p : (j + 1) * p, : (j + 1) * p], 1, 2)
        rows.append(block @ features)  # (K, (j + 1) (1 + k), N)
    H = np.empty((N, r, N, r))
    for i in range(r):
        whole = rows[i].reshape(-1, N)
        for j in range(i, r):
            part = whole if j == i else rows[j][:, : (i + 1) * p].reshape(-1, N)
            H[:, i, :, j] = whole.T @ part
            H[:, j, :, i] = H[:, i, :, j].T
    return H.reshape(N * r, N * r)


def _hinge(part: Penalty, Q: Array) -> Array:
    """Evaluate the hinges ``max(0, asked − margin)`` of one penalty: (L, P).

    Q (L, n) are the configurations at the L poses of this penalty, with P margins per
    configuration.
    """
    return np.maximum(0.0, part.asked[:, None] - part.margin.measure(Q))


@dataclass(frozen=True, eq=False)
@read_only
class Descent:
    """Result of a minimisation of the cost of a function over its cell.

    Attributes
    ----------
    a : (N, r) array
        Final coefficients of the label s.
    value : _Value
        The cost at a, with the configurations of F.
    start : float
        The cost at the initial coefficients.
    steps : int
        Number of steps taken.
    """

    a: Array
    value: _Value
    start: float
    steps: int


def descend(cost: Cost, a: Array, *, enough: float = _ENOUGH) -> Descent:
    """Minimise the cost from coefficients a (N, r) of s(u), by the Levenberg–Marquardt method.

    Parameters
    ----------
    cost
        The cost.
    a
        Initial coefficients. If F with these coefficients does not exist at some node, the result
        has infinite cost.
    enough
        Relative decrease of the cost in one step below which the iteration ends.
    """
    found = levenberg_marquardt(_Problem(cost), a, _RULES, steps=_MOST, tolerance=enough)
    return Descent(found.at.x, found.at.data, found.start, found.steps)


class _Problem:
    """The cost as a problem for :func:`levenberg_marquardt`, which minimises it.

    Letters: g and H are gradient and Gauss–Newton Hessian of the cost, D a diagonal matrix that
    scales the damping.
    """

    def __init__(self, cost: Cost) -> None:
        self.cost = cost

    def evaluate(self, x: Array) -> Point[_Value]:
        """Evaluate the cost at coefficients x (N, r), with the configurations of the function.

        The cost is infinite if the function does not exist at some node.
        """
        value = self.cost.value(x)
        return Point(value.cost, value.cost, True, value, x)

    def merit(self, x: Array) -> float:
        """Evaluate the cost alone, as a number, at coefficients x (N, r)."""
        return self.cost.value(x).cost

    def model(self, at: Point[_Value]) -> tuple[Array, Array, Array]:
        """Evaluate g (N r,), H (N r, N r), and the diagonal (N r,) of D.

        ``at`` is the evaluated cost, g its gradient, and H its Gauss–Newton Hessian. The entries of
        all three are in the order of a (N, r), row by row. A small term is added to H, see
        :func:`_held`; D is the diagonal of H, with no entry of 0.
        """
        gradient, H = self.cost.model(at.data)
        return gradient, _held(H, at.data), _scaling(H)

    def step(self, model: tuple[Array, Array, Array], damping: float) -> Step:
        """Solve ``(H + μ D) dx = −g`` with μ = ``damping``, for one step of the minimisation.

        ``model`` is (g, H, D): gradient, Gauss–Newton Hessian, and the diagonal of the scaling D.
        """
        gradient, H, scale = model
        matrix = H + np.diag((damping + _REGULAR) * scale)
        dx = -np.asarray(np.linalg.solve(matrix, gradient), float)
        predicted = -0.5 * float(gradient @ dx)
        return Step(dx.reshape(-1, self.cost.r), predicted, damping)


def _scaling(H: Array) -> Array:
    """Return the diagonal (N r,) of H plus 1e-12 of its maximum, so that no entry is 0.

    H is the Hessian of the cost. The damping of a step is proportional to the result.
    """
    diagonal = np.diag(H)
    return diagonal + 1e-12 * diagonal.max()


def _held(H: Array, at: _Value) -> Array:
    """Add a small multiple of the identity to the Hessian H (N r, N r).

    The cost may hardly depend on some component of the label; the added term keeps this component
    from changing. In an axis task, for example, a joint that turns the tool about its axis changes
    the task coordinates only because the URDF is rounded, 1.5708 in place of π/2. Newton's step
    along such a joint would be a ratio of rounding errors. The term is proportional to
    ``at.desired_square`` of the evaluated cost ``at``.
    """
    return H + _IDLE * at.desired_square * np.eye(len(H))


def predicted_gain(cost: Cost, a: Array) -> float:
    """Predict by how much a Gauss–Newton step from coefficients a (N, r) would lower the cost.

    The result is the relative decrease, with which the fit decides whether a higher degree is
    worthwhile. The result is infinite if the function does not exist at some node.
    """
    value = cost.value(a)
    if not np.isfinite(value.cost):
        return np.inf
    gradient, H = cost.model(value)
    H = _held(H, value)
    step = np.linalg.solve(H + np.diag(_REGULAR * _scaling(H)), gradient)
    return float(0.5 * gradient @ step / value.cost)
