"""Lower bounds on the distances of body pairs, and on how fast each joint changes them.

Exact distances take long. The bounds show which of the many pairs can be the closest one, so that
few distances are computed. They also let a proof cover a whole box of configurations. Letters: K
configurations, N joints of the model, B bodies, P pairs of bodies.

``Joint`` is a joint of a URDF as plain data: its kind, links, axis, limits and mimic.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import Array
from ..native import BODY_TABLES, filled_struct, library
from .urdf import Joint

_Index = NDArray[np.intp]


class _JointPlacements:
    r"""Batched forward kinematics of joints, by array arithmetic.

    With P_j the rotation of joint j relative to its parent at q = 0, u the joint's unit axis, and
    [u] the matrix of the cross product with u, a revolute joint has the rotation

    .. math:: R_j = P_j (1 + \sin q \, [u] + (1 - \cos q) \, [u]^2)

    relative to its parent, and a prismatic joint translates by q u. A loop over configurations
    would be slower: Pinocchio needs 1 µs for each, but reading a placement from Python takes 2 µs.

    Parameters
    ----------
    model
        Model whose joints have one coordinate each.
    """

    def __init__(self, model: pin.Model) -> None:
        data = model.createData()
        self.parents = [int(parent) for parent in model.parents]
        here = model.jointPlacements
        pin.forwardKinematics(model, data, np.ones(model.nq))
        moved = [
            pin.log6(place.actInv(now)).vector for place, now in zip(here, data.liMi, strict=True)
        ]
        # q u, at q = 1; 0 for revolute joints
        self.slides = np.array([twist[:3] for twist in moved])
        # u; 0 for prismatic joints
        self.axes = np.array([twist[3:] for twist in moved])
        crosses = [pin.skew(axis) for axis in self.axes]
        self.fixed = np.array([place.homogeneous for place in here])
        P = self.fixed[:, :3, :3]
        self.sine = P @ np.array(crosses)
        self.versine = self.sine @ np.array(crosses)

    def __call__(self, Q: Array) -> tuple[Array, Array]:
        """Compute the placements of the N joints in the root frame at every row of Q (K, N).

        Return rotations (K, N + 1, 3, 3) and origins (K, N + 1, 3), m; index 0 is the root itself.
        """
        K, N = Q.shape
        R = np.empty((K, N + 1, 3, 3))
        p = np.zeros((K, N + 1, 3))
        R[:, 0] = np.eye(3)
        sin = np.sin(Q)[:, :, None, None]
        versine = (1 - np.cos(Q))[:, :, None, None]
        for j in range(1, N + 1):
            parent = self.parents[j]
            P = self.fixed[j, :3, :3]
            o = self.fixed[j, :3, 3]
            turn = P + sin[:, j - 1] * self.sine[j] + versine[:, j - 1] * self.versine[j]
            step = o + Q[:, j - 1, None] * (P @ self.slides[j])
            np.matmul(R[:, parent], turn, out=R[:, j])
            p[:, j] = p[:, parent] + (R[:, parent] @ step[:, :, None])[:, :, 0]
        return R, p


TELLING = 1e-6
"""Minimum distance between two centres at which their direction is well defined, m."""

APART = 1e-6
"""Error allowed to a measured distance, m."""

_LANES = 8
"""Number of corners per block in C, LANES of body_bounds.h."""

_FAST = 1e9
"""Rate of a joint with unbounded rates, m per rad or m."""

_NEARBY = 0.05
"""Relative motion of a pair's bodies since its last test, m, below which it may be measured."""

_KEPT, _CREDIT = 512, 8
"""Number of distances stored per pair; maximum excess of measurements over the tests they saved."""


