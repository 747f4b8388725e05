"""Time for motions: closed forms, laws of scale, limits on a finer grid, cycles alike; and the way
in."""

from __future__ import annotations

import io
import time
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import yaml
from arms import planar_task
from commands import refused, told

import repctl_pin as rp
from repctl_pin.motion.csv_file import csv_text, read_motions
from repctl_pin.motion.spec import parse_path
from repctl_pin.motion.timing import PRESETS
from repctl_pin.motion.write_motion import yaml_text

PANDA = np.array(PRESETS["panda"][0], float)
Q3 = np.array([0.3, 0.8, 0.8])


@pytest.fixture(scope="module")
def planar() -> rp.Task:
    return rp.Robot.load("planar3r").task("tool", "xy")


def closing(task: rp.Task) -> rp.RepeatableInverse:
    """A control whose leaf is θ₁ − θ₂/2 + θ₃/2 = const."""
    return rp.RepeatableInverse(
        task, rp.Polynomial(Q3, 1).weighted(np.array([[1.0], [-0.5], [0.5]]))
    )


@pytest.fixture(scope="module")
def ring(planar: rp.Task) -> rp.Motion:
    """Ten cycles that close."""
    control = closing(planar)
    return rp.follow(control, rp.circle(planar, Q3, 0.3), Q3, cycles=10, steps=200)


@pytest.fixture(scope="module")
def panda_motions(panda_pose, panda_design, q_panda) -> dict[str, rp.Motion]:
    path = rp.circle(panda_pose, q_panda, 0.1, start_angle=np.pi)
    controls = {"plain": rp.Pseudoinverse(panda_pose), "ours": panda_design.inverse}
    return {
        name: rp.follow(control, path, q_panda, cycles=10, steps=300)
        for name, control in controls.items()
    }


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
        way = rp.approach(begin, ring, velocity=v, acceleration=a)
        judged(way)
        expected = 1.2 / v + v / a if v * v / a < 1.2 else 2 * np.sqrt(1.2 / a)
        assert np.isclose(way.duration, expected, rtol=1e-4)
        np.testing.assert_allclose(way.q[[0, -1]], [begin, ring.q[0]], atol=1e-12)
        share = (way.q - begin) @ (Q3 - begin) / np.sum((Q3 - begin) ** 2)
        np.testing.assert_allclose(
            way.q, begin + share[:, None] * (Q3 - begin), atol=1e-12
        )  # straight


def test_ten_cycles_are_alike_but_the_first_and_the_last(ring) -> None:
    timed = rp.timed(ring, velocity=2.0, acceleration=6.0)
    judged(timed)
    assert timed.starts.size == 11 and timed.stops == 0
    np.testing.assert_allclose(np.diff(timed.starts)[1:-1], timed.cycle_time, atol=1e-9)
    assert np.isclose(timed.cycle_time * 1000 % 1, 0, atol=1e-6) or np.isclose(
        timed.cycle_time * 1000 % 1, 1, atol=1e-6
    )
    second = timed.cycle(1)
    for k in range(2, 9):
        for one, other in zip(second, timed.cycle(k), strict=True):
            np.testing.assert_allclose(other, one, atol=1e-9)
    for s in (timed.q[0], timed.q[-1]):
        np.testing.assert_allclose(s, ring.q[0], atol=1e-7)
    few = [rp.timed(replace(ring, cycles=k, q=ring.q[: 200 * k + 1], t=ring.t[: 200 * k + 1]), velocity=2.0,
                    acceleration=6.0).duration for k in (1, 2, 3, 4)]  # fmt: skip
    np.testing.assert_allclose(
        np.diff(few)[1:], timed.cycle_time, atol=2.1e-3
    )  # each cycle more takes one more
    assert np.isclose(few[3] + 6 * timed.cycle_time, timed.duration, atol=1e-9)


