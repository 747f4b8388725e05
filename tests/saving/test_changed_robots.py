"""A robot that was edited after saving is refused by name, wherever a number of the file depends on
what changed (issue 37, item 3)."""

from __future__ import annotations

import dataclasses
import json
import warnings
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from controls import some
from design_file import checksum
from designs import Cycle, with_potentials
from mimic_arm import MIMICS, arm
from proofs import design_of

import repctl_pin as rp

FEW = rp.FitOptions(samples=64, held_out=64)

RAIL = """<robot name="rail"><link name="world"/><link name="l0"/><link name="l1"/><link name="l2"/>
<link name="l3"/><link name="elbow"/><link name="tool"/>
<joint name="rail" type="prismatic"><parent link="world"/><child link="l0"/>
<origin xyz="0 0 0.1"/><axis xyz="1 0 0"/>
<limit lower="-0.5" upper="0.5" effort="1" velocity="0.7"/></joint>
<joint name="a" type="continuous"><parent link="l0"/><child link="l1"/>
<origin xyz="0 0 0.2"/><axis xyz="0 0 1"/><limit effort="1" velocity="1.1"/></joint>
<joint name="b" type="revolute"><parent link="l1"/><child link="l2"/>
<origin xyz="0.3 0 0" rpy="0 0 0.1"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2.5" effort="1" velocity="1.2"/></joint>
<joint name="c" type="revolute"><parent link="l2"/><child link="l3"/>
<origin xyz="0.4 0 0"/><axis xyz="0 0 1"/>
<limit lower="-2.1" upper="2" effort="1" velocity="1.3"/></joint>
<joint name="mark" type="fixed"><parent link="l2"/><child link="elbow"/>
<origin xyz="0.05 0 0"/></joint>
<joint name="tip" type="fixed"><parent link="l3"/><child link="tool"/>
<origin xyz="0.2 0 0"/></joint></robot>"""


def kinova_like(folder: Path) -> Path:
    """An arm of seven joints, four of them continuous, with masses, a marker and a tool."""
    rng = np.random.default_rng(7)
    axes = ["0 0 1", "0 1 0"] * 3 + ["0 0 1"]
    parts, parent = ['<robot name="gen"><link name="l0"/>'], "l0"
    for i, axis in enumerate(axes, 1):
        kind = "continuous" if i % 2 else "revolute"
        ends = "" if i % 2 else 'lower="-2.2" upper="2.3"'
        x, y, z = 0.02 * rng.standard_normal(3) + [0, 0, 0.2]
        parts.append(
            f'<joint name="j{i}" type="{kind}"><parent link="{parent}"/><child link="l{i}"/>'
            f'<origin xyz="{x:.4f} {y:.4f} {z:.4f}" rpy="0.01 0 0"/><axis xyz="{axis}"/>'
            f'<limit {ends} effort="1" velocity="1.4"/></joint><link name="l{i}"><inertial>'
            '<origin xyz="0.01 0 0.1"/><mass value="1.5"/><inertia ixx="0.02" ixy="0" ixz="0" '
            'iyy="0.03" iyz="0" izz="0.01"/></inertial></link>'
        )
        parent = f"l{i}"
    for name, link in (("marker", "l4"), ("tool", "l7")):
        parts.append(
            f'<link name="{name}"/><joint name="to_{name}" type="fixed"><parent link="{link}"/>'
            f'<child link="{name}"/><origin xyz="0.03 0 0.05"/></joint>'
        )
    file = folder / "gen.urdf"
    file.write_text("".join([*parts, "</robot>"]))
    return file


def panda(folder: Path) -> Path:
    file = folder / "panda.urdf"
    file.write_text(Path(rp.Robot.load("panda").description.path).read_text())
    return file


def rail(folder: Path) -> Path:
    file = folder / "rail.urdf"
    file.write_text(RAIL)
    return file


def mimic(folder: Path) -> Path:
    return arm(folder, MIMICS)


