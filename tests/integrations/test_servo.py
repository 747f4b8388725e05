"""The state machine of the ROS 2 node, without ROS: what it commands after each kind of message."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA
from cell_functions import function_of
from controls import some
from two_armed import Q0 as Q_TWO
from two_armed import two_armed

import repctl_pin as rp
from repctl_pin.extensions.integrations.servo import Servo, State
from repctl_pin.extensions.integrations.steady_time import SteadyTime

Q0, RATE, A, J = np.array([0.3, 0.8, 0.8]), 200.0, 6.0, 400.0
FEW = rp.FitOptions(samples=64, held_out=64)
TOOL = pin.SE3(pin.exp3(np.array([0.2, -0.1, 0.3])), np.array([0.02, 0.01, 0.1]))
WALL = """<robot name="w"><link name="room"/><link name="wall"><collision><geometry>
<box size="0.02 1 1"/></geometry></collision></link><joint name="a" type="fixed">
<parent link="room"/><child link="wall"/><origin xyz="0.46 0 0.4"/></joint></robot>"""


@cache
def design() -> rp.Design:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    potentials = rp.Polynomial(Q0, 2, 0.5)
    return rp.nearest_repeatable(rp.Pseudoinverse(task), potentials, rp.Box(Q0, 0.6), options=FEW)


class Bench:
    """A servo, and an arm that is always where it was commanded to be."""

    def __init__(self, q: np.ndarray = Q0, of: rp.Design | None = None) -> None:
        self.servo = Servo(of or design(), RATE, rp.Limits(acceleration=A, jerk=J))
        self.task, self.q, self.now, self.answers = self.servo.task, q.copy(), 0.0, True
        self.age = 0.0
        self.sent: list[np.ndarray] = []

    def run(self, seconds: float) -> np.ndarray | None:
        """Tick; return the last command, None if the last tick had none."""
        q = None
        for _ in range(round(seconds * RATE)):
            self.now += 1 / RATE
            if self.answers:
                found = dict(zip(self.task.joint_names, self.q, strict=True))
                self.servo.joints(found, self.now, age=self.age)
            q = self.servo.tick(self.now)
            if q is not None:
                self.q = q
                self.sent.append(q)
        return q

    def at(self, x: float, y: float, **more: float) -> None:
        """Ask for a displacement of the start's position."""
        p = self.task.placement(Q0).translation + [x, y, 0]
        self.servo.pose(p, (0, 0, 0, 1), **more)  # type: ignore[arg-type]

    def used(self) -> float:
        """Largest share of a limit in all commands, begun from rest."""
        Q = np.concatenate([np.tile(self.sent[0], (3, 1)), self.sent])
        most = (self.task.velocity_limit, A, J)
        return max(
            float((np.abs(np.diff(Q, k, axis=0)) * RATE**k / limit).max())
            for k, limit in enumerate(most, 1)
        )


@pytest.fixture
def bench() -> Bench:
    made = Bench()
    made.run(0.2)
    assert made.servo.state is State.RUNNING
    return made


def test_nothing_is_sent_before_the_joints_are_known_and_rest() -> None:
    bench = Bench()
    bench.answers = False
    assert bench.run(0.5) is None and bench.servo.reason == "no joint states yet"
    bench.servo.joints({bench.task.joint_names[0]: 0.3, "finger": 1.0}, bench.now)
    assert bench.run(0.1) is None and bench.servo.reason.startswith("no joint state of ")
    bench.answers = True
    for k in range(100):  # pushed by hand
        bench.q = Q0 + 0.002 * k
        assert bench.run(1 / RATE) is None and bench.servo.reason == "the arm moves"
    bench.q = Q0 + 9.0
    assert bench.run(0.5) is None and bench.servo.reason.startswith("cannot start: ")
    bench.q = Q0
    q = bench.run(0.5)
    assert q is not None and (q == Q0).all() and bench.servo.reason == ""


def test_targets_are_reached_on_one_leaf_within_the_limits(bench: Bench) -> None:
    inverse = design().inverse
    for x, y in (0.1, 0.05), (-0.1, 0.1), (0.1, 0.05):
        bench.at(x, y)
        q = bench.run(2.0)
        assert q is not None
        goal = bench.task.placement(Q0).translation + [x, y, 0]
        assert np.abs(bench.task.placement(q).translation - goal).max() < 1e-9
        assert np.abs(inverse.leaf(q) - inverse.leaf(Q0)).max() < 1e-9
    assert 0.5 < bench.used() <= 1 + 1e-6


