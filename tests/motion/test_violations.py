"""A motion that leaves its limits or touches something is marked, and no robot gets it unasked."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import chain_with_bodies
from commands import OUT, main, refused, told
from matplotlib.figure import Figure
from page_file import read

import repctl_pin as rp

CELL = """<robot name="cell"><link name="room"/>
<link name="post"><collision><geometry><cylinder radius="0.1" length="1"/></geometry></collision>
</link>
<joint name="there" type="fixed"><parent link="room"/><child link="post"/>
<origin xyz="{x} {y} 0"/></joint></robot>"""


def test_the_first_limit_and_the_first_touch_in_order(
    panda_pose: rp.Task, q_panda: np.ndarray, tmp_path: Path
) -> None:
    """The elbow is folded until links overlap, and then joint 4 leaves its limits."""
    path = rp.circle(panda_pose, q_panda, 0.05)
    motion = rp.follow(rp.Pseudoinverse(panda_pose), path, q_panda, cycles=2, steps=10)
    assert motion.first_violation is None and motion.first_touch is None
    assert rp.write_motion(motion, tmp_path / "good.csv").exists()
    q, folded = (motion.q.copy(), np.array([0.794, -0.812, -2.66, -3.022, 1.815, 3.424, 0.618]))
    q[13], q[17] = (folded, q_panda + [0, 0, 0, -0.9, 0, 0, 0])  # in cycle 2: 30 % and 70 % round
    bad = replace(motion, q=q)
    assert bad.first_violation == (1.7, "panda_joint4")
    moment, links = bad.first_touch
    assert set(links) == set(rp.Bodies(panda_pose).nearest(folded).links)
    assert 1.2 < moment <= 1.3  # the polyline collides before the sample
    said = (
        f"{' and '.join(links)} collide {100 * (moment - 1):.0f} % into cycle 2; "
        "panda_joint4 exceeds its limits 70 % into cycle 2: no trajectory was written; "
        "choose another start or path"
    )
    with pytest.raises(rp.InputError, match=f"^{re.escape(said)}"):
        rp.write_motion(bad, tmp_path / "bad.csv")
    assert rp.write_motion(bad, tmp_path / "bad.csv", allow_violations=True).exists()
    early = replace(motion, q=np.concatenate([q[17:], q[1:17], q[17:18]]))
    assert early.first_violation == (0.0, "panda_joint4")
    with pytest.raises(rp.InputError, match="^panda_joint4 exceeds its limits at the "):
        rp.write_motion(early, tmp_path / "early.csv")


def test_a_thinned_motion_is_the_same_at_fewer_points(
    panda_pose: rp.Task, q_panda: np.ndarray
) -> None:
    path = rp.circle(panda_pose, q_panda, 0.05)
    motion = rp.follow(rp.Pseudoinverse(panda_pose), path, q_panda, cycles=3, steps=20)
    few = motion.thinned(5)
    assert (
        few.steps == 5
        and np.array_equal(few.q, motion.q[::4])
        and np.array_equal(few.t, motion.t[::4])
    )
    assert np.array_equal(few.drift, motion.drift) and np.array_equal(
        motion.thinned(99).q, motion.q
    )
    # the ends of cycles are among them
    assert np.array_equal(motion.thinned(7).q[::7], motion.q[::20])


def test_no_file_for_a_robot_beyond_the_limits(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    for more in (
        ["--csv", "m.csv"],
        ["--yaml", "m.yaml"],
        ["--csv", "m.csv", "--acceleration", "2"],
    ):
        error = refused(capsys, *OUT, *more)
        assert (
            re.search(r"theta1 exceeds its limits \d+ % into cycle 1: ", error)
            and "or write it anyway with --allow-violations" in error
        )
        assert not list(tmp_path.iterdir())
    data = told(capsys, *OUT, "--csv", "m.csv", "--allow-violations")
    assert data["files"] == ["m.csv"] and data["first_violation"]["joint"] == "theta1"
    assert (np.loadtxt("m.csv", delimiter=",", skiprows=1)[:, 2] > 2 * np.pi).any()


def follow_past(post: tuple[float, float], folder: Path) -> list[str]:
    """A circle of the chain's tip about (2.1, 0.9), from (2.4, 0.9), with a post in the room."""
    (folder / "cell.urdf").write_text(CELL.format(x=post[0], y=post[1]))
    return [
        "follow",
        str(chain_with_bodies(folder)),
        "--frame",
        "tip",
        "--task",
        "xy",
        "--strategy",
        "pseudoinverse",
        "--start",
        "0.2,0.5,0.3",
        "--path",
        "circle:0.2:0",
        "--plane",
        "xy",
        "--steps",
        "100",
        "--cycles",
        "2",
        "--surroundings",
        str(folder / "cell.urdf"),
    ]


