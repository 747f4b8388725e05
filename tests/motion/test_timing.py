"""Time for motions: closed forms, laws of scale, limits on a finer grid, cycles alike; and the way
in."""

from __future__ import annotations

import io
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from arms import named_path, planar_task
from commands import refused, told
from controls import some
from scipy.interpolate import CubicSpline

import repctl_pin as rp

PANDA = np.array([15, 7.5, 10, 12.5, 15, 20, 20])
"""Franka's published limits of the joint accelerations, rad/s²."""
Q3 = np.array([0.3, 0.8, 0.8])


@pytest.fixture(scope="module")
def planar() -> rp.Task:
    return rp.Robot.load("planar3r").task("tool", "xy")


def closing(task: rp.Task) -> rp.RepeatableInverse:
    """A control whose leaf is θ₁ − θ₂/2 + θ₃/2 = const."""
    return rp.RepeatableInverse(
        task, rp.Polynomial(Q3, 1).weighted(np.array([[1.0], [-0.5], [0.5]]))
    )


def cycles_of(planar: rp.Task, cycles: int) -> rp.Motion:
    control = closing(planar)
    return rp.follow(control, rp.circle(planar, Q3, 0.3), Q3, cycles=cycles, steps=200)


@pytest.fixture(scope="module")
def ring(planar: rp.Task) -> rp.Motion:
    """Two cycles that close."""
    return cycles_of(planar, 2)


def panda_cycles(control: rp.Inverse, q: np.ndarray, cycles: int) -> rp.Motion:
    path = rp.circle(control.task, q, 0.1, start_angle=np.pi)
    return rp.follow(control, path, q, cycles=cycles, steps=300)


@pytest.fixture(scope="module")
def panda_motions(panda_pose, panda_design, q_panda) -> dict[str, rp.Motion]:
    controls = {"plain": rp.Pseudoinverse(panda_pose), "ours": panda_design.inverse}
    return {name: panda_cycles(control, q_panda, 5) for name, control in controls.items()}


def judged(timed: rp.TimedMotion) -> None:
    """All that a controller relies on."""
    rate = 1 / timed.t[1]
    assert timed.t[0] == 0 and np.allclose(np.diff(timed.t), 1 / rate, rtol=1e-9)
    for part in (timed.qdot, timed.qddot):
        assert not part[[0, -1]].any()
    assert np.abs(timed.qdot / timed.velocity).max() <= 1.001
    assert np.abs(timed.qddot / timed.acceleration).max() <= 1.001
    if rate >= 1000:
        assert (
            np.abs(np.gradient(timed.q, timed.t, axis=0) - timed.qdot) / timed.velocity
        ).max() < 1e-3
        assert (
            np.abs(np.gradient(timed.qdot, timed.t, axis=0) - timed.qddot) / timed.acceleration
        ).max() < 1e-3


def test_a_straight_way_in_takes_the_time_of_the_closed_form(planar, ring) -> None:
    """T = Δ/v + v/a where the speed limit is met, 2 √(Δ/a) where it is not, of the slowest
    joint."""
    begin = Q3 + [1.2, -0.4, 0.1]
    for v, a in ((0.5, 2.0), (5.0, 2.0)):
        way = rp.approach(begin, ring, rp.Limits(velocity=v, acceleration=a))
        judged(way)
        expected = 1.2 / v + v / a if v * v / a < 1.2 else 2 * np.sqrt(1.2 / a)
        assert np.isclose(way.duration, expected, rtol=1e-4)
        np.testing.assert_allclose(way.q[[0, -1]], [begin, ring.q[0]], atol=1e-12)
        share = (way.q - begin) @ (Q3 - begin) / np.sum((Q3 - begin) ** 2)
        # straight
        np.testing.assert_allclose(way.q, begin + share[:, None] * (Q3 - begin), atol=1e-12)


@pytest.mark.parametrize("cycles", some([5, 10], 5))
def test_cycles_are_alike_but_the_first_and_the_last(planar, cycles: int) -> None:
    ring = cycles_of(planar, cycles)
    timed = rp.timed(ring, rp.Limits(velocity=2.0, acceleration=6.0))
    judged(timed)
    assert timed.starts.size == cycles + 1 and timed.stops == 0
    np.testing.assert_allclose(np.diff(timed.starts)[1:-1], timed.cycle_time, atol=1e-9)
    assert np.isclose(timed.cycle_time * 1000 % 1, 0, atol=1e-6) or np.isclose(
        timed.cycle_time * 1000 % 1, 1, atol=1e-6
    )
    second = timed.cycle(1)
    for k in range(2, cycles - 1):
        for one, other in zip(second, timed.cycle(k), strict=True):
            np.testing.assert_allclose(other, one, atol=1e-9)
    for s in (timed.q[0], timed.q[-1]):
        np.testing.assert_allclose(s, ring.q[0], atol=1e-7)
    few = [
        rp.timed(
            replace(ring, cycles=k, q=ring.q[: 200 * k + 1], t=ring.t[: 200 * k + 1]),
            rp.Limits(velocity=2.0, acceleration=6.0),
        ).duration
        for k in (1, 2, 3, 4)
    ]
    # each cycle more takes one more
    np.testing.assert_allclose(np.diff(few)[1:], timed.cycle_time, atol=2.1e-3)
    assert np.isclose(few[3] + (cycles - 4) * timed.cycle_time, timed.duration, atol=1e-9)


