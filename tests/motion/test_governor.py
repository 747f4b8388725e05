"""The governor: limits on every sample from whatever comes in, and the way home afterwards."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA, planar_urdf
from cell_functions import function_of
from controls import control

import repctl_pin as rp

DT = 0.001
Q0 = np.array([0.3, 0.8, 0.8])
A, J = 6.0, 400.0
LOW = rp.Limits(acceleration=A, jerk=J)

Input = tuple["pin.SE3 | None", "np.ndarray | None"]


@cache
def planar(region: bool = False) -> rp.RepeatableInverse:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    inverse = control(task, Q0, rp.Polynomial(Q0, 2, 0.5))
    box = rp.Box(Q0, 0.1) if region else None
    return rp.RepeatableInverse(task, inverse.potentials, region=box)


def governed(jerk: float | None = J, *, region: bool = False, **more: float) -> rp.Governor:
    governor = rp.Governor(
        planar(region), DT, rp.Limits(velocity=2.0, acceleration=A, jerk=jerk), **more
    )
    governor.start(Q0)
    return governor


def moved(x: float = 0.0, y: float = 0.0) -> pin.SE3:
    """The start's placement, displaced."""
    place = planar().task.placement(Q0)
    return pin.SE3(place.rotation, place.translation + [x, y, 0.0])


def run(
    governor: rp.Governor, ticks: int, target: pin.SE3 | None = None, twist: object = None
) -> tuple[np.ndarray, list[rp.Status]]:
    """Ticks of one input, up to a target: the joints before and after each, and the statuses."""
    Q, said = [governor.q], []
    for _ in range(ticks):
        q, status = governor.step(target, twist)  # type: ignore[arg-type]
        Q.append(q)
        said.append(status)
        if target is not None and status is rp.Status.OK:
            break
    return np.array(Q), said


def used(
    Q: np.ndarray, velocity: float | np.ndarray, acceleration: float, jerk: float | None
) -> float:
    """Largest share of a limit that samples use, by their differences alone."""
    shares = [
        (np.abs(np.diff(Q, k, axis=0)) / DT**k / most).max()
        for k, most in enumerate((velocity, acceleration, jerk), 1)
        if most is not None
    ]
    return float(max(shares))


def inputs(rng: np.random.Generator, home: pin.SE3, ticks: int) -> Iterator[Input]:
    """Random targets, twists, reversals, jumps, garbage and nothing, held for some ticks."""
    hold, target, twist = 0, None, None
    for _ in range(ticks):
        if hold == 0:
            hold, kind = int(rng.choice([1, 3, 20, 100, 300])), int(rng.integers(7))
            target = None
            if kind < 3:
                p = home.translation + rng.normal(size=3) * rng.choice([0.02, 0.3, 5.0])
                target, twist = (
                    pin.SE3(pin.exp3(0.3 * rng.normal(size=3)) @ home.rotation, p),
                    None,
                )
            elif kind == 3 and twist is not None:
                twist = -twist
            elif kind < 6:
                twist = rng.normal(size=6) * rng.choice([0.01, 0.3, 100.0])
            else:
                twist = np.full(6, rng.choice([np.nan, np.inf, 1e200]))
        hold -= 1
        yield target, twist


@pytest.mark.parametrize("jerk", [J, pytest.param(None, marks=pytest.mark.slow)])
def test_no_limit_is_exceeded_and_the_same_pose_has_the_same_joints(jerk: float | None) -> None:
    governor, home = governed(jerk, margin=0.1), moved()
    rng = np.random.default_rng(9)
    Q = [governor.q]
    for target, twist in inputs(rng, home, 700):
        Q.append(governor.step(target, twist)[0])
    back, said = run(governor, 4000, home)
    Q_all, task = np.vstack([np.tile(Q0, (3, 1)), Q, back[1:]]), governor._task
    assert used(Q_all, 2.0, A, jerk) <= 1 + 1e-9
    assert np.ptp(Q_all, axis=0).max() > 0.3  # it does move
    assert task.limit_margin(Q_all).min() >= 0.1 - 1e-9
    leaves = [planar().leaf(q) for q in Q_all[::20]]
    assert np.abs(leaves - governor.leaf).max() < 1e-9
    assert said[-1] is rp.Status.OK and np.abs(back[-1] - Q0).max() < 1e-6