@pytest.mark.parametrize(
    ("position", "more", "said"),
    [
        ((np.nan, 0, 0), {}, "target refused: a position or quaternion has numbers that"),
        ((1, 1, 0), {"frame": "camera"}, "it is in frame 'camera', not in 'base'"),
        ((1, 1, 0), {"age": 5.0}, "its stamp is 5 s before this clock"),
        ((1, 1, 0), {"age": -5000.0}, "its stamp is 5000 s ahead of this clock"),
        ((1, 1, 0), {"age": np.nan}, "its stamp is nan s"),
    ],
)
def test_a_bad_target_stops_the_arm(
    bench: Bench, position: tuple[float, ...], more: dict, said: str
) -> None:
    bench.at(0.2, 0.0)
    bench.run(0.15)
    base = bench.servo.base
    bench.servo.pose(position, (0, 0, 0, 1), **more)
    assert said.replace("'base'", repr(base)) in bench.servo.reason
    bench.run(1.0)
    assert bench.servo.at_rest and bench.servo.state is State.RUNNING
    assert np.abs(bench.sent[-1] - bench.sent[0]).max() > 1e-3 and bench.used() <= 1 + 1e-6
    bench.at(0.0, 0.0)
    bench.run(2.0)
    assert bench.servo.reason == "" and np.abs(bench.q - Q0).max() < 1e-9


def test_a_twist_holds_for_the_timeout_only(bench: Bench) -> None:
    bench.servo.twist((0.1, 0, 0, 0, 0, 0), bench.now)
    bench.run(1.0)
    moved = bench.task.placement(bench.q).translation - bench.task.placement(Q0).translation
    assert 0 < moved[0] < 0.03 and abs(moved[1]) < 1e-6 and bench.servo.at_rest
    assert bench.servo.reason == "the last twist is more than 0.1 s old"
    bench.servo.twist((np.inf, 0, 0, 0, 0, 0), bench.now)
    assert bench.servo.reason == "twist refused: its numbers must be finite"


@pytest.mark.parametrize(
    "clock",
    [
        pytest.param(lambda t: t - 600, id="steps back"),
        pytest.param(lambda t: 0.2, id="stands still"),
        pytest.param(lambda t: -t, id="runs backwards"),
        pytest.param(lambda t: 1000 - (1000 * t) % 7, id="jumps about"),
        pytest.param(lambda t: np.nan, id="is not a number"),
    ],
)
def test_a_twist_ends_whatever_the_clock_does(bench: Bench, clock) -> None:
    """Issue 37, item 8: after a step back of 600 s, the last twist was never too old."""
    bench.servo.twist((0.1, 0, 0, 0, 0, 0), bench.now)
    begin = bench.now
    for k in range(1, 200):
        now = clock(begin + k / RATE)
        bench.servo.joints(dict(zip(bench.task.joint_names, bench.q, strict=True)), now)
        q = bench.servo.tick(now)
        bench.q = bench.q if q is None else q
        bench.sent.append(bench.q)
    moved = bench.task.placement(bench.q).translation - bench.task.placement(Q0).translation
    assert moved[0] < 0.1 * (0.1 + 0.1) and bench.servo.at_rest
    assert bench.used() <= 1 + 1e-6


@pytest.mark.parametrize("clock", [lambda t: t - 600, lambda t: 0.2, lambda t: -t])
def test_joints_that_stop_are_noticed_whatever_the_clock_does(bench: Bench, clock) -> None:
    """Issue 37, item 8: the twin, measured joints that are no longer measured."""
    bench.at(0.2, 0.0)
    begin = bench.now
    for k in range(1, 400):
        q = bench.servo.tick(clock(begin + k / RATE))
        if q is not None:
            bench.sent.append(q)
    assert q is None and bench.servo.state is State.WAITING
    assert bench.used() <= 1 + 1e-6


def test_time_goes_on_with_the_clock_and_without_it() -> None:
    """With a good clock it is the clock's; otherwise each tick is one period."""
    rng, time = np.random.default_rng(0), SteadyTime(0.01)
    good = 5.0 + np.cumsum(rng.uniform(0.006, 0.02, 100))
    assert np.allclose([time.tick(now) for now in good], good, rtol=0, atol=1e-12)
    last = good[-1]
    for k, now in enumerate([last, last - 600, np.nan, -np.inf, last - 700], 1):
        assert np.isclose(time.tick(now), last + 0.01 * k)
    assert np.isclose(time.tick(last - 700 + 0.01), last + 0.06)