def test_limits_hold_on_a_finer_grid_and_the_path_is_the_same(ring) -> None:
    once = replace(ring, cycles=2, q=ring.q[:401], t=ring.t[:401])
    limits = {"velocity": [0.9, 1.1, 2.0], "acceleration": [3.0, 2.0, 8.0]}
    fine = rp.timed(once, rp.Limits(**limits), rate=20_000)
    h = fine.t[1]
    qdot, qddot = np.diff(fine.q, axis=0) / h, np.diff(fine.q, 2, axis=0) / h**2
    used = (np.abs(qdot / limits["velocity"]).max(), np.abs(qddot / limits["acceleration"]).max())
    assert max(used) <= 1.001 and max(used) > 0.99
    at_most = np.maximum(
        np.abs(qdot[1:]) / limits["velocity"], np.abs(qddot) / limits["acceleration"]
    ).max(axis=1)
    assert np.median(at_most) > 0.98  # time-optimal: some limit is met nearly always
    path = ring.q[:201]
    away = [np.linalg.norm(path - q, axis=1).min() for q in fine.q[::400]]
    assert max(away) < 0.6 * np.linalg.norm(np.diff(path, axis=0), axis=1).max()


def test_time_goes_with_the_root_of_acceleration(ring) -> None:
    """With no speed limit t → λ t turns a into a / λ²."""
    slow, quick = (
        rp.timed(ring, rp.Limits(velocity=np.inf, acceleration=a), rate=1e5 if a > 3 else 1e4)
        for a in (2.0, 200.0)
    )
    assert np.isclose(slow.duration, 10 * quick.duration, rtol=1e-4)


@pytest.mark.slow
def test_panda_takes_hardly_longer_than_under_the_pseudoinverse(panda_motions) -> None:
    times = {}
    for name, motion in panda_motions.items():
        one = replace(motion, cycles=1, q=motion.q[:301], t=motion.t[:301])
        times[name] = rp.timed(one, rp.Limits(acceleration="panda")).duration
        begin = time.process_time()
        ten = rp.timed(motion, rp.Limits(acceleration="panda"))
        assert time.process_time() - begin < 1
        judged(ten)
    assert 1.20 < times["plain"] < 1.24  # the prototype's 1.225 s
    assert times["ours"] < 1.03 * times["plain"]


def test_torques_stay_within_the_efforts(panda_pose, panda_motions) -> None:
    motion = panda_motions["ours"]
    one = replace(motion, cycles=1, q=motion.q[:301], t=motion.t[:301])
    model, data = panda_pose.model, panda_pose.model.createData()
    effort = np.array([87.0, 87, 87, 87, 12, 12, 12])
    used = []
    for torque in (False, True):
        timed = rp.timed(one, rp.Limits(velocity=100.0, acceleration=300.0, torque=torque))
        tau = np.array(
            [
                pin.rnea(model, data, *row)
                for row in zip(timed.q, timed.qdot, timed.qddot, strict=True)
            ]
        )
        used.append(float(np.abs(tau / effort).max()))
    assert used[0] > 1.05 and 0.95 < used[1] < 1.01
    weak = panda_pose.robot.model.effortLimit.copy()
    try:
        panda_pose.robot.model.effortLimit = weak * 0.05
        with pytest.raises(rp.InputError, match="torque limits do not hold the arm"):
            rp.timed(one, rp.Limits(acceleration=10.0, torque=True))
    finally:
        panda_pose.robot.model.effortLimit = weak


def test_the_arm_stands_at_corners_and_stays_and_turns_round(planar) -> None:
    here = planar.placement(Q3)
    points = here.translation + np.array(
        [[0, 0, 0], [0.3, 0, 0], [0.3, 0, 0], [0.3, 0.3, 0], [0, 0, 0]]
    )
    path = rp.waypoints(points, here.rotation, times=[0, 1, 1.7, 3, 4])
    control = closing(planar)
    motion = rp.follow(control, path, Q3, cycles=4, steps=200)
    timed = rp.timed(motion, rp.Limits(velocity=2.0, acceleration=6.0))
    judged(timed)
    assert timed.stops == 2
    still = (np.abs(timed.qdot).max(axis=1) < 1e-12).astype(int)
    runs = (
        np.diff(np.flatnonzero(np.diff(np.r_[0, still, 0])).reshape(-1, 2), axis=1)[:, 0]
        * timed.t[1]
    )
    assert np.sum(np.abs(runs - 0.7) < 5e-3) == 4  # the stay, once a cycle
    second, third = timed.cycle(1), timed.cycle(2)
    for one, other in zip(second, third, strict=True):
        np.testing.assert_allclose(other, one, atol=1e-9)
    there = rp.follow(control, rp.polygon(planar, Q3, [[0.2, 0.1, 0]]), Q3, cycles=1, steps=100)
    back = rp.timed(there, rp.Limits(velocity=2.0, acceleration=6.0))
    judged(back)
    assert back.stops == 1


