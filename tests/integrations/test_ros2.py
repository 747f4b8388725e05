"""The ROS 2 node with the real rclpy: a simulated arm in another process, on the loopback.

Skipped where rclpy is not installed: the extra ros2 (260 MB) is not part of the extra test.
"""

from __future__ import annotations

import os
import re
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from cell_functions import middle, panda

import repctl_pin as rp

pytest.importorskip(
    "rclpy", reason="rclpy is not installed: the extra ros2, or a ROS 2 of one's own"
)
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from ros2_stage import Stage, on_loopback
from std_msgs.msg import Float64MultiArray

from repctl_pin.extensions.integrations.ros2 import spin

RATE = 100.0
LIMITS = ("acceleration:=panda", "jerk:=panda", f"rate:={RATE}")


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[rp.CellDesign, Path]:
    """Function of a cell, and its file."""
    task = panda()
    cell = rp.Cell(task, middle(), 0.1, 0.2)
    design = rp.nearest_inverse_function(rp.Pseudoinverse(task), cell)
    return design, rp.save(design, tmp_path_factory.mktemp("ros2") / "cell.json")


@pytest.fixture
def stage(
    found: tuple[rp.CellDesign, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Stage]:
    on_loopback(monkeypatch)
    design, file = found
    F = design.function
    with Stage(tmp_path, file, F(F.cell.placement), F.task.joint_names) as stage:
        yield stage


def used(Q: np.ndarray, task: rp.Task) -> float:
    """Largest share of the panda's published limits that consecutive commands use."""
    limits = (
        task.velocity_limit,
        np.array([15, 7.5, 10, 12.5, 15, 20, 20]),
        np.array([7500, 3750, 5000, 6250, 7500, 10000, 10000]),
    )
    return max(
        float((np.abs(np.diff(Q, k, axis=0)) * RATE**k / most).max())
        for k, most in enumerate(limits, 1)
    )


def off_the_leaf(F: rp.InverseFunction, Q: np.ndarray) -> float:
    """Largest distance of commands from F at their own poses, rad."""
    return float(max(np.abs(F(F.task.placement(q)) - q).max() for q in Q))


def test_a_pose_a_refused_one_and_a_clean_end(
    found: tuple[rp.CellDesign, Path], stage: Stage
) -> None:
    F = found[0].function
    node = stage.node(*LIMITS)
    x = F.cell.at(0.5 * np.ones(F.cell.k))
    stage.pose(x)
    stage.wait_for_motion()
    assert np.abs(stage.settle() - F(x)).max() < 1e-6
    stage.pose(pin.SE3(x.rotation, x.translation + [np.nan, 0, 0]))
    stage.wait_for("finite numbers")
    stage.pose(x, frame="camera")
    stage.wait_for("it is in frame 'camera', not in 'panda_link0'")
    stage.pose(x, age=3.0)
    stage.wait_for("its stamp is 3")
    assert "held on request" in stage.call("hold")
    stage.pose(F.cell.placement)
    time.sleep(0.3)
    assert np.abs(stage.settle() - F(x)).max() < 1e-6
    assert stage.call("resume") == "running"
    stage.pose(F.cell.placement)
    stage.wait_for_motion()
    node.send_signal(signal.SIGINT)  # in the middle of the motion: it brakes
    assert node.wait(20) == 0
    stage.wait_for_silence()
    Q = np.array([q for _, q in stage.commands])
    assert (Q[-1] == Q[-3]).all() and np.abs(Q[-1] - F(x)).max() > 1e-3
    assert used(Q, F.task) <= 1 + 1e-6 and off_the_leaf(F, Q) < 1e-6


@pytest.mark.slow
def test_sixty_seconds_round_a_closed_tour(found: tuple[rp.CellDesign, Path], stage: Stage) -> None:
    """Poses at 100 Hz, twice round: the joints at every stop are the same the second time."""
    F = found[0].function
    node = stage.node(*LIMITS)
    U = 0.9 * F.cell.sample(12, seed=4)
    stage.pose(F.cell.at(U[-1]))
    time.sleep(0.5)
    stage.settle()
    del stage.commands[:]
    rest, begin, sent, busy = [], time.monotonic(), 0, seconds_of(node.pid)
    for k in range(24):
        a, b = U[(k - 1) % 12], U[k % 12]
        for i in range(250):
            s = min(i / 180, 1.0)
            stage.pose(F.cell.at(a + s**2 * (3 - 2 * s) * (b - a)))
            sent += 1
            time.sleep(max(begin + sent / 100 - time.monotonic(), 0.0))
        while not stage.rests():  # a machine under load is late
            stage.pose(F.cell.at(b))
            time.sleep(0.01)
        rest.append(stage.commands[-1][1])
    lasted, busy = time.monotonic() - begin, seconds_of(node.pid) - busy
    Q, stops = np.array([q for _, q in stage.commands]), np.array(rest)
    apart = np.abs(stops[12:] - stops[:12]).max()
    reached = max(np.abs(F(F.cell.at(U[k % 12])) - q).max() for k, q in enumerate(stops))
    off, share = off_the_leaf(F, Q[::10]), used(Q, F.task)
    gaps = 1e3 * np.diff([t for t, _ in stage.commands])
    print(
        f"{sent} poses in {lasted:.1f} s; {len(Q)} commands, median gap {np.median(gaps):.1f} ms, "
        f"widest {gaps.max():.0f} ms; processor time of the node {busy / lasted:.0%}\n"
        f"second round {apart:.1e} rad from the first; stops {reached:.1e} rad from F, "
        f"all commands {off:.1e} rad; share of the limits {share:.3f}"
    )
    assert apart < 1e-6 and reached < 1e-6 and off < 1e-6
    assert share <= 1 + 1e-6  # a lost command would double a speed
    print(latency(F, stage))


def seconds_of(pid: int) -> float:
    """Processor time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def latency(F: rp.InverseFunction, stage: Stage, count: int = 100) -> str:
    """Time from a pose, sent to an arm at rest, to the first command that moves."""
    found, rng = [], np.random.default_rng(0)
    for k in range(count):
        stage.pose(F.cell.at(np.full(F.cell.k, 0.02 * (k % 2))))
        time.sleep(0.2)
        rest = stage.settle()
        time.sleep(rng.uniform(0, 0.01))
        before = len(stage.commands)
        sent = stage.pose(F.cell.at(np.full(F.cell.k, 0.02 * ((k + 1) % 2))))
        time.sleep(0.12)
        found.append(next(t for t, q in stage.commands[before - 1 :] if (q != rest).any()) - sent)
    middle, late = 1e3 * np.quantile(found, [0.5, 0.99])
    return f"latency from pose to command at {RATE:g} Hz: median {middle:.1f} ms, p99 {late:.1f} ms"


@pytest.mark.slow
def test_faults_in_the_middle_of_a_motion(found: tuple[rp.CellDesign, Path], stage: Stage) -> None:
    """NaN, a pose outside, an arm that stops answering, a killed node: nothing unsafe is sent."""
    F = found[0].function
    node = stage.node(*LIMITS)
    near, far = (F.cell.at(np.full(F.cell.k, u)) for u in (-0.7, 0.7))

    def moving(x: pin.SE3) -> None:
        stage.pose(x)
        time.sleep(0.15)

    def checked(what: str) -> np.ndarray:
        """All commands since the last check keep limits and leaf; return the last."""
        Q = np.array([q for _, q in stage.commands])
        print(f"{what}: {len(Q)} commands, share {used(Q, F.task):.3f}; {stage.said[-1]}")
        assert used(Q, F.task) <= 1 + 1e-6 and off_the_leaf(F, Q) < 1e-6, what
        del stage.commands[:]
        return Q[-1]

    stage.pose(near)
    time.sleep(0.5)
    stage.settle()
    bad = pin.SE3(far.rotation, far.translation * np.nan)
    outside = pin.SE3(far.rotation, far.translation + [0.2, 0, 0])
    for what, x in ("finite", bad), ("outside the cell", outside):
        moving(far)
        stage.pose(x)
        stage.wait_for(what)
        q = stage.settle()
        assert np.abs(q - F(far)).max() > 1e-2 and np.isfinite(q).all()
        stage.pose(near)
        time.sleep(0.5)
        stage.settle()
        assert np.abs(checked(what) - F(near)).max() < 1e-6

    moving(far)
    stage.arm.send_signal(signal.SIGSTOP)
    stage.wait_for("waiting: joint states are")
    time.sleep(0.3)
    silent = len(stage.commands)
    stage.pose(far)  # dropped: no target is kept while nothing is known of the arm
    time.sleep(0.5)
    assert len(stage.commands) == silent
    q = checked("arm stopped")
    stage.arm.send_signal(signal.SIGCONT)
    stage.wait_for("running")
    time.sleep(0.5)
    assert (stage.settle() == q).all()
    stage.pose(far)
    time.sleep(0.5)
    stage.settle()
    assert np.abs(checked("arm goes on") - F(far)).max() < 1e-6

    moving(near)
    node.kill()
    node.wait()
    time.sleep(0.3)
    checked("node killed")
    node = stage.node(*LIMITS)
    stage.pose(near)
    time.sleep(0.5)
    stage.settle()
    assert np.abs(checked("node started again") - F(near)).max() < 1e-6

    node.send_signal(signal.SIGINT)
    assert node.wait(20) == 0
    stage.node(*LIMITS, "leaf:=[0.4]", "output:=trajectory")
    del stage.commands[:]
    stage.pose(far)
    time.sleep(4.0)
    stage.settle()
    Q = np.array([q for _, q in stage.commands])
    assert used(Q, F.task) <= 1 + 1e-6
    assert np.abs(Q[-1] - F(far, leaf=[0.4])).max() < 1e-6
    del stage.commands[:]
    stage.twist(np.array([0.05, 0, 0, 0, 0, 0]))
    stage.wait_for("the last twist is more than 0.1 s old")
    stage.settle()
    Q = np.array([q for _, q in stage.commands])
    moved = F.task.placement(Q[-1]).translation - far.translation
    print("twist for 0.1 s:", moved)
    assert 0.002 < moved[0] < 0.02 and np.abs(moved[1:]).max() < 1e-5
    assert used(Q, F.task) <= 1 + 1e-6


def test_a_misspelt_parameter_is_refused(
    found: tuple[rp.CellDesign, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Issue 37, item 8: with jrek:=20 there was no jerk limit, and no word of it."""
    on_loopback(monkeypatch)
    for words, said in [
        (["-p", "jrek:=20.0"], "no parameter 'jrek'; did you mean 'jerk'"),
        (["-p", "leaf:=[0.1, 0.2]"], "parameter leaf: leaf must be 1 finite numbers"),
        (["-p", "accelaration:=5.0"], "no parameter 'accelaration'; did you mean 'acc"),
    ]:
        given = ["--ros-args", "-p", "acceleration:=panda", *words]
        with pytest.raises(rp.InputError, match=re.escape(said)):
            spin(found[0], given, threading.Event())


@pytest.mark.slow
def test_stale_stamps_start_nothing(
    found: tuple[rp.CellDesign, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Issue 37, item 8: joint states stamped an hour ago started the arm."""
    on_loopback(monkeypatch)
    F = found[0].function
    q = F(F.cell.placement)
    with Stage(tmp_path, found[1], q, F.task.joint_names, age=3600.0) as stage:
        said = "waiting: joint states are refused: their stamp is 3600 s before"
        stage.node(*LIMITS, until=said)
        time.sleep(0.3)
        assert not stage.commands


@pytest.mark.slow
def test_an_arm_beyond_a_limit_is_told_and_moves_back(
    found: tuple[rp.CellDesign, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Item 26.4: the diagnostics warn while a joint moves back inside from beyond its limit."""
    on_loopback(monkeypatch)
    task, levels = rp.Robot.load("panda").task("panda_hand_tcp", "position"), []
    q = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 1.9, 0.7])
    q[3] = task.lower[3]
    few = rp.FitOptions(samples=64, held_out=64)
    inside = q + [0, 0, 0, 0.3, 0, 0, 0]
    box = rp.Box(inside, 0.4)
    design = rp.nearest_repeatable(rp.Pseudoinverse(task), None, box, degree=1, options=few)
    q[3] -= 0.05
    file = rp.save(design, tmp_path / "design.json")
    with Stage(tmp_path, file, q, task.joint_names) as stage:
        stage.subscribe(DiagnosticArray, "/diagnostics", lambda m: levels.append(told(m)))
        stage.node(*LIMITS)
        time.sleep(0.3)
        assert all((np.array(sent) == q).all() for _, sent in stage.commands)
        stage.pose(task.placement(inside))
        stage.wait_for("a joint is beyond its limit or margin: it moves back inside first")
        stage.wait_for_motion()
        end = stage.settle()
    Q = np.array([sent for _, sent in stage.commands])
    out = Q[:, 3] < task.lower[3]
    assert end[3] > task.lower[3] and np.diff(Q[out, 3]).min() >= -1e-12
    assert np.abs(np.diff(Q, axis=0))[out[:-1]].max() * RATE <= 0.1 * task.velocity_limit.max()
    assert used(Q, task) <= 1 + 1e-6
    assert (DiagnosticStatus.WARN, "RECOVERING") in levels


def told(message: DiagnosticArray) -> tuple[bytes, str]:
    """Level of the diagnostics, and the governor's status in them."""
    status = message.status[0]
    return status.level, {one.key: one.value for one in status.values}["governor"]


def test_links_without_a_shape_are_refused_unless_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Item 26.5: the node takes bodies that lack shapes only with ``unchecked:=allow``."""
    on_loopback(monkeypatch)
    text = rp.Robot.load("panda").description.path.read_text()
    mesh = "example-robot-data/robots/panda_description/meshes/collision/link5"
    (tmp_path / "arm.urdf").write_text(text.replace(mesh, "gone/link5"))
    folders = rp.Robot.load("panda").package_dirs
    task = rp.Robot.load(tmp_path / "arm.urdf", package_dirs=folders).task("panda_hand_tcp")
    box = rp.Box(task.reference, 0.1)
    few = rp.FitOptions(samples=64, held_out=64)
    design = rp.nearest_repeatable(rp.Pseudoinverse(task), None, box, degree=1, options=few)
    given = ["--ros-args", "-p", "acceleration:=panda", "-p", "body_distance:=0.01"]
    with pytest.raises(
        rp.InputError, match="1 body without a collision shape.*: panda_link5;.*unchecked"
    ):
        spin(design, given, threading.Event())
    stop = threading.Event()
    stop.set()
    spin(design, [*given, "-p", "unchecked:=allow"], stop)


@pytest.mark.slow
def test_a_simulation_that_steps_back(
    found: tuple[rp.CellDesign, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Issue 37, item 8: -600 s on /clock, and the last twist was never too old."""
    on_loopback(monkeypatch)
    F = found[0].function
    q, offset, ends = F(F.cell.placement), [1000.0 - time.monotonic()], []
    with Stage(tmp_path, found[1], q, F.task.joint_names, age=None) as stage:

        def clock() -> None:
            while not ends:
                stage.clock(time.monotonic() + offset[0])
                time.sleep(0.002)

        thread = threading.Thread(target=clock)
        thread.start()
        try:
            stage.node(*LIMITS, "use_sim_time:=true")
            for _ in range(20):
                stage.twist(np.array([0.05, 0, 0, 0, 0, 0]))
                time.sleep(0.01)
            stage.wait_for_motion()
            offset[0] -= 600
            stage.wait_for("the last twist is more than 0.1 s old")
            end = F.task.placement(stage.settle()).translation
        finally:
            ends.append(True)
            thread.join()
    assert 1e-3 < end[0] - F.cell.placement.translation[0] < 0.05
    assert used(np.array([q for _, q in stage.commands]), F.task) <= 1 + 1e-6


@pytest.mark.slow
def test_other_joint_names_and_a_position_controller(
    found: tuple[rp.CellDesign, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    on_loopback(monkeypatch)
    F, sent = found[0].function, []
    q = F(F.cell.placement)
    names = tuple(f"left_{name}" for name in F.task.joint_names)
    with Stage(tmp_path, found[1], q, names) as stage:
        stage.subscribe(Float64MultiArray, "commands", lambda m: sent.append(list(m.data)))
        stage.node(*LIMITS, "output:=positions", f"joints:=[{','.join(names)}]")
        time.sleep(0.5)
        assert not stage.commands and np.abs(np.array(sent) - q).max() == 0


def test_a_hand_a_tool_and_a_wall(
    found: tuple[rp.CellDesign, Path], stage: Stage, tmp_path: Path
) -> None:
    wall = tmp_path / "wall.urdf"
    wall.write_text(
        """<robot name="w"><link name="room"/><link name="wall"><collision><geometry>
        <box size="0.02 1 1"/></geometry></collision></link><joint name="a" type="fixed">
        <parent link="room"/><child link="wall"/><origin xyz="0.58 0 0.4"/></joint></robot>"""
    )
    F = found[0].function
    more = (f"surroundings:={wall}", "body_distance:=0.02", "tool:=[0.0, 0.0, 0.05]")
    stage.node(*LIMITS, *more, "hand_scale:=0.5")
    tool = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.05]))
    stage.clutch(True)
    hand = pin.SE3(np.eye(3), np.array([7.0, 8.0, 9.0]))
    for k in range(60):
        hand.translation[1] = 8.0 + 0.001 * k
        stage.hand(hand)
        time.sleep(1 / RATE)
    assert "hand pose" not in stage.clutch(False)
    moved = F.task.placement(stage.settle()).translation - F.cell.placement.translation
    assert 0.01 < moved[1] < 0.031 and np.abs(moved[[0, 2]]).max() < 2e-3
    stage.pose(F.cell.placement * tool)
    stage.wait_for_motion()
    assert np.abs(stage.settle() - F(F.cell.placement)).max() < 1e-9
    goal = F.cell.placement.copy()
    goal.translation[0] += 0.09
    stage.pose(goal * tool)
    stage.wait_for("wall are near each other ahead")
    task = rp.Bodies(F.task, surroundings=wall)
    assert 0.02 <= task.nearest(stage.settle()).distance < 0.03


