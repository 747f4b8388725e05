"""Self-motion to another leaf: the frame rests, the limits hold, and the leaf is reached."""

from __future__ import annotations

import numpy as np
import pytest
from arms import Q_PANDA
from controls import control

import repctl_pin as rp
from repctl_pin.motion import leaf_change, profile

DT = 0.005
Q0 = np.array([0.3, 0.8, 0.8])


def planar(box: rp.Box | None = None) -> rp.RepeatableInverse:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    potentials = control(task, Q0, rp.Polynomial(Q0, 2, 0.5)).potentials
    return rp.RepeatableInverse(task, potentials, region=box)


def panda() -> rp.RepeatableInverse:
    task = rp.Robot.load("panda").task("panda_hand_tcp", "position")  # r = 4
    return control(task, Q_PANDA, rp.Polynomial(Q_PANDA, 2, 0.5))


@pytest.mark.parametrize(("make", "q"), [(planar, Q0), (panda, Q_PANDA)])
@pytest.mark.parametrize("jerk", [None, 300.0])
def test_pieces_lead_to_the_leaf(
    make: object, q: np.ndarray, jerk: float | None
) -> None:
    inverse = make()  # type: ignore[operator]
    n, place = inverse.task.n, inverse.task.placement(q).translation
    limits = profile.JointLimits(
        np.full(n, 0.5), np.full(n, 4.0), jerk=jerk and np.full(n, jerk)
    )
    wanted = inverse.leaf(q) + 0.15
    Q = q[None]
    while np.abs(inverse.leaf(Q[-1]) - wanted).max() > 1e-10:
        piece = leaf_change.leaf_change(inverse, Q[-1], wanted, limits, DT)
        assert np.abs(piece[-1] - Q[-1]).max() <= 0.1
        Q = np.concatenate([Q, piece])
    assert (
        np.abs([inverse.task.placement(p).translation - place for p in Q]).max() < 1e-10
    )
    levels = np.array([inverse.leaf(p) for p in Q])
    assert (np.diff(levels, axis=0) > -1e-12).all()  # straight there
    Q = np.concatenate([np.tile(q, (3, 1)), Q, np.tile(Q[-1], (3, 1))])
    shares = [np.abs(np.diff(Q, k, axis=0)).max() / DT**k for k in (1, 2, 3)]
    used = [shares[0] / 0.5, shares[1] / 4.0, shares[2] / (jerk or np.inf)]
    assert 0.5 < max(used) <= 1 + 1e-9


def test_a_motion_out_of_omega_or_the_limits_is_refused() -> None:
    limits = profile.JointLimits(np.ones(3), np.ones(3))
    with pytest.raises(rp.InputError, match="would leave Ω"):
        inverse = planar(rp.Box(Q0, 0.03))
        leaf_change.leaf_change(inverse, Q0, inverse.leaf(Q0) + 0.1, limits, DT)
    inverse = planar()
    q = Q0
    with pytest.raises(rp.InputError):
        for _ in range(200):
            q = leaf_change.leaf_change(inverse, q, [9.0], limits, 0.1)[-1]