def test_rounded_corners_are_not_stops_and_take_less_time(planar) -> None:
    control = rp.Pseudoinverse(planar)
    motions = [
        rp.follow(control, named_path(planar, Q3, words), Q3, cycles=1, steps=400)
        for words in ("square:0.3", "square:0.3:blend=0.05")
    ]
    sharp, rounded = (
        rp.timed(motion, rp.Limits(velocity=2.0, acceleration=6.0)) for motion in motions
    )
    judged(rounded)
    assert (sharp.stops, rounded.stops) == (3, 0)
    assert rounded.duration < 0.95 * sharp.duration


def one_cycle(motion: rp.Motion) -> rp.Motion:
    """The first cycle alone."""
    rows = slice(motion.steps + 1)
    return replace(motion, cycles=1, q=motion.q[rows], qdot=motion.qdot[rows], t=motion.t[rows])


BAD = [
    (
        {},
        "= is missing, and the model has no acceleration limit of joint 'theta1'.* panda, fr3, ur",
    ),
    ({"acceleration": "kuka"}, "no acceleration limits are published for 'kuka'"),
    ({"acceleration": "panda"}, "of 7 joints, but 'tool' is moved by 3"),
    ({"acceleration": 0}, "acceleration must be"),
    ({"acceleration": [1, -1, 1]}, "acceleration must be"),
    ({"acceleration": np.nan}, "acceleration must be"),
    ({"acceleration": np.inf}, "acceleration must be finite"),
    ({"acceleration": [1, 2]}, "acceleration must be"),
    ({"acceleration": 1, "velocity": 0}, "velocity must be"),
    ({"acceleration": 1, "velocity": [1, np.nan, 1]}, "velocity must be"),
    ({"jerk": 10}, "acceleration= is missing.*jerk= requires it too"),
    (
        {"acceleration": 1, "jerk": "ur"},
        "no jerk limits are published for 'ur', only for panda, fr3",
    ),
    (
        {"acceleration": 1, "jerk": "panda"},
        "'panda' has jerk limits of 7 joints, but 'tool' is moved by 3",
    ),
    ({"acceleration": 1, "jerk": 0}, "jerk must be"),
    ({"acceleration": 1, "jerk": [1, 2]}, "jerk must be"),
    ({"acceleration": 1, "jerk": np.inf}, "jerk must be finite"),
]


@pytest.mark.parametrize("options, why", BAD, ids=range(len(BAD)))
def test_bad_limits_get_one_clear_line(ring, options: dict, why: str) -> None:
    for call in (
        lambda: rp.timed(ring, rp.Limits(**options)),
        lambda: rp.approach(Q3 + 0.1, ring, rp.Limits(**options)),
    ):
        with pytest.raises(rp.InputError, match=why) as error:
            call()
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "options, why",
    [
        ({"tool_speed": 0}, "tool_speed must be one number above 0 or 2 of them"),
        ({"rate": 0}, "rate must be above 0"),
        ({"tool_speed": [1, 2, 3]}, "tool_speed must be"),
        ({"keep_times": "yes"}, "keep_times must be True or False"),
        (
            {"keep_times": True, "velocity": 0.1},
            "times of the path exceed the limits: theta. would need .* its speed at",
        ),
        ({"keep_times": True, "tool_speed": 0.1}, r"the tool would need 3.7\d* times its speed at"),
    ],
)
def test_bad_options_of_a_timed_motion_get_one_clear_line(ring, options: dict, why: str) -> None:
    with pytest.raises(rp.InputError, match=why) as error:
        given = {"velocity": 2.0, "acceleration": 5.0} | options
        own = {name: given.pop(name) for name in ("keep_times", "rate") if name in given}
        rp.timed(one_cycle(ring), rp.Limits(**given), **own)
    assert "\n" not in str(error.value)


def differences(timed: rp.TimedMotion) -> list[np.ndarray]:
    """Speed, acceleration and jerk of the samples alone, as shares of the limits: the largest of
    each."""
    h, limits = timed.t[1], (timed.velocity, timed.acceleration, timed.jerk)
    return [
        (np.abs(np.diff(timed.q, k, axis=0)) / h**k / limit).max()
        for k, limit in enumerate(limits, 1)
        if limit is not None
    ]