@pytest.mark.parametrize(
    ("age", "said"),
    [
        (3600.0, "their stamp is 3600 s before this clock; synchronise the clocks"),
        (-0.5, "their stamp is 0.5 s ahead of this clock; synchronise the clocks"),
        (np.nan, "joint states are refused: "),
        (np.inf, "joint states are refused: "),
    ],
)
def test_stale_stamps_of_joints_start_nothing_and_stop_a_motion(
    bench: Bench, age: float, said: str
) -> None:
    """Issue 37, item 8: joint states stamped an hour ago started the arm."""
    fresh = Bench()
    fresh.age = age
    assert fresh.run(1.0) is None and fresh.servo.state is State.WAITING
    assert said in fresh.servo.reason
    bench.at(0.2, 0.0)
    bench.run(0.15)
    bench.age = age
    assert bench.run(1.5) is None and bench.servo.state is State.WAITING
    assert said in bench.servo.reason and bench.used() <= 1 + 1e-6
    bench.age = 0.05
    assert bench.run(0.5) is not None and bench.servo.state is State.RUNNING


def test_a_driver_that_repeats_its_last_message_is_late(bench: Bench) -> None:
    """Issue 37, item 8: the values still arrive, and only their stamp shows that they are old."""
    bench.at(0.2, 0.0)
    for k in range(300):
        bench.age = k / RATE
        q = bench.run(1 / RATE)
    assert q is None and bench.servo.state is State.WAITING and bench.used() <= 1 + 1e-6


def test_hold_stops_and_keeps_no_target(bench: Bench) -> None:
    bench.at(0.2, 0.0)
    bench.run(0.15)
    bench.servo.hold()
    bench.at(0.2, 0.0)
    bench.run(1.0)
    held = bench.q
    assert bench.servo.state is State.HOLDING and bench.servo.at_rest
    bench.servo.resume()
    bench.run(0.3)
    assert bench.servo.state is State.RUNNING and (bench.q == held).all()
    bench.at(0.0, 0.0)
    bench.run(2.0)
    assert np.abs(bench.q - Q0).max() < 1e-9 and bench.used() <= 1 + 1e-6


def test_stale_joints_brake_then_nothing_is_sent(bench: Bench) -> None:
    bench.at(0.2, 0.0)
    bench.run(0.15)
    bench.answers = False
    assert bench.run(1.5) is None and bench.servo.state is State.WAITING
    assert "joint states are" in bench.servo.reason and bench.used() <= 1 + 1e-6
    last = bench.sent[-1]
    assert (last == bench.sent[-3]).all()
    bench.answers = True
    q = bench.run(0.5)
    assert q is not None and (q == last).all()  # on the same leaf, without the old target


