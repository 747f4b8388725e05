"""Paths, reaching and following: laws of closed curves, orders of integrators, oracles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from arms import named_path
from scipy.integrate import solve_ivp

import repctl_pin as rp


def all_paths(task: rp.Task, q: np.ndarray) -> list[rp.TaskPath]:
    loop = [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0.05], [0, 0, 0]]
    return [
        rp.circle(task, q, 0.1, normal="x", start_angle=0.7),
        rp.figure_eight(task, q, 0.1, normal="y", start_angle=0.3),
        named_path(task, q, "rose:0.1", "yz"),
        rp.polygon(task, q, [[0.1, 0, 0], [0.1, 0.05, 0.1]]),
        rp.waypoints(np.array(loop) + task.placement(q).translation, task.placement(q).rotation),
        named_path(task, q, "square:0.2", "yz"),
        named_path(task, q, "polygon:5:0.1", "xz"),
    ]


def test_paths_are_closed_start_at_the_frame_and_their_twist_is_their_slope(
    panda_pose, q_panda
) -> None:
    here = panda_pose.placement(q_panda)
    for path in all_paths(panda_pose, q_panda):
        for s in (0.0, 1.0):
            assert np.allclose(path.placement(s).translation, here.translation, atol=1e-12), (
                path.name
            )
            assert np.array_equal(path.placement(s).rotation, here.rotation)
        e = 1e-6
        for s in np.linspace(0.013, 0.987, 16):
            slope = (path.point(s + e) - path.point(s - e)) / (2 * e)
            assert np.allclose(path.twist(s)[:3], slope, atol=1e-7), path.name
            assert not path.twist(s)[3:].any()


def test_shapes_are_what_their_names_say(panda_pose, q_panda) -> None:
    circle, eight, _, _, _, square, pentagon = all_paths(panda_pose, q_panda)
    around = circle.points(200)[:-1]
    center = around.mean(axis=0)
    assert (
        np.allclose(np.linalg.norm(around - center, axis=1), 0.1) and np.ptp(around[:, 0]) < 1e-15
    )
    assert np.isclose(circle.length, 0.2 * np.pi, rtol=1e-4)
    assert np.isclose(square.length, 0.8, rtol=1e-6) and np.allclose(
        square.breaks, [0.25, 0.5, 0.75]
    )
    assert np.isclose(pentagon.length, 5 * 2 * 0.1 * np.sin(np.pi / 5), rtol=1e-6)
    assert np.allclose(eight.point(0.5), eight.point(0.0))


def test_reach_finds_the_target_and_says_when_it_cannot(panda_pose, q_panda) -> None:
    target = panda_pose.placement(q_panda)
    target.translation = target.translation + [0.05, 0.1, -0.1]
    q = rp.solve_ik(panda_pose, q_panda, target)
    assert np.linalg.norm(panda_pose.error(q, target)) < 1e-9
    target.translation = target.translation + [2.0, 0, 0]
    with pytest.raises(rp.InputError, match="cannot reach"):
        rp.solve_ik(panda_pose, q_panda, target)


@pytest.mark.parametrize(
    ("name", "kind", "most"),
    [
        pytest.param("panda", "pose", 3, marks=pytest.mark.slow),
        pytest.param("xarm7", "pose", 1, marks=pytest.mark.slow),
        pytest.param("ur5", "pose", 1, marks=pytest.mark.slow),
        pytest.param("kinova", "pose", 1, marks=pytest.mark.slow),
        ("prr", "xy", 0),
        ("panda", "position", 0),
    ],
)
def test_poses_of_the_arm_are_found(name: str, kind: str, most: int) -> None:
    """Issue 37, item 20: no pose of an arm within its limits is said to be out of reach.

    40 random ones, of which q0 alone leads to none (xarm7: its reference pose is singular) or some
    to half; from several starts nearly all are found.
    """
    task = rp.Robot.load(name).task(kind=kind)
    low, high = np.maximum(task.lower, -np.pi), np.minimum(task.upper, np.pi)
    refused = []
    for q in np.random.default_rng(37).uniform(low, high, (40, task.n)):
        target = task.placement(q)
        try:
            found = rp.solve_ik(task, task.reference, target)
        except rp.InputError as error:
            refused.append(str(error))
            continue
        assert np.linalg.norm(task.error(found, target)) < 1e-9
        assert task.limit_margin(found).min() > -1e-9
    assert len(refused) <= most
    assert all("cannot" not in said and "41 starts" in said for said in refused)


@pytest.mark.slow
def test_out_of_reach_is_said_where_it_is_proved() -> None:
    """Issue 37, item 20: links of 1 m each reach 3 m from joint 1; a rail adds its stroke; and the
    hole of an arm round its base is not proved, so that it says what was tried."""
    arm = rp.Robot.load("planar3r").task("tool", "xy")
    rail = rp.Robot.load("prr").task("tool", "xy")
    x = pin.SE3(np.eye(3), np.array([3.001, 0.0, 0.0]))
    with pytest.raises(rp.InputError, match=r"cannot reach .* 3 m from .*most 3 m long"):
        rp.solve_ik(arm, arm.reference, x)
    rp.solve_ik(rail, rail.reference, x)  # the rail goes there
    uneven = pin.SE3(np.eye(3), np.array([0.2, 0.0, 0.0]))
    long = rp.Robot.load("ur5").task("tool0", "pose")
    with pytest.raises(rp.InputError, match="no solution found from 41 starts"):
        rp.solve_ik(long, long.reference, pin.SE3(np.eye(3), np.zeros(3)))
    rp.solve_ik(arm, arm.reference, uneven)


@pytest.mark.parametrize("integrator, order", [("euler", 1), ("rk4", 4)])
def test_integrators_converge_at_their_order(
    panda_pose, q_panda, integrator: str, order: int
) -> None:
    path = rp.circle(panda_pose, q_panda, 0.1, normal="yz")
    strategy = rp.Pseudoinverse(panda_pose)

    def end(steps: int) -> np.ndarray:
        return rp.follow(strategy, path, q_panda, cycles=1, steps=steps, integrator=integrator).q[
            -1
        ]

    exact = rp.follow(strategy, path, q_panda, cycles=1, steps=2000).q[-1]
    coarse, fine = np.linalg.norm(end(40) - exact), np.linalg.norm(end(80) - exact)
    assert abs(np.log2(coarse / fine) - order) < 0.35


def test_corners_do_not_spoil_the_order(panda_pose, q_panda) -> None:
    path = rp.polygon(panda_pose, q_panda, [[0.07, 0, 0], [0.03, 0.11, 0]])
    strategy = rp.Pseudoinverse(panda_pose)
    ends = [rp.follow(strategy, path, q_panda, cycles=1, steps=k).q[-1] for k in (30, 60, 1000)]
    coarse, fine = (np.linalg.norm(q - ends[2]) for q in ends[:2])
    assert np.log2(coarse / fine) > 3.3
    assert np.linalg.norm(panda_pose.placement(ends[2]).translation - path.point(1.0)) < 1e-11


def test_panda_ten_cycles(panda_pose, panda_design, q_panda) -> None:
    """The main promise: J⁺ creeps by more than 0.1 rad, the repeatable inverse by less than
    1e-8."""
    path = rp.circle(panda_pose, q_panda, 0.1, normal="yz", start_angle=np.pi)
    creeping = rp.follow(rp.Pseudoinverse(panda_pose), path, q_panda, cycles=10, steps=500)
    closed = rp.follow(panda_design.inverse, path, q_panda, cycles=10, steps=500)
    assert creeping.drift[-1] > 0.1
    assert closed.drift.max() < 1e-8
    for motion in (creeping, closed):
        assert motion.tracking_error.max() < 1e-8 and motion.turning_error.max() < 1e-8

    # An oracle that shares no code with follow: tight adaptive integration with numpy's own pinv.
    def rhs(s: float, q: np.ndarray) -> np.ndarray:
        return np.linalg.pinv(panda_pose.jacobian(q)) @ path.twist(s % 1.0)

    oracle = solve_ivp(rhs, (0, 10), q_panda, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    assert np.abs(creeping.q[-1] - oracle).max() < 1e-6
    assert abs(creeping.drift[-1] - np.linalg.norm(oracle - q_panda)) < 1e-6


def test_planar_3r_drift_is_the_theorys() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    expected = {
        (1, -1.5, 1.2): (1.00150, 1.69832, 1.91071),
        (0.3, 0.8, 0.8): (0.000246, 0.001320, 0.002892),
    }
    for q0, drifts in expected.items():
        path = rp.circle(task, q0, 0.3, normal="-z", start_angle=np.pi)
        motion = rp.follow(rp.Pseudoinverse(task), path, q0, cycles=10)
        assert np.allclose(motion.drift[[0, 4, 9]], drifts, atol=6e-6)


@pytest.mark.parametrize("kind", ["pose", "axis", "position", "xz"])
def test_open_loop_tracking_is_exact_for_every_kind_of_task(panda, q_panda, kind: str) -> None:
    task = panda.task("panda_hand_tcp", kind)
    path = rp.circle(task, q_panda, 0.08, normal="xz", start_angle=np.pi / 2)
    motion = rp.follow(rp.Pseudoinverse(task), path, q_panda, cycles=2, steps=300)
    assert motion.tracking_error.max() < 1e-9 and motion.turning_error.max() < 1e-9
    ends = [task.placement(q) for q in (motion.q[0], motion.q[-1])]
    if kind == "axis":
        assert np.allclose(ends[0].rotation[:, 2], ends[1].rotation[:, 2], atol=1e-9)


def test_turning_twists_are_followed_too(panda, q_panda) -> None:
    """A path that tilts the tool to and fro: the pose and axis kinds follow its orientation."""
    axis = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    start = panda.task("panda_hand_tcp", "pose").placement(q_panda)

    class Tilt:
        name, breaks = "tilt", ()

        def placement(self, s: float) -> pin.SE3:
            return pin.SE3(
                pin.exp3(axis * 0.3 * np.sin(2 * np.pi * s)) @ start.rotation, start.translation
            )

        def twist(self, s: float) -> np.ndarray:
            return np.concatenate([np.zeros(3), axis * 0.6 * np.pi * np.cos(2 * np.pi * s)])

    for kind in ("pose", "axis"):
        task = panda.task("panda_hand_tcp", kind)
        motion = rp.follow(rp.Pseudoinverse(task), Tilt(), q_panda, cycles=1, steps=300)  # type: ignore[arg-type]
        assert motion.tracking_error.max() < 1e-9 and motion.turning_error.max() < 1e-9


def test_feedback_brings_a_disturbed_start_back(panda_pose, q_panda) -> None:
    path = rp.circle(panda_pose, q_panda, 0.1, normal="yz")
    off = q_panda + 0.01
    with pytest.raises(rp.InputError, match="starts .* away"):
        rp.follow(rp.Pseudoinverse(panda_pose), path, off, cycles=1)
    for integrator, gain in (("euler", 100.0), ("rk4", 50.0)):
        motion = rp.follow(
            rp.Pseudoinverse(panda_pose),
            path,
            off,
            cycles=1,
            steps=500,
            integrator=integrator,
            feedback=gain,
        )
        assert motion.tracking_error[0] > 1e-3 and motion.tracking_error[-1] < 1e-4


def test_posture_closes_on_the_posture_and_creeps_to_it_when_started_off_it(
    panda_pose, q_panda
) -> None:
    path = rp.circle(panda_pose, q_panda, 0.1, normal="yz")
    off = q_panda + 0.57 * rp.redundancy.nullspace(panda_pose.jacobian(q_panda))[:, 0]
    on = rp.follow(rp.PostureControl(panda_pose, q_panda, 5.0), path, q_panda, cycles=4)
    away = rp.follow(rp.PostureControl(panda_pose, off, 1.0), path, q_panda, cycles=4)
    assert np.ptp(on.drift[1:]) < 1e-4  # settles in the first cycle
    assert away.drift[0] > 0.1 > 2 * np.abs(np.diff(away.drift))[-1]
    assert away.tracking_error.max() < 1e-8
    # from the start it stays away, from cycle to cycle it closes: each adds a small share of the
    # one before
    np.testing.assert_allclose(away.cycle_drift[0], away.drift[0], rtol=1e-12)
    assert (away.cycle_drift[1:] < 0.2 * away.cycle_drift[:-1]).all() and away.drift[-1] > 0.1


def test_the_cycle_that_breaks_a_limit_is_counted_as_people_count(panda_pose, q_panda) -> None:
    """From 1; and what happens at the very end of the last cycle happens in it."""
    path = rp.circle(panda_pose, q_panda, 0.02)
    motion = rp.follow(rp.Pseudoinverse(panda_pose), path, q_panda, cycles=3, steps=20)
    assert motion.first_violation is None and motion.broken_cycle == 0
    for row, cycle in ((0, 1), (19, 1), (20, 2), (45, 3), (60, 3)):
        q = motion.q.copy()
        q[row:, 3] = panda_pose.upper[3] + 0.1
        broken = replace(motion, q=q)
        assert broken.first_violation == (row / 20, "panda_joint4") and broken.broken_cycle == cycle


def test_motion_judges_limits_and_speeds(panda_pose, q_panda) -> None:
    path = rp.circle(panda_pose, q_panda, 0.1, normal="xy")
    motion = rp.follow(rp.Pseudoinverse(panda_pose), path, q_panda, cycles=8, steps=100, period=5.0)
    outside = (motion.q < panda_pose.lower - 1e-9) | (motion.q > panda_pose.upper + 1e-9)
    if outside.any():
        assert motion.first_violation is not None
        row = int(np.argmax(outside.any(axis=1)))
        assert motion.first_violation[0] == row / 100
        assert outside[row, panda_pose.joint_names.index(motion.first_violation[1])]
    else:
        assert motion.first_violation is None
    assert np.isclose(
        motion.rms_speed, np.sqrt(np.mean(np.sum(motion.qdot[:-1] ** 2, axis=1))), rtol=1e-3
    )
    slower = rp.follow(
        rp.Pseudoinverse(panda_pose), path, q_panda, cycles=1, steps=100, period=10.0
    )
    assert np.allclose(slower.q, motion.q[:101], atol=1e-12)  # slowing down keeps the joint path
    assert np.allclose(slower.qdot[:100] * 2, motion.qdot[:100], atol=1e-12)


def test_violation_is_found_where_it_is() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q0 = np.array([6.2, 1.0, -1.4])
    path = rp.circle(task, q0, 0.4)
    motion = rp.follow(rp.Pseudoinverse(task), path, q0, cycles=2, steps=100)
    assert motion.first_violation is not None
    cycle, joint = motion.first_violation
    row = round(cycle * 100)
    column = task.joint_names.index(joint)
    assert motion.q[row, column] > task.upper[column] >= motion.q[row - 1, column]


def test_a_motion_into_a_singularity_says_where() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q0 = np.array([0.0, 0.4, 0.4])
    path = rp.polygon(task, q0, [[0.5, 0, 0], [0.5, 0.5, 0]])
    with pytest.raises((rp.SingularityError, rp.InputError), match="cycle|reach"):
        rp.follow(rp.Pseudoinverse(task), path, q0, cycles=1, steps=200)


BAD_CSV = {
    "too few": ("0.5,0,0.5\n0.5,0,0.5\n", "at least 3"),
    "text": ("x,y,z\n0.5,0,0.5\n0.6,zero,0.5\n0.6,0.1,0.5\n0.5,0,0.5\n", "line 3"),
    "nan": ("0.5,0,0.5\n0.6,nan,0.5\n0.6,0.1,0.5\n0.5,0,0.5\n", "line 2"),
    "open": ("0.5,0,0.5\n0.6,0,0.5\n0.6,0.1,0.5\n0.5,0.2,0.5\n", "open by"),
    "two columns": ("0.5,0\n0.6,0\n0.6,0.1\n0.5,0\n", "line 1"),
    "empty": ("", "no waypoints"),
    "nowhere": ("0.5,0,0.5\n0.5,0,0.5\n0.5,0,0.5\n0.5,0,0.5\n", "all points are the same"),
    "columns unknown": ("x,z\n0.5,0\n", "named x, z; name them x, y, z"),
    "a column twice": ("x,y,y\n0.5,0,0\n", "two columns are named 'y'"),
    "no quaternion": (
        "x,y,z,qx,qy,qz,qw\n0.5,0,0.5,0,0,0,2\n",
        "line 2: the quaternion has length 2",
    ),
    "six numbers": (
        "x,y,z,qx,qy,qz,qw\n0.5,0,0.5,0,0,0\n",
        "line 2: 6 fields, but the header has 7",
    ),
    "time back": (
        "x,y,z,time\n0.5,0,0.5,0\n0.6,0,0.5,2\n0.5,0,0.5,1\n",
        "line 4: the time must increase",
    ),
    "too many": ("0.5,0,0.5\n" * 100_000, "100000 waypoints; reduce them"),
    "binary": ("\udcff\udcfe\x00", "not UTF-8 text"),
}


@pytest.mark.parametrize("case", BAD_CSV)
def test_bad_waypoint_files_get_one_clear_line(tmp_path, case: str) -> None:
    text, message = BAD_CSV[case]
    file = tmp_path / "loop.csv"
    file.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(rp.InputError, match=message) as error:
        rp.Problem("planar3r", path=str(file))
    assert "\n" not in str(error.value)


def test_missing_waypoint_file(tmp_path) -> None:
    with pytest.raises(rp.InputError, match="cannot read .*No such file"):
        rp.Problem("planar3r", path=str(tmp_path / "none.csv"))


@pytest.mark.parametrize(
    "text",
    [
        "circle",
        "circle:-1",
        "circle:x",
        "circle:0.1:x",
        "circle:0.1:inf",
        "circle:1:2:3",
        "hexagon:1",
        "polygon:2:1",
        "",
    ],
)
def test_bad_path_spec_get_one_clear_line(text: str) -> None:
    with pytest.raises(rp.InputError, match="circle:RADIUS"):
        rp.Problem("planar3r", path=text)


@pytest.mark.parametrize(
    "options",
    [
        {"cycles": 0},
        {"steps": 0},
        {"steps": 1.5},
        {"integrator": "rk5"},
        {"period": 0},
        {"feedback": -1},
    ],
)
def test_bad_options_of_follow(panda_pose, q_panda, options: dict) -> None:
    path = rp.circle(panda_pose, q_panda, 0.1)
    with pytest.raises(rp.InputError):
        rp.follow(rp.Pseudoinverse(panda_pose), path, q_panda, **options)


def test_rms_speed_is_a_mean_over_time() -> None:
    """A polygon under two prismatic joints: the speed is the path's; slowed down on two edges, a
    mean of two speeds."""
    task = rp.Robot.load("ppr").task("tool", "xy")
    T = np.diag([1.0, 1.0, 1e6])  # θ₃ hardly moves: q̇ = (ẋ, ẏ, 0)
    motion = rp.follow(
        rp.WeightedInverse(task, T @ T),
        rp.polygon(task, np.zeros(3), [(2, 0, 0), (2, 1, 0), (0, 1, 0)]),
        np.zeros(3),
        cycles=1,
        steps=60,
        period=6.0,
    )
    assert motion.rms_speed == pytest.approx(1.0, rel=1e-6)
    # 4 m at 0.5 m/s and 2 m at 1 m/s, but for the steps at the corners
    slow = motion.retimed([0.5, 1e3, 1e3])
    assert slow.rms_speed == pytest.approx(np.sqrt((8 * 0.25 + 2 * 1.0) / 10), rel=0.02)
    once, thrice = (
        rp.follow(rp.Pseudoinverse(task), motion.path, np.zeros(3), cycles=k, steps=12)
        for k in (1, 3)
    )
    fine = rp.follow(rp.Pseudoinverse(task), motion.path, np.zeros(3), cycles=1, steps=1200)
    assert once.rms_speed == pytest.approx(fine.rms_speed, rel=2e-3)
    assert np.isfinite(thrice.rms_speed)


def test_prismatic_steps_may_be_long() -> None:
    task = rp.Robot.load("ppr").task("tool", "xy")
    path = rp.polygon(task, np.zeros(3), [(40, 0, 0), (40, 40, 0), (0, 40, 0)])
    weight = np.diag([1.0, 1.0, 1e9])
    motion = rp.follow(rp.WeightedInverse(task, weight), path, np.zeros(3), cycles=1, steps=40)
    assert np.abs(np.diff(motion.q, axis=0)).max() > 3 and motion.tracking_error.max() < 1e-3


def test_a_path_whose_functions_change_is_followed_as_they_are() -> None:
    """The functions of a user's path read a variable, as in a notebook."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q0 = np.array([0.3, 1.0, 0.8])
    here, size = task.placement(q0), [0.1]

    def point(s: float) -> np.ndarray:
        return here.translation + [size[0] * np.sin(2 * np.pi * s), 0, 0]

    def slope(s: float) -> np.ndarray:
        return np.array([2 * np.pi * size[0] * np.cos(2 * np.pi * s), 0, 0])

    path = rp.TaskPath("back and forth", point, slope, here.rotation)
    for size[0] in (0.1, 0.05):
        motion = rp.follow(rp.Pseudoinverse(task), path, q0, cycles=1, steps=40)
        reached = task.placement(motion.q[10]).translation
        assert abs(reached[0] - here.translation[0] - size[0]) < 1e-4
        assert motion.tracking_error.max() < 1e-4
