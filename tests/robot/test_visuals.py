"""What a robot looks like: against Pinocchio's own geometry, and against the kinematics."""

from __future__ import annotations

import os
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from controls import some
from page_file import Visuals

import repctl_pin as rp


def configurations(robot: rp.Robot, count: int = 4) -> np.ndarray:
    """Some configurations inside the limits, near the reference pose."""
    rng = np.random.default_rng(1)
    low, high = (
        np.clip(limit, robot.reference - 1, robot.reference + 1)
        for limit in (robot.lower, robot.upper)
    )
    return rng.uniform(low, high, (count, len(robot.joint_names)))


@cache
def loaded(name: str) -> tuple[rp.Robot, pin.Model, pin.GeometryModel]:
    """A robot, and what Pinocchio makes of it: reading the meshes is dear."""
    robot = rp.Robot.load(name)
    return robot, *pinocchios(robot)


def pinocchios(robot: rp.Robot) -> tuple[pin.Model, pin.GeometryModel]:
    """Pinocchio's own model and visual geometry, the same joints locked."""
    model = pin.buildModelFromXML(robot.description.xml)
    kind = pin.GeometryType.VISUAL
    file, folders = str(robot.description.path), list(robot.package_dirs)
    geometry = pin.buildGeomFromUrdf(model, file, kind, package_dirs=folders)
    assert not robot.locked
    return model, geometry


def all_joints(robot: rp.Robot, model: pin.Model, q: np.ndarray) -> np.ndarray:
    """Put the robot's joints, and those that mimic them, into Pinocchio's order."""
    values = dict(zip(robot.joint_names, q, strict=True))
    for joint in robot.description.joints:
        if joint.mimic is not None:
            values[joint.name] = joint.multiplier * values[joint.mimic] + joint.offset
    return np.array([values[name] for name in tuple(model.names)[1:]])


@pytest.mark.parametrize("name", some(["panda", "talos", "ppr", "kinova"], "panda", "ppr"))
def test_placements_are_pinocchios(name: str) -> None:
    robot, model, geometry = loaded(name)
    visuals = Visuals.of(robot)
    assert {s.name for s in visuals.shapes} == {g.name for g in geometry.geometryObjects}
    Q = configurations(robot)
    placements = visuals.placements(Q)
    assert placements.shape == (len(Q), len(visuals.shapes), 4, 4)
    data, geometry_data = model.createData(), geometry.createData()
    for q, placed in zip(Q, placements, strict=True):
        pin.updateGeometryPlacements(
            model, data, geometry, geometry_data, all_joints(robot, model, q)
        )
        for shape, M in zip(visuals.shapes, placed, strict=True):
            k = geometry.getGeometryId(shape.name)
            np.testing.assert_allclose(
                M, geometry_data.oMg[k].homogeneous, atol=1e-12, err_msg=shape.name
            )


@pytest.mark.parametrize("name", some(["panda", "talos", "tiago", "ppr"], "panda", "ppr"))
def test_links_beyond_joints_at_rest_are_placed_as_one_configuration_is(name: str) -> None:
    """One row alone has no joint that changes, and all rows together have some."""
    robot = rp.Robot.load(name)
    visuals = Visuals.of(robot)
    for at_rest in (slice(None, None, 2), slice(1, None, 2), slice(3), slice(3, None)):
        Q = configurations(robot)
        Q[:, at_rest] = Q[0, at_rest]
        alone = [visuals.placements(q[None])[0] for q in Q]
        np.testing.assert_allclose(visuals.placements(Q), alone, rtol=0, atol=1e-14)
    assert visuals.placements(Q[:0]).shape == (0, len(visuals.shapes), 4, 4)


@pytest.mark.parametrize("name", some(["panda", "talos", "kinova", "baxter"], "panda", "kinova"))
def test_scales_and_colours_are_pinocchios(name: str) -> None:
    robot, _, geometry = loaded(name)
    mirrored = 0
    for shape in Visuals.of(robot).shapes:
        theirs = geometry.geometryObjects[geometry.getGeometryId(shape.name)]
        if shape.kind == "mesh":
            np.testing.assert_allclose(shape.scale, theirs.meshScale, err_msg=shape.name)
            assert shape.path is not None
            assert shape.path == Path(theirs.meshPath).resolve()
            mirrored += np.prod(shape.scale) < 0
        if theirs.overrideMaterial:
            np.testing.assert_allclose(shape.color, theirs.meshColor, atol=1e-6, err_msg=shape.name)
        elif shape.kind == "mesh" and shape.path is not None:
            assert (shape.color is None) == (shape.path.suffix.lower() != ".stl")
    assert (mirrored > 0) == (name == "talos")


