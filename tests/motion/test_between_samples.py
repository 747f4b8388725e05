"""Body distances hold between the samples of a motion: a dense check is the oracle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from controls import control, some

import repctl_pin as rp

LINKS = np.array([0.5, 0.4, 0.3])

ARM = """<robot name="arm"><link name="base"/>
{links}
{joints}</robot>"""

LINK = """<link name="l{k}"><collision><origin xyz="{x} 0 0" rpy="0 1.5707963 0"/>
<geometry><capsule radius="0.01" length="{length}"/></geometry></collision></link>"""

JOINT = """<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/>
<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2" effort="1"/>
</joint>"""

THIN = """<robot name="thin"><link name="ground"/><link name="thin"><collision>
<origin rpy="0 0 {yaw}"/><geometry>{shape}</geometry></collision></link>
<joint name="there" type="fixed"><parent link="ground"/><child link="thin"/>
<origin xyz="{x} {y} 0"/></joint></robot>"""


def arm(folder: Path) -> Path:
    """Three links of capsules in a plane."""
    starts = [0.0, *LINKS[:2]]
    parents = ["base", "l0", "l1"]
    links = [LINK.format(k=k, x=a / 2, length=a) for k, a in enumerate(LINKS)]
    joints = [JOINT.format(k=k, parent=parents[k], x=starts[k]) for k in range(3)]
    (folder / "arm.urdf").write_text(ARM.format(links="\n".join(links), joints="\n".join(joints)))
    return folder / "arm.urdf"


def beside(folder: Path, x: float, y: float, yaw: float, shape: str) -> rp.Task:
    """Make the task of the arm with a thin body beside it."""
    (folder / "thin.urdf").write_text(THIN.format(x=x, y=y, yaw=yaw, shape=shape))
    robot = rp.Robot.load(arm(folder), surroundings=folder / "thin.urdf")
    return robot.task("l2", "xy")


def motion_of(task: rp.Task, Q: np.ndarray) -> rp.Motion:
    """Make a motion of samples Q; its path plays no part."""
    q0 = np.array([0.4, 0.9, 0.8])
    motion = rp.follow(rp.Pseudoinverse(task), rp.circle(task, q0, 0.05), q0, cycles=1, steps=10)
    t = np.linspace(0.0, 1.0, len(Q))
    return replace(motion, t=t, q=Q, qdot=np.gradient(Q, t, axis=0), steps=len(Q) - 1)


def dense(task: rp.Task, Q: np.ndarray, count: int) -> float:
    """Measure the minimum body distance at ``count`` points between each two samples, m."""
    share = np.arange(count)[:, None] / count
    points = [a + share * (b - a) for a, b in pairwise(Q)]
    return float(rp.Bodies(task).distances(np.vstack([*points, Q[-1:]])).min())


def test_a_pin_between_two_samples_is_hit(tmp_path: Path) -> None:
    """Issue 52, item 26.2: the tip passes a pin of 1 mm radius between two samples."""
    Q = np.linspace([0.0, 0.3, 0.2], [1.0, 0.3, 0.2], 21)
    middle = np.cumsum((Q[10] + Q[11]) / 2)
    x, y = np.sum(LINKS[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1), axis=0)
    task = beside(tmp_path, x, y, 0.0, '<cylinder radius="0.001" length="0.2"/>')
    motion = motion_of(task, Q)
    assert motion.body_distance.min() > 0  # none of the samples collides
    moment, links = motion.first_touch
    assert 0.5 < moment < 0.55 and links == ("l2", "thin")
    assert motion.clearance.distance < 0
    with pytest.raises(rp.InputError, match="l2 and thin collide 5[0-9] % into cycle 1"):
        rp.write_motion(motion, tmp_path / "motion.csv")
    assert not (tmp_path / "motion.csv").exists()


SLIDE = """<robot name="slide"><link name="base"><collision><origin xyz="0 0 0.13"/>
<geometry><sphere radius="0.005"/></geometry></collision></link><link name="turning"/>
<link name="rod"><collision><origin xyz="-1 0 0.1"/><geometry><sphere radius="0.005"/></geometry>
</collision></link>
<link name="hand"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="turning"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="2" effort="1"/></joint>
<joint name="slide" type="prismatic"><parent link="turning"/><child link="rod"/><axis xyz="1 0 0"/>
<limit lower="0.1" upper="0.3" velocity="2" effort="1"/></joint>
<joint name="wrist" type="revolute"><parent link="rod"/><child link="hand"/><axis xyz="0 0 1"/>
<origin xyz="0.05 0 0"/><limit lower="-3" upper="3" velocity="2" effort="1"/></joint></robot>"""


def test_a_slide_beyond_its_limits_moves_the_hand_further(tmp_path: Path) -> None:
    """A revolute joint moves the hand by its radius, also where that is beyond the slide's limits.

    The hand passes a pin at 1.05 m between two samples. The limits allow 0.35 m; with that radius,
    the distances at the samples would rule out one below the 2 cm from rod to base.
    """
    (tmp_path / "slide.urdf").write_text(SLIDE)
    pin = '<cylinder radius="0.001" length="0.2"/>'
    (tmp_path / "thin.urdf").write_text(THIN.format(x=1.05, y=0, yaw=0, shape=pin))
    robot = rp.Robot.load(tmp_path / "slide.urdf", surroundings=tmp_path / "thin.urdf")
    task = robot.task("hand", "xy")
    q0 = np.array([0.4, 0.2, 0.5])
    motion = rp.follow(rp.Pseudoinverse(task), rp.circle(task, q0, 0.02), q0, cycles=1, steps=10)
    Q = np.linspace([-0.15, 1.0, 0.0], [0.15, 1.0, 0.0], 4)
    t = np.linspace(0.0, 1.0, len(Q))
    motion = replace(motion, t=t, q=Q, qdot=np.gradient(Q, t, axis=0), steps=len(Q) - 1)
    assert motion.body_distance.min() > 0  # none of the samples collides
    assert motion.clearance.touch is not None or not motion.clearance.between


def test_the_minimum_between_two_samples_is_found_to_a_tenth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The tip passes a ball at 10 cm, half-way between two samples at 15 cm.

    The bounds at the samples exclude a collision, so only the minimum is sought."""
    gap, turn = 0.1, 0.09
    reach = LINKS.sum() + 0.01
    task = beside(tmp_path, reach + gap + 0.01, 0.0, 0.0, '<sphere radius="0.01"/>')
    bodies = rp.Bodies(task)
    model, measured = type(bodies._model), []
    some_distances = model.some_distances
    monkeypatch.setattr(
        model,
        "some_distances",
        lambda *given, **more: measured.append(given) or some_distances(*given, **more),
    )
    ends = np.array([[-turn, 0.0, 0.0], [turn, 0.0, 0.0]])
    found = bodies._along(ends, np.array([0, 1]))
    assert found.distances.min() > 1.4 * gap
    assert gap - 1e-9 <= found.distance <= gap / 0.9 and found.at == pytest.approx(0.5, abs=0.2)
    assert found.links == ("l2", "thin") and found.between and found.touch is None
    assert found.points == 2 + len(measured) > 2