@pytest.mark.slow
@pytest.mark.parametrize("cycles", some([5, 10], 5))
def test_jerk_is_kept_between_the_samples_and_costs_hardly_any_time(
    panda_design, q_panda, cycles: int
) -> None:
    motion = panda_cycles(panda_design.inverse, q_panda, cycles)
    limits = rp.Limits(acceleration="panda", jerk="panda")  # as published
    smooth = rp.timed(motion, limits, rate=10_000)
    free = rp.timed(motion, rp.Limits(acceleration="panda"), rate=10_000)
    jerk = np.diff(free.q, 3, axis=0) * 1e12 / [7500, 3750, 5000, 6250, 7500, 10000, 10000]
    assert np.abs(jerk).max() > 2 and free.jerk is None
    assert max(differences(smooth)) < 1.01
    assert smooth.duration < 1.02 * free.duration
    judged(smooth)
    again = smooth.cycle(1)
    for k in range(2, cycles - 1):
        for one, other in zip(again[1:], smooth.cycle(k)[1:], strict=True):
            np.testing.assert_array_equal(other, one)  # bit for bit
    path = rp.timed(motion, rp.Limits(acceleration="panda")).q
    far = [np.linalg.norm(path - q, axis=1).min() for q in smooth.q[5000:15000:977]]
    assert max(far) < 0.6 * np.linalg.norm(np.diff(path, axis=0), axis=1).max()


def test_an_approach_from_beyond_a_limit_never_goes_farther_out(ring) -> None:
    """Item 26.4: a measured joint 0.05 rad beyond its limit was refused."""
    upper = ring.task.upper
    for j in range(3):
        begin = Q3.copy()
        begin[j] = upper[j] + 0.05
        way = rp.approach(begin, ring, rp.Limits(velocity=2.0, acceleration=6.0, jerk=100.0))
        np.testing.assert_allclose(way.q[0], begin, atol=1e-12)
        np.testing.assert_allclose(way.q[-1], ring.q[0], atol=1e-9)
        assert np.diff(way.q[:, j]).max() <= 1e-12
        assert max(differences(way)) < 1.01
        begin[j] = upper[j] + 0.2
        with pytest.raises(rp.InputError, match="by more than 0.1"):
            rp.approach(begin, ring, rp.Limits(acceleration=6.0))


@pytest.mark.slow
def test_a_straight_way_with_bounded_jerk_takes_the_time_of_the_closed_form(ring) -> None:
    """``T = a/J + √((a/J)² + 4Δ/a)`` where the acceleration limit is met, ``T³ = 32 Δ/J`` where it
    is not."""
    begin = Q3 + [1.2, -0.4, 0.1]
    for a, J in ((2.0, 5.0), (2.0, 100.0), (50.0, 5.0)):
        way = rp.approach(begin, ring, rp.Limits(velocity=50.0, acceleration=a, jerk=J), rate=5_000)
        met = 1.2 > 2 * a**3 / J**2
        expected = a / J + np.sqrt((a / J) ** 2 + 4 * 1.2 / a) if met else (32 * 1.2 / J) ** (1 / 3)
        assert expected * (1 - 1e-6) < way.duration < expected * 1.005
        assert max(differences(way)) < 1.01


@pytest.mark.slow
def test_time_goes_with_the_cube_root_of_jerk(planar) -> None:
    """With no other limit t → λ t turns a jerk J into J / λ³."""
    path = rp.circle(planar, Q3, 0.3)
    once = rp.follow(closing(planar), path, Q3, cycles=1, steps=60)
    options = {"velocity": np.inf, "acceleration": 1e6}
    slow, quick = (rp.timed(once, rp.Limits(jerk=J, **options)) for J in (16.0, 2000.0))
    assert np.isclose(slow.duration, 5 * quick.duration, rtol=2e-3)
    assert max(differences(slow)[:2]) < 1 and 0.95 < differences(slow)[2] < 1.01


def test_torques_stay_within_the_efforts_with_bounded_jerk(panda_pose, panda_motions) -> None:
    one = one_cycle(panda_motions["ours"])
    timed = rp.timed(one, rp.Limits(velocity=100.0, acceleration=300.0, jerk=1e5, torque=True))
    model, data = panda_pose.model, panda_pose.model.createData()
    tau = np.array(
        [pin.rnea(model, data, *row) for row in zip(timed.q, timed.qdot, timed.qddot, strict=True)]
    )
    assert 0.9 < np.abs(tau / [87.0, 87, 87, 87, 12, 12, 12]).max() < 1.01
    assert max(differences(timed)) < 1.01


@pytest.mark.parametrize("jerk", [None, 200.0])
def test_the_tool_keeps_its_speed(planar, ring, jerk) -> None:
    once = one_cycle(ring)
    timed = rp.timed(once, rp.Limits(velocity=2.0, acceleration=6.0, jerk=jerk, tool_speed=0.3))
    points = planar.positions(timed.q)
    v = np.linalg.norm(np.diff(points, axis=0), axis=1) / timed.t[1]
    assert v.max() < 0.3 * 1.005 and np.median(v) > 0.29
    turning = rp.timed(
        once, rp.Limits(velocity=2.0, acceleration=6.0, jerk=jerk, tool_speed=[0.3, 0.05])
    )
    omega = np.abs(np.diff(turning.q.sum(axis=1))) / turning.t[1]
    assert omega.max() < 0.05 * 1.01 and turning.duration > timed.duration


