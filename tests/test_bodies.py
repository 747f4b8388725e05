"""Distances between a robot's own bodies: closed forms, and the full meshes as an oracle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import repctl_pin as rp

LINK = """
<link name="{name}"><collision><origin xyz="{x} 0 0"/><geometry>{shape}</geometry></collision></link>
"""
JOINT = """
<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{x} 0 0"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
"""


@pytest.fixture
def chain(tmp_path: Path) -> rp.Task:
    """Three unit links in a plane; balls of 0.1 m at the root and at the tip, and a mesh that is not there."""
    ball, lost = '<sphere radius="0.1"/>', '<mesh filename="lost.stl"/>'
    links = [("base", 0, ball), ("a", 0.5, lost), ("b", 0.5, '<box size="0.2 0.1 0.1"/>'), ("tip", 1, ball)]
    text = "".join(LINK.format(name=name, x=x, shape=shape) for name, x, shape in links)
    joints = [("base", "a", 0), ("a", "b", 1), ("b", "tip", 1)]
    text += "".join(JOINT.format(k=k, parent=p, child=c, x=x) for k, (p, c, x) in enumerate(joints))
    file = tmp_path / "chain.urdf"
    file.write_text(f'<robot name="chain">{text}</robot>')
    return rp.Robot.load(file).task("tip", "position")


def test_two_balls_and_a_box(chain: rp.Task) -> None:
    bodies = rp.Bodies(chain)
    assert set(bodies.pairs) == {("base", "b"), ("base", "tip")} and bodies.missing == ("lost.stl",)
    straight = bodies.nearest(np.zeros(3))
    assert straight.links == ("base", "b") and straight.distance == pytest.approx(1.5 - 0.1 - 0.1, abs=1e-6)
    q = np.array([0.3, 2.0, 2.2])  # folded: the tip comes near the root
    tip = sum(np.exp(1j * angle) for angle in np.cumsum(q))
    found = bodies.nearest(q)
    assert found.links == ("base", "tip") and found.distance == pytest.approx(abs(tip) - 0.2, abs=1e-6)
    both = bodies.distances(np.array([q, np.zeros(3), q]))
    assert np.allclose(both, [found.distance, straight.distance, found.distance], atol=1e-9)


def test_bodies_that_overlap_are_below_zero(chain: rp.Task) -> None:
    q = np.array([0.0, 2 * np.pi / 3, 2 * np.pi / 3])  # an equilateral triangle: both balls in one place
    assert rp.Bodies(chain).nearest(q).distance < -0.1


def full_mesh_distances(task: rp.Task, pairs: set[frozenset[str]], Q: np.ndarray) -> np.ndarray:
    """The same pairs on the meshes as the files hold them, by Pinocchio's own reader."""
    robot = task.robot
    model = pin.buildModelFromXML(robot.description.xml)
    names = [model.names[i] for i in range(1, model.njoints)]
    shapes = pin.buildGeomFromUrdf(model, str(robot.description.path), pin.COLLISION, None, list(robot.package_dirs))
    link = [model.frames[body.parentFrame].name for body in shapes.geometryObjects]
    for b in range(shapes.ngeoms):
        for a in range(b):
            if frozenset((link[a], link[b])) in pairs:
                shapes.addCollisionPair(pin.CollisionPair(a, b))
    data, placed, found = model.createData(), pin.GeometryData(shapes), []
    place = {name: i for i, name in enumerate(robot.model.names[1:])}
    for q in robot.coupling.joints(task.full(Q)):
        whole = pin.neutral(model)
        for i, name in enumerate(names):
            if name in place:
                whole[i] = q[place[name]]
        pin.computeDistances(model, data, shapes, placed, whole)
        found.append(min(result.min_distance for result in placed.distanceResults))
    return np.array(found)


@pytest.mark.parametrize(
    ("name", "count"),
    [("panda", 30), *[pytest.param(name, 1000, marks=pytest.mark.slow) for name in ("panda", "baxter", "talos")]],
)
def test_never_above_the_meshes(name: str, count: int) -> None:
    """And, on bodies as round as these, at most 2 cm below them where they are apart."""
    task = rp.Robot.load(name).task()
    bodies = rp.Bodies(task)
    Q = np.random.default_rng(3).uniform(task.lower, task.upper, (count, task.n))
    ours = bodies.distances(Q)
    meshes = full_mesh_distances(task, set(map(frozenset, bodies.pairs)), Q)
    apart = ours > 0
    assert apart.sum() > count // 10
    assert (ours[apart] - meshes[apart]).max() < 1e-6
    if name == "panda":
        assert (meshes[apart] - ours[apart]).max() < 0.02


def test_the_pandas_elbow_comes_near_its_body_under_the_pseudoinverse(panda_pose: rp.Task, q_panda: np.ndarray) -> None:
    """From 0.118 m in cycle 1 to 0.026 m within ten; the repeatable inverse keeps the first cycle's distance."""
    path = rp.circle(panda_pose, q_panda, radius=0.1, normal="z")
    motion = rp.follow(rp.Pseudoinverse(panda_pose), path, q_panda, cycles=10, steps=100)
    assert motion.body_distance[:101].min() == pytest.approx(0.118, abs=3e-3)
    assert motion.body_distance.min() == pytest.approx(0.026, abs=3e-3)
    when, nearest = motion.nearest_bodies
    assert when > 8 and nearest.distance == pytest.approx(motion.body_distance.min()) and "panda_link5" in nearest.links


def test_an_arm_without_bodies() -> None:
    bodies = rp.Bodies(rp.Robot.load("planar3r").task())
    assert bodies.pairs == () and bodies.nearest(np.zeros(3)).distance == np.inf