def test_a_piece_is_as_long_as_its_longer_half(tmp_path: Path) -> None:
    """The arm moves slowly, then fast past a pin: its middle sample is far from the pin."""
    x, y = LINKS.sum() * np.array([np.cos(0.47), np.sin(0.47)])
    task = beside(tmp_path, x, y, 0.0, '<cylinder radius="0.001" length="0.2"/>')
    Q = np.array([[angle, 0.0, 0.0] for angle in (0.0, 0.01, 0.02, 0.32, 0.62)])
    found = rp.Bodies(task)._along(Q, np.array([0, 4]))
    assert found.touch is not None and 3.4 < found.touch[0] < 3.6


@pytest.mark.slow
@pytest.mark.parametrize("count", some([10, 20, 100], 10))
def test_never_clean_where_a_dense_check_finds_a_collision(count: int, tmp_path: Path) -> None:
    """Issue 52, item 26.2: pins and thin plates at random places, and coarse samples."""
    rng = np.random.default_rng(52)
    hidden = collisions = clean = 0
    for _ in range(count):
        radius, angle = rng.uniform(0.5, 1.2), rng.uniform(-0.5, 1.5)
        x, y = radius * np.cos(angle), radius * np.sin(angle)
        shape = rng.choice(
            [
                f'<cylinder radius="{rng.uniform(3e-4, 2e-3)}" length="0.1"/>',
                f'<box size="{rng.uniform(0.01, 0.1)} 0.0002 0.1"/>',
            ]
        )
        task = beside(tmp_path, x, y, rng.uniform(0, 3), str(shape))
        turns = rng.uniform(-0.4, 0.4, 3), rng.uniform(-0.6, 0.6, 3)
        s = np.linspace(0.0, 1.0, int(rng.integers(8, 40)))[:, None]
        Q = [0.3, 0.4, 0.3] + s * turns[0] + np.sin(2 * np.pi * s) * turns[1]
        motion = motion_of(task, Q)
        found, oracle = motion.clearance, dense(task, Q, 400)
        sampled = float(motion.body_distance.min())
        if oracle < 0:
            collisions += 1
            hidden += sampled >= 0
            assert found.touch is not None or not found.between
        elif found.touch is None and found.between:
            clean += 1
            least = found.distance - max(0.1 * found.distance, 5e-3)
            assert oracle >= least - 1e-6 and found.distance <= sampled + 1e-9
    assert hidden >= count / 20 and collisions - hidden >= count / 20 and clean >= 3 * count / 20