def test_a_straight_line_is_followed_at_the_speed_that_the_limits_allow() -> None:
    governor = rp.Governor(planar(), DT, rp.Limits(velocity=0.25, acceleration=A, jerk=J))
    governor.start(Q0)
    Q, said = run(governor, 3000, moved(0.0, -0.4))
    speed = np.abs(np.diff(Q, axis=0)).max(axis=1) / DT / 0.25
    ticks = len(said)
    assert np.median(speed[:ticks]) > 0.95 and (speed[:ticks] > 0.95).mean() > 0.8
    p = np.array([planar().task.placement(q).translation for q in Q])
    assert np.abs(p[:, 0] - p[0, 0]).max() < 1e-6  # a straight line
    assert np.abs(p[-1] - moved(0.0, -0.4).translation).max() < 1e-9
    assert np.abs(p[:, 1] - p[-1, 1])[np.argmin(p[:, 1]) :].max() < 1e-5  # no overshoot


def test_a_twist_is_reached_and_held() -> None:
    twist = np.array([0.05, -0.1, 0, 0, 0, 0])
    governor = governed()
    Q, said = run(governor, 400, twist=twist)
    assert said[0] is rp.Status.SLOWED and said[-1] is rp.Status.OK
    task = planar().task
    v = (task.placement(Q[-1]).translation - task.placement(Q[-2]).translation) / DT
    np.testing.assert_allclose(v, twist[:3], atol=1e-7)
    Q, said = run(governor, 600)  # nothing is asked for: stop
    assert said[-1] is rp.Status.OK and np.ptp(Q[-50:], axis=0).max() == 0


def test_garbage_stops_the_arm_and_it_goes_on_afterwards() -> None:
    governor = governed()
    run(governor, 150, moved(0.2, -0.4))
    skewed = pin.SE3(np.diag([1.0, 1.0, 2.0]), np.array([np.nan, 0, 0]))
    stopping, said = run(governor, 500, skewed)
    assert set(said) == {rp.Status.BAD_NUMBER}
    assert np.ptp(stopping[-50:], axis=0).max() == 0 and np.ptp(stopping, axis=0).max() > 0
    on, said = run(governor, 2500, moved(0.2, -0.4))
    assert said[-1] is rp.Status.OK
    assert used(np.vstack([stopping, on[1:]]), 2.0, A, J) <= 1 + 1e-9


def test_it_stops_before_a_joint_limit() -> None:
    task = planar().task
    margin = float(task.limit_margin(Q0).min()) - 0.1
    governor = governed(margin=margin)
    nearest = np.argmin(np.minimum(Q0 - task.lower, task.upper - Q0))
    v = planar()(Q0)[nearest] * (1 if Q0[nearest] > 0 else -1)
    Q, said = run(governor, 700, twist=[*(v / np.linalg.norm(v)), 0, 0, 0, 0])
    assert margin - 1e-9 <= task.limit_margin(Q).min() <= margin + 0.01
    assert said[-1] is rp.Status.LIMIT and np.abs(Q[-1] - Q[-2]).max() / DT < 0.05


def test_it_stops_at_the_edge_of_the_region_and_comes_back() -> None:
    governor, box = governed(region=True), rp.Box(Q0, 0.1)
    Q, said = run(governor, 400, twist=[-1.5, 0.6, 0, 0, 0, 0])
    assert rp.Status.OUTSIDE in said and said[-1] is not rp.Status.OK
    assert 0.7 < box.ratio(Q).max() <= 1 + 1e-6
    back, said = run(governor, 3000, moved())
    assert said[-1] is rp.Status.OK and np.abs(back[-1] - Q0).max() < 1e-6


@pytest.mark.slow
def test_out_of_reach_it_rests_and_comes_back() -> None:
    governor = governed()
    Q, said = run(governor, 3000, moved(5.0, 5.0))
    assert said[-1] in (rp.Status.SINGULAR, rp.Status.LIMIT, rp.Status.SLOWED)
    assert np.abs(np.diff(Q, axis=0))[-100:].max() / DT < 0.05
    back, said = run(governor, 6000, moved())
    assert said[-1] is rp.Status.OK and np.abs(back[-1] - Q0).max() < 1e-6
    assert used(np.vstack([Q, back[1:]]), 2.0, A, J) <= 1 + 1e-9


@pytest.mark.slow
def test_a_cell_is_not_left() -> None:
    function = function_of("positions")
    governor = rp.Governor(function.inverse, 0.004, rp.Limits(acceleration="panda", jerk="panda"))
    q0 = function(function.cell.placement)
    governor.start(q0)
    Q, said = run(governor, 200, twist=[0.4, 0.1, 0, 0, 0, 0])
    assert rp.Status.OUTSIDE in said and function.cell.ratio(Q).max() <= 1 + 1e-6
    Q, said = run(governor, 800, function.cell.placement)
    assert said[-1] is rp.Status.OK and np.abs(Q[-1] - q0).max() < 1e-6