ARMS: dict[str, tuple[Callable[[Path], Path], str, str, tuple[str, ...]]] = {
    "panda": (panda, "panda_hand_tcp", "pose", ("panda_link2", "panda_link4", "panda_link6")),
    "kinova-like": (kinova_like, "tool", "pose", ("l2", "marker", "l6")),
    "mimic": (mimic, "l7", "position", ()),
    "rail": (rail, "tool", "xy", ()),
}
"""URDF, frame and kind of each arm, and the frames of its arm angle."""


def design_on(task: rp.Task, frames: tuple[str, ...], *, inertia: bool) -> rp.Design:
    """A design with a cycle, of given coefficients, and an arm angle if there are frames for it."""
    q = task.reference + 0.4 * np.sin(1.0 + np.arange(task.n))
    potentials = rp.Polynomial(q, 1, 0.2)
    if frames:
        potentials = rp.ArmAngle(task, *frames, reference=(0.2, 1, 0.1)) + potentials
    A = np.random.default_rng(0).standard_normal((potentials.size, task.r))
    empty = design_of(task, potentials.weighted(A), rp.Box(q, 0.1))
    design = with_potentials(empty, potentials, A)
    cycle = Cycle(q, rp.circle(task, q, 0.01), 3.0)
    plain = rp.WeightedInverse(task, "inertia") if inertia else rp.Pseudoinverse(task)
    return dataclasses.replace(design, cycle=cycle, desired=plain)


def numbers_of(tree: ElementTree.ElementTree, task: rp.Task) -> list[tuple[str, str, str, int]]:
    """List every number of the joints from base to frame: joint, element, attribute and place."""
    parents = {joint.find("child").get("link"): joint for joint in tree.getroot().iter("joint")}
    link, chain = task.frame, []
    while link in parents:
        chain.append(parents[link])
        link = parents[link].find("parent").get("link")
    found = []
    for joint in chain:
        name, fixed = joint.get("name"), joint.get("type") == "fixed"
        found += [(name, "origin", key, i) for key in ("xyz", "rpy") for i in range(3)]
        if not fixed:
            found += [(name, "axis", "xyz", i) for i in range(3)]
            keys = [k for k in ("lower", "upper", "velocity") if joint.find("limit").get(k)]
            found += [(name, "limit", key, 0) for key in keys]
        if joint.find("mimic") is not None:
            found += [(name, "mimic", key, 0) for key in ("multiplier", "offset")]
    return found


DEFAULTS = {"xyz": "0 0 0", "rpy": "0 0 0", "multiplier": "1", "offset": "0"}


def changed(
    tree: ElementTree.ElementTree, name: str, tag: str, key: str, place: int, by: float
) -> bool:
    """Add ``by`` to one number of a joint, in place; False if that changes nothing of the arm."""
    joint = next(j for j in tree.getroot().iter("joint") if j.get("name") == name)
    element = joint.find(tag)
    if element is None:
        element = ElementTree.SubElement(joint, tag)
    values = [float(v) for v in element.get(key, DEFAULTS.get(key, "0")).split()]
    before = np.array(values)
    values[place] += by
    element.set(key, " ".join(map(repr, values)))
    # an axis of another length
    return not (tag == "axis" and np.linalg.norm(np.cross(before, values)) < 1e-12)


def loaded(file: Path, saved: Path, frame: str, kind: str) -> rp.Design | rp.CellDesign:
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        return rp.load(saved, rp.Robot.load(file).task(frame, kind))