@pytest.mark.slow
def test_a_gap_that_cannot_be_settled_is_said(tmp_path: Path) -> None:
    """The tip passes a plate at 1 nm: a collision is neither found nor ruled out."""
    plate = '<box size="0.002 0.4 0.1"/>'
    task = beside(tmp_path, 1.2 + 0.011 + 1e-9, 0.0, 0.0, plate)
    Q = np.linspace([-0.1, 0.0, 0.0], [0.1, 0.0, 0.0], 21)
    found = motion_of(task, Q).clearance
    assert found.touch is None and not found.between and found.points > 21
    assert found.undecided == ("l2", "thin")


BALL = """<link name="{name}"><collision><origin xyz="{x} 0 {z}"/><geometry>
<sphere radius="0.05"/></geometry></collision></link>"""

FIXED = """<joint name="{child}" type="fixed"><parent link="{parent}"/><child link="{child}"/>
</joint>"""


def folding(folder: Path) -> rp.Task:
    """Make the task of an arm whose balls on both sides of a joint, 0.3 m from it, meet at q_2 = π.

    They are checked for collisions only; the ball of the base is measured, 0.4 m below the others.
    """
    balls = {"low": (0, -0.4), "l0": (0.2, 0), "palm": (0.3, 0), "l2": (0.5, 0.4)}
    links = [BALL.format(name=name, x=x, z=z) for name, (x, z) in balls.items()]
    joints = [
        JOINT.format(k=k, parent=parent, x=x).replace('"3"', '"3.5"')
        for k, (parent, x) in enumerate({"base": 0, "l0": 0.5, "l1": 0.1}.items())
    ]
    joints += [FIXED.format(parent="base", child="low"), FIXED.format(parent="l1", child="palm")]
    links.append('<link name="l1"/>')
    (folder / "fold.urdf").write_text(ARM.format(links="".join(links), joints="".join(joints)))
    return rp.Robot.load(folder / "fold.urdf").task("l2", "xy")


