"""Distances between a robot's own bodies: closed forms, and the full meshes as an oracle."""

from __future__ import annotations

import gc
import os
import pickle
import re
import subprocess
import sys
import weakref
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from arms import chain_with_bodies, spatial_urdf
from controls import some

import repctl_pin as rp

mesh_cache = import_module("repctl_pin.model.mesh_cache")


@pytest.fixture
def chain(tmp_path: Path) -> rp.Task:
    """Three unit links in a plane; balls of 0.1 m at the root and at the tip, and a mesh that is
    not there."""
    return rp.Robot.load(chain_with_bodies(tmp_path)).task("tip", "position")


def test_two_balls_and_a_box(chain: rp.Task) -> None:
    bodies = rp.Bodies(chain)
    assert set(bodies.pairs) == {("base", "b"), ("base", "tip")} and bodies.missing == ("lost.stl",)
    straight = bodies.nearest(np.zeros(3))
    assert straight.links == ("base", "b") and straight.distance == pytest.approx(
        1.5 - 0.1 - 0.1, abs=1e-6
    )
    q = np.array([0.3, 2.0, 2.2])  # folded: the tip comes near the root
    tip = sum(np.exp(1j * angle) for angle in np.cumsum(q))
    found = bodies.nearest(q)
    assert found.links == ("base", "tip") and found.distance == pytest.approx(
        abs(tip) - 0.2, abs=1e-6
    )
    both = bodies.distances(np.array([q, np.zeros(3), q]))
    assert np.allclose(both, [found.distance, straight.distance, found.distance], atol=1e-9)


def test_bodies_that_overlap_are_below_zero(chain: rp.Task) -> None:
    # an equilateral triangle: both balls in one place
    q = np.array([0.0, 2 * np.pi / 3, 2 * np.pi / 3])
    assert rp.Bodies(chain).nearest(q).distance < -0.1


def test_what_always_touches_is_asked_inside_the_limits(chain: rp.Task, tmp_path: Path) -> None:
    text = (tmp_path / "chain.urdf").read_text()
    for j in (1, 2):  # folded to a triangle, whatever they do: both balls in one place
        at = text.index(f'"j{j}"')
        text = text[:at] + text[at:].replace('lower="-3" upper="3"', 'lower="2.07" upper="2.12"', 1)
    (tmp_path / "chain.urdf").write_text(text)
    task = rp.Robot.load(tmp_path / "chain.urdf").task("tip", "position")
    assert ("base", "tip") in rp.Bodies(task).touching


CELL = """<robot name="cell"><link name="room"/>
<link name="wall"><collision><geometry><box size="0.2 4 4"/></geometry></collision></link>
<link name="base"><collision><geometry><sphere radius="0.25"/></geometry></collision></link>
<joint name="there" type="{kind}"><parent link="room"/><child link="wall"/><origin xyz="3.6 0 0"/>
<axis xyz="0 0 1"/></joint>
<joint name="here" type="fixed"><parent link="room"/><child link="base"/><origin xyz="0 0 0.3"/>
</joint></robot>"""


def test_surroundings_stand_where_their_root_is(chain: rp.Task, tmp_path: Path) -> None:
    """A wall ahead of the tip, and a post over the root whose link has a name that the robot has
    too."""
    (tmp_path / "cell.urdf").write_text(CELL.format(kind="fixed"))
    task = rp.Robot.load(tmp_path / "chain.urdf", surroundings=tmp_path / "cell.urdf").task(
        "tip", "position"
    )
    bodies, alone = rp.Bodies(task), rp.Bodies(chain)
    assert bodies.standing == {"wall", "surroundings/base"}
    assert set(bodies.pairs) >= {
        *alone.pairs,
        ("tip", "wall"),
        ("b", "wall"),
        ("tip", "surroundings/base"),
    }
    straight = bodies.nearest(np.zeros(3))  # the tip's ball ends at 3.1 m, the wall begins at 3.5 m
    assert straight.links == ("tip", "wall") and straight.distance == pytest.approx(0.4, abs=1e-6)
    # folded, far from the wall: the post is nearer than the root's ball
    q = np.array([2.9, 1.9, 2.0])
    tip = abs(sum(np.exp(1j * angle) for angle in np.cumsum(q)))
    assert bodies.nearest(q).links == ("tip", "surroundings/base")
    assert np.isclose(bodies.nearest(q).distance, np.hypot(tip, 0.3) - 0.35, atol=1e-6)
    assert bodies.nearest(q).distance < alone.nearest(q).distance
    task = task.robot.task("tip", "xy")
    motion = rp.follow(rp.Pseudoinverse(task), rp.circle(task, q, 0.05), q, cycles=1, steps=20)
    assert motion.body_distance == pytest.approx(bodies.distances(motion.q))


def test_hulls_that_overlap_are_no_touch(chain: rp.Task, tmp_path: Path) -> None:
    """The tip's ball is in the hole of the root's ring, where the ring's hull is full; then on the
    ring itself."""
    trimesh.creation.torus(0.4, 0.1).export(tmp_path / "ring.stl")
    text = (tmp_path / "chain.urdf").read_text()
    ring = '<origin xyz="3 0 0"/><geometry><mesh filename="ring.stl"/></geometry>'
    text = text.replace('<origin xyz="0 0 0"/><geometry><sphere radius="0.1"/></geometry>', ring, 1)
    (tmp_path / "chain.urdf").write_text(text)
    bodies = rp.Bodies(rp.Robot.load(tmp_path / "chain.urdf").task("tip", "position"))
    touching = bodies.nearest(np.zeros(3))
    assert (touching.distance, touching.links) == (0.0, ("base", "tip"))
    assert bodies.hull_distances(np.zeros((1, 3)))[0] < -0.1
    on_it = bodies.nearest(np.array([0.4 / 3, 0.0, 0.0]))
    assert on_it.links == ("base", "tip") and on_it.distance < 0
    assert bodies.nearest(np.array([0.7 / 3, 0.0, 0.0])).distance > 0