def test_a_path_keeps_its_own_times(panda_pose, panda_design, q_panda) -> None:
    """Waypoints round a circle, faster on one side: each is passed at its time, the whole later by
    half the ramps."""
    u = np.linspace(0, 1, 81)
    here, angle = panda_pose.placement(q_panda), 2 * np.pi * u
    points = here.translation + 0.1 * np.stack(
        [np.sin(angle), np.cos(angle) - 1, 0 * angle], axis=1
    )
    times = 8 * (u + 0.1 * np.sin(angle) / (2 * np.pi))
    path = rp.waypoints(points, here.rotation, times=times)
    motion = rp.follow(panda_design.inverse, path, q_panda, cycles=4, steps=320)
    timed = rp.timed(motion, rp.Limits(acceleration="panda", jerk="panda"), keep_times=True)
    judged(timed)
    assert max(differences(timed)) < 1.01
    assert timed.stops == 0 and np.isclose(timed.cycle_time, 8, atol=1e-9)
    ramps = timed.duration - 32
    assert 0 < ramps < 0.1
    first = timed.starts[0] + ramps / 2
    joints = CubicSpline(timed.t, timed.q)
    for cycle in range(4):
        for t, point in list(zip(times, points, strict=True))[2:-2]:
            placed = panda_pose.placement(joints(first + 8 * cycle + t))
            assert np.linalg.norm(placed.translation - point) < 5e-5
    np.testing.assert_array_equal(timed.cycle(2)[1], timed.cycle(1)[1])


def test_a_corner_keeps_its_time(planar) -> None:
    here = planar.placement(Q3)
    corners = rp.waypoints(
        here.translation + [[0, 0, 0], [0.3, 0, 0], [0.3, 0.3, 0], [0, 0, 0]],
        here.rotation,
        times=[0, 2, 5, 9],
    )
    timed = rp.timed(
        rp.follow(closing(planar), corners, Q3, cycles=1, steps=200),
        rp.Limits(velocity=2.0, acceleration=6.0),
        keep_times=True,
    )
    assert timed.stops == 2 and timed.duration < 9.2
    still = timed.t[np.abs(timed.qdot).max(axis=1) < 1e-3]
    for t in (2, 5):
        assert np.abs(still - timed.starts[0] - t).min() < 0.5 * (timed.duration - 9) + 2e-3


def overridden(run: rp.Run, wishes: list[float], ticks: int, dt: float) -> np.ndarray:
    """Joints of a run, the override asked for changed after so many ticks."""
    return np.array([run.step(dt, wish)[0] for wish in wishes for _ in range(ticks)])


@pytest.fixture(scope="module")
def jerky(ring) -> rp.TimedMotion:
    """Two cycles of the planar arm with bounded jerk."""
    return rp.timed(ring, rp.Limits(velocity=2.0, acceleration=6.0, jerk=100.0))


@pytest.mark.slow
@pytest.mark.parametrize("bounded", some([True, False], False))
def test_an_override_keeps_the_path_and_the_limits(ring, jerky, bounded) -> None:
    timed = jerky if bounded else rp.timed(ring, rp.Limits(velocity=2.0, acceleration=6.0))
    run, dt = rp.Run(timed), 0.002
    wishes, seen = [1, 0.4, -1, -1, -1, 0, 0, 1, 1, 0.4, 1, 1], []
    for wish in wishes:
        for _ in range(100):
            q, qdot = run.step(dt, wish)
            seen.append((run.t, run.override, *q, *qdot))
    t, override, *rest = np.array(seen).T
    Q, Qdot = np.array(rest[:3]).T, np.array(rest[3:]).T
    for k, limit in enumerate((timed.velocity, timed.acceleration, timed.jerk), 1):
        if limit is not None:
            assert (np.abs(np.diff(Q, k, axis=0)) / dt**k / limit).max() < 1.01
    # of samples a millisecond apart
    np.testing.assert_allclose(Q, CubicSpline(timed.t, timed.q)(t), atol=1e-7)
    assert np.abs(np.gradient(Q, dt, axis=0)[2:-2] - Qdot[2:-2]).max() < 0.05
    assert np.ptp(override) > 1.5 and {0.0, 1.0} < set(override)
    assert np.abs(Qdot[override == 0]).max() == 0


