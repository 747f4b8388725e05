"""Distances between a robot's own bodies: closed forms, and the full meshes as an oracle."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from arms import chain_with_bodies

import repctl_pin as rp
from repctl_pin.robot import body_shapes
from repctl_pin.robot.bodies import Nearest
from repctl_pin.robot.body_bounds import JointPlacements


@pytest.fixture
def chain(tmp_path: Path) -> rp.Task:
    """Three unit links in a plane; balls of 0.1 m at the root and at the tip, and a mesh that is not there."""
    return rp.Robot.load(chain_with_bodies(tmp_path)).task("tip", "position")


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


def test_what_always_touches_is_asked_inside_the_limits_in_any_coordinates(chain: rp.Task, tmp_path: Path) -> None:
    text = (tmp_path / "chain.urdf").read_text()
    for j in (1, 2):  # folded to a triangle, whatever they do: both balls in one place
        at = text.index(f'"j{j}"')
        text = text[:at] + text[at:].replace('lower="-3" upper="3"', 'lower="2.07" upper="2.12"', 1)
    (tmp_path / "chain.urdf").write_text(text)
    task = rp.Robot.load(tmp_path / "chain.urdf").task("tip", "position")
    absolute = rp.Bodies(task.in_coordinates(rp.absolute_angles(task)))
    assert ("base", "tip") in rp.Bodies(task).touching
    assert (absolute.touching, absolute.pairs) == (rp.Bodies(task).touching, rp.Bodies(task).pairs)


CELL = """<robot name="cell"><link name="room"/>
<link name="wall"><collision><geometry><box size="0.2 4 4"/></geometry></collision></link>
<link name="base"><collision><geometry><sphere radius="0.25"/></geometry></collision></link>
<joint name="there" type="{kind}"><parent link="room"/><child link="wall"/><origin xyz="3.6 0 0"/>
<axis xyz="0 0 1"/></joint>
<joint name="here" type="fixed"><parent link="room"/><child link="base"/><origin xyz="0 0 0.3"/></joint></robot>"""


def test_surroundings_stand_where_their_root_is(chain: rp.Task, tmp_path: Path) -> None:
    """A wall ahead of the tip, and a post over the root whose link has a name that the robot has too."""
    (tmp_path / "cell.urdf").write_text(CELL.format(kind="fixed"))
    task = rp.Robot.load(tmp_path / "chain.urdf", surroundings=tmp_path / "cell.urdf").task("tip", "position")
    bodies, alone = rp.Bodies(task), rp.Bodies(chain)
    assert bodies.standing == {"wall", "surroundings/base"}
    assert set(bodies.pairs) >= {*alone.pairs, ("tip", "wall"), ("b", "wall"), ("tip", "surroundings/base")}
    straight = bodies.nearest(np.zeros(3))  # the tip's ball ends at 3.1 m, the wall begins at 3.5 m
    assert straight.links == ("tip", "wall") and straight.distance == pytest.approx(0.4, abs=1e-6)
    q = np.array([2.9, 1.9, 2.0])  # folded, far from the wall: the post is nearer than the root's ball
    tip = abs(sum(np.exp(1j * angle) for angle in np.cumsum(q)))
    assert bodies.nearest(q).links == ("tip", "surroundings/base")
    assert np.isclose(bodies.nearest(q).distance, np.hypot(tip, 0.3) - 0.35, atol=1e-6)
    assert bodies.nearest(q).distance < alone.nearest(q).distance
    task = task.robot.task("tip", "xy")
    motion = rp.follow(rp.Pseudoinverse(task), rp.circle(task, q, 0.05), q, cycles=1, steps=20)
    assert motion.body_distance == pytest.approx(bodies.distances(motion.q))


def test_hulls_that_overlap_are_no_touch(chain: rp.Task, tmp_path: Path) -> None:
    """The tip's ball is in the hole of a ring, where the ring's hull is full; then on the ring itself."""
    trimesh.creation.torus(0.4, 0.1).export(tmp_path / "ring.stl")
    ring = CELL.format(kind="fixed").replace('<box size="0.2 4 4"/>', '<mesh filename="ring.stl"/>')
    (tmp_path / "cell.urdf").write_text(ring.replace("3.6 0 0", "3 0 0"))
    bodies = rp.Bodies(
        rp.Robot.load(tmp_path / "chain.urdf", surroundings=tmp_path / "cell.urdf").task("tip", "position")
    )
    assert bodies.nearest(np.zeros(3)) == Nearest(0.0, ("tip", "wall"))
    on_it = bodies.nearest(np.array([0.4 / 3, 0.0, 0.0]))
    assert on_it.links == ("tip", "wall") and on_it.distance < 0
    assert bodies.nearest(np.array([0.7 / 3, 0.0, 0.0])).distance > 0


def test_a_flat_mesh_is_a_thin_body(chain: rp.Task, tmp_path: Path) -> None:
    """A square of no thickness 0.6 m before the tip's ball: a hull without volume crashes the distance library."""
    corners = [[0, -0.5, -0.5], [0, 0.5, -0.5], [0, 0.5, 0.5], [0, -0.5, 0.5]]
    trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]]).export(tmp_path / "flat.stl")
    sign = CELL.format(kind="fixed").replace('<box size="0.2 4 4"/>', '<mesh filename="flat.stl"/>')
    (tmp_path / "cell.urdf").write_text(sign)
    bodies = rp.Bodies(
        rp.Robot.load(tmp_path / "chain.urdf", surroundings=tmp_path / "cell.urdf").task("tip", "position")
    )
    assert bodies.nearest(np.zeros(3)).links == ("tip", "wall")
    assert bodies.nearest(np.zeros(3)).distance == pytest.approx(0.5, abs=2e-4)