@pytest.mark.slow
def test_few_exact_tests_decide_a_motion_near_a_mesh(
    chain: rp.Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The tip's ball moves in the hole of a ring and into it (56.1): its collisions are known."""
    ring = trimesh.creation.torus(0.4, 0.1, major_sections=128, minor_sections=64)
    ring.export(tmp_path / "ring.stl")
    text = (tmp_path / "chain.urdf").read_text()
    mesh = '<origin xyz="3 0 0"/><geometry><mesh filename="ring.stl"/></geometry>'
    text = text.replace('<origin xyz="0 0 0"/><geometry><sphere radius="0.1"/></geometry>', mesh, 1)
    (tmp_path / "chain.urdf").write_text(text)
    chain = rp.Robot.load(tmp_path / "chain.urdf").task("tip", "position")
    bodies = rp.Bodies(chain)
    Q = 0.1 * np.sin(np.linspace(0, 20, 3000)[:, None] * [1, 1.3, 1.7])
    tip = np.array([chain.placement(q).act(np.array([1.0, 0, 0])) for q in Q])
    gap = np.abs(np.linalg.norm(tip - [3, 0, 0], axis=1) - 0.4) - 0.2
    calls, collide = [0], coal.collide

    def counted(*arguments: object) -> int:
        calls[0] += 1
        return int(collide(*arguments))

    monkeypatch.setattr(coal, "collide", counted)
    hits = np.array([bodies.distances(q[None])[0] < 0 for q in Q])
    clear = np.abs(gap) > 2e-3
    assert (hits == (gap < 0))[clear].all() and hits.sum() > 300
    free = (gap > 0) & (np.linalg.norm(tip - [3, 0, 0], axis=1) < 0.4)
    assert free.sum() > 300 and calls[0] - hits.sum() < free.sum() / 2


def surrounded(tmp_path: Path, *shapes: str, at: str = "3 0 0") -> rp.Bodies:
    """The chain's bodies beside one link of some shapes."""
    collisions = "".join(f"<collision><geometry>{shape}</geometry></collision>" for shape in shapes)
    joint = '<joint name="j" type="fixed"><parent link="room"/><child link="wall"/>'
    link = f'<robot name="cell"><link name="room"/><link name="wall">{collisions}</link>'
    (tmp_path / "cell.urdf").write_text(f'{link}{joint}<origin xyz="{at}"/></joint></robot>')
    robot = rp.Robot.load(tmp_path / "chain.urdf", surroundings=tmp_path / "cell.urdf")
    return rp.Bodies(robot.task("tip", "position"))


def walls(*places: tuple[float, float]) -> trimesh.Trimesh:
    """Boxes of 0.2 m by 8 m by 2 m along x or y at places (x, 0) or (0, y), in one mesh."""
    sizes = [(0.2, 8, 2) if y == 0 else (8, 0.2, 2) for _, y in places]
    boxes = [trimesh.creation.box(size) for size in sizes]
    moved = [box.apply_translation([x, y, 0]) for box, (x, y) in zip(boxes, places, strict=True)]
    return trimesh.util.concatenate(moved)


def test_a_room_in_one_mesh_is_as_near_as_its_walls(chain: rp.Task, tmp_path: Path) -> None:
    """Its hull holds the whole arm, at every configuration; a post through the elbow is seen
    too."""
    places = ((3.5, 0.0), (-3.5, 0.0), (0.0, 3.5), (0.0, -3.5))
    walls(*places).export(tmp_path / "room.stl")
    bodies = surrounded(tmp_path, '<mesh filename="room.stl"/>', at="0 0 0")
    assert bodies.touching == () and ("tip", "wall") in bodies.pairs and bodies.notes[1:] == []
    Q = np.random.default_rng(4).uniform(-3, 3, (60, 3))
    tips = np.exp(1j * np.cumsum(Q, axis=1)).sum(axis=1)
    walls_at = 3.3 - np.maximum(abs(tips.real), abs(tips.imag))  # of the tip's ball
    nearer = np.minimum(rp.Bodies(chain).distances(Q), walls_at)
    apart = nearer > 0
    assert apart.sum() > 20
    other = (
        (bodies.distances(Q)[apart] - nearer[apart]) < 1e-6
    ).all()  # the box of b may be nearer still
    nearest = bodies.nearest(np.zeros(3))
    assert other and nearest.links == ("tip", "wall")
    assert nearest.distance == pytest.approx(0.3, abs=1e-6)
    post = trimesh.creation.cylinder(0.02, 2).apply_translation([1.5, 0, 0])
    trimesh.util.concatenate([walls(*places), post]).export(tmp_path / "room.stl")
    bodies = surrounded(tmp_path, '<mesh filename="room.stl"/>', at="0 0 0")
    through = bodies.nearest(np.zeros(3))
    assert through.distance < 0 and through.links == ("b", "wall")


@pytest.mark.parametrize("roof", [True, False])
def test_a_hollow_mesh_has_no_inside_and_a_full_one_has(
    chain: rp.Task, tmp_path: Path, roof: bool
) -> None:
    """A shell around the tip's ball: open, or a closed cavity; then the full block."""
    block = trimesh.creation.box((1, 1, 1))
    if roof:
        cavity = trimesh.creation.box((0.8, 0.8, 0.8))
        cavity.invert()
        shell = trimesh.util.concatenate([block, cavity])
    else:
        shell = trimesh.Trimesh(block.vertices, block.faces[2:], process=False)
    shell.export(tmp_path / "shell.stl")
    block.export(tmp_path / "block.stl")
    q = np.zeros(3)
    far = surrounded(tmp_path, '<mesh filename="shell.stl"/>', at="3 0 0")
    assert far.nearest(q).distance == pytest.approx(0.3 if roof else 0.4, abs=1e-6)
    assert surrounded(tmp_path, '<mesh filename="block.stl"/>', at="3 0 0").nearest(q).distance < 0
    bent = trimesh.util.concatenate([block, trimesh.creation.box((0.1, 4, 0.1))])
    bent.export(tmp_path / "bent.stl")  # its surface is not its hull's
    inside = surrounded(tmp_path, '<mesh filename="bent.stl"/>', at="3.3 0 0").nearest(q)
    assert inside.links == ("tip", "wall") and inside.distance < 0


def test_a_ball_wholly_inside_a_link_touches_it(panda_pose: rp.Task, tmp_path: Path) -> None:
    """16 mm in a link whose surface is a mesh: not in its hull only, and not on its surface."""
    trimesh.creation.torus(0.4, 0.1).export(tmp_path / "ring.stl")
    chain_with_bodies(tmp_path)
    text = (tmp_path / "chain.urdf").read_text()
    at = '<origin xyz="1 0 0"/><geometry><sphere radius="0.1"/></geometry>'  # the tip's
    text = text.replace(at, '<origin xyz="1 0 0"/><geometry><mesh filename="ring.stl"/></geometry>')
    (tmp_path / "chain.urdf").write_text(text)
    small = '<sphere radius="0.016"/>'
    within = surrounded(tmp_path, small, at="3.4 0 0").nearest(np.zeros(3))
    assert within.links == ("tip", "wall") and within.distance < 0
    assert surrounded(tmp_path, small, at="3 0 0").nearest(np.zeros(3)).distance == 0  # in the hole
    trimesh.creation.icosphere(1, 0.016).export(tmp_path / "small.stl")
    assert (
        surrounded(tmp_path, '<mesh filename="small.stl"/>', at="3.4 0 0")
        .nearest(np.zeros(3))
        .distance
        < 0
    )


def test_pairs_that_an_srdf_rules_out_are_looked_at_for_contact(panda_pose: rp.Task) -> None:
    """MoveIt's file for the panda rules out its hand and link 5, whose meshes meet where q6 is
    small."""
    bodies, q = rp.Bodies(panda_pose), np.array(panda_pose.reference)
    assert bodies.disabled == () and ("panda_link5", "panda_hand") in bodies.only_contact
    assert bodies.nearest(q).distance > 0.1  # though links 5 and 7 are 2 cm apart
    q[5:] = 0.2, 0.0
    assert bodies.nearest(q).distance < 0 and "panda_link5" in bodies.nearest(q).links


@pytest.mark.parametrize(
    ("name", "count"), [("panda", 15), pytest.param("talos", 8, marks=pytest.mark.slow)]
)
def test_no_contact_of_the_meshes_is_missed(name: str, count: int) -> None:
    """Between any two bodies but those that are named as left out."""
    task = rp.Robot.load(name).task()
    bodies = rp.Bodies(task)
    Q = np.random.default_rng(7).uniform(task.lower, task.upper, (150, task.n))
    looked_at = {frozenset(pair) for pair in (*bodies.pairs, *bodies.only_contact)}
    touch = np.isneginf(full_mesh_distances(task, looked_at, Q, only_contact=True))
    assert touch.sum() >= count
    assert (touch == (bodies.distances(Q) < 0)).all()
    named = looked_at | {
        frozenset(pair) for pair in (*bodies.adjacent, *bodies.disabled, *bodies.touching)
    }
    links = {link for pair in named for link in pair}
    moved = [frozenset((a, b)) for a in bodies._model.links for b in bodies._model.links if a < b]
    carried = dict(zip(bodies._model.links, bodies._model._joint, strict=True))
    assert links and all(
        pair in named for pair in moved if len({carried[link] for link in pair}) == 2
    )


def test_baxters_padded_neighbours_are_counted_and_left_out() -> None:
    """Shapes that overlap in ordinary poses and are ruled out by the SRDF; a note counts them."""
    task = rp.Robot.load("baxter").task()
    bodies = rp.Bodies(task)
    assert ("left_upper_shoulder", "left_upper_elbow") in bodies.disabled
    assert bodies.notes[0].startswith(f"{len(bodies.disabled)} pairs of links overlap and are not")
    assert ("torso", "left_upper_forearm_visual") in bodies.only_contact


def test_no_shape_is_dropped_however_many_there_are(chain: rp.Task, tmp_path: Path) -> None:
    """1,500 boxes far away, then one on the tip's ball."""
    far = [
        f'<collision><origin xyz="0 {20 + k} 0"/><geometry><box size="1 1 1"/></geometry>'
        f"</collision>"
        for k in range(1500)
    ]
    near = '<collision><origin xyz="3 0 0"/><geometry><box size="1 1 1"/></geometry></collision>'
    text = f'<robot name="cell"><link name="wall">{"".join(far)}{near}</link></robot>'
    (tmp_path / "cell.urdf").write_text(text)
    robot = rp.Robot.load(tmp_path / "chain.urdf", surroundings=tmp_path / "cell.urdf")
    bodies = rp.Bodies(robot.task("tip", "position"))
    assert bodies.nearest(np.zeros(3)).distance < -0.1
    assert any(
        "the surroundings have 1501 shapes: all are measured" in note for note in bodies.notes
    )
    own = (
        (tmp_path / "chain.urdf")
        .read_text()
        .replace('<link name="tip">', f'<link name="tip">{"".join(far)}')
    )
    (tmp_path / "chain.urdf").write_text(own)
    assert len(rp.Robot.load(tmp_path / "chain.urdf").description.collisions) == 1504


UNUSABLE = {
    "malformed": ('<mesh filename="torn.dae"/>', "'torn.dae' cannot be read"),
    "torn": (
        '<mesh filename="torn.stl"/>',
        "'torn.stl' (contains no readable triangles|cannot be read)",
    ),
    "no triangles": (
        '<mesh filename="empty.obj"/>',
        "'empty.obj' (contains no readable triangles|cannot be read)",
    ),
    "huge": (
        '<mesh filename="ball.stl" scale="1e9 1e9 1e9"/>',
        "'ball.stl' is 2e\\+09 m large.*correct its scale",
    ),
    "no size": ('<mesh filename="ball.stl" scale="0 0 0"/>', "'ball.stl' has size 0"),
    "a point": ('<sphere radius="0"/>', "the sphere 'wall_0' has size 0"),
    "a line": ('<box size="1 0 0"/>', "the box 'wall_0' has size 0"),
    "a large box": ('<box size="1e9 1 1"/>', "the box 'wall_0' is 1e\\+09 m large"),
    "lost": ('<mesh filename="no.stl"/>', "'no.stl' is missing"),
}


@pytest.mark.parametrize("case", UNUSABLE)
def test_shapes_that_cannot_be_measured_are_said_to_be_what_they_are(
    chain: rp.Task, tmp_path: Path, case: str
) -> None:
    """Surroundings are refused; the robot's own are in its notes."""
    shape, why = UNUSABLE[case]
    (tmp_path / "torn.stl").write_bytes(b"\x00" * 80 + b"\xff\xff\xff\x7f" + b"\x01" * 30)
    (tmp_path / "torn.dae").write_text("<COLLADA")
    (tmp_path / "empty.obj").write_text("v 0 0 0\n")
    trimesh.creation.icosphere(2, 1.0).export(tmp_path / "ball.stl")
    with pytest.raises(rp.InputError, match=why) as error:
        surrounded(tmp_path, shape)
    assert "\n" not in str(error.value) and "link 'wall'" in str(error.value)
    text = (tmp_path / "chain.urdf").read_text().replace('<mesh filename="lost.stl"/>', shape)
    (tmp_path / "chain.urdf").write_text(text)
    own = rp.Bodies(rp.Robot.load(tmp_path / "chain.urdf").task("tip", "position"))
    assert (
        re.search(why.replace("wall_0", "a_0"), own.notes[0])
        and "collisions of a are not detected" in own.notes[0]
    )


def test_a_collada_mesh_has_its_unit(chain: rp.Task, tmp_path: Path) -> None:
    """A cube of 1,000 mm is as near as a cube of 1 m; drawn meshes have the unit, too."""
    written = trimesh.creation.box((1000, 1000, 1000)).export(file_type="dae").decode()
    millimetres = '<asset><unit name="millimeter" meter="0.001"/>'
    text = re.sub(r"<asset>(\s*<unit[^>]*/>)?", millimetres, written, count=1)
    (tmp_path / "cube.dae").write_text(text)
    cubes = [
        surrounded(tmp_path, shape, at="3.9 0 0").nearest(np.zeros(3)).distance
        for shape in ('<mesh filename="cube.dae"/>', '<box size="1 1 1"/>')
    ]
    assert cubes[0] == pytest.approx(cubes[1], abs=1e-6) and cubes[1] > 0.1


def test_a_flat_box_is_a_plate(chain: rp.Task, tmp_path: Path) -> None:
    bodies = surrounded(tmp_path, '<box size="0 1 1"/>', at="3.4 0 0")
    assert bodies.nearest(np.zeros(3)).distance == pytest.approx(0.3, abs=1e-6)


def test_bodies_of_the_same_joints_are_made_once(chain: rp.Task, tmp_path: Path) -> None:
    """Whatever task asks for them; a mesh that changes, or other joints, make others."""
    mesh = tmp_path / "lost.stl"  # the chain's own
    trimesh.creation.box((0.1, 0.1, 0.1)).export(mesh)

    def load(**given):
        robot = rp.Robot.load(tmp_path / "chain.urdf", **given)
        return robot.task("tip", "position")

    with ThreadPoolExecutor(8) as pool:
        everyone = list(pool.map(lambda _: rp.Bodies(load()), range(16)))
    first = everyone[0].pairs
    assert first and all(b.pairs is first for b in everyone)
    other = rp.Robot.load(tmp_path / "chain.urdf").task("b", "xy")
    for task in (load(lock=["j0"]), other):
        assert rp.Bodies(task).pairs is not first
    assert rp.Bodies(load()).pairs is first
    trimesh.creation.box((0.1, 0.1, 5)).export(mesh)
    assert rp.Bodies(load()).pairs is not first


def test_distances_do_not_depend_on_earlier_ones(panda_pose: rp.Task) -> None:
    """The search for a distance began where the last one of the same pair had ended, so results
    differed by up to 1e-6 m, and a whole table by which tables had been made before it."""
    bodies = rp.Bodies(panda_pose)
    rng = np.random.default_rng(4)
    Q = panda_pose.reference + rng.uniform(-0.6, 0.6, (64, 7))
    before = bodies.hull_distances(Q), bodies.distances(Q)
    bodies.distances(rng.uniform(panda_pose.lower, panda_pose.upper, (64, 7)))
    assert np.array_equal(bodies.hull_distances(Q[::-1])[::-1], before[0])
    assert np.array_equal(bodies.distances(Q[::-1])[::-1], before[1])


@pytest.mark.parametrize("name", some(["panda", "tiago"], "panda"))
def test_the_test_for_near_bodies_agrees_with_their_distances(name: str) -> None:
    """At distances of 0 and more; the test ends before the distance is known."""
    task = rp.Robot.load(name).task(None, "pose")
    bodies = rp.Bodies(task)
    rng = np.random.default_rng(5)
    Q = np.clip(task.reference + rng.uniform(-1, 1, (128, task.n)), task.lower, task.upper)
    distances = bodies.distances(Q)
    for least in (0.002, 0.0, 0.05, np.median(distances) + 1e-5):
        assert np.array_equal(bodies._nearer(Q, least), distances < least)


def test_threads_may_share_bodies(panda_pose: rp.Task) -> None:
    bodies = rp.Bodies(panda_pose)
    Q = np.random.default_rng(8).uniform(panda_pose.lower, panda_pose.upper, (300, 7))
    alone = bodies.distances(Q)
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(8) as pool:
            together = list(pool.map(lambda _: bodies.distances(Q), range(8)))
    finally:
        sys.setswitchinterval(before)
    assert all(np.allclose(found, alone, rtol=0, atol=1e-6) for found in together)
    again = pickle.loads(pickle.dumps(bodies))
    assert np.allclose(again.distances(Q), alone, rtol=0, atol=1e-6)


def test_a_flat_mesh_is_a_thin_body(chain: rp.Task, tmp_path: Path) -> None:
    """A square of no thickness 0.6 m before the tip's ball: a hull without volume crashes the
    distance library."""
    corners = [[0, -0.5, -0.5], [0, 0.5, -0.5], [0, 0.5, 0.5], [0, -0.5, 0.5]]
    trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]]).export(tmp_path / "flat.stl")
    sign = CELL.format(kind="fixed").replace('<box size="0.2 4 4"/>', '<mesh filename="flat.stl"/>')
    (tmp_path / "cell.urdf").write_text(sign)
    bodies = rp.Bodies(
        rp.Robot.load(tmp_path / "chain.urdf", surroundings=tmp_path / "cell.urdf").task(
            "tip", "position"
        )
    )
    assert bodies.nearest(np.zeros(3)).links == ("tip", "wall")
    assert bodies.nearest(np.zeros(3)).distance == pytest.approx(0.5, abs=2e-4)