@pytest.mark.slow
def test_at_full_override_a_run_gives_the_samples_and_backs_up_the_same_way(ring) -> None:
    timed = rp.timed(one_cycle(ring), rp.Limits(velocity=2.0, acceleration=6.0))
    run = rp.Run(timed)
    there = overridden(run, [1], len(timed.t) - 1, timed.t[1])
    np.testing.assert_allclose(there, timed.q[1:], atol=1e-9)
    assert np.isclose(run.t, timed.t[-1])
    back = overridden(run, [-1], len(timed.t) - 1, timed.t[1])
    np.testing.assert_allclose(back, timed.q[-2::-1], atol=1e-9)
    assert run.t == pytest.approx(0, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cycles", "stops"), [(3, 3), pytest.param(10, 15, marks=pytest.mark.slow)]
)
def test_a_cycle_closes_however_often_it_was_stopped(planar, cycles: int, stops: int) -> None:
    ring = cycles_of(planar, cycles)
    jerky = rp.timed(ring, rp.Limits(velocity=2.0, acceleration=6.0, jerk=100.0))
    run = rp.Run(jerky)
    stopped = []
    for _ in range(stops):
        overridden(run, [1], 15, 0.01)
        while run.override:
            _, qdot = run.step(0.01, 0)
        assert not qdot.any()
        stopped.append(run.t)
    assert np.diff(stopped).min() > 0 and stopped[-1] < jerky.starts[-2]
    while run.t < jerky.t[-1]:
        q, qdot = run.step(0.01)
    np.testing.assert_allclose(q, jerky.q[-1], atol=1e-12)
    np.testing.assert_allclose(q, ring.q[0], atol=1e-7)


@pytest.mark.slow
def test_a_run_goes_on_from_the_nearest_point_of_the_path(ring, jerky) -> None:
    timed = jerky
    away = ring.q[120] + [0.02, -0.03, 0.01]
    way = rp.approach(
        away, ring, rp.Limits(velocity=2.0, acceleration=6.0, jerk=100.0), to="nearest"
    )
    judged(way)
    nearest = np.linalg.norm(ring.q[:201] - away, axis=1)
    assert (
        np.isclose(np.linalg.norm(way.q[-1] - away), nearest.min())
        and nearest.min() < nearest[0] / 5
    )
    run = rp.Run(timed, q=way.q[-1])
    assert timed.starts[0] < run.t < timed.starts[1]
    q, qdot = run.step(1e-6)
    np.testing.assert_allclose(q, way.q[-1], atol=1e-6)
    assert np.abs(qdot).max() < 1e-3  # from rest
    Q = overridden(run, [1], 500, 0.002)
    assert (np.abs(np.diff(Q, 3, axis=0)) / 0.002**3).max() < 101
    with pytest.raises(rp.InputError, match="on the motion's path already"):
        rp.approach(ring.q[120], ring, rp.Limits(acceleration=1.0), to="nearest")
    with pytest.raises(rp.InputError, match="'start', 'nearest'|start, nearest"):
        rp.approach(away, ring, rp.Limits(acceleration=1.0), to="end")
    with pytest.raises(rp.InputError, match='q is 0.0.* away from the path; .* to="nearest"'):
        rp.Run(timed, q=away)


def test_what_a_run_cannot_use_is_refused(ring) -> None:
    timed = rp.timed(ring, rp.Limits(acceleration=6.0))
    for wrong in (None, ring, replace(timed, trajectory=None)):
        with pytest.raises(rp.InputError, match="timed"):
            rp.Run(wrong)
    run = rp.Run(timed)
    for options, why in (
        ({"dt": 0}, "dt must be above 0"),
        ({"dt": np.nan}, "dt must be"),
        ({"dt": 0.01, "override": 1.5}, "override must be from -1 to 1, not 1.5"),
        ({"dt": 0.01, "override": np.nan}, "override must be a finite number"),
    ):
        with pytest.raises(rp.InputError, match=why):
            run.step(**options)
    assert run.t == 0


def test_torque_limits_want_masses(tmp_path) -> None:
    task = planar_task([1, 1, 1], tmp_path)
    motion = rp.follow(closing(task), rp.circle(task, Q3, 0.1), Q3, cycles=1, steps=60)
    with pytest.raises(rp.InputError, match="torque limits require the effort of every joint"):
        rp.timed(motion, rp.Limits(acceleration=1.0, torque=True))


def test_what_cannot_be_approached_or_timed_is_refused(planar, ring) -> None:
    for q, why in (
        (Q3, "already"),
        ([9, 0, 0], "outside its limits"),
        ([0, 0], "2 numbers"),
        ([0, 0, np.nan], "finite"),
    ):
        with pytest.raises(rp.InputError, match=why):
            rp.approach(q, ring, rp.Limits(acceleration=1.0))
    for wrong in (None, "motion", ring.q):
        with pytest.raises(rp.InputError, match="motion must be"):
            rp.timed(wrong, rp.Limits(acceleration=1.0))
        with pytest.raises(rp.InputError, match="motion must be"):
            rp.approach(Q3, wrong, rp.Limits(acceleration=1.0))
    with pytest.raises(rp.InputError, match="do not move"):
        rp.timed(replace(ring, q=np.tile(Q3, (len(ring.q), 1))), rp.Limits(acceleration=1.0))
    with pytest.raises(rp.InputError, match="no cycle 10"):
        rp.timed(ring, rp.Limits(acceleration=5.0)).cycle(10)