def beyond_a_limit() -> tuple[Bench, np.ndarray, pin.SE3]:
    """A bench whose second joint is measured 0.05 rad beyond its limit, and a target inside."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q = np.array([0.3, task.upper[1] + 0.05, 0.8])
    middle = np.array([0.3, task.upper[1] - 0.4, 0.8])
    few = rp.Polynomial(middle, 2, 0.5)
    box = rp.Box(middle, 0.6)
    of = rp.nearest_repeatable(rp.Pseudoinverse(task), few, box, options=FEW)
    bench = Bench(q, of)
    bench.run(0.2)
    inside = np.array([0.3, task.upper[1], 0.8])
    goal, back = task.placement(inside), of.inverse(inside)[1]  # towards a smaller second joint
    goal.translation[:2] -= 0.02 * back / np.linalg.norm(back)
    return bench, q, goal


def slowly_inside(bench: Bench, q: np.ndarray) -> bool:
    """Tell whether the way back is never farther out, and at most at a tenth of the speed."""
    Q = np.array([q, *bench.sent])
    out = Q[:, 1] > bench.task.upper[1]
    speed = np.abs(np.diff(Q, axis=0))[out[:-1]].max() * RATE
    back = bool(np.diff(Q[out, 1]).max() <= 1e-12)
    return back and bool(speed <= 0.1 * bench.task.velocity_limit.min())


def test_an_arm_beyond_a_limit_moves_back_inside_first() -> None:
    """Item 26.4: it waits for a target, says why it moves elsewhere, and then follows it."""
    bench, q, goal = beyond_a_limit()
    servo = bench.servo
    assert servo.state is State.RUNNING and (np.array(bench.sent) == q).all()
    servo.pose(goal.translation, (0, 0, 0, 1))
    bench.run(0.1)
    assert servo.stopped_early and servo.status.name == "RECOVERING"
    assert (
        servo.said == "running: a joint is beyond its limit or margin: it moves back inside first"
    )
    bench.run(5)
    assert servo.status.name == "OK" and servo.said == "running"
    assert slowly_inside(bench, q) and bench.used() <= 1 + 1e-6
    assert np.abs(bench.task.placement(bench.q).translation - goal.translation).max() < 1e-9


@pytest.mark.parametrize("event", some(["hold", "stale", "leaf", "twist"], "stale"))
def test_the_way_back_inside_is_not_broken_off(event: str) -> None:
    """Item 26.4: whatever comes in between, the arm comes to rest inside its limits."""
    bench, q, goal = beyond_a_limit()
    servo, inside = bench.servo, bench.task.upper[1]
    servo.pose(goal.translation, (0, 0, 0, 1))
    bench.run(0.3)
    assert servo.status.name == "RECOVERING" and bench.q[1] > inside
    if event == "hold":
        servo.hold()
    elif event == "stale":
        bench.answers = False
    elif event == "leaf":
        at = np.array([0.3, inside, 0.8])
        still = np.linalg.svd(bench.task.jacobian(at))[2][-1]  # the self-motion
        servo.leaf(servo._inverse.leaf(at - 0.03 * np.sign(still[1]) * still))
    else:
        servo.twist([0.05, 0, 0, 0, 0, 0], bench.now)
    bench.run(5)
    assert bench.q[1] <= inside and servo.at_rest
    assert slowly_inside(bench, q) and bench.used() <= 1 + 1e-6
    if event == "leaf":  # reached afterwards, then the target
        assert np.abs(bench.task.placement(bench.q).translation - goal.translation).max() < 1e-9


def test_hold_outlasts_stale_joints(bench: Bench) -> None:
    bench.servo.hold()
    bench.answers = False
    bench.run(1.0)
    bench.answers = True
    bench.at(0.1, 0.0)
    bench.run(1.0)
    assert bench.servo.state is State.HOLDING and (bench.q == Q0).all()
    assert bench.servo.reason == "held on request"


def test_an_arm_that_does_not_follow_gets_no_commands_until_resumed(bench: Bench) -> None:
    pushed = Q0 + [0.0, 0.3, 0.0]
    for _ in range(100):
        bench.q = pushed
        q = bench.run(1 / RATE)
    assert q is None and bench.servo.state is State.HOLDING
    assert bench.servo.reason.startswith("the arm does not follow: ")
    bench.servo.resume()
    q = bench.run(0.5)
    assert q is not None and (q == pushed).all() and bench.servo.state is State.RUNNING


def test_resume_while_braking_after_a_fault_moves_nowhere() -> None:
    """Issue 37, item 8: it went on, 0.60 rad from the joints, and compared no more."""
    sent = []
    for resumes in False, True:
        bench = Bench()
        bench.run(0.2)
        bench.at(0.4, 0.0)
        bench.run(0.25)
        stuck, answered = bench.q + [0.0, 0.35, 0.0], bench.task.joint_names
        for _ in range(100):
            bench.now += 1 / RATE
            bench.servo.joints(dict(zip(answered, stuck, strict=True)), bench.now)
            q = bench.servo.tick(bench.now)
            if q is None:
                break
            bench.sent.append(q)
            if resumes:
                bench.servo.resume()
                bench.at(0.4, 0.0)
        assert q is None and bench.used() <= 1 + 1e-6
        sent.append(np.array(bench.sent))
    assert len(sent[0]) > 60 and np.array_equal(*sent)
    bench.q = stuck
    q = bench.run(0.5)
    assert q is not None and (q == stuck).all() and bench.servo.state is State.RUNNING


def test_an_arm_that_is_stuck_says_why(bench: Bench) -> None:
    """Issue 37, item 8: the message was only "running"."""
    bench.at(5.0, 0.0)
    bench.run(3.0)
    assert bench.servo.at_rest and bench.servo.stopped_early
    assert bench.servo.said.startswith("running: stopped before the target: ")
    assert "Ω" in bench.servo.said or "reach" in bench.servo.said
    bench.at(0.0, 0.0)
    bench.run(3.0)
    assert bench.servo.said == "running" and np.abs(bench.q - Q0).max() < 1e-9


def test_a_leaf_is_reached_with_the_next_target(bench: Bench) -> None:
    inverse = design().inverse
    wanted = inverse.leaf(Q0) + 0.2
    assert bench.servo.leaf(wanted) == ""
    assert (
        bench.servo.leaf([0.1, 0.2])
        == bench.servo.leaf([np.nan])
        == "leaf must be 1 finite numbers"
    )
    bench.run(0.5)
    assert (bench.q == Q0).all()  # nothing moves without a target
    bench.at(0.05, 0.0)
    bench.run(6.0)
    goal = bench.task.placement(Q0).translation + [0.05, 0, 0]
    assert np.abs(inverse.leaf(bench.q) - wanted).max() < 1e-9
    assert np.abs(bench.task.placement(bench.q).translation - goal).max() < 1e-9
    assert bench.used() <= 1 + 1e-6
    way = [bench.task.placement(q).translation[0] for q in bench.sent]
    shares = (np.array(way) - way[0]) / 0.05
    levels = np.array([(inverse.leaf(q) - inverse.leaf(Q0))[0] for q in bench.sent]) / 0.2
    np.testing.assert_allclose(levels, shares, atol=1e-7)  # at the same time


def test_a_level_by_message_moves_the_elbow_while_the_hand_rests(bench: Bench) -> None:
    """57.1: at once and within the limits; a stop drops it, and no later target brings it back."""
    inverse, place = design().inverse, bench.task.placement(Q0)
    wanted = inverse.leaf(Q0) + 0.2
    bench.servo.level(wanted)
    bench.run(3.0)
    assert np.abs(inverse.leaf(bench.q) - wanted).max() < 1e-9 and bench.servo.said == "running"
    assert max(np.abs(bench.task.error(q, place)).max() for q in bench.sent) < 1e-9
    bench.servo.level(inverse.leaf(Q0))
    bench.run(0.1)
    for bad, said in (([0.1, 0.2], "1 finite"), ([np.nan], "1 finite"), ([], "1 finite")):
        bench.servo.level(bad)
        assert bench.servo.reason.startswith("level refused: leaf must be ")
        assert said in bench.servo.reason
    bench.run(1.0)
    rest = inverse.leaf(bench.q)
    assert bench.servo.at_rest and np.abs(rest - inverse.leaf(Q0)).max() > 0.02
    bench.at(0.05, 0.0)
    bench.run(2.0)
    assert np.abs(inverse.leaf(bench.q) - rest).max() < 1e-9
    bench.servo.hold()
    bench.servo.level(wanted)
    held = bench.run(1.0)
    bench.servo.resume()
    assert (bench.run(1.0) == held).all() and bench.used() <= 1 + 1e-6


def seek(bench: Bench, ticks: int = 600) -> None:
    """Tick until the arm rests at the level of the elbow; a search takes real time."""
    for _ in range(ticks):
        bench.run(5 / RATE)
        if bench.servo.at_rest and not bench.servo._elbow.searching:
            return
        time.sleep(1e-3)


def test_hand_and_elbow_back_bring_the_joints_back(bench: Bench) -> None:
    """57.1: points of the base; the elbow is at the nearest place, also beyond Ω's edge."""
    inverse, rng, ends = design().inverse, np.random.default_rng(4), []
    begin = inverse.elbow(Q0)
    for x, y, point in [
        (0.0, 0.0, begin),
        (0.08, 0.03, begin + [0.05, 0.02, 0]),
        (-0.05, 0.06, begin + [-9.0, 0.3, 0]),
        *((*rng.uniform(-0.05, 0.05, 2), begin + rng.normal(size=3) * 0.2) for _ in range(3)),
        (0.0, 0.0, begin),
    ]:
        bench.at(x, y)
        bench.servo.elbow(point)
        seek(bench)
        assert bench.servo.said == "running" and bench.servo.status.name == "OK"
        goal = bench.task.placement(Q0)
        goal.translation += [x, y, 0]
        assert np.abs(bench.task.error(bench.q, goal)).max() < 1e-9
        found = inverse.leaf_toward(inverse.solve(goal, Q0), elbow=point, margin=0.02)
        assert np.abs(bench.q - found.q).max() < 1e-6
        assert bench.servo.elbow_said == f"{found.distance:.3g} m from its point"
        ends.append(bench.q)
    assert np.ptp([inverse.leaf(q)[0] for q in ends]) > 0.1
    assert np.abs(ends[-1] - ends[0]).max() < 1e-9 and bench.used() <= 1 + 1e-6
    assert max(design().region.ratio(q[None])[0] for q in ends) <= 1


