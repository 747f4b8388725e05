"""Plausibility checks of recorded frames: units, order of the joints, frame of the poses, times.

A frame is a row of a recording. A mistake in the recording, such as degrees or another tool frame,
would later give wrong joints without an error. So each check raises an InputError that names the
mistake. A session is one run of the recorder, such as a demonstration. Letters: Q (K, n),
configurations of n joints at K frames; p (K, 3), m, and R (K, 3, 3), positions and rotations of the
recorded poses. A difference of poses, ``miss`` in the code, is a pair (m, rad). The noise is the
median difference that remains after the best constant offset of the tool or the base.

``_Explanation`` is an explanation of a constant offset, its remedy, and the difference that
remains.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from ...base.arguments import Array, percentage, row
from ...base.errors import InputError
from ...model.chain_formulas import rotation_vectors
from ...model.length import arm_reach
from ...model.native_kinematics import placed
from ...model.rotations import matrix_quaternions, mean_rotation, quaternion_matrices
from ...model.task import Task

_SOME = 256
"""Maximum number of frames at which recorded joints and poses are compared."""

_APART_M, _APART_RAD = 0.05, 0.2
"""Median difference between forward kinematics and recorded poses above which they are refused."""

_CALIBRATED_M, _CALIBRATED_RAD = 3e-3, 0.01
"""Constant offsets of poses that are taken for the calibration of the arm, and not refused."""

_EXPLAINED = 1.5
"""Ratio of the misses without and with an offset from which the offset is not noise."""

_FEWEST = 4
"""Minimum number of frames at which an offset is distinguished from noise."""

_ALIKE_M, _ALIKE_RAD = 0.01, 0.05
"""Median difference below which a corrected reading of the numbers explains the poses."""

_OTHERS = (
    ": no offset of the tool or the base explains that, so the poses do not belong to these joints",
    "give the joints that move this frame, in order and in rad",
)
"""Explanation and remedy where the misses stay large after the best offset is taken out."""

_RARELY = 0.05
"""Fraction of the frames in which a joint may exceed its limits if their order is right."""

_BEYOND = 0.1
"""Distance beyond a joint limit that no calibration explains, rad or m."""


def require_metres(task: Task, p: Array) -> None:
    """Raise an InputError if positions p (K, 3), m, are far beyond the arm's reach.

    If they would be within reach as millimetres, the message says so.
    """
    q = np.array(task.reference)
    reach = arm_reach(task, q)
    away = float(np.median(np.linalg.norm(p - task.joint_origins(q)[0], axis=1)))
    if reach <= 0 or away < 20 * reach:
        return
    fact = (
        f"the positions are {away:.3g} m from the base in the median; the arm reaches {reach:.2g} m"
    )
    if away / 1000 < 1.5 * reach:
        raise InputError(f"{fact}: they look like millimetres", remedy="divide them by 1000")
    raise InputError(fact, remedy="give positions in m, in the frame of the base")


def require_radians(task: Task, Q: Array) -> None:
    """Raise an InputError if configurations (K, n) fit the joint limits only in degrees."""
    beyond = -task.limit_margin(Q)
    if float((beyond.max(axis=1) > _BEYOND).mean()) < 0.5 or not task.revolute.any():
        return
    converted = np.where(task.revolute, np.radians(Q), Q)
    size = float(np.abs(Q[:, task.revolute]).max())
    if size > 2 * np.pi and float((task.limit_margin(converted).min(axis=1) >= 0).mean()) > 0.9:
        raise InputError(
            f"the joints go to {size:.3g} and fit their limits only as degrees",
            remedy="convert them to rad",
        )


def require_limits(task: Task, Q: Array) -> None:
    """Raise an InputError if one joint exceeds its limits in most configurations Q (K, n).

    If the values fit the limits in another order of the joints, the message says so.
    """
    beyond = (-task.limit_margin(Q) > _BEYOND).mean(axis=0)
    joint = int(np.argmax(beyond))
    if beyond[joint] <= 0.5:
        return
    names = ", ".join(task.joint_names)
    share = percentage(beyond[joint])
    fact = f"{task.joint_names[joint]} is outside its limits in {share} of the frames"
    some = Q[np.linspace(0, len(Q) - 1, min(_SOME, len(Q))).astype(int)]
    for order in _orders(task.n):
        if ((-task.limit_margin(some[:, order]) > _BEYOND).mean(axis=0) <= _RARELY).all():
            raise InputError(
                f"{fact}; the values fit in another order of the joints",
                remedy=f"give the joints in the order {names}",
            )
    raise InputError(fact, remedy=f"check that these are the joints {names}, and their units")


def require_agreement(task: Task, Q: Array, p: Array, R: Array, *, quaternions: bool) -> None:
    """Raise an InputError if recorded poses differ from the forward kinematics of recorded joints.

    A constant offset of the tool or of the base is refused if it is larger than the noise, and also
    larger than an arm's calibration usually corrects, 3 mm or 0.01 rad. Any other difference is
    refused if its median over the frames is above 0.05 m or 0.2 rad. If a mistake in the numbers
    would explain the difference, the message names the mistake.

    Parameters
    ----------
    task
        The task.
    Q, p, R : (K, n), (K, 3) and (K, 3, 3) arrays
        Configurations, positions and rotations at the same recorded frames.
    quaternions
        True if R comes from quaternions, whose order may be wrong.
    """
    some = np.linspace(0, len(Q) - 1, min(_SOME, len(Q))).astype(int)
    Q = Q[some]
    p = p[some]
    R = R[some]
    by = _distance(task, Q, p, R)
    offset = _offset(task, Q, p, R)
    if by[0] <= _APART_M and by[1] <= _APART_RAD and offset is None:
        return
    why, remedy = _explanation(task, Q, p, R, quaternions=quaternions)
    if not why and len(Q) >= _FEWEST:
        why, remedy = offset or _OTHERS
    angle = f" and {by[1]:.2g} rad" if task.kind.turns else ""
    raise InputError(
        f"forward kinematics of the joints misses the poses by {by[0]:.2g} m{angle} in the "
        f"median{why}",
        remedy=remedy,
    )


def _explanation(task: Task, Q: Array, p: Array, R: Array, *, quaternions: bool) -> tuple[str, str]:
    """Find a mistake in the recorded numbers that explains why joints and poses disagree.

    Other orders of the joints and, if ``quaternions``, quaternions that begin with qw are tried.
    ``quaternions`` is True if R (K, 3, 3) comes from quaternions. Return the explanation, empty if
    none is found, and the remedy, as texts for the error message.
    """
    few = slice(None, None, max(1, len(Q) // 16))
    for order in _orders(task.n):
        if _alike(_distance(task, Q[few][:, order], p[few], R[few])):
            names = ", ".join(task.joint_names)
            return (": the joints are in another order", f"give them in the order {names}")
    turned = _first_is_w(R)
    if quaternions and _alike(_distance(task, Q, p, turned)):
        return ": the quaternions begin with qw", "give qx, qy, qz, qw"
    return "", "check the frame, the units and the order of the joints"


def _offset(task: Task, Q: Array, p: Array, R: Array) -> tuple[str, str] | None:
    """Find a constant offset of the tool or of the base; return its description and the remedy.

    Q are the recorded joints, p and R the recorded poses. Three offsets are fitted: another frame
    of the tool, a shift of the base, and a shift with a rotation of the base. A later one of these
    is used only if it leaves a clearly smaller difference. If the one that is used still leaves
    more than 0.05 m or 0.2 rad, the text says that no offset explains the difference. Return None
    if the poses differ by no more than the noise or the usual corrections by calibration, or if
    there are fewer than four frames.
    """
    if len(Q) < _FEWEST:
        return None
    p_own, R_own, _ = placed(task, Q)
    rows = list(task.rows[: min(3, task.m)])
    without = _miss(task, p, R, p_own, R_own)
    found = [
        _other_frame(task, p, R, p_own, R_own, rows),
        _other_base(task, p, R, p_own, R_own, rows, np.eye(3)),
        _other_base(task, p, R, p_own, R_own, rows, _base_rotation(task, p, R, p_own, R_own, rows)),
    ]
    best = found[0]
    for other in found[1:]:
        if 1.05 * _size(other.miss) + 1e-3 < _size(best.miss):
            best = other
    free = len(Q) * len(rows)
    least = _EXPLAINED * np.sqrt(free / (free - min(6, 2 * len(rows))))  # an offset fits noise
    shifted = without[0] > max(_CALIBRATED_M, least * best.miss[0])
    turned = without[1] > max(_CALIBRATED_RAD, least * best.miss[1])
    if not (shifted or turned):
        return None
    if best.miss[0] > _APART_M or best.miss[1] > _APART_RAD:
        return _OTHERS
    return best.why, best.remedy


class _Explanation(NamedTuple):
    """Explanation of a constant offset.

    ``why`` is a text that completes an error message, ``remedy`` the instruction that follows it,
    and ``miss`` (m, rad) the difference that the explanation leaves.
    """

    why: str
    remedy: str
    miss: tuple[float, float]


def _other_frame(
    task: Task, p: Array, R: Array, p_own: Array, R_own: Array, rows: list[int]
) -> _Explanation:
    """Fit another frame of the tool: ``p = p_own + R_own d``, ``R = R_own D``.

    d (3,), m, and D (3, 3) are the position and rotation of the other frame in the frame of the
    task. p (K, 3) and R (K, 3, 3) are the recorded poses, p_own and R_own those by forward
    kinematics. ``rows`` are the components of the position that the task commands.
    """
    d = np.linalg.lstsq(R_own[:, rows].reshape(-1, 3), (p - p_own)[:, rows].ravel(), rcond=1e-6)[0]
    D = mean_rotation(np.swapaxes(R_own, 1, 2) @ R) if task.kind.turns else np.eye(3)
    at = row(np.round(d, 3) + 0.0)
    why = f": the poses are of a frame at {at} m in {task.frame}{_turned(D)}"
    return _Explanation(why, "name that frame", _miss(task, p, R, p_own + R_own @ d, R_own @ D))


def _other_base(
    task: Task, p: Array, R: Array, p_own: Array, R_own: Array, rows: list[int], B: Array
) -> _Explanation:
    """Explain a difference by another base, with the given rotation B (3, 3) and a fitted shift t.

    Then ``p = B p_own + t`` and ``R = B R_own``. Return the explanation, with the difference that
    remains. p (K, 3) and R (K, 3, 3) are the recorded poses, p_own and R_own those by forward
    kinematics. ``rows`` are the components of the position that the task commands.
    """
    t = np.zeros(3)
    t[rows] = (p - p_own @ B.T).mean(axis=0)[rows]
    at = row(np.round(t, 3) + 0.0)
    why = f": the poses are in another base frame, shifted by {at} m{_turned(B)}"
    return _Explanation(why, "name that base", _miss(task, p, R, p_own @ B.T + t, B @ R_own))


def _size(miss: tuple[float, float]) -> float:
    """Combine a difference (m, rad) into one number, by which explanations are compared.

    Metres are divided by 3 mm and radians by 0.01 rad, the usual corrections by the calibration of
    an arm. The result is the sum of both.
    """
    return miss[0] / _CALIBRATED_M + miss[1] / _CALIBRATED_RAD


def _turned(R: Array) -> str:
    angle = float(np.linalg.norm(rotation_vectors(R[None])))
    return f", turned by {angle:.2g} rad" if angle > _CALIBRATED_RAD else ""


def _base_rotation(
    task: Task, p: Array, R: Array, p_own: Array, R_own: Array, rows: list[int]
) -> Array:
    """Find the rotation B (3, 3) from the arm's base to the base of recorded poses p, R.

    p_own and R_own are the poses by forward kinematics. For a pose task ``R ≈ B R_own``; otherwise
    B is found from the positions alone, in the coordinates ``rows`` that the task commands.
    """
    if task.m == 6:
        return mean_rotation(R @ np.swapaxes(R_own, 1, 2))
    a, b = (x[:, rows] - x[:, rows].mean(axis=0) for x in (p_own, p))
    U, _, Vt = np.linalg.svd(b.T @ a)
    signs = np.ones(len(rows))
    signs[-1] = np.linalg.det(U @ Vt)
    B = np.eye(3)
    if len(rows) > 1:
        B[np.ix_(rows, rows)] = U @ np.diag(signs) @ Vt
    return B


def _orders(n: int) -> list[list[int]]:
    """List orders of n joints to try: reversed, shifted cyclically, and with two joints exchanged.

    These are the usual mistakes. An order is a list of n indices: entry i is the column of the
    recorded joints that is taken as joint i. It is right if these joints agree with the poses.
    """
    plain = list(range(n))
    orders = [plain[::-1]] + [plain[i:] + plain[:i] for i in range(1, n)]
    for i, j in combinations(range(n), 2):
        swapped = plain.copy()
        swapped[i], swapped[j] = j, i
        orders.append(swapped)
    return orders


def _first_is_w(R: Array) -> Array:
    """Return the rotations (K, 3, 3) that the file meant if its quaternions begin with qw.

    ``R`` are the rotations that were read with qw as the last number.
    """
    x = matrix_quaternions(R)
    return quaternion_matrices(x[:, [1, 2, 3, 0]])


def _distance(task: Task, Q: Array, p: Array, R: Array) -> tuple[float, float]:
    """Compute the median differences, (m, rad), of poses p, R from the forward kinematics of Q."""
    p_own, R_own, _ = placed(task, Q)
    return _miss(task, p, R, p_own, R_own)


def _miss(task: Task, p: Array, R: Array, p_own: Array, R_own: Array) -> tuple[float, float]:
    """Compute the median differences, (m, rad), between poses p, R and p_own, R_own.

    Only the task's components count: the angle is 0 for a position task, and that between the tool
    axes for an axis task.
    """
    rows = task.rows[: min(3, task.m)]
    distance = float(np.median(np.linalg.norm((p - p_own)[:, rows], axis=1)))
    if not task.kind.turns:
        return distance, 0.0
    if task.kind.tool_axes:
        cosine = np.einsum("Ka,Ka->K", R_own[:, :, 2], R[:, :, 2]).clip(-1, 1)
        return distance, float(np.median(np.arccos(cosine)))
    turn = rotation_vectors(R @ np.swapaxes(R_own, 1, 2))
    return distance, float(np.median(np.linalg.norm(turn, axis=1)))


def _alike(by: tuple[float, float]) -> bool:
    """Test whether joints and poses agree: median differences ``by`` below (0.01 m, 0.05 rad)."""
    return by[0] < _ALIKE_M and by[1] < _ALIKE_RAD


def require_increasing(times: Array, sessions: Array, *, split: bool) -> None:
    """Raise an InputError if times (K,) do not increase within each session of the recording.

    ``sessions`` (K,) is the index of each frame's session; ``split`` is True if there are several.
    The error's attribute ``at`` is the index of a frame whose time is not later than that of the
    preceding frame of its session.
    """
    order = np.argsort(sessions, kind="stable")
    late = (np.diff(times[order]) <= 0) & (np.diff(sessions[order]) == 0)
    if not late.any():
        return
    k = int(np.argmax(late))
    before, after = times[order[k]], times[order[k + 1]]
    remedy = "sort the frames by time" + ("" if split else ", or number the sessions")
    raise InputError(
        f"the time {after:.6g} s follows {before:.6g} s, but must increase within a session",
        remedy=remedy,
        at=int(order[k + 1]),
    )