def test_the_way_in_does_not_lead_through_the_robot_itself(panda_pose, panda_motions) -> None:
    folded = np.array([0.794, -0.812, -2.66, -3.022, 1.815, 3.424, 0.618])  # the hand at the base
    motion = panda_motions["ours"]
    least = rp.Bodies(panda_pose).distances(np.linspace(folded, motion.q[0], 101)).min()
    assert least < 0
    with pytest.raises(
        rp.InputError,
        match=r"'panda_\w+' and 'panda_\w+' collide at \d+ % of the straight .* bodies=False",
    ):
        rp.approach(folded, motion, rp.Limits(acceleration="panda"))
    judged(rp.approach(folded, motion, rp.Limits(acceleration="panda"), bodies=False))
    judged(rp.approach(motion.q[0] + 0.2, motion, rp.Limits(acceleration="panda")))


def test_a_robot_reads_what_was_computed(ring, tmp_path) -> None:
    once = replace(ring, cycles=1, q=ring.q[:201], t=ring.t[:201])
    timed = rp.timed(once, rp.Limits(velocity=2.0, acceleration=6.0), rate=100)
    text = rp.write_motion(timed, tmp_path / "timed.csv").read_text()
    names = text.splitlines()[0].split(",")
    assert names == [
        "time",
        *(f"{j}{end}" for end in ("", "_velocity", "_acceleration") for j in timed.joints),
    ]
    table = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1)
    np.testing.assert_array_equal(
        table, np.column_stack([timed.t, timed.q, timed.qdot, timed.qddot])
    )
    message = yaml.safe_load(
        rp.write_motion(timed, tmp_path / "timed.yaml").read_text(encoding="utf-8")
    )
    assert tuple(message["joint_names"]) == timed.joints
    for point, t, *rows in zip(
        message["points"], timed.t, timed.q, timed.qdot, timed.qddot, strict=True
    ):
        assert np.isclose(
            point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"],
            t,
            atol=1e-9,
        )
        for name, row in zip(("positions", "velocities", "accelerations"), rows, strict=True):
            np.testing.assert_allclose(point[name], row, atol=1e-12)


def test_a_motion_is_written_for_a_robot(ring, planar, tmp_path) -> None:
    ring = one_cycle(ring)
    timed = rp.timed(ring, rp.Limits(acceleration=6.0), rate=100)
    way = rp.approach(Q3 + 0.2, ring, rp.Limits(acceleration=6.0), rate=100)
    for motion in (ring, timed, way):
        written = np.genfromtxt(
            rp.write_motion(motion, tmp_path / "m.csv"), delimiter=",", names=True
        )
        for joint, column in zip(planar.joint_names, motion.q.T, strict=True):
            np.testing.assert_array_equal(written[joint], column)
        file = rp.write_motion(motion, str(tmp_path / "m.yaml"))
        assert yaml.safe_load(file.read_text(encoding="utf-8"))["points"]
    beyond = replace(ring, q=ring.q + 9.0)
    for motion in (beyond, replace(timed, motion=beyond)):
        with pytest.raises(
            rp.InputError, match="exceeds its limits at the start: .*allow_violations=True"
        ):
            rp.write_motion(motion, tmp_path / "no.csv")
        assert rp.write_motion(motion, tmp_path / "yes.csv", allow_violations=True).exists()
    assert not (tmp_path / "no.csv").exists()
    for wrong, why in (
        (tmp_path / "m.txt", "must end in .csv or .yaml"),
        (None, "file must be"),
        (tmp_path / "n" / "m.csv", "cannot write"),
    ):
        with pytest.raises(rp.InputError, match=why):
            rp.write_motion(timed, wrong)
    with pytest.raises(rp.InputError, match="motion must be"):
        rp.write_motion(ring.q, tmp_path / "m.csv")


