"""The governor as the servo runs it: its joints and refusals; and as exported, in cells, and after
any history."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA
from cell_functions import middle, panda
from controls import NEEDS_C, control, own_cache, some  # noqa: F401
from test_governor_c import DOUBLE, Pose, in_c

import repctl_pin as rp
from repctl_pin.extensions.integrations.servo import Servo, State

sys.path.insert(0, str(Path(__file__).parents[1] / "attack"))

from governor_ticks import ARMS

Q0, DT = np.array([0.3, 0.8, 0.8]), 0.005
LIMITS = rp.Limits(acceleration=6.0, jerk=400.0)


def task_of(robot: str) -> tuple[rp.Task, np.ndarray]:
    if robot == "panda":
        return rp.Robot.load("panda").task("panda_hand_tcp", "pose"), Q_PANDA
    return rp.Robot.load(robot).task("tool", "xy"), Q0


@cache
def design(robot: str = "planar3r", half_width: float = 0.15) -> rp.Design:
    task, q0 = task_of(robot)
    few, degree = rp.FitOptions(samples=64, held_out=64), 2 if task.n == 3 else 1
    return rp.nearest_repeatable(
        rp.Pseudoinverse(task), rp.Polynomial(q0, degree, 0.5), rp.Box(q0, half_width), options=few
    )


class Arm:
    """A servo, and an arm that is always where it was commanded to be."""

    def __init__(self, of: rp.Design, q: np.ndarray = Q0) -> None:
        self.servo, self.q, self.now = Servo(of, 1 / DT, LIMITS), q, 0.0
        for _ in range(40):
            self.tick()

    def tick(self) -> np.ndarray | None:
        self.now += DT
        names = self.servo.task.joint_names
        self.servo.joints(dict(zip(names, self.q, strict=True)), self.now)
        q = self.servo.tick(self.now)
        self.q = self.q if q is None else q
        return q

    def step(
        self, target: pin.SE3 | None, twist: np.ndarray | None
    ) -> tuple[np.ndarray | None, rp.Status]:
        if target is not None:
            self.servo.pose(target.translation, pin.Quaternion(target.rotation).coeffs())
        elif twist is not None:
            self.servo.twist(twist, self.now)
        return self.tick(), self.servo.status


@NEEDS_C
@pytest.mark.parametrize(("robot", "ticks"), [("planar3r", 180), ("panda", 120)])
def test_it_commands_the_same_joints(robot: str, ticks: int) -> None:
    rng, said, worst = np.random.default_rng(0), set(), 0.0
    q0, planar = task_of(robot)[1], robot == "planar3r"
    arm = Arm(design(robot), q0)
    governor = rp.Governor(design(robot).inverse, DT, LIMITS)
    governor.start(q0)
    home = arm.servo.task.placement(q0)
    assert arm.servo.state is State.RUNNING and (arm.q == q0).all()
    for k in range(ticks):
        if k % 30 == 0:
            p = home.translation + rng.normal(size=3) * 0.2 * [1, 1, not planar]
            R = home.rotation if planar else pin.exp3(0.2 * rng.normal(size=3))
            target, twist = pin.SE3(R @ home.rotation, p), None
            if k % 90 == 60:
                target, twist = None, rng.normal(size=6)
        (q, status), (q_c, status_c) = (g.step(target, twist) for g in (governor, arm))
        assert status == status_c and isinstance(status_c, rp.Status)
        assert q_c is not None and arm.servo.command is not None
        worst, said = max(worst, np.abs(q - q_c).max()), said | {status}
        assert (arm.servo.command == q_c).all()
    assert worst < 1e-9 and np.abs(q - q0).max() > 1e-3
    assert {rp.Status.OUTSIDE, rp.Status.SLOWED} <= said or not planar
    assert arm.servo.current_leaf == pytest.approx(governor.leaf, abs=1e-12)


@NEEDS_C
def test_the_way_to_another_leaf_begins_where_the_arm_is() -> None:
    arm = Arm(design(half_width=0.6))
    task, Q = arm.servo.task, [arm.q]
    target = task.placement(Q0 + [0.1, 0.1, -0.1])
    leaf = design(half_width=0.6).inverse.leaf(Q0) + 0.1
    for k in range(1200):
        if k == 400:
            assert arm.servo.at_rest and arm.servo.leaf(leaf) == ""
        arm.step(target, None)
        Q.append(arm.q)
    assert arm.servo.at_rest and np.abs(Q[400] - Q0).max() > 0.05
    assert np.abs(arm.servo.current_leaf - leaf).max() < 1e-8
    assert np.abs(task.error(arm.q, target)).max() < 1e-8
    assert (np.abs(np.diff(Q, axis=0)) <= (1 + 1e-6) * DT * task.velocity_limit).all()
    assert np.abs(np.diff(Q, 2, axis=0)).max() <= (1 + 1e-6) * DT**2 * 6.0


@NEEDS_C
def test_it_refuses_the_same_starts() -> None:
    governor, arm = rp.Governor(design().inverse, DT, LIMITS), Arm(design(), Q0 + 0.2)
    with pytest.raises(rp.InputError, match="outside the region Ω") as caught:
        governor.start(Q0 + 0.2)
    assert arm.servo.state is State.WAITING and arm.servo.command is None
    assert arm.servo.reason == f"cannot start: {caught.value}"
    with pytest.raises(rp.InputError, match="has not started"):
        governor.step()


class Exported:
    """The governor of an exported folder."""

    def __init__(
        self,
        inverse: rp.RepeatableInverse,
        folder: Path,
        dt: float,
        limits: rp.Limits,
        margin: float,
    ) -> None:
        rp.export_c(inverse, folder / "governor", "arm")
        self.library, self.dt, task = in_c(folder / "governor"), dt, inverse.task
        of_joints = (
            task.velocity_limit,
            np.broadcast_to(limits.acceleration, task.n),
            np.broadcast_to(limits.jerk, task.n),
        )
        self.bounds = (DOUBLE * (3 * task.n + 1))(*np.concatenate(of_joints), margin)
        self.state = ctypes.create_string_buffer(1 << 20)
        self.q = np.zeros(task.n)

    def start(self, q: np.ndarray) -> None:
        start = (DOUBLE * len(q))(*q)
        begin = self.library.arm_governor_start
        assert begin(self.state, start, DOUBLE(self.dt), self.bounds) == rp.Status.OK

    def step(
        self, target: pin.SE3 | None = None, twist: np.ndarray | None = None
    ) -> tuple[np.ndarray, rp.Status]:
        pose = rates = None
        if target is not None:
            R = (DOUBLE * 9)(*target.rotation.ravel())
            pose = ctypes.byref(Pose((DOUBLE * 3)(*target.translation), R))
        elif twist is not None:
            rates = (DOUBLE * 6)(*twist)
        q = self.q.ctypes.data_as(ctypes.POINTER(DOUBLE))
        status = self.library.arm_governor_step(self.state, pose, rates, None, q)
        return self.q.copy(), rp.Status(status)


@pytest.mark.slow
@NEEDS_C
def test_where_the_straight_line_is_blocked_it_takes_the_way_of_the_joints(tmp_path: Path) -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    inverse = control(task, Q0, rp.Polynomial(Q0, 2, 0.5))
    governor = Exported(inverse, tmp_path, DT, LIMITS, 0.01)
    governor.start(Q0)
    rng, said = np.random.default_rng(127), []
    for _ in range(2):
        twist = np.concatenate([rng.normal(size=2), np.zeros(4)])
        for _ in range(300):
            governor.step(twist=twist)
    assert np.abs(governor.q - Q0).max() > 1
    for _ in range(2500):
        q, status = governor.step(task.placement(Q0))
        said.append(status)
        if status is rp.Status.OK:
            break
    assert said.count(rp.Status.SINGULAR) + said.count(rp.Status.LIMIT) > 30
    assert said[-1] is rp.Status.OK and np.abs(q - Q0).max() < 1e-6


CELLS: dict[str, Callable[[rp.Task, pin.SE3], rp.Cell]] = {
    "yaw": lambda task, middle: rp.Cell(task, middle, 0.05, (0, 0, 2.2)),
    "curved": lambda task, middle: rp.Cell(task, middle, (0.04, 0, 0.04), (0.2, 0.1, 0)),
    "sector": lambda task, middle: rp.Sector(
        task, middle, radius=0.05, angle=1.5, half_angle=(0.2, 0), spin=0.5
    ),
}


@cache
def cell_inverse(name: str) -> tuple[rp.RepeatableInverse, rp.InverseFunction]:
    """A function over a cell of the panda, coordinates of width 0 among its own."""
    task = panda()
    cell = CELLS[name](task, middle())
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        cell,
        posture=rp.solve_ik(task, Q_PANDA, cell.placement),
        degree=2,
        options=rp.FitOptions(samples=64, held_out=64),
    )
    return found.inverse, found.function


@pytest.mark.slow
@NEEDS_C
@pytest.mark.parametrize("name", some(CELLS, "curved"))
def test_in_a_cell_every_target_is_reached_by_a_straight_line(name: str, tmp_path: Path) -> None:
    """Issue 37, item 7: with a coordinate of width 0, the governor stopped for good at the edge."""
    inverse, F = cell_inverse(name)
    rng, cell = np.random.default_rng(3), F.cell
    U = rng.uniform(-1, 1, (12, cell.k))
    U[::3] = np.sign(U[::3])  # corners
    U[:2] = U[:1] * [[1], [-1]]  # across the whole cell: yaw +2.2 and -2.2
    limits = rp.Limits(acceleration=10.0, jerk=2000.0)
    governor = Exported(inverse, tmp_path, 0.01, limits, 0.0)
    governor.start(F(cell.at(np.zeros(cell.k))))
    before = np.zeros(cell.k)
    for number, u in enumerate(U):
        at_rest = number % 4 != 3
        for _ in range(0 if at_rest else 24):
            governor.step(cell.at(-u))
        way = u - before
        target = cell.at(u)
        for _ in range(1000):
            q, status = governor.step(target)
            here = cell.coordinates_of(cell.task.placement(q)) - before
            if at_rest:
                off_line = here - (here @ way) / (way @ way) * way
                assert np.abs(off_line).max() < 1e-6
            if status is rp.Status.OK:
                break
        assert status is rp.Status.OK and np.abs(q - F(target)).max() < 1e-9
        before = u


@pytest.mark.slow
@NEEDS_C
def test_a_target_outside_a_cell_leads_to_the_nearest_pose_inside(tmp_path: Path) -> None:
    """Issue 37, item 7: at rest next to the edge, both go on to a target inside."""
    inverse, F = cell_inverse("yaw")
    cell, limits = F.cell, rp.Limits(acceleration=10.0, jerk=2000.0)
    exported = Exported(inverse, tmp_path, 0.01, limits, 0.0)
    governor = rp.Governor(inverse, 0.01, limits)
    for one in (exported, governor):
        one.start(F(cell.at(np.zeros(cell.k))))
    beyond = cell.at(np.zeros(cell.k))
    beyond.translation = beyond.translation + [0.2, 0.0, 0.01]
    beyond.rotation = pin.exp3(np.array([0.1, 0.0, 0.0])) @ beyond.rotation
    last = []
    for k in range(250):
        target = beyond if k < 150 else cell.placement
        (q, status), (expected, wanted) = (one.step(target) for one in (exported, governor))
        assert status is wanted and np.abs(q - expected).max() < 1e-8
        last.append(status)
        if k == 149:
            assert status is rp.Status.OUTSIDE
            inside = cell.coordinates_of(cell.task.placement(q))
            np.testing.assert_allclose(inside, [1.0, 0.0, 0.2, 0.0], atol=1e-9)
    assert last[-1] is rp.Status.OK and rp.Status.OK not in last[:150]


def history(rng: np.random.Generator, home: pin.SE3) -> tuple[pin.SE3 | None, np.ndarray | None]:
    """A random target or twist, also beyond the reach and more than half a turn away."""
    if rng.integers(2):
        return None, rng.normal(size=6) * rng.choice([0.05, 0.5, 5.0])
    p = home.translation + rng.normal(size=3) * rng.choice([0.02, 0.3, 1.0])
    turn = pin.exp3(rng.choice([0.3, 1.0, 2.0]) * rng.normal(size=3))
    return pin.SE3(turn @ home.rotation, p), None


@pytest.mark.slow
@NEEDS_C
@pytest.mark.parametrize("name", ["panda", "iiwa14", "xarm7", "baxter", "rail"])
def test_after_any_history_the_same_pose_has_the_same_joints(name: str, tmp_path: Path) -> None:
    task, q0, acceleration, jerk = ARMS[name](tmp_path)
    inverse = control(task, q0, rp.Polynomial(q0, 2, 0.5))
    limits = rp.Limits(acceleration=acceleration, jerk=jerk)
    governor = Exported(inverse, tmp_path, 1e-3, limits, 0.02)
    home, missed = task.placement(q0), []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        governor.start(q0)
        for _ in range(rng.integers(1, 12)):
            target, twist = history(rng, home)
            for _ in range(int(rng.choice([100, 400, 1500]))):
                governor.step(target, twist)
        for _ in range(30_000):
            q, status = governor.step(home)
            if status is rp.Status.OK:
                break
        if status is not rp.Status.OK or np.abs(q - q0).max() > 1e-6:
            missed.append((seed, status))
    print(f"{name}: missed {missed}")
    assert not missed