class BodyBounds:
    """Lower bounds on the distances of pairs of convex bodies, from bounding spheres and boxes.

    With c_a and c_b the centres of two bodies and u = (c_a − c_b) / |c_a − c_b|, the body distance
    is at least

        |c_a − c_b| − h_a(u) − h_b(u),

    where h_a(u) bounds how far body a extends from its centre along u. It is the radius of the
    bounding sphere or, if smaller, Σ w_i |(Rᵀ u)_i| for the bounding box with half-widths w and
    rotation R. Centres and R are in the root frame. Most pairs are shown by this bound not to be
    the closest, in a fraction of the time of an exact distance.

    Parameters
    ----------
    model
        Model whose joints move the bodies; they have one coordinate each.
    joint
        Number, in the model, of the joint that carries each of the B bodies; 0 for the root.
    place
        Placement of each body relative to that joint.
    bodies
        Shape of each body, whose bounding box and sphere are computed.
    pairs
        Indices (P, 2) of the two bodies of each pair.
    only_contact
        Mask (P,) of the pairs that are checked for collisions only.
    """

    def __init__(
        self,
        model: pin.Model,
        joint: Sequence[int],
        place: Sequence[pin.SE3],
        bodies: Sequence[coal.CollisionGeometry],
        pairs: _Index,
        only_contact: NDArray[np.bool_],
    ) -> None:
        self._model, self._pairs, self._only_contact = model, pairs, only_contact
        self._placements = _JointPlacements(model)
        self._joint = np.array(joint, np.intp)
        centers = [at.act(body.aabb_center) for at, body in zip(place, bodies, strict=True)]
        boxes = [body.aabb_local for body in bodies]
        self._centers = np.array(centers).reshape(-1, 3)  # relative to the joint
        self._radii = np.array([body.aabb_radius for body in bodies])
        self._turns = np.array([at.rotation for at in place]).reshape(-1, 3, 3)
        self._half = np.array([(box.max_ - box.min_) / 2 for box in boxes]).reshape(-1, 3)
        self._corners = [
            _corners(body) @ at.rotation.T + at.translation
            for at, body in zip(place, bodies, strict=True)
        ]
        self._first, self._second = pairs.T
        self._rows, row = np.unique(self._first, return_inverse=True)
        self._columns, column = np.unique(self._second, return_inverse=True)
        self._flat = row * len(self._columns) + column
        self._reach = self._radii[self._first] + self._radii[self._second]
        self.tables = self._native_tables(place, bodies)

    @property
    def size(self) -> int:
        """Number of entries, per configuration, of the largest array that a call allocates.

        The caller divides many configurations into blocks that fit in memory.
        """
        return len(self._rows) * len(self._columns)

    def __call__(self, Q: Array) -> Array:
        """Compute lower bounds on the distances of all P pairs at Q (K, N): (K, P), m.

        Q has a value per joint of the model. Bounding boxes give tighter bounds than spheres, but
        take longer. So they are used only for pairs whose bound from the spheres is small: less
        than d/2, where d is the smallest distance between the two centres of any pair at that
        configuration. The C code in body_bounds.c does the same, and is used if it was built.
        """
        native = library()
        if native is not None:
            bounds = np.empty((len(Q), len(self._pairs)))
            self._call(native.body_bounds, Q, bounds)
            return bounds
        R, p = self._placements(Q)
        centers = np.einsum("kbij,bj->kbi", R[:, self._joint], self._centers) + p[:, self._joint]
        squares = np.einsum("kbi,kbi->kb", centers, centers)
        products = centers[:, self._rows] @ centers[:, self._columns].swapaxes(1, 2)
        products = products.reshape(len(Q), -1)[:, self._flat]  # (K, P)
        gaps = squares[:, self._first] + squares[:, self._second] - 2 * products
        gaps = np.sqrt(np.maximum(gaps, 0.0, out=gaps), out=gaps)
        bounds = gaps - self._reach
        k, pair = np.nonzero((bounds < gaps.min(axis=1, keepdims=True) / 2) & (gaps > TELLING))
        a, b = self._first[pair], self._second[pair]
        u = centers[k, a] - centers[k, b]
        gap = np.sqrt(np.einsum("mi,mi->m", u, u))
        u /= gap[:, None]
        bounds[k, pair] = gap - self._extent(R, k, a, u) - self._extent(R, k, b, u)
        return bounds

    def tighten(self, Q: Array, bounds: Array) -> Array:
        """Tighten the lower bounds (K, P), m, of the few pairs that can be the nearest at Q (K, N).

        The tighter bounds come from planes between two bodies instead of boxes. With them, seldom
        more than one distance per configuration is left to measure. A collision-only pair gets the
        bound inf if its bound excludes a collision. ``bounds`` is changed and returned. If the
        native library was not built, only the bounds of collision-only pairs are changed.
        """
        native = library()
        if native is None:
            bounds[self._only_contact & (bounds >= 0)] = np.inf
        else:
            self._call(native.tighten_bounds, Q, bounds)
        return bounds

    def _call(self, function: Any, Q: Array, bounds: Array) -> None:
        """Call a function of the library that sets or changes ``bounds`` (K, P) at Q (K, N), m."""
        Q = np.ascontiguousarray(Q, float)
        rows = (ctypes.c_void_p(array.ctypes.data) for array in (Q, bounds))
        count, telling = ctypes.c_long(len(Q)), ctypes.c_double(TELLING)
        function(ctypes.byref(self.tables), count, telling, *rows)

    def _native_tables(
        self, place: Sequence[pin.SE3], bodies: Sequence[coal.CollisionGeometry]
    ) -> Any:
        """Create the struct :data:`BODY_TABLES` of these joints, bodies and pairs, for C.

        ``place`` and ``bodies`` are those of :class:`BodyBounds`.
        """
        joints = self._placements
        ints: dict[str, ArrayLike] = {"parent": joints.parents, "joint": self._joint}
        ints |= {"first": self._first, "second": self._second}
        P = joints.fixed[:, :3, :3]
        reals: dict[str, ArrayLike] = {"fixed": P, "sine": joints.sine, "versine": joints.versine}
        reals |= {"origin": joints.fixed[:, :3, 3]}
        reals |= {"slide": (P @ joints.slides[:, :, None])[:, :, 0]}
        reals |= {"centers": self._centers, "radii": self._radii}
        reals |= {"turns": self._turns, "halves": self._half}
        sums = [_as_sum(body) for body in bodies]
        blocks = [
            _blocks(corners @ at.rotation.T + at.translation)
            for at, (corners, _, _) in zip(place, sums, strict=True)
        ]
        ints |= {"block": np.cumsum([0, *map(len, blocks)]), "only_contact": self._only_contact}
        reals |= {"corners": np.concatenate([np.empty((0, 3, _LANES)), *blocks])}
        reals |= {"ball": [ball for _, ball, _ in sums], "disc": [disc for *_, disc in sums]}
        reals |= {"axis": self._turns[:, :, 2]}
        sizes = {"joints": len(joints.parents) - 1, "bodies": len(self._joint)}
        return filled_struct(BODY_TABLES, ints, reals, sizes | {"pairs": len(self._pairs)})[0]

    def _extent(self, R: Array, k: _Index, body: _Index, u: Array) -> Array:
        """Bound how far M bodies extend from their centres along unit vectors u (M, 3): (M,), m.

        R (K, N + 1, 3, 3) are the rotations of all joints. ``k`` (M,) is the index of the
        configuration, and ``body`` (M,) that of the body.
        """
        local = np.einsum("mij,mi->mj", R[k, self._joint[body]], u)
        box = np.abs(np.einsum("mij,mi->mj", self._turns[body], local))
        return np.minimum(self._radii[body], np.einsum("mi,mi->m", box, self._half[body]))

    def reach(self, joints: Mapping[str, Joint], strokes: Array) -> Array:
        """Bound how fast each joint changes the distance of each pair: (P, N), m per rad or m.

        From q to q', the distances of the pairs change by at most ``reach @ |q − q'|`` (P,). So a
        single distance rules out collisions in a whole box of configurations. Per radian, a
        revolute joint moves a point by the point's distance from the joint's axis. For the joint
        that carries a body, this distance is largest at a corner of the body. For each joint before
        it in the chain, the distance is bounded by adding the lengths between the joints. The bound
        holds at every configuration whose prismatic joints are within ±``strokes`` (N,), m.
        ``joints`` are the joints of the robot, by name.
        """
        model = self._model
        movers = [set(model.supports[j]) - {0} for j in self._joint.tolist()]
        far_on_joint, off_axis = self._extents()
        steps = self._placements.fixed[:, :3, 3]
        lengths = np.linalg.norm(steps, axis=1).tolist()
        aside = self._off(self._placements.parents, steps).tolist()
        slides = [name in joints and joints[name].kind == "prismatic" for name in model.names]
        reach = np.zeros((len(self._pairs), model.nq))
        for row, (a, b) in zip(reach, self._pairs.tolist(), strict=True):
            for body, other in ((a, b), (b, a)):
                far, off = far_on_joint[body], off_axis[body]
                for j in sorted(movers[body] - movers[other], reverse=True):
                    row[j - 1] = 1.0 if slides[j] else off
                    far += strokes[j - 1] if slides[j] else 0.0
                    far, off = far + lengths[j], far + aside[j]
        return reach

    def _extents(self) -> tuple[list[float], list[float]]:
        """Bound how far each body extends from its joint's origin, and from its joint's axis.

        The result is two lists, in this order, with one number per body, m. For a prismatic joint,
        the second bound is the distance from the joint's origin, too.
        """
        joint = self._joint.tolist()
        spheres = np.linalg.norm(self._centers, axis=1) + self._radii
        far = [np.linalg.norm(points, axis=1).max() for points in self._corners]
        tubes = self._off(joint, self._centers) + self._radii
        off = [
            self._off([j] * len(points), points).max()
            for j, points in zip(joint, self._corners, strict=True)
        ]
        return np.minimum(spheres, far).tolist(), np.minimum(tubes, off).tolist()

    def _off(self, joint: Sequence[int], points: Array) -> Array:
        """Compute the distances of M points from the axes of M joints: (M,), m.

        ``joint`` has the numbers of the joints in the model, and ``points`` (M, 3) are in the
        frames of these joints, m. For a prismatic joint, the result is the distance from the
        joint's origin.
        """
        axes = self._placements.axes[joint]
        along = np.einsum("mi,mi->m", points, axes)
        return np.asarray(np.linalg.norm(points - along[:, None] * axes, axis=1))