@pytest.mark.parametrize(
    ("point", "more", "said"),
    [
        ((np.nan, 0, 0), {}, "elbow refused: its numbers must be finite"),
        ((0.1, 0, 0), {"frame": "camera"}, "elbow refused: it is in frame 'camera'"),
        ((0.1, 0, 0), {"age": 5.0}, "elbow refused: its stamp is 5 s before"),
    ],
)
def test_a_bad_elbow_stops_the_arm(bench: Bench, point: tuple, more: dict, said: str) -> None:
    bench.at(0.2, 0.0)
    bench.run(0.15)
    bench.servo.elbow(point, **more)
    assert said in bench.servo.reason
    rest = bench.run(1.0)
    assert bench.servo.at_rest and bench.used() <= 1 + 1e-6
    bench.servo.elbow(design().inverse.elbow(rest))
    seek(bench)
    assert bench.servo.reason == ""


def test_an_elbow_where_no_level_is_found_keeps_the_level(bench: Bench) -> None:
    inverse = design().inverse
    bench.at(5.0, 0.0)
    bench.servo.elbow(inverse.elbow(Q0) + [0, 0.1, 0])
    for _ in range(300):
        bench.run(1 / RATE)
        time.sleep(1e-3)
        if bench.servo.elbow_said:
            break
    assert bench.servo.elbow_said.startswith("no level found: ")
    assert "the level stays constant: none was found for the elbow: " in bench.servo.said
    bench.run(2.0)
    assert np.abs(inverse.leaf(bench.q) - inverse.leaf(Q0)).max() < 1e-9