def test_an_elbow_a_level_and_an_operators_elbow(
    found: tuple[rp.CellDesign, Path], stage: Stage
) -> None:
    """57.1: hand and elbow of two tracker's points, a point of the base, and a level."""
    F = found[0].function
    home, told_elbows = F.cell.placement, []
    stage.subscribe(DiagnosticArray, "/diagnostics", lambda m: told_elbows.append(elbow_of(m)))
    stage.node(*LIMITS, "timeout:=2.0")
    point = F.inverse.elbow(F(home)) + [0.0, 0.1, 0.03]
    stage.elbow(point, frame="panda_link0")
    stage.wait_for_motion()
    level = F.leaf_toward(home, elbow=point, margin=0.02)
    assert np.abs(stage.settle() - level.q).max() < 1e-6  # the hand rests
    time.sleep(0.2)
    assert f"{level.distance:.3g} m from its point" in told_elbows[-1]
    stage.elbow(point, frame="camera")
    stage.wait_for("elbow refused: it is in frame 'camera', not in 'panda_link0'")
    stage.level(0.1, 0.2)
    stage.wait_for("level refused: leaf must be 1 finite numbers")
    stage.level(0.2)
    stage.wait_for_motion()
    assert np.abs(stage.settle() - F(home, leaf=[0.2])).max() < 1e-6
    stage.clutch(True)
    hand = pin.SE3(np.eye(3), np.array([7.0, 8.0, 9.0]))
    begin = F.inverse.elbow(stage.commands[-1][1])
    for k in range(200):
        way = 0.001 * min(max(k - 50, 0), 100)  # at rest until both are engaged
        hand.translation[1] = 8.0 + 0.5 * way
        stage.hand(hand)
        stage.elbow(np.array([7.0, 8.0 + way, 9.5]), "hand_elbow", "tracker")
        time.sleep(1 / RATE)
    x = pin.SE3(home.rotation, home.translation + [0.0, 0.05, 0.0])
    level = F.leaf_toward(x, elbow=begin + [0.0, 0.1, 0.0], margin=0.02)
    for _ in range(100):
        stage.hand(hand)
        time.sleep(1 / RATE)
    Q = np.array([q for _, q in stage.commands])
    assert np.abs(Q[-1] - level.q).max() < 1e-6
    assert used(Q, F.task) <= 1 + 1e-6


def elbow_of(message: DiagnosticArray) -> str:
    """Elbow in a message of the diagnostics."""
    return {one.key: one.value for one in message.status[0].values}["elbow"]