def test_placements_are_rigid_where_meshes_are_mirrored() -> None:
    robot = rp.Robot.load("talos")
    R = Visuals.of(robot).placements(configurations(robot))[..., :3, :3]
    np.testing.assert_allclose(
        R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-12)


ARM = """<robot name="arm">
  <link name="base"><visual><geometry>{base}</geometry></visual></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="upper"/>
<origin xyz="0 0 0.4"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <link name="upper"><visual><origin xyz="0 0 0.1" rpy="0.1 0.2 0.3"/>
<geometry>{upper}</geometry>{material}
    </visual></link>
  <joint name="slide" type="prismatic"><parent link="upper"/><child link="rod"/>
<origin xyz="0.3 0 0.1" rpy="0 0.5 0"/>
    <axis xyz="1 0 0"/><limit lower="-0.1" upper="0.5" velocity="1" effort="1"/></joint>
  <link name="rod"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
  <joint name="end" type="fixed"><parent link="rod"/><child link="tool"/><origin xyz="0 0.2 0"/>
</joint>
  <link name="tool"/>
</robot>"""
BOX, BALL = '<box size="0.1 0.2 0.3"/>', '<sphere radius="0.05"/>'


def arm(
    folder: Path,
    base: str = BOX,
    upper: str = BALL,
    material: str = "",
    text: str = ARM,
    **options: Any,
) -> rp.Robot:
    """Load a small arm: a turning link, a sliding one, a tool."""
    file = folder / "arm.urdf"
    file.write_text(text.format(base=base, upper=upper, material=material))
    return rp.Robot.load(file, **options)


def ends(shape: Any, M: np.ndarray) -> np.ndarray:
    """The two end points (2, 3) of a tube or a cylinder."""
    half = np.array([0, 0, shape.size[1] / 2])
    return np.array([M[:3, :3] @ -half + M[:3, 3], M[:3, :3] @ half + M[:3, 3]])


def test_missing_mesh_is_listed_and_its_link_drawn_as_a_tube(tmp_path: Path) -> None:
    name = "package://nowhere/upper.stl"
    robot = arm(tmp_path, upper=f'<mesh filename="{name}"/>')
    visuals = Visuals.of(robot)
    by_link = {link: {s.name for s in visuals.shapes if s.link == link} for link in robot.frames}
    assert by_link["base"] == {"base_0"}
    assert by_link["upper"] == {"slide_tube", "turn_joint"}
    Q = configurations(robot)
    placed = visuals.placements(Q)
    k = [s.name for s in visuals.shapes].index("slide_tube")
    for q, M in zip(Q, placed[:, k], strict=True):
        upper = pin.SE3(pin.rpy.rpyToMatrix(0, q[0], 0), np.array([0, 0, 0.4]))
        expected = [upper.translation, upper * np.array([0.3, 0, 0.1])]
        np.testing.assert_allclose(ends(visuals.shapes[k], M), expected, atol=1e-12)