def test_hulls_are_read_from_the_cache_and_never_from_a_broken_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def distance(name: str, *, radius: float = 0.2) -> float:
        folder = tmp_path / name
        folder.mkdir()
        trimesh.creation.cone(radius, 0.3).export(folder / "lost.stl")
        task = rp.Robot.load(chain_with_bodies(folder)).task("tip", "position")
        return rp.Bodies(task).nearest(np.array([0.3, 0.5, 2.9])).distance

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    first = distance("first")
    (kept,) = (tmp_path / "cache" / "repctl_pin" / "meshes").iterdir()
    script = (
        "import sys; import numpy as np; import repctl_pin as rp\n"
        "task = rp.Robot.load('first/chain.urdf').task('tip', 'position')\n"
        "d = rp.Bodies(task).nearest(np.array([0.3, 0.5, 2.9])).distance\n"
        "print(repr(float(d)), 'trimesh' in sys.modules)"
    )
    run = [sys.executable, "-c", script]
    said = subprocess.run(run, cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    assert said.split() == [repr(first), "False"]
    whole = kept.read_bytes()
    for k, damaged in enumerate((b"", whole[: len(whole) // 2], whole[:300] + bytes(1200))):
        kept.write_bytes(damaged)
        assert distance(f"damaged {k}") == first and kept.read_bytes() == whole
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null")
    assert distance("no cache") == first
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # the specification has it ignored
    assert distance("at home") == first and not (tmp_path / "relative").exists()
    assert (tmp_path / "home" / ".cache" / "repctl_pin" / "meshes" / kept.name).exists()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert distance("another mesh", radius=0.25) == pytest.approx(first - 0.05, abs=0.01)


def test_a_mesh_that_is_replaced_while_it_is_read_is_not_cached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else its arrays would be taken for those of the old content."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    mesh = tmp_path / "link.stl"
    mesh.write_text("old")

    def replaced() -> dict[str, np.ndarray]:
        (tmp_path / "draft").write_text("new")
        (tmp_path / "draft").replace(mesh)
        return {"x": np.array([2.0])}

    assert mesh_cache.cached(mesh, "", replaced)["x"] == 2.0
    mesh.write_text("old")
    assert mesh_cache.cached(mesh, "", lambda: {"x": np.array([1.0])})["x"] == 1.0


def test_the_cache_of_meshes_keeps_the_files_that_were_used_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(mesh_cache, "_LARGEST_CACHE", 2500)
    mesh, read = tmp_path / "link.stl", []
    mesh.write_text("solid")
    folder = tmp_path / "cache" / "repctl_pin" / "meshes"

    def use(variant: str) -> None:
        def make() -> dict[str, np.ndarray]:
            read.append(variant)
            return {"x": np.zeros(90)}  # a file of some 1 kB

        mesh_cache.cached(mesh, variant, make)
        for file in folder.iterdir():  # the clock of files can be coarse
            then = file.stat().st_mtime_ns - 10**9
            os.utime(file, ns=(then, then))

    for variant in "abacab":  # c takes the place of b
        use(variant)
    assert read == ["a", "b", "c", "b"]
    assert len(list(folder.iterdir())) == 2


def test_a_hull_with_a_corner_of_many_neighbours_is_made_coarser(
    chain: rp.Task, tmp_path: Path
) -> None:
    """A cone of 400 sides, whose tip has more neighbours than the distance library takes: never
    farther than it is, and at most 2 mm nearer."""
    trimesh.creation.cone(0.1, 0.3, sections=400).export(tmp_path / "cone.stl")
    file, end = tmp_path / "chain.urdf", '<origin xyz="1 0 0"/><geometry>'
    text = file.read_text().replace(
        f'{end}<sphere radius="0.1"/>', f'{end}<mesh filename="cone.stl"/>'
    )
    file.write_text(text)
    for far in (0.5, 0.3, 0.17):  # in a direction in which a box would be nearer
        at = f"{3 + far / np.sqrt(2)} {far / np.sqrt(2)} 0"
        bodies = surrounded(tmp_path, '<sphere radius="0.05"/>', at=at)
        found = bodies.nearest(np.zeros(3))
        assert found.links == ("tip", "wall")
        assert far - 0.15 - 2e-3 < found.distance <= far - 0.15 + 1e-5


BAD_CELLS = {
    "moves": (
        CELL.format(kind="continuous"),
        "line 4: joint 'there' moves, but surroundings must be rigid",
    ),
    "empty": ('<robot name="cell"><link name="room"/></robot>', "have no <collision>"),
    "torn": (CELL[:200], "cell.urdf"),
    "mesh": (
        CELL.format(kind="fixed").replace('<sphere radius="0.25"/>', '<mesh filename="no.stl"/>'),
        "'no.stl'",
    ),
}


@pytest.mark.parametrize("case", BAD_CELLS)
def test_surroundings_that_cannot_be_used_are_refused(
    chain: rp.Task, tmp_path: Path, case: str
) -> None:
    text, why = BAD_CELLS[case]
    (tmp_path / "cell.urdf").write_text(text)
    with pytest.raises(rp.InputError, match=why) as error:
        rp.Bodies(
            rp.Robot.load(tmp_path / "chain.urdf", surroundings=tmp_path / "cell.urdf").task(
                "tip", "position"
            )
        )
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("name", "count"), [("panda", 20), ("tiago", 4), ("spatial", 20)])
def test_balls_and_boxes_bound_every_pair_from_below(name: str, count: int, tmp_path: Path) -> None:
    """Also on arms with prismatic joints, of any direction."""
    task = rp.Robot.load(spatial_with_balls(tmp_path) if name == "spatial" else name).task()
    bodies = rp.Bodies(task)
    model = bodies._model
    Q = np.random.default_rng(1).uniform(task.lower, task.upper, (count, task.n))
    whole = bodies._drive.joints(Q) if bodies._drive is not None else Q
    tight = []
    for q, all_joints, bounds in zip(Q, whole, model._bounds(whole), strict=True):
        model._move(all_joints)
        exact = np.array([model._exact(k) for k in range(len(bounds))])
        assert (bounds <= exact + 1e-9).all()
        apart = np.isfinite(exact) & (exact > 0.1)
        tight.append((bounds[apart] / exact[apart]).mean())
        assert bodies.nearest(q).distance == pytest.approx(exact.min(), abs=1e-5)
    assert np.mean(tight) > 0.5


TWO_BOXES = """<robot name="boxes">
<link name="base"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
<link name="post"/><link name="arm"><collision><origin xyz="0.2 0.03 0"/><geometry>
<box size="0.4 0.02 0.02"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="post"/><axis xyz="0 0 1"/>
<origin xyz="0.1 0 0"/><limit lower="-3" upper="3" velocity="2" effort="1"/></joint>
<joint name="lift" type="revolute"><parent link="post"/><child link="arm"/><axis xyz="0 1 0"/>
<origin xyz="0 0.03 1"/><limit lower="-3" upper="3" velocity="2" effort="1"/></joint></robot>"""


def test_a_joint_moves_a_body_by_the_distance_of_its_corners_from_the_axis(tmp_path: Path) -> None:
    (tmp_path / "boxes.urdf").write_text(TWO_BOXES)
    model = rp.Bodies(rp.Robot.load(tmp_path / "boxes.urdf").task("arm", "position"))._model
    corner = np.array([0.4, 0.04, 0.01])
    rates = [np.linalg.norm(corner) + 0.03, np.hypot(0.4, 0.01)]  # the post is 1 m long
    np.testing.assert_allclose(model.reach(), [rates], rtol=1e-12)


def test_a_slide_moves_a_body_by_its_own_motion(tmp_path: Path) -> None:
    text = TWO_BOXES.replace('"lift" type="revolute"', '"lift" type="prismatic"')
    (tmp_path / "boxes.urdf").write_text(text)
    model = rp.Bodies(rp.Robot.load(tmp_path / "boxes.urdf").task("arm", "position"))._model
    assert model.reach()[:, 1].tolist() == [1.0]


def test_a_pair_that_moves_little_is_measured_until_its_credit_is_spent(chain: rp.Task) -> None:
    """5 cm since the last test is little. Eight measurements in a row that save no test are the
    last; each saved test allows one more."""
    still, q = np.full(2, np.inf), np.array([2.0, -1.0])
    known = type(rp.Bodies(chain)._model._known)(np.array([[1.0, 0.5]]), still)
    assert not known.pays(0, q)
    assert not known.pays(0, q + [0.04, 0.03])
    assert [known.pays(0, q + [0.0, 0.03]) for _ in range(10)] == [True] * 8 + [False] * 2
    known.note(0, q, 0.1)
    assert known.knows(0, q + [0.05, 0.05]) and not known.knows(0, q + [0.1, 0.05])
    assert [known.pays(0, q + [0.0, 0.03]) for _ in range(2)] == [True, False]


def test_no_distance_is_stored_where_a_slide_is_beyond_its_strokes(chain: rp.Task) -> None:
    """The bounds on the rates of a pair do not hold there."""
    known = type(rp.Bodies(chain)._model._known)(np.ones((1, 2)), np.array([np.inf, 0.2]))
    known.note(0, np.array([0.0, 0.3]), 9.0)
    assert not known.knows(0, np.array([0.0, 0.1]))
    known.note(0, np.array([0.0, 0.1]), 9.0)
    assert known.knows(0, np.array([0.0, 0.15])) and not known.knows(0, np.array([0.0, 0.3]))


def spatial_with_balls(folder: Path) -> str:
    """Write an arm of revolute and prismatic joints of any direction; return its file."""
    ball = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'
    text = re.sub(r'(name="link\d")/>', rf"\1>{ball}</link>", spatial_urdf(7, 3))
    (folder / "spatial.urdf").write_text(text, encoding="utf-8")
    return str(folder / "spatial.urdf")


@pytest.mark.parametrize("name", ["panda", "tiago", "spatial"])
def test_no_joint_moves_a_corner_faster_than_its_bound(name: str, tmp_path: Path) -> None:
    """Of the two bodies of a pair, one moves in the frame of the other, by a small step."""
    task = rp.Robot.load(spatial_with_balls(tmp_path) if name == "spatial" else name).task()
    bodies, step = rp.Bodies(task), 1e-6
    model = bodies._model
    reach, corners = model.reach(), [body_points(body.hull) for body in model._bodies]
    Q = np.random.default_rng(5).uniform(task.lower, task.upper, (3, task.n))
    largest = np.zeros_like(reach)
    for q in bodies._drive.joints(Q):
        here = placed(model, q)
        for j in range(reach.shape[1]):
            there = placed(model, q + step * np.eye(len(q))[j])
            for k in np.flatnonzero(reach[:, j]):
                ways = [
                    np.linalg.norm(
                        (
                            there[a].actInv(there[b]).homogeneous
                            - here[a].actInv(here[b]).homogeneous
                        )
                        @ corners[b].T,
                        axis=0,
                    ).max()
                    for a, b in (model.pairs[k], model.pairs[k, ::-1])
                ]
                largest[k, j] = max(largest[k, j], min(ways) / step)
    assert (largest <= reach + 1e-6).all()
    moved = reach > 0
    assert np.median(largest[moved] / reach[moved]) > 0.5


def body_points(hull: coal.CollisionGeometry) -> np.ndarray:
    """The corners of a mesh's hull, or points of another body: (M, 4), homogeneous."""
    points = np.zeros((1, 3))
    if isinstance(hull, coal.Convex):
        points = np.array(hull.points())
    elif isinstance(hull, coal.Sphere):
        points = hull.radius * np.eye(3)
    return np.column_stack([points, np.ones(len(points))])


def placed(model: Any, q: np.ndarray) -> list[pin.SE3]:
    """The placements of the robot's bodies at q."""
    model._move(q)
    return [pin.SE3(place) for place in model._placed.oMg]


def full_mesh_distances(
    task: rp.Task, pairs: set[frozenset[str]], Q: np.ndarray, *, only_contact: bool = False
) -> np.ndarray:
    """The same pairs on the meshes as the files hold them, by Pinocchio's own reader; or −inf for
    contact, else inf."""
    robot = task.robot
    model = pin.buildModelFromXML(robot.description.xml)
    names = [model.names[i] for i in range(1, model.njoints)]
    shapes = pin.buildGeomFromUrdf(
        model, str(robot.description.path), pin.COLLISION, None, list(robot.package_dirs)
    )
    link = [model.frames[body.parentFrame].name for body in shapes.geometryObjects]
    for b in range(shapes.ngeoms):
        for a in range(b):
            if frozenset((link[a], link[b])) in pairs:
                shapes.addCollisionPair(pin.CollisionPair(a, b))
    data, placed, found = model.createData(), pin.GeometryData(shapes), []
    place = {name: i for i, name in enumerate(robot.model.names[1:])}
    for q in robot.coupling.joints(task.to_robot(Q)):
        whole = pin.neutral(model)
        for i, name in enumerate(names):
            if name in place:
                whole[i] = q[place[name]]
        if only_contact:
            touch = pin.computeCollisions(model, data, shapes, placed, whole, True)
            found.append(-np.inf if touch else np.inf)
            continue
        pin.computeDistances(model, data, shapes, placed, whole)
        found.append(min(result.min_distance for result in placed.distanceResults))
    return np.array(found)


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("panda", 30),
        *[
            pytest.param(name, 1000, marks=pytest.mark.slow)
            for name in ("panda", "baxter", "talos")
        ],
    ],
)
def test_never_above_the_meshes(name: str, count: int) -> None:
    """And, on bodies as round as these, at most 2 cm below them where they are apart."""
    task = rp.Robot.load(name).task()
    bodies = rp.Bodies(task)
    Q = np.random.default_rng(3).uniform(task.lower, task.upper, (count, task.n))
    ours = bodies.distances(Q)
    meshes = full_mesh_distances(task, set(map(frozenset, bodies.pairs)), Q)
    contact = full_mesh_distances(
        task, set(map(frozenset, bodies.only_contact)), Q, only_contact=True
    )
    meshes = np.where(np.isneginf(contact), np.minimum(meshes, 0), meshes)
    apart = ours > 0
    assert apart.sum() > count // 10
    assert (ours[apart] - meshes[apart]).max() < 1e-6
    assert (meshes[ours < 0] < 1e-6).all() and (
        meshes[ours == 0] > 0
    ).all()  # it touches where the meshes do
    if name == "panda":
        assert (meshes[apart] - ours[apart]).max() < 0.02


@pytest.mark.slow
def test_the_pandas_elbow_comes_near_its_body_under_the_pseudoinverse(
    panda_pose: rp.Task, panda_design: rp.Design, q_panda: np.ndarray
) -> None:
    """From 0.117 m in cycle 1 to contact within ten; the repeatable inverse keeps the first cycle's
    distance."""
    path = rp.circle(panda_pose, q_panda, radius=0.1, normal="z")
    motion = rp.follow(rp.Pseudoinverse(panda_pose), path, q_panda, cycles=10, steps=100)
    assert motion.body_distance[:101].min() == pytest.approx(0.1175, abs=5e-4)
    assert motion.body_distance[:651].min() > 0.03 and motion.first_touch is not None
    when, nearest = motion.nearest_bodies
    assert (
        when > 8
        and nearest.distance < 0
        and nearest.distance == pytest.approx(motion.body_distance.min())
        and "panda_link5" in nearest.links
    )
    ours = rp.follow(panda_design.inverse, path, q_panda, cycles=10, steps=100).body_distance
    assert ours.min() == pytest.approx(0.1192, abs=5e-4) and ours.min() == pytest.approx(
        ours[:101].min(), abs=1e-6
    )


def test_an_arm_without_bodies() -> None:
    bodies = rp.Bodies(rp.Robot.load("planar3r").task())
    assert bodies.pairs == () and bodies.nearest(np.zeros(3)).distance == np.inf
    assert bodies._pair_bounds(np.zeros((2, 3))).shape == (2, 0)


def test_a_pair_is_moved_by_either_of_two_coupled_joints(chain: rp.Task, tmp_path: Path) -> None:
    """The last joint repeats the first one; only the first one moves b."""
    text = (tmp_path / "chain.urdf").read_text()
    at = text.index('name="j2"')
    text = text[:at] + text[at:].replace("</joint>", '<mimic joint="j0"/></joint>', 1)
    (tmp_path / "coupled.urdf").write_text(text)
    bodies = rp.Bodies(rp.Robot.load(tmp_path / "coupled.urdf").task("tip", "xy"))
    assert set(bodies.pairs) == {("base", "b"), ("base", "tip")}
    assert bodies._moved_by(0).tolist() == [True, True]


def test_bodies_are_described_in_words(chain: rp.Task, tmp_path: Path) -> None:
    """How many pairs are checked, and what is not; of several meshes, the first is named."""
    bodies = rp.Bodies(chain)
    counts = "2 pairs measured, 0 for collisions only; not checked: 1 adjacent"
    assert repr(bodies) == f"<Bodies of chain: {counts}, 0 disabled by the SRDF, 0 overlapping>"
    assert bodies.not_checked.startswith("1 body without a collision shape")
    assert "more like it" not in bodies.notes[0]
    text = (tmp_path / "chain.urdf").read_text()
    (tmp_path / "two.urdf").write_text(
        text.replace('<sphere radius="0.1"/>', LOST.replace("lost", "gone"), 1)
    )
    two = rp.Bodies(rp.Robot.load(tmp_path / "two.urdf").task("tip", "position"))
    assert two.notes[0].endswith(" (and 1 more like it)")
    assert two.not_checked.startswith("2 bodies without")
    (tmp_path / "all.urdf").write_text(text.replace(LOST, '<sphere radius="0.1"/>'))
    whole = rp.Bodies(rp.Robot.load(tmp_path / "all.urdf").task("tip", "position"))
    assert whole.not_checked == "" and whole.notes == []
    whole.touching = (("a", "b"),) * 3
    whole.disabled = (("a", "b"),)
    assert whole.notes == [
        "a and b, a and b, a and b overlap at every sampled configuration; they are not checked",
        "1 pair of links overlaps and is not checked: the SRDF disables it",
    ]
    whole.touching = (("a", "b"),) * 4
    assert whole.notes[0].startswith("a and b, a and b, a and b and 1 more pair overlap")


LOST = '<mesh filename="lost.stl"/>'


TWO_SHAPES = """<robot name="capsules"><link name="l0">{body}</link>
<link name="l1">{body}</link><link name="l2">{body}</link><link name="l3">{body}</link>
<link name="l4"/>
{joints}</robot>"""

CAPSULE = """<collision><geometry><cylinder radius="0.09" length="0.2"/></geometry></collision>
<collision><origin xyz="0 0 0.1"/><geometry><sphere radius="0.09"/></geometry></collision>
<collision><origin xyz="0 0 -0.1"/><geometry><sphere radius="0.09"/></geometry></collision>"""


def test_pairs_of_links_are_in_one_list(tmp_path: Path) -> None:
    """Issue 52, item 26.6: links of several shapes, some of which overlap by construction."""
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="{x} 0 0.05"/><axis xyz="{axis}"/>'
        '<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>'
        for k, (x, axis) in enumerate([(0, "0 0 1"), (0, "0 1 0"), (0.3, "0 0 1"), (0.3, "0 1 0")])
    )
    (tmp_path / "capsules.urdf").write_text(TWO_SHAPES.format(body=CAPSULE, joints=joints))
    task = rp.Robot.load(tmp_path / "capsules.urdf").task("l4", "position")
    bodies = rp.Bodies(task)
    kinds = [bodies.pairs, bodies.only_contact, bodies.adjacent, bodies.disabled, bodies.touching]
    listed = [frozenset(pair) for kind in kinds for pair in kind]
    assert len(listed) == len(set(listed)) == 6
    assert ("l0", "l2") in bodies.touching
    # l0 and l2 overlap from the start, so that no distance is theirs
    assert not {"l0", "l2"} >= {*bodies.nearest(task.reference).links}


