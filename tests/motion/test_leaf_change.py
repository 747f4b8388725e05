"""Self-motion to another leaf, as a servo commands it: the frame rests, the limits hold, and the
leaf is reached."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from arms import Q_PANDA, planar_urdf
from controls import control
from proofs import design_of

import repctl_pin as rp
from repctl_pin.extensions.integrations.servo import Servo, State
from repctl_pin.extensions.runtime.leaf_change import leaf_change
from repctl_pin.motion.limits import joint_limits

pytestmark = pytest.mark.filterwarnings("ignore:.*Python serves")
RATE = 200.0
Q0 = np.array([0.3, 0.8, 0.8])


@pytest.fixture(autouse=True)
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """These motions are Python's own, and compiling takes longer than they do."""
    monkeypatch.setenv("CC", "no-such-compiler")


def planar() -> rp.RepeatableInverse:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    return control(task, Q0, rp.Polynomial(Q0, 2, 0.5))


def panda() -> rp.RepeatableInverse:
    task = rp.Robot.load("panda").task("panda_hand_tcp", "position")  # r = 4
    return control(task, Q_PANDA, rp.Polynomial(Q_PANDA, 2, 0.5))


def changed(
    inverse: rp.RepeatableInverse,
    q: np.ndarray,
    leaf: np.ndarray,
    *,
    region: rp.Box | None = None,
    limits: rp.Limits | None = None,
) -> tuple[np.ndarray, Servo]:
    """Commands of a servo that is told another leaf, and the target where it is."""
    region = region or rp.Box(q, 9.0)
    design = design_of(inverse.task, inverse.potentials, region)
    servo = Servo(design, RATE, limits or rp.Limits(velocity=1.0, acceleration=1.0))
    place, Q, now = inverse.task.placement(q), [q], 0.0
    told = False
    while now < 30:
        now += 1 / RATE
        servo.joints(dict(zip(inverse.task.joint_names, Q[-1], strict=True)), now)
        following = servo.tick(now)
        Q += [] if following is None else [following]
        if servo.state is State.RUNNING and not told:
            told = servo.leaf(leaf) == ""
            servo.pose(place.translation, (0, 0, 0, 1))
        elif told and (servo.state is State.HOLDING or at(inverse, Q[-1], leaf)):
            break
    return np.array([*Q, *[servo.tick(now) for _ in range(3)]]), servo


def at(inverse: rp.RepeatableInverse, q: np.ndarray, leaf: np.ndarray) -> bool:
    return bool(np.abs(inverse.leaf(q) - leaf).max() < 1e-9)


@pytest.mark.parametrize(("make", "q"), [(planar, Q0), (panda, Q_PANDA)])
@pytest.mark.parametrize("jerk", [None, 300.0])
def test_pieces_lead_to_the_leaf(
    make: Callable[[], rp.RepeatableInverse], q: np.ndarray, jerk: float | None
) -> None:
    inverse = make()
    place = inverse.task.placement(q).translation
    limits = rp.Limits(velocity=0.5, acceleration=4.0, jerk=jerk)
    wanted = inverse.leaf(q) + 0.15
    Q, servo = changed(inverse, q, wanted, limits=limits)
    assert servo.state is State.RUNNING and at(inverse, Q[-1], wanted)
    off = [inverse.task.placement(p).translation - place for p in Q]
    assert np.abs(off).max() < 1e-10
    levels = np.array([inverse.leaf(p) for p in Q])
    assert (np.diff(levels, axis=0) > -1e-12).all()  # straight there
    share = (levels - levels[0]) / 0.15
    assert np.ptp(share, axis=1).max() < 1e-9
    Q = np.concatenate([np.tile(q, (3, 1)), Q])
    used = [
        np.abs(np.diff(Q, k, axis=0)).max() * RATE**k / most
        for k, most in enumerate((0.5, 4.0, jerk or np.inf), 1)
    ]
    assert 0.5 < max(used) <= 1 + 1e-9
    still = (np.diff(Q, axis=0) == 0).all(axis=1)
    rests = np.flatnonzero(still[1:] & ~still[:-1])
    assert np.abs(np.diff(Q[[0, *rests]], axis=0)).max() <= 0.1  # from rest to rest


def test_a_motion_out_of_omega_or_the_limits_is_refused(tmp_path: Path) -> None:
    inverse, refused = planar(), "leaf refused: the motion to the leaf would leave "
    wanted = inverse.leaf(Q0) + 0.1
    Q, servo = changed(inverse, Q0, wanted, region=rp.Box(Q0, 0.03))
    assert servo.reason.startswith(refused + "Ω;") and (Q == Q0).all()
    file = tmp_path / "narrow.urdf"
    file.write_text(planar_urdf((1.0, 1.0, 1.0), range_=0.82), encoding="utf-8")
    task = rp.Robot.load(file).task("tool", "xy")
    for away in (0.1, -0.1):
        inverse = control(task, Q0, rp.Polynomial(Q0, 2, 0.5))
        Q, servo = changed(inverse, Q0, inverse.leaf(Q0) + away)
        assert servo.reason.startswith(refused + "the limits of 'theta")
        assert (Q == Q0).all()


def test_an_end_outside_omega_by_half_a_millionth_is_refused() -> None:
    """Item 26.23: the end was accepted up to 1e-6 outside Ω, where a governor cannot start."""
    inverse = planar()
    limits = joint_limits(inverse.task, rp.Limits(velocity=0.5, acceleration=4.0, jerk=300.0))
    wanted = inverse.leaf(Q0) + 0.02
    end = leaf_change(inverse, Q0, wanted, limits, 1 / RATE)[-1]
    far = np.abs(end - Q0).max()

    def within(ratio: float) -> rp.RepeatableInverse:
        region = rp.Box(Q0, far / ratio)
        return rp.RepeatableInverse(inverse.task, inverse.potentials, region=region)

    with pytest.raises(rp.InputError, match="would leave Ω"):
        leaf_change(within(1 + 5e-7), Q0, wanted, limits, 1 / RATE)
    inside = within(1 - 1e-6)
    governor = rp.Governor(inside, 1 / RATE, rp.Limits(acceleration=4.0))
    governor.start(leaf_change(inside, Q0, wanted, limits, 1 / RATE)[-1])


@pytest.mark.parametrize("rate", [100.0, 200.0, 1000.0])
def test_called_again_it_keeps_the_jerk_limit_at_the_junction(rate: float) -> None:
    """Item 26.23: the third difference across two parts was up to 6 % above the limit."""
    inverse, jerk = planar(), 300.0
    limits = joint_limits(inverse.task, rp.Limits(velocity=0.5, acceleration=4.0, jerk=jerk))
    wanted, q, parts = inverse.leaf(Q0) + 0.2, Q0, [np.tile(Q0, (3, 1))]
    while not at(inverse, q, wanted):
        parts.append(leaf_change(inverse, q, wanted, limits, 1 / rate))
        q = parts[-1][-1]
    assert len(parts) > 2
    used = np.abs(np.diff(np.vstack(parts), 3, axis=0)).max() * rate**3 / jerk
    assert 0.3 < used <= 1 + 1e-9
