"""Forward kinematics and Jacobian of a task as unrolled, straight-line C."""

from __future__ import annotations

from collections.abc import Sequence
from operator import mul

import numpy as np

from ....arguments import Array
from ....model.joint_chain import joint_chain
from ....model.task import Task
from .expressions import Expression, Graph, assignments

_Vector = list[Expression]
_Matrix = list[_Vector]


class ChainExpressions:
    """Kinematics of a task's chain as expressions in ``q[0]`` … ``q[n − 1]``.

    Attributes
    ----------
    p : (3,) expressions
        Position of the frame's origin, m.
    R : (3, 3) expressions
        Orientation of the frame.
    J : (m, n) expressions
        Jacobian of ``ẋ = J q̇`` (2), rows as in :class:`repctl_pin.model.task.Task`. For a task in
        other joint coordinates ψ, q stands for ψ.
    angles : list of expressions
        Angles of the revolute joints if ``lanes``, in which case their sines and cosines are
        inputs; otherwise empty.

    Parameters
    ----------
    task
        The task.
    lanes
        Write code for several poses at a time: every variable has one value per pose l, and joint
        i is ``x[i][l]``.
    """

    def __init__(self, task: Task, *, lanes: bool = False) -> None:
        self.graph, self.lanes, self.angles = Graph(), lanes, _Vector()
        q = [
            self.graph.input(f"x[{i}][l]" if lanes else f"q[{i}]")
            for i in range(task.n)
        ]
        drive, joints = task.drive, q
        if drive is not None:
            rows = zip(drive.S, drive.offset, strict=True)
            joints = [
                self._weighted(row, q) + self.graph.number(offset)
                for row, offset in rows
            ]
        chain = joint_chain(task)
        *places, frame = zip(chain.R, chain.p, strict=True)
        self.p = self._numbers(np.zeros(3))
        self.R = [self._numbers(row) for row in np.eye(3)]
        axes: list[
            tuple[bool, _Vector, _Vector]
        ] = []  # revolute or not, axis, and position
        turned = np.eye(3)  # from the joint's axes to axes with z along the joint
        for angle, turns, axis, (rotation, translation) in zip(
            joints, chain.revolute, chain.axes, places, strict=True
        ):
            B = _z_along(axis)
            self._fixed(turned.T @ rotation @ B, turned.T @ translation)
            axes.append((turns, [row[2] for row in self.R], self.p))
            if turns:
                self._turn(angle)
            else:
                self.p = [
                    p + z * angle for p, z in zip(self.p, axes[-1][1], strict=True)
                ]
            turned = B
        self._fixed(turned.T @ frame[0], turned.T @ frame[1])
        columns = [self._column(*axis) for axis in axes]
        J = [[column[i] for column in columns] for i in range(6)]
        if task.kind == "axis":  # ω along the frame's own x and y
            axes_of_frame = [[row[k] for row in self.R] for k in range(2)]
            J[3:] = [
                [self.graph.total(map(mul, axis, c[3:])) for c in columns]
                for axis in axes_of_frame
            ]
        else:
            J = [J[row] for row in task.rows]
        self.J = (
            J
            if drive is None
            else [[self._weighted(column, row) for column in drive.S.T] for row in J]
        )

    def _column(self, turns: bool, z: _Vector, o: _Vector) -> _Vector:
        """Compute the frame's twist (v, ω) per unit speed of a joint with axis z through o."""
        if not turns:
            return [*z, *self._numbers(np.zeros(3))]
        d = [a - b for a, b in zip(self.p, o, strict=True)]
        return [
            z[1] * d[2] - z[2] * d[1],
            z[2] * d[0] - z[0] * d[2],
            z[0] * d[1] - z[1] * d[0],
            *z,
        ]

    def _fixed(self, rotation: Array, translation: Array) -> None:
        self.p = [
            p + self._weighted(translation, row)
            for p, row in zip(self.p, self.R, strict=True)
        ]
        self.R = [
            [self._weighted(column, row) for column in rotation.T] for row in self.R
        ]

    def _turn(self, angle: Expression) -> None:
        """Rotate the frame about its z axis: ``R ← R R_z(angle)``."""
        c, s = self._cosine_and_sine(angle)
        self.R = [[x * c + y * s, y * c - x * s, z] for x, y, z in self.R]

    def _cosine_and_sine(self, angle: Expression) -> _Vector:
        if not self.lanes or angle.kind == "number":
            return [self.graph.function(name, angle) for name in ("cos", "sin")]
        j = len(self.angles)
        self.angles.append(angle)
        return [self.graph.input(f"{name}[{j}][l]") for name in ("cosine", "sine")]

    def _weighted(self, weights: Array, terms: _Vector) -> Expression:
        return self.graph.total(
            self.graph.number(w) * t for w, t in zip(weights, terms, strict=True)
        )

    def _numbers(self, values: Array) -> _Vector:
        return [self.graph.number(v) for v in values]

    def code(self) -> dict[str, str]:
        """Write C assignments of ``p[3]``, ``R[9]`` and ``J[m][n]``.

        Returns three texts by name: ``placement`` (p and R), ``jacobian`` (J) and ``chain`` (all).
        """
        p = {f"p[{i}]": e for i, e in enumerate(self.p)}
        R = {
            f"R[{3 * i + k}]": e
            for i, row in enumerate(self.R)
            for k, e in enumerate(row)
        }
        J = {
            f"J[{a}][{i}]": e for a, row in enumerate(self.J) for i, e in enumerate(row)
        }
        return {
            "placement": assignments(p | R),
            "jacobian": assignments(J),
            "chain": assignments(p | R | J),
        }

    def lane_code(
        self, row_of: Sequence[int], column_of: Sequence[int]
    ) -> tuple[str, str, str]:
        """Write C assignments for several poses: three texts.

        The first assigns ``angle``, the angles of the revolute joints; the second ``here``, which
        is p and R (12 numbers); the third ``here`` and J. J is written into the matrix A: its row a
        and column i go to ``A[row_of[a]][column_of[i]]``.
        """
        angles = {f"angle[{j}][l]": e for j, e in enumerate(self.angles)}
        entries = [*self.p, *(e for row in self.R for e in row)]
        here = {f"here[{i}][l]": e for i, e in enumerate(entries)}
        A = {
            f"A[{row_of[a]}][{column_of[i]}][l]": e
            for a, row in enumerate(self.J)
            for i, e in enumerate(row)
        }
        angle, place, whole = (
            assignments(part, " " * 12) for part in (angles, here, here | A)
        )
        return angle, place, whole


def _z_along(axis: Array) -> Array:
    """Compute a rotation (3, 3) whose third column is a given unit vector.

    Along the axes x, y and z, its entries are exactly 0, 1 and −1.
    """
    axis = np.where(np.abs(axis) < 1e-15, 0.0, axis) + 0.0
    k = int(np.argmax(np.abs(axis)))
    other = np.eye(3)[(k + 1) % 3]
    x = other - (other @ axis) * axis
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])