@pytest.mark.parametrize("name", some(ARMS, "rail"))
def test_every_number_that_a_design_depends_on_is_checked(name: str, tmp_path: Path) -> None:
    """Issue 37, item 3: one number at a time, of each joint from base to frame. All are detected:
    limits of a mimic joint only where they narrow those of its leader."""
    make, frame, kind, frames = ARMS[name]
    file = make(tmp_path)
    task = rp.Robot.load(file).task(frame, kind)
    saved = rp.save(design_on(task, frames, inertia=False), tmp_path / "d.json")
    text, detected, missed = file.read_text(), 0, []
    for joint, tag, key, place in numbers_of(ElementTree.parse(file), task):
        tree = ElementTree.ElementTree(ElementTree.fromstring(text))
        by = {"upper": -0.01, "lower": 0.01}.get(key, 1e-3)
        if not changed(tree, joint, tag, key, place, by):
            continue
        tree.write(file)
        now = rp.Robot.load(file).task(frame, kind)
        same = all(
            np.array_equal(getattr(now, name), getattr(task, name))
            for name in ("lower", "upper", "velocity_limit")
        )
        if tag == "limit" and same:  # of a mimic joint that its leader never reaches
            loaded(file, saved, frame, kind)
            continue
        try:
            loaded(file, saved, frame, kind)
            missed.append((joint, tag, key, place))
        except rp.InputError as error:
            detected += 1
            assert "\n" not in str(error) and str(saved) in str(error)
            if tag == "limit":
                driver = next(
                    j.mimic or j.name for j in now.robot.joints.values() if j.name == joint
                )
                assert f"{driver!r}" in str(error) and "limit" in str(error)
    assert not missed and detected > 25
    file.write_text(text)
    loaded(file, saved, frame, kind)


@pytest.mark.parametrize("name", some(["panda", "kinova-like"], "kinova-like"))
def test_a_moved_marker_of_an_arm_angle_is_named(name: str, tmp_path: Path) -> None:
    """Issue 37, item 3: the frame of a marker is on no joint of the chain; ∂ψ/∂q depends on it."""
    make, frame, kind, frames = ARMS[name]
    file, marker = make(tmp_path), frames[1]
    text = file.read_text()
    if name == "panda":
        frames, marker = (frames[0], "marker", frames[2]), "marker"
        extra = (
            '<link name="marker"/><joint name="to_marker" type="fixed">'
            '<parent link="panda_link4"/><child link="marker"/>'
            '<origin xyz="0.03 0 0.05"/></joint></robot>'
        )
        text = text.replace("</robot>", extra)
        file.write_text(text)
    task = rp.Robot.load(file).task(frame, kind)
    with_angle = rp.save(design_on(task, frames, inertia=False), tmp_path / "a.json")
    without = rp.save(design_on(task, (), inertia=False), tmp_path / "p.json")
    for place in range(3):
        tree = ElementTree.ElementTree(ElementTree.fromstring(text))
        changed(tree, f"to_{marker}", "origin", "xyz", place, 0.02)
        tree.write(file)
        with pytest.raises(rp.InputError, match=f"frame '{marker}' is displaced by 0.0"):
            loaded(file, with_angle, frame, kind)
        loaded(file, without, frame, kind)  # nothing of it depends on the marker


def test_masses_are_checked_where_the_inertia_is_the_weight(tmp_path: Path) -> None:
    """Issue 37, item 3."""
    make, frame, kind, _ = ARMS["kinova-like"]
    file = make(tmp_path)
    text = file.read_text()
    task = rp.Robot.load(file).task(frame, kind)
    heavy, plain = (
        rp.save(design_on(task, (), inertia=inertia), tmp_path / f"{inertia}.json")
        for inertia in (True, False)
    )
    for old, new in (
        ('mass value="1.5"', 'mass value="1.501"'),
        ('ixx="0.02"', 'ixx="0.0201"'),
        ('<origin xyz="0.01 0 0.1"/>', '<origin xyz="0.0101 0 0.1"/>'),
    ):
        for k in range(4, 7):  # of one link each
            parts = text.split(old)
            file.write_text(old.join(parts[:k]) + new + old.join(parts[k:]))
            with pytest.raises(rp.InputError, match="inertia differs by"):
                loaded(file, heavy, frame, kind)
            loaded(file, plain, frame, kind)