@pytest.mark.parametrize("jerk", [5.0, 20.0, 100.0])
def test_at_low_jerk_it_arrives_and_does_not_turn_back(jerk: float) -> None:
    """Issue 37, item 6: at low jerk, the governor swung around a target for ever."""
    limits = rp.Limits(velocity=2.0, acceleration=3.0, jerk=jerk)
    for x, y in ((0.05, -0.03), (-0.1, -0.2)):
        governor = rp.Governor(planar(), 0.004, limits)
        governor.start(Q0)
        Q, said = run(governor, 1500, moved(x, y))
        assert said[-1] is rp.Status.OK
        way = np.array([planar().task.placement(q).translation for q in Q])
        left = np.linalg.norm(way - moved(x, y).translation, axis=1)
        assert left[-1] < 1e-9 and np.diff(left).max() < 1e-5


def test_an_input_that_is_not_heeded_yet_is_not_reached() -> None:
    governor = governed()
    assert governor.step(moved())[1] is rp.Status.OK
    assert governor.step(moved(0.1))[1] is rp.Status.SLOWED


def test_a_rotation_is_held_by_a_pose_task() -> None:
    """ω of the frame by differences of its placement, after a turn of more than 0.6 rad."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    inverse = control(task, Q_PANDA, rp.Polynomial(Q_PANDA, 2, 0.5))
    governor = rp.Governor(inverse, DT, rp.Limits(acceleration=7.0, jerk=3000.0))
    governor.start(Q_PANDA)
    twist = np.array([0.02, 0.0, -0.03, 0.3, 0.5, -0.2])
    Q, said = run(governor, 1200, twist=twist)
    first, last, end = (task.placement(Q[k]) for k in (0, -2, -1))
    assert said[-1] is rp.Status.OK
    assert np.linalg.norm(pin.log3(end.rotation @ first.rotation.T)) > 0.6
    omega = pin.log3(end.rotation @ last.rotation.T) / DT
    np.testing.assert_allclose(omega, twist[3:], atol=1e-7)
    v = (end.translation - last.translation) / DT
    np.testing.assert_allclose(v, twist[:3], atol=1e-7)
    assert used(Q, task.velocity_limit, 7.0, 3000.0) <= 1 + 1e-9


def test_a_copy_goes_on_as_the_governor_does() -> None:
    governor = governed()
    run(governor, 150, moved(0.2, -0.4))
    copy = pickle.loads(pickle.dumps(governor))
    Q, _ = run(governor, 300, moved(0.2, -0.4))
    np.testing.assert_array_equal(run(copy, 300, moved(0.2, -0.4))[0], Q)
    np.testing.assert_array_equal(copy.leaf, governor.leaf)


def test_what_c_cannot_hold_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    limits = rp.Limits(acceleration=5.0)
    task = planar().task
    posture = rp.ExtendedJacobian(task, lambda q: q[:1] ** 2)
    assert isinstance(posture, rp.RepeatableInverse)
    with pytest.raises(rp.InputError, match="cannot be written as C"):
        rp.Governor(posture, DT, limits)
    monkeypatch.setenv("REPCTL_NATIVE", "no")
    with pytest.raises(rp.InputError, match="requires the native library") as caught:
        rp.Governor(planar(), DT, limits)
    assert "unset REPCTL_NATIVE" in str(caught.value)


def test_bad_arguments_are_named() -> None:
    inverse = planar()
    for arguments, words in (
        ({}, "acceleration= is missing"),
        ({"jerk": 100.0}, "acceleration= is missing.*jerk= requires it too"),
        ({"acceleration": 5.0, "dt": 0.0}, "dt must be above 0"),
        ({"acceleration": 5.0, "margin": 100.0}, "margin = 100 rad .* half the range of joint"),
        ({"acceleration": "panda"}, "of 7 joints"),
        ({"acceleration": 5.0, "velocity": np.inf}, "has no speed limit"),
        ({"acceleration": 5.0, "torque": True}, "^torque: a governor does not support this limit"),
        ({"acceleration": 5.0, "tool_speed": 1.0}, "^tool_speed: a governor does not"),
    ):
        with pytest.raises(rp.InputError, match=words) as caught:
            own = {k: v for k, v in arguments.items() if k in ("dt", "margin")}
            given = {k: v for k, v in arguments.items() if k not in own}
            rp.Governor(inverse, limits=rp.Limits(**given), **({"dt": DT} | own))
        assert "\n" not in str(caught.value)
    governor = rp.Governor(inverse, DT, rp.Limits(acceleration=5.0), margin=0.5)
    with pytest.raises(rp.InputError, match="has not started"):
        governor.step()
    with pytest.raises(rp.InputError, match="outside its limits"):
        governor.start([0.0, 9.0, 0.0])
    with pytest.raises(rp.InputError, match="a governor takes 10 to 10,000"):
        rp.Governor(inverse, 0.2, rp.Limits(acceleration=5.0))
    governor.start(Q0)
    with pytest.raises(rp.InputError, match="mutually exclusive"):
        governor.step(moved(), [0.0] * 6)
    with pytest.raises(rp.InputError, match="twist"):
        governor.step(twist=[0.0] * 5)
    with pytest.raises(rp.InputError, match="outside the region Ω"):
        governed(region=True).start(Q0 + 0.5)


@pytest.mark.parametrize("ticks", [4, 20, 100])
def test_a_slow_loop_makes_the_motion_of_a_fast_one(ticks: int) -> None:
    """Item 26.1: at slow rates the governor stood still; the commands are those of 1 ms."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "position")
    q0 = np.array([0.1645, 1.0344, -1.1132, -0.6831, -0.5389, 2.8319, 0.7733])
    inverse = control(task, q0, rp.Polynomial(q0, 2, 0.5))
    limits = rp.Limits(acceleration="panda", jerk="panda")
    target = pin.SE3(task.placement(q0).rotation, np.array([0.644, -0.31, 0.107]))
    fast, slow = (rp.Governor(inverse, dt, limits) for dt in (DT, ticks * DT))
    fast.start(q0)
    slow.start(q0)
    Q, _ = run(fast, 4000, target)
    Q_slow, said = run(slow, 4000 // ticks, target)
    assert said[-1] is rp.Status.OK
    assert len(said) == -(-(len(Q) - 1) // ticks)
    np.testing.assert_allclose(Q_slow[:-1], Q[: (len(Q_slow) - 1) * ticks : ticks], atol=1e-9)


@pytest.mark.parametrize("dt", [0.001, 0.02])
def test_it_moves_back_from_beyond_a_limit(dt: float) -> None:
    """Item 26.4: a measured joint beyond its limit returns slowly, never farther out."""
    inverse = planar()
    upper = inverse.task.upper
    limits = rp.Limits(velocity=2.0, acceleration=A, jerk=J)
    governor = rp.Governor(inverse, dt, limits, margin=0.02)
    q = np.array([0.3, 0.8, upper[2] + 0.05])
    governor.start(q)
    assert governor.recovering and (governor.step()[0] == q).all()  # it does not move by itself
    target = inverse.task.placement(np.clip(q, -upper + 0.02, upper - 0.02))
    Q, said = run(governor, int(5 / dt), target)
    assert said[0] is rp.Status.RECOVERING and said[-1] is rp.Status.OK
    assert np.diff(Q[:, 2]).max() <= 1e-12 and Q[-1, 2] <= upper[2] - 0.02
    assert not governor.recovering and (Q[:, :2] == q[:2]).all()
    Q = np.vstack([[q] * 3, Q])
    assert np.abs(np.diff(Q, axis=0)).max() / dt <= 0.2
    assert np.abs(np.diff(Q, 3, axis=0)).max() / dt**3 <= J
    with pytest.raises(rp.InputError, match="by more than 0.1"):
        governor.start(upper + 0.2)


def test_a_frame_a_thousand_kilometres_away_is_refused(tmp_path: Path) -> None:
    """Item 26.13: such a start was accepted, and every step was BAD_NUMBER."""
    for away, fits in ((9e5, True), (5e6, False)):
        text = planar_urdf([1, 1, 1]).replace('xyz="0.0 0 0"', f'xyz="{away} 0 0"')
        (tmp_path / "far.urdf").write_text(text)
        task = rp.Robot.load(tmp_path / "far.urdf").task("tool", "xy")
        governor = rp.Governor(control(task, Q0, rp.Polynomial(Q0, 2, 0.5)), DT, LOW)
        if fits:
            governor.start(Q0)
            continue
        with pytest.raises(rp.InputError, match="10⁶ m or more from the base"):
            governor.start(Q0)