def test_the_clutch_takes_the_operators_elbow(bench: Bench) -> None:
    """57.2: either message may come first; the first point is the arm's own elbow."""
    servo, hand, still = bench.servo, np.array([5.0, -3.0, 1.0]), (0, 0, 0, 1)
    elbow, inverse = np.array([4.8, -3.3, 1.0]), design().inverse
    servo.hand_elbow(elbow)
    assert (bench.run(0.3) == Q0).all()  # not coupled
    servo.couple(True)
    servo.hand_elbow(elbow)  # before the hand: it waits for the next one
    servo.hand(hand, still, bench.now)
    for _ in range(20):
        servo.hand(hand, still, bench.now)
        servo.hand_elbow(elbow)
        bench.run(1 / RATE)
        time.sleep(2e-3)
    assert np.abs(bench.q - Q0).max() < 1e-6
    for k in range(200):
        servo.hand(hand + [0.0005 * min(k, 100), 0, 0], still, bench.now)
        servo.hand_elbow(elbow + [0, 0.0008 * min(k, 100), 0])
        bench.run(2 / RATE)
        time.sleep(2e-3)
    goal = bench.task.placement(Q0)
    goal.translation[0] += 0.05
    found = inverse.leaf_toward(
        inverse.solve(goal, Q0), elbow=inverse.elbow(Q0) + [0, 0.08, 0], margin=0.02
    )
    assert np.abs(bench.q - found.q).max() < 1e-6 and bench.used() <= 1 + 1e-6
    servo.hand_elbow([np.nan, 0, 0])
    assert servo.reason == "elbow refused: its numbers must be finite; the level stays constant"
    for k in range(100):
        servo.hand(hand + [0.05 - 0.0005 * k, 0, 0], still, bench.now)
        servo.hand_elbow(elbow)
        bench.run(2 / RATE)
    moved = bench.task.placement(bench.q).translation - bench.task.placement(Q0).translation
    assert abs(moved[0]) < 0.01 and np.abs(inverse.leaf(bench.q) - found.leaf).max() < 1e-6


def test_a_leaf_out_of_reach_stops_the_arm_before_it(bench: Bench) -> None:
    bench.servo.leaf(design().inverse.leaf(Q0) + 50.0)
    bench.at(0.05, 0.0)
    bench.run(8.0)
    assert bench.servo.stopped_early and bench.servo.at_rest
    assert bench.servo.said.startswith("running: stopped before the target: ")
    assert bench.used() <= 1 + 1e-6