def folded(task: rp.Task, angles: list[float], rows: int = 1) -> Any:
    """Find the first collision of a motion of the second joint, with every ``rows``-th sample."""
    Q = np.array([[0.2, angle, 0.1] for angle in angles])
    return rp.Bodies(task)._along(Q, np.arange(0, len(Q), rows))


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_neighbours_that_collide_are_found_at_samples(
    share: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neighbours are checked for collisions only, in pieces, or at samples without measurements."""
    task = folding(tmp_path)
    module = type(folded(task, [0.0, 1.0])).__module__
    monkeypatch.setattr(f"{module}._MOST", int(4000 * share))
    found = folded(task, [0.0, 1.0, 2.0, 3.14, 2.0])
    assert ("l0", "palm") in rp.Bodies(task).only_contact
    at, links = found.touch
    assert links == ("l0", "palm") and not found.between and found.distance < 0
    assert at == 3 if share == 0 else 2 < at < 3
    assert (found.distances < 0).tolist() == [False, False, False, True, False]


def test_a_collision_found_last_is_searched_for_an_earlier_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Measurements are spent on other pairs, and only the samples show that neighbours collide."""
    task = folding(tmp_path)
    angles = [0.0, 1.0, 2.0, 3.14, 2.0]
    first, links = folded(task, angles).touch
    monkeypatch.setattr(f"{type(folded(task, angles)).__module__}._MOST", 12)
    assert folded(task, angles).touch == (pytest.approx(first, abs=0.01), links)


@pytest.mark.parametrize("angles", [[3.14], [3.14, 3.14], [3.14, 2.0, 0.0], [0.0, 3.14]])
def test_motions_that_begin_or_end_in_a_collision_of_neighbours(
    angles: list[float], tmp_path: Path
) -> None:
    """A motion of one sample has no pieces, and a collision at the end was shown nowhere."""
    found = folded(folding(tmp_path), angles)
    assert found.touch is not None and not found.between
    assert found.touch[0] == 0 or angles[0] == 0
    assert (found.distances < 0).tolist() == [angle > 3 for angle in angles]


@pytest.mark.slow
@pytest.mark.parametrize("chosen", some([True, False], True))
def test_a_study_whose_motions_all_collide_says_so_first(
    tmp_path: Path, chosen: bool, only_starts: Callable[..., None], quick_choices: None
) -> None:
    """Issue 52, item 26.10: a ball at the root of the third link lies in a ball around the arm.

    The user gives start and path, or no default start is free."""
    task = beside(tmp_path, 0.45, 0.35, 0.0, '<sphere radius="0.3"/>')
    q0 = np.array([0.4, 0.9, 0.8])
    given = rp.Problem(task, start=q0, path=rp.circle(task, q0, 0.05))
    only_starts((q0, "first"))
    few = rp.FitOptions(samples=64, held_out=64)
    study = rp.study(given if chosen else rp.Problem(task), cycles=1, options=few)
    from repctl_pin.show.text.answer import study_answer

    text = "".join(span.text for span in study_answer(study)).replace("\u00a0", " ")
    assert text.startswith("No motion without a collision was found: ")
    assert "and thin collide" in " ".join(text.split())
    # with J⁺ free of collisions, the motion that would be run still collides
    usual = study.row("pseudoinverse")
    free = rp.Robot.load(arm(tmp_path)).task("l2", "xy")
    clean = replace(usual, motion=replace(usual.motion, task=free))
    rows = tuple(clean if row is usual else row for row in study.rows)
    text = "".join(span.text for span in study_answer(replace(study, rows=rows)))
    assert text.startswith("Under the repeatable one, ")


@pytest.mark.parametrize("count", [0, 13])
def test_a_timed_motion_is_checked_where_it_leaves_the_points(tmp_path: Path, count: int) -> None:
    """Item 26.2: a smooth curve through few points hits a wire that the straight lines pass.

    A timed motion with as many samples as the original one, ``count``, is checked as well."""
    arm = tmp_path / "arm.urdf"
    arm.write_text(
        f'<robot name="arm"><link name="l0"/>{"".join(map(_link, (1, 2, 3)))}{_TOOL}</robot>'
    )
    task, q0 = rp.Robot.load(arm).task("tool", "xy"), np.array([0.3, 0.8, 0.8])
    path = rp.circle(task, q0, radius=0.25)
    inverse = control(task, q0, rp.Polynomial(q0, 2, 0.5))
    motion = rp.follow(inverse, path, q0, cycles=1, steps=12, integrator=rp.LeafLock(4))
    rate = 200.0
    if count:
        # two samples before and after the motion
        rate = (count - 3.5) / rp.timed(motion, rp.Limits(acceleration=4.0)).duration
    timed = rp.timed(motion, rp.Limits(acceleration=4.0), rate=rate)
    shares = np.arange(50)[:, None, None] / 50
    straight = (motion.q[:-1] + shares * np.diff(motion.q, axis=0)).reshape(-1, 3)
    beside = None
    for angle in np.linspace(0, 2 * np.pi, 24, endpoint=False):
        ray = np.array([np.cos(angle), np.sin(angle), 0])
        ends = [max(task.placement(q).translation @ ray for q in Q) for Q in (straight, timed.q)]
        if ends[1] - ends[0] > 3e-3:
            k = int(np.argmax([task.placement(q).translation @ ray for q in timed.q]))
            beside = task.placement(timed.q[k]).translation - 2e-4 * ray
            break
    assert beside is not None
    post = tmp_path / "post.urdf"
    post.write_text(_POST.format(at=" ".join(map(repr, beside.tolist()))))
    walled = rp.Robot.load(arm, surroundings=post).task("tool", "xy")
    bodies = rp.Bodies(walled)
    assert bodies.distances(straight).min() > 0 > bodies.distances(timed.q).min()
    motion = replace(motion, task=walled)
    timed = rp.timed(motion, rp.Limits(acceleration=4.0), rate=rate)
    assert motion.first_touch is None and (not count or timed.q.shape == motion.q.shape)
    with pytest.raises(rp.InputError, match=r"ball and wire collide at .* s of the timed motion"):
        rp.write_motion(timed, tmp_path / "timed.csv")
    assert not (tmp_path / "timed.csv").exists()
    rp.write_motion(motion, tmp_path / "plain.csv")
    rp.write_motion(timed, tmp_path / "timed.csv", allow_violations=True)


def _link(k: int) -> str:
    """A link without a shape, and the joint that carries it."""
    return (
        f'<link name="l{k}"/><joint name="j{k}" type="revolute"><parent link="l{k - 1}"/>'
        f'<child link="l{k}"/><origin xyz="{0.5 * (k > 1)} 0 0"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" velocity="2" effort="1"/></joint>'
    )


_TOOL = """<link name="tool"/><joint name="e" type="fixed"><parent link="l3"/><child link="tool"/>
<origin xyz="0.5 0 0"/></joint><link name="ball"><collision><geometry><sphere radius="0.0005"/>
</geometry></collision></link><joint name="b" type="fixed"><parent link="tool"/>
<child link="ball"/></joint>"""
_POST = """<robot name="w"><link name="room"/><link name="wire"><collision><geometry>
<box size="0.0005 0.0005 1"/></geometry></collision></link><joint name="a" type="fixed">
<parent link="room"/><child link="wire"/><origin xyz="{at}"/></joint></robot>"""