def test_a_hull_with_a_corner_of_many_neighbours_is_made_coarser() -> None:
    """A cone of 400 sides: its tip has more neighbours than the distance library takes."""
    cone = trimesh.creation.cone(0.1, 0.3, sections=400)
    hull = body_shapes._hull(np.asarray(cone.convex_hull.vertices, float))
    ball, far = coal.Sphere(0.05), np.array([0.5, 0.0, 0.0])
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    apart = coal.distance(hull, coal.Transform3s(), ball, coal.Transform3s(np.eye(3), far), request, result)
    assert 0.35 - 2e-3 < apart <= 0.35 + 1e-9  # never farther than it is


BAD_CELLS = {
    "moves": (CELL.format(kind="continuous"), "line 4: joint 'there' moves, but surroundings stand still"),
    "empty": ('<robot name="cell"><link name="room"/></robot>', "no <collision> in it"),
    "torn": (CELL[:200], "cell.urdf"),
    "mesh": (CELL.format(kind="fixed").replace('<sphere radius="0.25"/>', '<mesh filename="no.stl"/>'), "'no.stl'"),
}


@pytest.mark.parametrize("case", BAD_CELLS)
def test_surroundings_that_cannot_be_used_are_refused(chain: rp.Task, tmp_path: Path, case: str) -> None:
    text, why = BAD_CELLS[case]
    (tmp_path / "cell.urdf").write_text(text)
    with pytest.raises(rp.InputError, match=why) as error:
        rp.Bodies(rp.Robot.load(tmp_path / "chain.urdf", surroundings=tmp_path / "cell.urdf").task("tip", "position"))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["talos", "tiago", "ppr", "baxter"])
def test_joints_are_placed_as_pinocchio_does(name: str) -> None:
    model = rp.Robot.load(name).model
    Q = np.random.default_rng(0).uniform(-2, 2, (7, model.nq))
    R, p = JointPlacements(model)(Q)
    data = model.createData()
    for q, rotations, origins in zip(Q, R, p, strict=True):
        pin.forwardKinematics(model, data, q)
        np.testing.assert_allclose(rotations, [joint.rotation for joint in data.oMi], atol=1e-12)
        np.testing.assert_allclose(origins, [joint.translation for joint in data.oMi], atol=1e-12)


def test_balls_and_boxes_bound_every_pair_from_below(panda_pose: rp.Task) -> None:
    bodies = rp.Bodies(panda_pose)
    Q = np.random.default_rng(1).uniform(panda_pose.lower, panda_pose.upper, (20, 7))
    for q, bounds in zip(Q, bodies._bounds(Q), strict=True):
        pin.updateGeometryPlacements(bodies._model, bodies._data, bodies._shapes, bodies._placed, q)
        exact = [bodies._exact(k) for k in range(len(bounds))]
        assert (bounds <= np.array(exact) + 1e-9).all()
        assert bodies.nearest(q).distance == pytest.approx(min(exact), abs=1e-5)


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
    assert (meshes[ours < 0] < 1e-6).all() and (meshes[ours == 0] > 0).all()  # it touches where the meshes do
    if name == "panda":
        assert (meshes[apart] - ours[apart]).max() < 0.02


def test_the_pandas_elbow_comes_near_its_body_under_the_pseudoinverse(
    panda_pose: rp.Task, panda_design: rp.Design, q_panda: np.ndarray
) -> None:
    """From 0.117 m in cycle 1 to 0.024 m within ten; the repeatable inverse keeps the first cycle's distance."""
    path = rp.circle(panda_pose, q_panda, radius=0.1, normal="z")
    motion = rp.follow(rp.Pseudoinverse(panda_pose), path, q_panda, cycles=10, steps=100)
    assert motion.body_distance[:101].min() == pytest.approx(0.1175, abs=5e-4)
    assert motion.body_distance.min() == pytest.approx(0.0239, abs=5e-4)
    when, nearest = motion.nearest_bodies
    assert when > 8 and nearest.distance == pytest.approx(motion.body_distance.min()) and "panda_link5" in nearest.links
    ours = rp.follow(panda_design.inverse, path, q_panda, cycles=10, steps=100).body_distance
    assert ours.min() == pytest.approx(0.1192, abs=5e-4) and ours.min() == pytest.approx(ours[:101].min(), abs=1e-6)


def test_an_arm_without_bodies() -> None:
    bodies = rp.Bodies(rp.Robot.load("planar3r").task())
    assert bodies.pairs == () and bodies.nearest(np.zeros(3)).distance == np.inf