def test_follow_times_a_motion(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    words = [
        "follow",
        "planar3r",
        "--strategy",
        "pseudoinverse",
        "--path",
        "square:0.2",
        "--steps",
        "80",
    ]
    data = told(
        capsys,
        *words,
        "--acceleration",
        "2,3,4",
        "--rate",
        "100",
        "--csv",
        "m.csv",
        "--yaml",
        "m.yaml",
        "--profile",
        "p.png",
    )
    assert (
        data["slowed_by"] is None and data["cycle_time"] == data["duration"] and data["stops"] == 3
    )
    table = np.loadtxt("m.csv", delimiter=",", skiprows=1)
    assert (
        table.shape[1] == 10 and not table[[0, -1], 4:].any() and table[-1, 0] >= data["duration"]
    )
    assert (np.abs(table[:, 7:]).max(axis=0) < np.array([2, 3, 4]) * 1.001).all()
    assert (tmp_path / "p.png").read_bytes()[:4] == b"\x89PNG"
    assert "neither numbers" in refused(capsys, *words, "--acceleration", "1,x")
    assert "no acceleration limits are published for 'pandas'" in refused(
        capsys, *words, "--acceleration", "pandas"
    )
    assert "requires --acceleration" in refused(capsys, *words, "--profile", "p.png")


@pytest.mark.slow
def test_follow_keeps_jerk_tool_speed_and_times(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    words = [
        "follow",
        "planar3r",
        "--strategy",
        "pseudoinverse",
        "--path",
        "circle:0.2:180",
        "--steps",
        "80",
    ]
    limits = ["--acceleration", "2,3,4", "--jerk", "50", "--rate", "1000", "--csv", "m.csv"]
    quick = told(capsys, *words, *limits)
    table = np.loadtxt("m.csv", delimiter=",", skiprows=1)
    assert np.abs(np.diff(table[:, 1:4], 3, axis=0)).max() < 50 * 1.01 * 1e-9
    slow = told(capsys, *words, *limits, "--tool-speed", "0.1")
    assert slow["duration"] > 2 * np.pi * 0.2 / 0.1 > quick["duration"]
    own = told(capsys, *words, *limits, "--keep-times", "--period", "7")
    assert 7 < own["duration"] < 7.5
    for option in (["--jerk", "50"], ["--tool-speed", "0.1"], ["--keep-times"]):
        assert f"{option[0]} requires --acceleration" in refused(capsys, *words, *option)
    assert "--jerk '1,x' is neither numbers" in refused(
        capsys, *words, *limits[:2], "--jerk", "1,x"
    )
    assert "--tool-speed 'v' is not one or two" in refused(
        capsys, *words, *limits[:2], "--tool-speed", "v"
    )


def test_a_file_has_at_least_ten_samples_per_cycle(tmp_path: Path) -> None:
    """Item 26.18: a rate of 0.5 per second loses the cycle between the samples."""
    problem = rp.Problem("planar3r")
    control = rp.Pseudoinverse(problem.task)
    motion = rp.follow(control, problem.cycle, problem.start, cycles=2, steps=100)
    limits = rp.Limits(acceleration=5.0)
    with pytest.raises(rp.InputError, match="samples per cycle.*use a rate of at least"):
        rp.write_motion(rp.timed(motion, limits, rate=0.5), tmp_path / "slow.csv")
    assert not list(tmp_path.iterdir())
    rp.write_motion(rp.timed(motion, limits, rate=50.0), tmp_path / "fast.csv")


@pytest.mark.parametrize("tiny", [{"jerk": 1e-12}, {"jerk": 1e-300}, {"acceleration": 1e-12}])
def test_limits_that_no_motion_ends_within_are_one_line(
    tiny: dict[str, float], ring: rp.Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Item 26.18: refused before any profile is computed, by ``J T³/6`` and ``a T²/2``."""
    monkeypatch.setattr("scipy.optimize.milp", None)
    kept = rp.Limits(velocity=9.0, **{"acceleration": 5.0} | tiny)
    away = np.abs(ring.q - ring.q[0]).max()
    for call, way in (
        (lambda: rp.timed(ring, kept), away),
        (lambda: rp.approach(ring.q[0] - 0.3, ring, kept), 0.3),
    ):
        with pytest.raises(rp.InputError, match="at least .* s, which at 1000 samples") as caught:
            call()
        least = float(re.search(r"at least (\S+) s", str(caught.value))[1])
        jerk, a = tiny.get("jerk"), tiny.get("acceleration")
        law = (6 * way) ** (1 / 3) / jerk ** (1 / 3) if jerk else (2 * way / a) ** 0.5
        assert np.isclose(least, law, rtol=0.01)


def test_tiny_jerk_at_a_low_rate_is_refused_before_any_program(
    ring: rp.Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Item 26.18: memory would suffice; the bound is ``(6 q / J)^⅓``, and the remedy is enough."""
    monkeypatch.setattr("scipy.optimize.milp", None)
    away = np.abs(ring.q - ring.q[0]).max()
    for jerk in (1e-12, 1e-14):
        with pytest.raises(rp.InputError, match="more than an hour; raise the jerk") as caught:
            rp.timed(ring, rp.Limits(velocity=9.0, acceleration=5.0, jerk=jerk), rate=0.1)
        least = float(re.search(r"shorter than (\S+) s", str(caught.value))[1])
        assert np.isclose(least, (6 * away / jerk) ** (1 / 3), rtol=0.01)


def test_the_command_refuses_a_coarse_rate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Item 26.18: by the command, no file is left, and the rate that it names is taken."""
    monkeypatch.chdir(tmp_path)
    words = ["follow", "planar3r", "--strategy", "pseudoinverse", "--steps", "100"]
    words += ["--acceleration", "5", "--csv", "m.csv"]
    said = refused(capsys, *words, "--rate", "0.5")
    found = re.search(
        r"samples per cycle .*; use a rate of at least (\d+) samples per second", said
    )
    assert found is not None and not list(tmp_path.iterdir())
    told(capsys, *words, "--rate", found[1])
    assert len((tmp_path / "m.csv").read_text().splitlines()) > 10