def test_surroundings_must_not_be_touched(tmp_path, capsys) -> None:
    """The tip's link has a ball at its end, 1 m beyond the joint that carries it."""
    task = rp.Robot.load(chain_with_bodies(tmp_path)).task("tip", "xy")
    ball = sum(np.exp(1j * angle) for angle in np.cumsum([0.2, 0.5, 0.3]))
    here = task.positions(np.array([[0.2, 0.5, 0.3]]))[0]
    assert np.isclose(complex(here[0], here[1]), ball - np.exp(1j))
    far = told(capsys, *follow_past((5.0, 0.0), tmp_path), "--csv", str(tmp_path / "m.csv"))
    assert far["first_touch"] is None and far["body_distance"] > 0.5
    (tmp_path / "m.csv").unlink()
    words = follow_past((ball.real, ball.imag), tmp_path)
    assert "tip and post collide at the start: no trajectory" in refused(
        capsys, *words, "--csv", str(tmp_path / "m.csv")
    )
    near = follow_past((ball.real - 0.25, ball.imag), tmp_path)  # not at the start, but on the way
    error = refused(capsys, *near, "--yaml", str(tmp_path / "m.yaml"))
    assert (
        re.search(r"tip and post collide \d+ % into cycle 1: ", error)
        and not (tmp_path / "m.yaml").exists()
    )
    assert main(near) == 0
    out, warning = capsys.readouterr()
    assert (
        re.search(r"\nbody distance   collision, overlap up to [\d.]+ [cm]?m, between", out)
        and "m, between tip and post\n" in out
    )
    assert "note: collisions of a are not detected: mesh 'lost.stl' is missing" in out
    assert (
        re.match(r"repctl: warning: tip and post collide \d+ % into cycle 1; ", warning)
        and warning.count("\n") == 1
    )
    assert main([*near, "--json"]) == 0
    touch = json.loads(capsys.readouterr().out)["first_touch"]
    assert touch["links"] == ["tip", "post"] and 0 < touch["cycle"] < 1


@pytest.mark.slow
def test_baxter_breaks_a_limit_in_cycle_7_and_ours_none() -> None:
    """Ten cycles of the study's circle, from the middle of the joints' ranges."""
    task = rp.Robot.load("baxter").task("left_gripper", "pose")
    q0 = task.from_robot(task.robot.poses["middle"])
    problem = rp.Problem(task, start=q0)
    assert np.array_equal(problem.start, q0)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        None,
        rp.Box(q0, 0.4),
        degree=1,
        options=rp.FitOptions(samples=512, held_out=256),
        shrink=True,
    )
    plain, ours = (
        rp.follow(it, problem.cycle, q0, cycles=10, steps=80)
        for it in (rp.Pseudoinverse(task), design.inverse)
    )
    moment, name = plain.first_violation
    assert 6 < moment < 7 and name == "left_w2"
    assert ours.drift.max() < 1e-3 and ours.first_violation is None
    assert plain.thinned(10).first_touch is ours.thinned(10).first_touch is None


@pytest.mark.slow
def test_figures_mark_the_first_violation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a study draws them: words and a cross at the drift, and a cross at the joint."""
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda it, *_, **__: drawn.append(it))
    path = ["--start", "6.2,1,-1.4", "--path", "circle:0.4:0", "--plane", "xy"]
    few = ["--degree", "1", "--cycles", "2", "--steps", "50", "--quiet"]
    assert main(["study", "planar3r", *path, *few, "--out", str(tmp_path / "out")]) == 0
    drift, joints = drawn[:2]
    assert any(line.get_marker() == "x" for line in drift.axes[0].lines)
    words = [text.get_text() for text in drift.axes[0].texts]
    assert any("limit in cycle 1" in text for text in words)
    crosses = [
        ax.get_title("left") for ax in joints.axes for line in ax.lines if line.get_marker() == "x"
    ]
    assert set(crosses) == {"theta1"}  # theta2 and theta3 stay within theirs


def test_the_page_marks_the_touch(tmp_path) -> None:
    """The words and the moment, and a point that moves with the link."""
    words = follow_past((2.035, 1.684), tmp_path)
    task = rp.Robot.load(tmp_path / "chain.urdf", surroundings=words[-1]).task("tip", "xy")
    q0 = np.array([0.2, 0.5, 0.3])
    motion = rp.follow(rp.Pseudoinverse(task), rp.circle(task, q0, 0.2), q0, cycles=2, steps=100)
    assert motion.first_touch is not None and 0 < motion.first_touch[0] < 1
    scene, _, _ = read(rp.animation({"J⁺": motion}).page)
    broken = scene["arms"][0]["broken"]
    assert broken["words"] == "tip and post have touched" and broken["cycle"] == 1
    assert np.isclose(broken["at"], motion.first_touch[0], atol=0.011)