def test_it_brakes_before_it_ends(bench: Bench) -> None:
    bench.at(0.2, 0.0)
    bench.run(0.15)
    while (q := bench.servo.brake()) is not None:
        bench.sent.append(q)
    assert (bench.sent[-1] == bench.sent[-3]).all() and bench.used() <= 1 + 1e-6
    assert Bench().servo.brake() is None


def test_random_messages_never_exceed_a_limit_or_leave_the_leaf() -> None:
    bench, rng = Bench(), np.random.default_rng(0)
    inverse, said = design().inverse, set()
    bench.run(0.2)
    for _ in range(150):
        kind = int(rng.integers(9))
        if kind < 4:
            p = bench.task.placement(Q0).translation + rng.normal(size=3) * rng.choice(
                [0.05, 2, 1e9]
            )
            bench.servo.pose(p, rng.normal(size=4))
        elif kind == 4:
            bench.servo.twist(rng.normal(size=6) * rng.choice([0.1, 10, 1e9]), bench.now)
        elif kind == 5:
            bench.servo.pose(rng.choice([np.nan, np.inf, 0.0], 3), (0, 0, 0, 0))
        elif kind == 6:
            bench.servo.hold()
        elif kind == 7:
            bench.answers = not bench.answers
        else:
            bench.servo.resume()
            bench.answers = True
        bench.run(float(rng.choice([0.01, 0.1, 0.4])))
        said |= {bench.servo.state, bench.servo.status}
    Q = np.array(bench.sent)
    assert bench.used() <= 1 + 1e-6 and np.isfinite(Q).all() and len(Q) > 1000
    assert max(np.abs(inverse.leaf(q) - inverse.leaf(Q0)).max() for q in Q[::5]) < 1e-8
    assert set(State) <= said and (Q > bench.task.lower).all() and (Q < bench.task.upper).all()


def test_the_status_says_when_the_command_is_beyond_the_proved_radius() -> None:
    made = design()
    proof = rp.prove(made, seconds=5)
    closes = replace(proof.closes, metres=0.05)
    proof = replace(proof, closes=closes, seal="").sealed(made.subject)
    bench = Bench()
    bench.servo = Servo(replace(made, proof=proof), RATE, rp.Limits(acceleration=A, jerk=J))
    bench.run(0.2)
    bench.at(0.2 * proof.closes.metres, 0.0)
    bench.run(2.0)
    assert bench.servo.said == "running"
    bench.at(1.2 * proof.closes.metres, 0.0)
    bench.run(3.0)
    assert bench.servo.state is State.RUNNING and not bench.servo.stopped_early
    assert bench.servo.said == "running, beyond the proved radius"
    bench.at(0.0, 0.0)
    bench.run(3.0)
    assert bench.servo.said == "running"


def test_a_clutch_moves_the_arm_with_the_hand_and_stops_it(bench: Bench) -> None:
    servo, hand, still = bench.servo, np.array([5.0, -3.0, 1.0]), (0, 0, 0, 1)
    servo.hand(hand, still, bench.now)
    assert (bench.run(0.3) == Q0).all()  # not coupled
    servo.couple(True)
    for k in range(100):
        servo.hand(hand + [0.001 * k, 0, 0], still, bench.now)
        q = bench.run(1 / RATE)
        if k == 0:
            assert (q == Q0).all()
    moved = bench.task.placement(bench.q).translation - bench.task.placement(Q0).translation
    assert 0.05 < moved[0] <= 0.1 and abs(moved[1]) < 1e-3
    bench.run(0.5)
    assert servo.at_rest and servo.reason == "the last hand pose is more than 0.1 s old"
    servo.hand(hand + 1, still, bench.now)  # found again: not coupled any more
    rest = bench.run(0.5)
    assert (rest == bench.sent[-50]).all()
    servo.couple(True)
    servo.hand(hand + 1, still, bench.now)
    assert np.abs(bench.run(0.05) - rest).max() < 1e-9 and servo.reason == ""
    servo.hand((np.nan, 0, 0), still, bench.now)
    assert "hand pose refused: a position or quaternion has numbers that" in servo.reason
    servo.couple(True)
    servo.hold()
    servo.hand(hand, still, bench.now)
    assert (bench.run(0.3) == bench.sent[-1]).all() and bench.used() <= 1 + 1e-6