def test_limits_hold_on_a_finer_grid_and_the_path_is_the_same(ring) -> None:
    once = replace(ring, cycles=2, q=ring.q[:401], t=ring.t[:401])
    limits = {"velocity": [0.9, 1.1, 2.0], "acceleration": [3.0, 2.0, 8.0]}
    fine = rp.timed(once, rate=20_000, **limits)
    h = fine.t[1]
    qdot, qddot = np.diff(fine.q, axis=0) / h, np.diff(fine.q, 2, axis=0) / h**2
    used = np.abs(qdot / limits["velocity"]).max(), np.abs(qddot / limits["acceleration"]).max()
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
        rp.timed(ring, velocity=np.inf, acceleration=a, rate=1e5 if a > 3 else 1e4)
        for a in (2.0, 200.0)
    )
    assert np.isclose(slow.duration, 10 * quick.duration, rtol=1e-4)


def test_panda_takes_hardly_longer_than_under_the_pseudoinverse(panda_motions) -> None:
    times = {}
    for name, motion in panda_motions.items():
        one = replace(motion, cycles=1, q=motion.q[:301], t=motion.t[:301])
        times[name] = rp.timed(one, acceleration="panda").duration
        begin = time.process_time()
        ten = rp.timed(motion, acceleration="panda")
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
        timed = rp.timed(one, velocity=100.0, acceleration=300.0, torque=torque)
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
            rp.timed(one, acceleration=10.0, torque=True)
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
    timed = rp.timed(motion, velocity=2.0, acceleration=6.0)
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
    back = rp.timed(there, velocity=2.0, acceleration=6.0)
    judged(back)
    assert back.stops == 1


def test_rounded_corners_are_not_stops_and_take_less_time(planar) -> None:
    control = rp.Pseudoinverse(planar)
    motions = [
        rp.follow(control, parse_path(words)(planar, Q3), Q3, cycles=1, steps=400)
        for words in ("square:0.3", "square:0.3:blend=0.05")
    ]
    sharp, rounded = (rp.timed(motion, velocity=2.0, acceleration=6.0) for motion in motions)
    judged(rounded)
    assert (sharp.stops, rounded.stops) == (3, 0)
    assert rounded.duration < 0.95 * sharp.duration


def test_coordinates_do_not_matter(planar) -> None:
    absolute = planar.in_coordinates(rp.absolute_angles(planar))
    path = rp.circle(planar, Q3, 0.2)
    motion = rp.follow(
        rp.Pseudoinverse(absolute), path, absolute.coordinates.coordinates(Q3), cycles=1, steps=200
    )
    timed = rp.timed(motion, velocity=[1.0, 2.0, 3.0], acceleration=[3.0, 4.0, 5.0])
    judged(timed)
    plain = replace(motion, task=planar, q=motion.joints(motion.q), qdot=motion.joints(motion.qdot))
    same = rp.timed(plain, velocity=[1.0, 2.0, 3.0], acceleration=[3.0, 4.0, 5.0])
    np.testing.assert_allclose(timed.q, same.q, atol=1e-9)
    assert timed.joints == planar.joint_names
    with pytest.raises(rp.InputError, match="of the robot's own joints"):
        rp.timed(motion, acceleration=1.0, torque=True)


BAD = [
    ({}, "acceleration= is missing, and a URDF has none: .* panda, fr3, ur"),
    ({"acceleration": "kuka"}, "no accelerations of 'kuka' are known"),
    ({"acceleration": "panda"}, "of 7 joints, but 'tool' is moved by 3"),
    ({"acceleration": 0}, "acceleration must be"),
    ({"acceleration": [1, -1, 1]}, "acceleration must be"),
    ({"acceleration": np.nan}, "acceleration must be"),
    ({"acceleration": np.inf}, "acceleration must be finite"),
    ({"acceleration": [1, 2]}, "acceleration must be"),
    ({"acceleration": 1, "velocity": 0}, "velocity must be"),
    ({"acceleration": 1, "velocity": [1, np.nan, 1]}, "velocity must be"),
    ({"acceleration": 1, "rate": 0}, "rate must be above 0"),
]


@pytest.mark.parametrize("options, why", BAD, ids=range(len(BAD)))
def test_bad_limits_get_one_clear_line(ring, options: dict, why: str) -> None:
    for call in (lambda: rp.timed(ring, **options), lambda: rp.approach(Q3 + 0.1, ring, **options)):
        with pytest.raises(rp.InputError, match=why) as error:
            call()
        assert "\n" not in str(error.value)