def test_speed_limits_are_checked_where_a_period_keeps_them(tmp_path: Path) -> None:
    """Issue 37, item 3: without a cycle, no number of a design depends on them."""
    make, frame, kind, _ = ARMS["rail"]
    file = make(tmp_path)
    design = design_on(rp.Robot.load(file).task(frame, kind), (), inertia=False)
    timed = rp.save(design, tmp_path / "timed.json")
    plain = rp.save(dataclasses.replace(design, cycle=None), tmp_path / "plain.json")
    file.write_text(RAIL.replace('velocity="1.2"', 'velocity="0.9"'))
    with pytest.raises(rp.InputError, match=r"the speed limit of 'b' was 1.2 and is 0.9"):
        loaded(file, timed, frame, kind)
    loaded(file, plain, frame, kind)


BODIES = RAIL.replace(
    '<link name="l3"/>',
    '<link name="l3"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>',
).replace(
    '<link name="world"/>',
    '<link name="world"><collision><origin xyz="0 1.5 0.3"/><geometry><sphere radius="0.2"/>'
    "</geometry></collision></link>",
)


@pytest.mark.slow
def test_a_cell_s_limits_refuse_and_its_bodies_drop_the_distance(tmp_path: Path) -> None:
    """Issue 37, item 3: F does not depend on the bodies, only its body distance does."""
    file = tmp_path / "rail.urdf"
    file.write_text(BODIES)
    task = rp.Robot.load(file).task("tool", "xy")
    q = np.array([0.0, 0.3, 0.8, 0.7])
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task),
        rp.Cell(task, task.placement(q), 0.05),
        posture=q,
        degree=2,
        options=FEW,
    )
    assert 0 < found.body_distance < 2
    saved = rp.save(found, tmp_path / "cell.json")
    assert loaded(file, saved, "tool", "xy").body_distance == found.body_distance
    for old, new in (
        ('radius="0.2"', 'radius="0.21"'),
        ('xyz="0 1.5 0.3"', 'xyz="0 1.51 0.3"'),
        ('box size="0.1 0.1', 'box size="0.1 0.11'),
    ):
        file.write_text(BODIES.replace(old, new))
        now = rp.Robot.load(file).task("tool", "xy")
        with pytest.warns(UserWarning, match="body distance and collisions were dropped"):
            again = rp.load_cell(saved, now)
        assert np.isnan(again.body_distance) and "not known" in again.summary()
        assert np.array_equal(
            again.function.batch(np.zeros((1, 2))), found.function.batch(np.zeros((1, 2)))
        )
        resaved = rp.save(again, tmp_path / "again.json")
        with pytest.warns(UserWarning, match="collision bodies"):
            assert np.isnan(rp.load_cell(resaved, now).body_distance)
    file.write_text(BODIES.replace('upper="2.5"', 'upper="2.4"'))
    with pytest.raises(rp.InputError, match=r"limits of 'b' were \[-2, 2.5\] and are \[-2, 2.4\]"):
        loaded(file, saved, "tool", "xy")


def test_an_older_file_loads_and_says_what_is_not_checked(tmp_path: Path) -> None:
    """Issue 37, item 3: a file of this schema without limits, frames and masses."""
    make, frame, kind, frames = ARMS["kinova-like"]
    file = make(tmp_path)
    task = rp.Robot.load(file).task(frame, kind)
    saved = rp.save(design_on(task, frames, inertia=True), tmp_path / "d.json")
    content = json.loads(saved.read_text())
    del content["task"]["limits"], content["potentials"]["parts"][0]["points"]
    del content["desired"]["inertia"]
    content["checksum"] = checksum(content)
    saved.write_text(json.dumps(content))
    with pytest.warns(UserWarning) as notes:
        rp.load_design(saved, task)
    (note,) = notes
    for part in ("joint limits", "frames of the arm angle", "masses"):
        assert part in str(note.message)