def _as_sum(body: coal.CollisionGeometry) -> tuple[Array, float, float]:
    """Describe a body as the Minkowski sum of a convex hull, a ball, and a disc normal to z.

    Return the corners (M, 3) of the hull, in the frame of the body, and the radii of the ball and
    of the disc; all in m. A surface that is not convex is described by its bounding box.
    """
    if isinstance(body, coal.Sphere):
        return np.zeros((1, 3)), body.radius, 0.0
    if isinstance(body, coal.Capsule):
        return _ends(body), body.radius, 0.0
    if isinstance(body, coal.Cylinder):
        return _ends(body), 0.0, body.radius
    return _corners(body), 0.0, 0.0


def _ends(body: coal.Capsule | coal.Cylinder) -> Array:
    """List the ends of the axis of a capsule or cylinder: (2, 3), m."""
    return np.array([[0.0, 0.0, -body.halfLength], [0.0, 0.0, body.halfLength]])


def _blocks(corners: Array) -> Array:
    """Arrange corners (M, 3) in blocks, as C reads them: (⌈M / 8⌉, 3, 8), m.

    The last corner is repeated until the last block is full.
    """
    count = -(-len(corners) // _LANES)
    full = corners[np.minimum(np.arange(count * _LANES), len(corners) - 1)]
    return full.reshape(count, _LANES, 3).swapaxes(1, 2)


def _corners(body: coal.CollisionGeometry) -> Array:
    """List points whose convex hull contains a body: (M, 3), m, in the frame of the body.

    They are the vertices of a convex mesh, or else those of the bounding box.
    """
    if isinstance(body, coal.Convex):
        return np.array(body.points())
    box = body.aabb_local
    which = np.indices((2, 2, 2)).reshape(3, 8).T
    return np.where(which, box.max_, box.min_)


class KnownApart:
    r"""Memory of measured surface distances, which rule out contact at nearby configurations.

    Two surfaces with the distance d at a configuration x do not touch at any q with ρ·\|q − x\| <
    d, where ρ (N,) bounds how fast each joint changes the pair's distance. They do not touch on the
    straight line from x to q either, so no body gets inside another one. A pair is given by its
    index, 0 to P − 1.

    Parameters
    ----------
    reach
        Bounds (P, N) on how fast each joint changes the distance of each pair, m per rad or m.
    strokes
        Largest absolute value of each joint's position (N,) for which ``reach`` holds, m; inf for
        revolute joints.
    """

    def __init__(self, reach: Array, strokes: Array) -> None:
        # a joint with unbounded rates keeps a pair known only while it stands still
        self._reach = np.minimum(reach, _FAST)
        self._strokes = strokes
        self._tested: dict[int, Array] = {}
        self._credit: dict[int, int] = {}
        self._moves = [np.flatnonzero(rates) for rates in reach]
        self._known: dict[int, tuple[Array, Array]] = {}
        self._noted: dict[int, int] = {}

    def knows(self, pair: int, q: Array) -> bool:
        """Test whether a stored distance shows that the surfaces of a pair do not touch at q (N,).

        ``pair`` is the pair's index.
        """
        if pair not in self._known or (np.abs(q) > self._strokes).any():
            return False
        at, distances = self._known[pair]
        ways = np.abs(at - self._scaled(pair, q)).sum(axis=1)
        known = bool((ways < distances - APART).any())
        if known:
            self._credit[pair] = min(self._credit.get(pair, _CREDIT) + 1, _CREDIT)
        return known

    def pays(self, pair: int, q: Array) -> bool:
        """Record that a pair is tested at q (N,), and return whether to measure its distance too.

        Measuring takes longer than a test for contact, but can save further tests. It is worth the
        time if the pair moves little from test to test. So the result is True if two conditions
        hold. By the bounds ``reach``, the distance has changed by less than 5 cm since the pair's
        last test. And the credit of the pair is above 0. The credit begins at 8, its maximum. It
        falls by 1 when the result is True, and rises by 1 when a stored distance saves a test.
        """
        last, self._tested[pair] = self._tested.get(pair), q
        near = last is not None and float(np.abs(q - last) @ self._reach[pair]) < _NEARBY
        credit = self._credit.get(pair, _CREDIT)
        if near and credit > 0:
            self._credit[pair] = credit - 1
        return near and credit > 0

    def note(self, pair: int, q: Array, distance: float) -> None:
        """Store the surface distance, m, of a pair at q (N,); at most 512 per pair, the newest.

        Nothing is stored if a prismatic joint is beyond ``strokes``.
        """
        if (np.abs(q) > self._strokes).any():
            return
        if pair not in self._known:
            self._known[pair] = np.zeros((_KEPT, len(self._moves[pair]))), np.zeros(_KEPT)
        row = self._noted[pair] = (self._noted.get(pair, -1) + 1) % _KEPT
        at, distances = self._known[pair]
        at[row], distances[row] = self._scaled(pair, q), distance

    def _scaled(self, pair: int, q: Array) -> Array:
        """Return the products q_j ρ_j, m, at q (N,), one for each joint j that moves a pair.

        ``pair`` is the pair's index. A joint moves the pair if its bound ρ_j is not 0.
        """
        moves = self._moves[pair]
        return np.asarray(q[moves] * self._reach[pair, moves])


def strokes(model: pin.Model, joints: Mapping[str, Joint]) -> Array:
    """Compute the largest |q| that the limits allow for each joint: (N,), m; inf if revolute.

    A prismatic joint that mimics another also has inf.
    """
    kinds = (joints[name] for name in list(model.names)[1:])
    return np.array([_stroke(j) if j.kind == "prismatic" else np.inf for j in kinds])


def _stroke(joint: Joint) -> float:
    if joint.mimic is not None:
        return float(np.inf)
    return max(abs(joint.lower), abs(joint.upper))