def test_torque_limits_want_masses(tmp_path) -> None:
    task = planar_task([1, 1, 1], tmp_path)
    motion = rp.follow(closing(task), rp.circle(task, Q3, 0.1), Q3, cycles=1, steps=60)
    with pytest.raises(rp.InputError, match="torque limits need efforts and masses"):
        rp.timed(motion, acceleration=1.0, torque=True)


def test_what_cannot_be_approached_or_timed_is_refused(planar, ring) -> None:
    for q, why in (
        (Q3, "already"),
        ([9, 0, 0], "outside its limits"),
        ([0, 0], "2 numbers"),
        ([0, 0, np.nan], "finite"),
    ):
        with pytest.raises(rp.InputError, match=why):
            rp.approach(q, ring, acceleration=1.0)
    for wrong in (None, "motion", ring.q):
        with pytest.raises(rp.InputError, match="motion must be"):
            rp.timed(wrong, acceleration=1.0)
        with pytest.raises(rp.InputError, match="motion must be"):
            rp.approach(Q3, wrong, acceleration=1.0)
    with pytest.raises(rp.InputError, match="do not move"):
        rp.timed(replace(ring, q=np.tile(Q3, (len(ring.q), 1))), acceleration=1.0)
    with pytest.raises(rp.InputError, match="no cycle 10"):
        rp.timed(ring, acceleration=5.0).cycle(10)


def test_the_way_in_does_not_lead_through_the_robot_itself(panda_pose, panda_motions) -> None:
    folded = np.array([0.794, -0.812, -2.66, -3.022, 1.815, 3.424, 0.618])  # the hand at the base
    motion = panda_motions["ours"]
    least = rp.Bodies(panda_pose).distances(np.linspace(folded, motion.q[0], 101)).min()
    assert least < 0
    with pytest.raises(
        rp.InputError, match=r"'panda_\w+' and 'panda_\w+' touch, \d+% of it done: .* bodies=False"
    ):
        rp.approach(folded, motion, acceleration="panda")
    judged(rp.approach(folded, motion, acceleration="panda", bodies=False))
    judged(rp.approach(motion.q[0] + 0.2, motion, acceleration="panda"))


def test_a_robot_reads_what_was_computed(ring, tmp_path) -> None:
    once = replace(ring, cycles=1, q=ring.q[:201], t=ring.t[:201])
    timed = rp.timed(once, velocity=2.0, acceleration=6.0, rate=100)
    text = csv_text(timed)
    names = text.splitlines()[0].split(",")
    assert names == [
        "time",
        *(f"{j}{end}" for end in ("", "_velocity", "_acceleration") for j in timed.joints),
    ]
    table = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1)
    np.testing.assert_array_equal(
        table, np.column_stack([timed.t, timed.q, timed.qdot, timed.qddot])
    )
    (tmp_path / "timed.csv").write_text(text)
    np.testing.assert_array_equal(read_motions(tmp_path / "timed.csv", timed.joints)[0].q, timed.q)
    message = yaml.safe_load(yaml_text(timed))
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


def test_a_motion_is_written_for_a_robot(ring, tmp_path) -> None:
    timed = rp.timed(ring, acceleration=6.0, rate=100)
    way = rp.approach(Q3 + 0.2, ring, acceleration=6.0, rate=100)
    for motion, text in ((ring, csv_text(ring)), (timed, csv_text(timed)), (way, csv_text(way))):
        assert rp.write_motion(motion, tmp_path / "m.csv").read_text(encoding="utf-8") == text
        assert rp.write_motion(motion, str(tmp_path / "m.yaml")).read_text(
            encoding="utf-8"
        ) == yaml_text(motion)
    beyond = replace(ring, q=ring.q + 9.0)
    for motion in (beyond, replace(timed, motion=beyond)):
        with pytest.raises(
            rp.InputError, match="exceeds its limits in cycle 1.*allow_violations=True"
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
    data = told(capsys, *words, "--acceleration", "2,3,4", "--rate", "100", "--csv", "m.csv", "--yaml", "m.yaml",
                "--profile", "p.png")  # fmt: skip
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
    assert "no accelerations of 'pandas'" in refused(capsys, *words, "--acceleration", "pandas")
    assert "give --acceleration with it" in refused(capsys, *words, "--profile", "p.png")