def test_robot_without_shapes_is_drawn_from_its_kinematics(tmp_path: Path) -> None:
    robot = arm(tmp_path, text=re.sub(r"<visual>.*?</visual>", "", ARM, flags=re.DOTALL))
    visuals = Visuals.of(robot)
    shapes = {s.name: k for k, s in enumerate(visuals.shapes)}
    assert set(shapes) == {
        "turn_tube",
        "turn_joint",
        "slide_tube",
        "slide_slider",
        "slide_rail",
        "end_tube",
    }
    q = np.array([0.7, 0.3])
    placed = visuals.placements(q[None])[0]
    upper = pin.SE3(pin.rpy.rpyToMatrix(0, 0.7, 0), np.array([0, 0, 0.4]))
    joint = upper * pin.SE3(pin.rpy.rpyToMatrix(0, 0.5, 0), np.array([0.3, 0, 0.1]))
    rod = joint * pin.SE3(np.eye(3), np.array([0.3, 0, 0]))
    expected = {
        "turn_tube": [np.zeros(3), upper.translation],
        "slide_tube": [upper.translation, joint.translation],
        "slide_rail": [joint * np.array([-0.1, 0, 0]), joint * np.array([0.5, 0, 0])],  # its limits
        "end_tube": [rod.translation, rod * np.array([0, 0.2, 0])],
    }
    for name, points in expected.items():
        k = shapes[name]
        np.testing.assert_allclose(
            ends(visuals.shapes[k], placed[k]), points, atol=1e-12, err_msg=name
        )
    # along its axis
    np.testing.assert_allclose(placed[shapes["turn_joint"]][:3, 2], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(placed[shapes["slide_slider"]][:3, 3], rod.translation, atol=1e-12)


def test_a_picture_stands_at_the_root_with_the_task_on_its_base() -> None:
    robot = rp.Robot.load("tiago", base="torso_lift_link")
    task = robot.task(kind="position")
    q = task.reference + 0.1
    visuals = Visuals.of(robot)
    k = next(k for k, s in enumerate(visuals.shapes) if s.link == "arm_1_link")
    whole = task.to_robot(q)[None]
    placed = visuals.placements(whole)[0, k, :3, 3]
    lift = robot.reference[robot.joint_names.index("torso_lift_joint")]
    base = rp.Robot.load("tiago").task("torso_lift_link", "position").placement([lift])
    np.testing.assert_allclose(placed, base.act(task.joint_origins(q)[0]), atol=1e-12)


def test_materials(tmp_path: Path) -> None:
    mesh = tmp_path / "a.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    written = '<mesh filename="a.obj" scale="1 -2 3"/>'

    def upper(material: str) -> list[Any]:
        return [
            s
            for s in Visuals.of(arm(tmp_path, upper=written, material=material)).shapes
            if s.link == "upper"
        ]

    (own,) = upper("")
    assert (own.kind, own.path, own.scale, own.color) == (
        "mesh",
        mesh.resolve(),
        (1.0, -2.0, 3.0),
        None,
    )
    (red,) = upper('<material name="red"><color rgba="1 0 0 0.5"/></material>')
    assert red.color == (1.0, 0.0, 0.0, 0.5)
    assert upper('<material name="none"><color rgba="1 0 0 0"/></material>') == []  # invisible


@pytest.mark.parametrize(
    ("name", "packages", "found"),
    [
        ("package://my_arm/meshes/a b.stl", ["share"], True),
        ("package:///my_arm/meshes/a b.stl", ["share/my_arm/meshes", "share"], True),
        ("package://my_arm/meshes/a b.stl", ["share/my_arm"], True),
        ("package://other/meshes/a b.stl", ["share/my_arm"], True),
        ("file://{mesh}", [], True),
        ("{mesh}", [], True),
        ("share/my_arm/meshes/a b.stl", [], True),
        ("http://my_arm/meshes/a b.stl", ["share"], False),
        ("share", [], False),  # a folder is no mesh
    ],
)
def test_where_meshes_are_found(
    name: str, packages: list[str], found: bool, tmp_path: Path
) -> None:
    """What is drawn, and what bodies are made of."""
    mesh = tmp_path / "share" / "my_arm" / "meshes" / "a b.stl"
    mesh.parent.mkdir(parents=True)
    trimesh.creation.box((0.1, 0.1, 0.1)).export(mesh)
    name = name.format(mesh=mesh)
    shape = f'<geometry><mesh filename="{name}"/></geometry>'
    text = ARM.replace("</visual></link>", f"</visual><collision>{shape}</collision></link>")
    robot = arm(
        tmp_path,
        upper=f'<mesh filename="{name}"/>',
        text=text,
        package_dirs=[tmp_path / folder for folder in packages],
    )
    paths = {s.path for s in Visuals.of(robot).shapes} - {None}
    assert paths == ({mesh} if found else set())
    bodies = rp.Bodies(robot.task("tool", "position"))
    assert set(bodies.missing) == (set() if found else {name})


def test_a_shape_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(rp.UrdfError, match="upper"):
        Visuals.of(arm(tmp_path, upper='<sphere radius="wide"/>'))


def test_surroundings_are_drawn_where_they_stand(tmp_path: Path) -> None:
    """A shelf, turned, on a panda: its collision shape, measured from the root, however the joints
    are."""
    (tmp_path / "cell.urdf").write_text(
        """<robot name="cell"><link name="room"/>
<link name="shelf"><collision><origin xyz="0 0 0.1"/><geometry><box size="0.4 1 0.02"/></geometry>
</collision></link>
<joint name="at" type="fixed"><parent link="room"/><child link="shelf"/>
<origin xyz="0.5 0 0.4" rpy="0 1.5 0"/></joint>
</robot>"""
    )
    robot = rp.Robot.load("panda", surroundings=tmp_path / "cell.urdf")
    visuals, alone = Visuals.of(robot), Visuals.of(rp.Robot.load("panda"))
    assert visuals.shapes[:-1] == alone.shapes
    assert (visuals.shapes[-1].kind, visuals.shapes[-1].size) == (
        "box",
        (0.4, 1, 0.02),
    ) and visuals.shapes[-1].standing
    expected = np.eye(4)
    expected[:3, :3] = [[np.cos(1.5), 0, np.sin(1.5)], [0, 1, 0], [-np.sin(1.5), 0, np.cos(1.5)]]
    expected[:3, 3] = [0.5 + 0.1 * np.sin(1.5), 0, 0.4 + 0.1 * np.cos(1.5)]
    Q = configurations(robot)
    np.testing.assert_allclose(
        visuals.placements(Q)[:, -1], np.broadcast_to(expected, (len(Q), 4, 4)), atol=1e-12
    )
    np.testing.assert_array_equal(visuals.placements(Q)[:, :-1], alone.placements(Q))


def test_a_missing_texture_is_no_traceback(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    """Issue 52, item 26.9: a .ply names an image that is not there."""
    cube = trimesh.creation.box()
    head = ["ply", "format ascii 1.0", "comment TextureFile lost.png"]
    head += [f"element vertex {len(cube.vertices)}", *(f"property float {x}" for x in "xyz")]
    head += [f"element face {len(cube.faces)}", "property list uchar int vertex_indices"]
    rows = [" ".join(map(str, point)) for point in cube.vertices.tolist()]
    rows += ["3 " + " ".join(map(str, face)) for face in cube.faces.tolist()]
    (tmp_path / "cube.ply").write_text("\n".join([*head, "end_header", *rows]) + "\n")
    trimesh.load(tmp_path / "cube.ply", resolver=trimesh.resolvers.FilePathResolver(tmp_path))
    assert "Traceback" in capfd.readouterr().err or caplog.text  # alone, trimesh logs it
    caplog.clear()
    mesh = '<geometry><mesh filename="cube.ply"/></geometry>'
    text = (
        f'<robot name="r"><link name="a"/><link name="b"><visual>{mesh}</visual>'
        f"<collision>{mesh}</collision></link>"
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    (tmp_path / "r.urdf").write_text(text)
    task = rp.Robot.load(tmp_path / "r.urdf").task("b", "xy")
    from repctl_pin.model.surfaces import read_surface

    assert len(read_surface(tmp_path / "cube.ply").faces) == 12
    assert not rp.Bodies(task).missing
    said = capfd.readouterr()
    assert not said.out and not said.err and not caplog.records


def test_corners_are_computed_once_per_robot_and_mesh_file(tmp_path: Path) -> None:
    """The rows of a study, its page and its report ask for the same; a file that changes is read
    anew."""
    mesh = tmp_path / "link.stl"
    trimesh.creation.box([0.1, 0.1, 0.4]).export(mesh)
    robot = arm(tmp_path, upper='<mesh filename="link.stl"/>')
    first = Visuals.of(robot).corners()
    again = Visuals.of(robot).corners()
    assert all(one is other for one, other in zip(first, again, strict=True))
    assert [np.ptp(points, axis=0).max() for points in first].count(pytest.approx(0.4)) >= 1
    trimesh.creation.box([0.1, 0.1, 0.6]).export(mesh)
    os.utime(mesh, ns=(1, 1))  # however coarse the clock of the files is
    longest = [np.ptp(points, axis=0).max() for points in Visuals.of(robot).corners()]
    assert longest.count(pytest.approx(0.6)) >= 1 and pytest.approx(0.4) not in longest