def test_bodies_stop_the_arm_and_are_named(tmp_path: Path) -> None:
    near = tmp_path / "near.urdf"
    near.write_text(WALL)
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), None, rp.Box(Q_PANDA, 0.4), degree=1, options=FEW
    )
    servo = Servo(
        design,
        RATE,
        rp.Limits(acceleration="panda", jerk="panda"),
        bodies=rp.Bodies(task, surroundings=near),
        body_distance=0.03,
        tool=TOOL,
    )
    place = task.placement(Q_PANDA) * TOOL
    q, now = Q_PANDA, 0.0
    for k in range(300):
        now += 1 / RATE
        servo.joints(dict(zip(task.joint_names, q, strict=True)), now)
        if k == 60:
            turn = pin.Quaternion(place.rotation).coeffs()
            servo.pose(place.translation + [0.15, 0, 0], turn)
        sent = servo.tick(now)
        q = q if sent is None else sent
    assert "and wall are near each other ahead" in servo.said
    assert 0.03 <= rp.Bodies(task, surroundings=near).nearest(q).distance < 0.04
    moved = task.placement(q) * TOOL  # on the tool's own straight line
    assert moved.translation[0] > place.translation[0] + 0.01
    assert np.abs(moved.translation - place.translation)[1:].max() < 1e-6


def test_links_without_a_shape_are_refused_unless_allowed(tmp_path: Path) -> None:
    """Item 26.5."""
    text = rp.Robot.load("panda").description.path.read_text()
    mesh = "example-robot-data/robots/panda_description/meshes/collision/link5"
    (tmp_path / "arm.urdf").write_text(text.replace(mesh, "gone/link5"))
    folders = rp.Robot.load("panda").package_dirs
    task = rp.Robot.load(tmp_path / "arm.urdf", package_dirs=folders).task("panda_hand_tcp")
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), None, rp.Box(Q_PANDA, 0.1), degree=1, options=FEW
    )
    limits, bodies = rp.Limits(acceleration="panda"), rp.Bodies(task)
    with pytest.raises(rp.InputError, match="1 body without a collision shape.*: panda_link5;"):
        Servo(design, RATE, limits, bodies=bodies)
    Servo(design, RATE, limits, bodies=bodies, unchecked="allow")


def test_a_design_of_several_frames_is_refused(tmp_path: Path) -> None:
    task = two_armed(tmp_path).task
    both = rp.nearest_repeatable(
        rp.Pseudoinverse(task), None, rp.Box(Q_TWO, 0.1), degree=1, options=FEW
    )
    with pytest.raises(rp.InputError, match="^the ROS 2 node takes a task of one"):
        Servo(both, RATE, rp.Limits(acceleration=A))


def of_cell(F: rp.InverseFunction, tool: pin.SE3) -> Servo:
    """A servo of a cell's function, whose evaluation does not matter here."""
    design = rp.CellDesign.__new__(rp.CellDesign)
    object.__setattr__(design, "function", F)
    return Servo(design, RATE, rp.Limits(acceleration=5.0), tool=tool)


def test_a_tool_of_a_cell_gets_the_targets_and_twists() -> None:
    F = function_of("poses")
    servo, x = of_cell(F, TOOL), F.cell.at(0.3 * np.ones(F.cell.k))
    q, now, names = F(F.cell.placement), 0.0, F.task.joint_names
    tips = []
    for k in range(600):
        now += 1 / RATE
        servo.joints(dict(zip(names, q, strict=True)), now)
        if k == 40:
            goal = x * TOOL
            turn = pin.Quaternion(goal.rotation).coeffs()
            servo.pose(goal.translation, turn)
        elif k == 450:
            assert np.abs(q - F(x)).max() < 1e-9
        elif k > 450:
            servo.twist((0, 0, 0, 0.1, 0.0, 0.1), now)
            tips.append((F.task.placement(q) * TOOL).translation)
        sent = servo.tick(now)
        q = q if sent is None else sent
    assert np.ptp(tips, axis=0).max() < 1e-3  # it turns about the tool's tip
    end = F.task.placement(q)
    assert np.linalg.norm(end.translation - x.translation) > 5e-3
    with pytest.raises(rp.InputError, match="another tool requires a pose task"):
        of_cell(function_of("positions"), TOOL)