def test_a_shape_of_the_surroundings_that_overlaps_hides_no_other(tmp_path: Path) -> None:
    """Issue 52, item 26.6: a link of the surroundings holds the pedestal and a post."""
    scene = """<robot name="scene"><link name="scene">
    <collision><geometry><sphere radius="0.3"/></geometry></collision>
    <collision><origin xyz="2.5 0 0"/><geometry><sphere radius="0.1"/></geometry></collision>
    </link></robot>"""
    (tmp_path / "scene.urdf").write_text(scene)
    arm = chain_with_bodies(tmp_path)
    text = arm.read_text()
    at = text.index('<link name="a"')
    end = text.index(">", at)
    ball = "<collision><geometry><sphere radius='0.2'/></geometry></collision>"
    link = f'<link name="a">{ball}' + ("</link>" if text[end - 1] == "/" else "")
    arm.write_text(text[:at] + link + text[end + 1 :])
    task = rp.Robot.load(arm, surroundings=tmp_path / "scene.urdf").task("tip", "position")
    bodies = rp.Bodies(task)
    assert ("a", "scene_0 of scene") in bodies.touching and ("a", "scene") in bodies.pairs
    assert any("scene_0 of scene overlap" in note for note in bodies.notes)


def test_a_task_is_freed_with_the_bodies_that_its_motions_share() -> None:
    """56.8: a survey of a hundred studies kept every robot that it loaded."""
    few = rp.FitOptions(samples=64, held_out=64)
    study = rp.study("planar3r", cycles=1, steps=40, degree=1, options=few)
    assert study.rows[0].motion.clearance.distance > 0
    kept = weakref.ref(study.task)
    del study
    gc.collect()
    assert kept() is None
