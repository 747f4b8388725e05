"""The gatekeeper: every bad file is one clear line; every good one is one number per joint in
Pinocchio."""

from __future__ import annotations

import copy
import math
import os
import random
import re
import stat
import time
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from controls import some
from lxml import etree

import repctl_pin as rp

INF = math.inf
NO_LIMIT = 1e3
"""What Pinocchio is given where a joint has no limit."""


def joint(
    name="j", kind="revolute", parent="a", child="b", body='<axis xyz="0 0 1"/>', limit="-1 1"
) -> str:
    """One joint, on a line of its own."""
    if limit:
        lower, upper = limit.split()
        body += f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'
    links = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{links}{body}</joint>'


def robot(*lines: str, head: str = '<robot name="r">') -> str:
    """A file: the root in line 1, then one element a line."""
    return "\n".join([head, *lines, "</robot>"])


def links(*names: str) -> str:
    return "".join(f'<link name="{name}"/>' for name in names)


def chain(n: int, kind: str = "revolute", padding: str = "") -> str:
    lines = [links("l0")]
    for i in range(n):
        lines.append(links(f"l{i + 1}") + padding)
        lines.append(
            joint(f"j{i}", kind, f"l{i}", f"l{i + 1}", limit="-1 1" if kind == "revolute" else "")
        )
    return robot(*lines)


def with_inertia(mass: str = "1", ixx: str = "1") -> str:
    inertia = f'<inertia ixx="{ixx}" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    return f'<link name="b"><inertial><mass value="{mass}"/>{inertia}</inertial></link>'


def with_shape(shape: str) -> str:
    return f'<link name="b"><visual><geometry>{shape}</geometry></visual></link>'


ONE_JOINT = robot(links("a", "b"), joint())
BOMB = """<?xml version="1.0"?>
<!DOCTYPE robot [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;"><!ENTITY
c "&b;&b;&b;&b;&b;&b;">]>
<robot name="&c;"><link name="a"/></robot>"""
XXE = BOMB.replace('<!ENTITY a "aaaaaaaaaa">', '<!ENTITY a SYSTEM "file:///etc/hostname">')

# name → (file, what the message must hold); every row of the table 'Bad URDFs' and more
BAD = {
    # not a URDF at all
    "empty": ("", "empty"),
    "blank": (" \n\t\n", "empty"),
    "text": ("robot arm of mine", "not XML"),
    "binary": (bytes(range(256)) * 8, "binary file"),
    "html": ("<!DOCTYPE html>\n<html><body><p>404<br></body></html>", "web page"),
    "html, bare": ("\n<HTML><body>", "web page"),
    "lfs": ("version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "git lfs pull"),
    "sdf": ('<?xml version="1.0"?><sdf version="1.9"><model name="m"/></sdf>', "SDF"),
    "mjcf": ('<mujoco model="m"><worldbody><joint/></worldbody></mujoco>', "MuJoCo cannot"),
    "srdf": ('<robot name="r"><group name="arm"/></robot>', "SRDF"),
    "collada": ('<COLLADA xmlns="http://www.collada.org"/>', "COLLADA"),
    "other root": ("<!-- hello -->\n<launch/>", "line 2", "<launch>", "<robot>"),
    "xacro macro": (
        robot(
            '<xacro:macro name="m"/>',
            head='<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">',
        ),
        ("line 2", "xacro:macro", "run `xacro"),
    ),
    "xacro value": (
        robot(links("a", "b"), joint(body='<origin xyz="${L} 0 0"/>')),
        ("line 3", "run `xacro"),
    ),
    "xacro arg": (robot(links("a"), '<link name="$(arg prefix)b"/>'), ("line 3", "run `xacro")),
    # broken XML
    "truncated": (ONE_JOINT[: len(ONE_JOINT) // 2], ("line 3", "not well-formed")),
    "malformed": (robot(links("a"), "<link name=a/>"), ("line 3", "not well-formed")),
    "unclosed comment": ("<!-- <robot/>", "not well-formed"),
    "undeclared entity": (robot('<link name="&x;"/>'), ("line 2", "not well-formed")),
    "bad encoding": (ONE_JOINT.replace('"a"', '"\xe4"').encode("latin-1"), "not well-formed"),
    "entity bomb": (BOMB, "DOCTYPE"),
    "external entity": (XXE, "DOCTYPE"),
    "bomb in utf-16": (
        BOMB.replace('version="1.0"', 'version="1.0" encoding="utf-16"').encode("utf-16"),
        "DOCTYPE",
    ),
    "nested 100": (robot(links("a"), "<x>" * 100 + "</x>" * 100), ("line 3", "nest")),
    "nested 100000": (robot(links("a"), "<x>" * 100_000 + "</x>" * 100_000), "line 3"),
    # names
    "no link": (robot(), ("line 1", "<robot>", "no <link>")),
    "no robot name": (robot(links("a"), head="<robot>"), ("line 1", "no name")),
    "version": (robot(links("a"), head='<robot name="r" version="2.0">'), ("line 1", "2.0")),
    "link without a name": (robot(links("a"), "<link/>"), ("line 3", "link", "no name")),
    "joint without a name": (robot(links("a", "b"), joint("")), ("line 3", "joint", "no name")),
    "two links of a name": (
        robot(links("a"), links("b"), links("a")),
        ("line 4", "link 'a'", "line 2"),
    ),
    "two joints of a name": (
        robot(links("a", "b", "c"), joint(), joint(parent="b", child="c")),
        ("line 4", "joint 'j'", "line 3"),
    ),
    "two materials of a name": (
        robot('<material name="m"/>', links("a"), '<material name="m"/>'),
        ("line 4", "'m'"),
    ),
    "reserved name": (robot(links("a", "b"), joint("universe")), ("line 3", "joint 'universe'")),
    # the tree
    "missing parent": (
        robot(links("b"), joint()),
        ("line 3", "<parent> of joint 'j'", "no link 'a'"),
    ),
    "missing child": (
        robot(links("a"), joint()),
        ("line 3", "<child> of joint 'j'", "no link 'b'"),
    ),
    "no parent": (
        robot(links("a", "b"), joint(parent="")),
        ("line 3", "joint 'j'", "no parent link"),
    ),
    "two roots": (
        robot(links("a", "b"), links("c"), joint()),
        ("line 3", "link 'c'", "'a'", "root"),
    ),
    "two parents": (
        robot(links("a", "b", "c"), joint("j"), joint("k", parent="c")),
        ("line 4", "joint 'k'", "link 'b'", "joint 'j' (line 3)"),
    ),
    "rootless cycle": (
        robot(links("a", "b"), joint("j"), joint("k", parent="b", child="a")),
        ("line 3", "no root"),
    ),
    "loop aside": (
        robot(
            links("a", "b", "c"),
            joint("j", parent="b", child="c"),
            joint("k", parent="c", child="b"),
        ),
        ("line 4", "joint 'k'", "loop"),
    ),
    "its own child": (robot(links("a", "b"), joint(parent="b")), ("line 3", "joint 'j'", "loop")),
    # joints
    "no type": (
        robot(links("a", "b"), joint().replace(' type="revolute"', "")),
        ("line 3", "joint 'j'", "no type"),
    ),
    "unknown type": (
        robot(links("a", "b"), joint(kind="screw")),
        ("line 3", "joint 'j'", "'screw'", "revolute"),
    ),
    "zero axis": (
        robot(links("a", "b"), joint(body='<axis xyz="0 0 0"/>')),
        ("line 3", "<axis> of joint 'j'"),
    ),
    "tiny axis": (
        robot(links("a", "b"), joint(body='<axis xyz="0 0 1e-320"/>')),
        ("line 3", "no direction"),
    ),
    "huge axis": (
        robot(links("a", "b"), joint(body='<axis xyz="0 0 1e200"/>')),
        ("line 3", "<axis>", "more than any robot has"),
    ),
    "axis of two": (
        robot(links("a", "b"), joint(body='<axis xyz="0 1"/>')),
        ("line 3", "3 numbers"),
    ),
    "inverted limits": (
        robot(links("a", "b"), joint(limit="1 -1")),
        ("line 3", "<limit> of joint 'j'", "above"),
    ),
    "equal limits": (
        robot(links("a", "b"), joint(limit="1 1")),
        ("line 3", "<limit> of joint 'j'", "fixed"),
    ),
    "no limit": (
        robot(links("a", "b"), joint(limit="")),
        ("line 3", "joint 'j'", "<limit>", "continuous"),
    ),
    "negative speed": (
        robot(links("a", "b"), joint().replace('velocity="1"', 'velocity="-2"')),
        ("line 3", "velocity", "negative"),
    ),
    "mimics nobody": (
        robot(links("a", "b"), joint(body="<mimic/>")),
        ("line 3", "<mimic> of joint 'j'"),
    ),
    "mimics a stranger": (
        robot(
            links("a", "b", "c"),
            joint(),
            joint("k", parent="b", child="c", body='\n<mimic joint="jj"/>'),
        ),
        ("line 5", "<mimic> of joint 'k'", "no joint 'jj'", "correct the name"),
    ),
    "mimics one of two": (  # a prefix may be missing, but which?
        robot(
            links("a", "b", "c", "d"),
            joint("l_j"),
            joint("l_up_j", parent="b", child="c"),
            joint("l_up_k", parent="c", child="d", body='<mimic joint="j"/>'),
        ),
        ("line 5", "<mimic> of joint 'l_up_k'", "no joint 'j'"),
    ),
    "mimics itself": (
        robot(links("a", "b"), joint(body='<mimic joint="j"/>')),
        ("line 3", "<mimic> of joint 'j'"),
    ),
    # numbers
    "nan origin": (
        robot(links("a", "b"), joint(body='<origin xyz="0 nan 0"/>')),
        ("line 3", "<origin> of joint 'j'"),
    ),
    "inf origin": (
        robot(links("a", "b"), joint(body='<origin rpy="inf 0 0"/>')),
        ("line 3", "rpy", "finite"),
    ),
    "1e400 limit": (
        robot(links("a", "b"), joint(limit="-1 1e400")),
        ("line 3", "upper", "1e400", "finite"),
    ),
    "inf limit": (robot(links("a", "b"), joint(limit="-inf inf")), ("line 3", "lower", "finite")),
    "text limit": (robot(links("a", "b"), joint(limit="-pi 1")), ("line 3", "'-pi'", "finite")),
    "python number": (robot(links("a", "b"), joint(limit="-1_0 1")), ("line 3", "'-1_0'")),
    "comma": (robot(links("a", "b"), joint(body='<origin xyz="1,2,3"/>')), ("line 3", "3 numbers")),
    "nan mimic": (
        robot(links("a", "b"), joint(body='<mimic joint="k" multiplier="nan"/>')),
        ("line 3", "<mimic> of joint 'j'"),
    ),
    "nan damping": (
        robot(links("a", "b"), joint(body='<dynamics damping="nan"/>')),
        ("line 3", "<dynamics>"),
    ),
    "nan safety": (
        robot(links("a", "b"), joint(body='<safety_controller k_velocity="x"/>')),
        ("line 3", "<safety_controller> of joint 'j'"),
    ),
    "negative mass": (
        robot(links("a"), with_inertia("-1"), joint()),
        ("line 3", "<mass> of link 'b'", "negative"),
    ),
    "nan mass": (
        robot(links("a"), with_inertia("NaN"), joint()),
        ("line 3", "<mass> of link 'b'", "finite"),
    ),
    "no mass value": (
        robot(links("a"), with_inertia().replace(' value="1"', ""), joint()),
        ("line 3", "<mass> of link 'b'"),
    ),
    "inf inertia": (
        robot(links("a"), with_inertia(ixx="inf"), joint()),
        ("line 3", "<inertia> of link 'b'", "ixx"),
    ),
    "nan scale": (
        robot(links("a"), with_shape('<mesh filename="m.stl" scale="1 1 nan"/>'), joint()),
        ("line 3", "<mesh> of link 'b'", "scale"),
    ),
    "nameless mesh": (
        robot(links("a"), with_shape("<mesh/>"), joint()),
        ("line 3", "<mesh> of link 'b'", "filename"),
    ),
    "negative box": (
        robot(links("a"), with_shape('<box size="1 -1 1"/>'), joint()),
        ("line 3", "<box> of link 'b'"),
    ),
    "sizeless sphere": (robot(links("a"), with_shape("<sphere/>"), joint()), ("line 3", "radius")),
    "nan cylinder": (
        robot(links("a"), with_shape('<cylinder radius="nan" length="1"/>'), joint()),
        ("line 3", "<cylinder> of link 'b'"),
    ),
    "full-width mass": (
        robot(links("a"), with_inertia("１２"), joint()),
        ("line 3", "<mass> of link 'b'", "finite"),
    ),
    "wide space": (
        robot(links("a", "b"), joint(body='<origin xyz="0\u30000\u30000"/>')),
        ("line 3", "<origin>"),
    ),
    "origin of 1e308": (
        robot(links("a", "b"), joint(body='<origin xyz="1e308 0 0"/>')),
        ("line 3", "more than any robot has"),
    ),
    "limits of 1e308": (
        robot(links("a", "b"), joint(limit="1e307 1e308")),
        ("line 3", "<limit>", "too far from 0"),
    ),
    "limits far away": (
        robot(links("a", "b"), joint(limit="2000 3000")),
        ("line 3", "<limit>", "too far from 0"),
    ),
    "comma in a name": (robot(links("a", "b"), joint("a,b")), ("line 3", "joint 'a,b'", "rename")),
    "line break in a name": (robot(links("a", "b"), joint("a&#10;b")), ("line 3", "rename")),
    "quote in a name": (robot(links("a", "b"), joint("a&quot;b")), ("line 3", "rename")),
    "control in a link's name": (
        robot(links("a", "b&#9;"), joint(child="b&#9;")),
        ("line 2", "rename"),
    ),
    "mimics a planar joint": (
        robot(
            links("a", "b", "c"),
            joint("p", "planar", limit=""),
            joint("k", parent="b", child="c", body='<mimic joint="p"/>'),
        ),
        ("line 4", "<mimic> of joint 'k'", "joint 'p' is planar"),
    ),
    "300,000 attributes": (
        robot('<link name="a" ' + " ".join(f'a{i}="1"' for i in range(300_000)) + "/>"),
        ("line 2", "300001 attributes"),
    ),
    "capsule of nothing": (
        robot(links("a"), with_shape("<capsule/>"), joint()),
        ("line 3", "<capsule>", "radius"),
    ),
    # sizes that would exhaust or crash Pinocchio
    "1000-link chain": (chain(1000, "fixed"), "a chain has over 300 links"),
    "200 moving in all": (
        robot(links("a"), *(links(f"b{i}") + joint(f"j{i}", child=f"b{i}") for i in range(201))),
        ("line 1", "201 movable joints", "200"),
    ),
    "101 moving": (chain(101), ("joint 'j100'", "movable")),
    "301 fixed": (chain(301, "fixed"), ("line 2", "link 'l0'", "a chain has over 300 links")),
    "5000-link star": (
        robot(links("a"), *(links(f"b{i}") + joint(f"j{i}", child=f"b{i}") for i in range(5000))),
        ("line 1", "5000 joints"),
    ),
    "4000-link chain of 10 MB": (
        chain(4000, padding=f"<!-- {'x' * 2500} -->"),
        ("larger than", "MB"),
    ),
}


def refusal(path: Path) -> str:
    """The message of the refusal: one line, soon, that begins with the file."""
    start = time.process_time()
    with pytest.raises(rp.UrdfError) as caught:
        rp.Robot.load(path)
    assert time.process_time() - start < 5.0
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert message.isprintable()
    assert len(message) < 400 + len(str(path))
    return message[len(str(path)) :]


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_one_clear_line(tmp_path: Path, name: str) -> None:
    content, *expected = BAD[name]
    words = [w for e in expected for w in ([e] if isinstance(e, str) else e)]
    path = tmp_path / "bad.urdf"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    message = refusal(path)
    assert not [word for word in words if word not in message], message


def test_the_line_is_the_line(tmp_path: Path) -> None:
    path = tmp_path / "long.urdf"
    # the parser counts no further
    for blank, said in ((50_000, "line 50003:"), (70_000, "after line 65534:")):
        path.write_text(robot(links("a", "b"), *[""] * blank, joint(limit="1 -1")))
        assert f": {said} <limit>" in refusal(path)


def test_paths_that_are_no_file(tmp_path: Path) -> None:
    assert "no such file" in refusal(tmp_path / "nowhere.urdf")
    assert "is a folder" in refusal(tmp_path)
    os.mkfifo(tmp_path / "pipe.urdf")
    assert "not a regular file" in refusal(tmp_path / "pipe.urdf")
    with pytest.raises(rp.InputError, match="robot must be a file.s name"):
        rp.Robot.load("a\0b.urdf")
    with pytest.raises(rp.InputError, match=r"^a b\.urdf: no such file"):
        rp.Robot.load("a\nb.urdf")


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may read everything"
)
def test_an_unreadable_file(tmp_path: Path) -> None:
    path = tmp_path / "secret.urdf"
    path.write_text(ONE_JOINT)
    path.chmod(stat.S_IWUSR)
    assert "cannot be read" in refusal(path)


def test_a_read_that_fails_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "secret.urdf"
    path.write_text(ONE_JOINT)

    def refuse(*_args: object, **_options: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    assert "cannot be read (Permission denied)" in refusal(path)


def test_size_is_checked_before_parsing(tmp_path: Path) -> None:
    path = tmp_path / "big.urdf"
    with path.open("wb") as file:  # sparse: no disk is filled
        file.truncate(250_000_000)
    assert "larger than" in refusal(path)


def test_plain_data(tmp_path: Path) -> None:
    path = tmp_path / "good.urdf"
    mesh = '<visual><geometry><mesh filename="{}" scale="1 1 1"/></geometry></visual>'
    path.write_text(
        robot(
            '<link name="a">'
            + mesh.format("package://nowhere/a.stl")
            + mesh.format("meshes/b.stl")
            + "</link>",
            links("b", "c", "d", "e", "f"),
            joint("turn", "continuous", "a", "b", limit="-1 1"),
            joint("lift", "prismatic", "b", "c", body='<axis xyz="0 3 4"/>', limit="-0.25 0.5"),
            joint("free", "revolute", "c", "d", body="", limit="-1e16 2"),
            joint(
                "none",
                "revolute",
                "d",
                "e",
                body='<mimic joint="lift"/><limit effort="0" velocity="0"/>',
                limit="",
            ),
            joint("f", "fixed", "e", "f", body='<axis xyz="0 0 0"/>', limit=""),
        )
    )
    d = rp.Robot.load(path).description
    turn, lift, free, none, fixed = d.joints
    assert (d.name, d.path, d.root, d.links) == ("r", path, "a", ("a", "b", "c", "d", "e", "f"))
    assert d.meshes == ("package://nowhere/a.stl", "meshes/b.stl")
    assert [j.kind for j in d.joints] == [
        "continuous",
        "prismatic",
        "revolute",
        "revolute",
        "fixed",
    ]
    assert [(j.lower, j.upper) for j in (turn, lift, free, none)] == [
        (-INF, INF),
        (-0.25, 0.5),
        (-INF, 2),
        (-INF, INF),
    ]
    assert [j.velocity for j in d.joints] == [1, 1, 1, INF, INF]
    assert lift.axis == pytest.approx((0, 0.6, 0.8)) and free.axis == (1, 0, 0)
    assert [j.mimic for j in d.joints] == [None, None, None, "lift", None]
    assert [j.line for j in d.joints] == [4, 5, 6, 7, 8]
    assert fixed.name == "f"  # as the link is called too
    assert d.notes == (
        "joint 'none' has no range (lower = upper = 0): read as unlimited",
        "speed limit 0 of joint 'none' read as no limit",
    )

    model = pin.buildModelFromXML(d.xml)
    assert tuple(model.names)[1:] == ("turn", "lift", "free", "none")
    assert model.nq == model.nv == 4
    np.testing.assert_array_equal(
        model.lowerPositionLimit, [-NO_LIMIT, -0.25, -NO_LIMIT, -NO_LIMIT]
    )
    np.testing.assert_array_equal(model.upperPositionLimit, [NO_LIMIT, 0.5, 2.0, NO_LIMIT])
    tags = {element.tag for element in etree.fromstring(d.xml).iter()}
    assert not tags & {"visual", "collision", "material", "mesh"}


def test_a_joint_that_shares_its_name_with_a_link_can_be_locked(tmp_path: Path) -> None:
    path = tmp_path / "same.urdf"
    follower = joint("k", parent="b", child="c", body='<mimic joint="b"/>')
    path.write_text(
        robot(
            links("a", "b", "c", "b_joint"),
            joint("b"),
            follower,
            joint("m", "fixed", "c", "b_joint"),
        )
    )
    machine = rp.Robot.load(path, lock=["b"])
    assert machine.joint_names == () and machine.locked == ("b", "k")
    machine = rp.Robot.load(path)
    assert machine.joint_names == ("b",) and machine.chain("b") == ("b",)
    assert set(machine.frames) == {"a", "b", "c", "b_joint"}


def test_a_leader_without_its_prefix_is_found_and_said() -> None:
    d = rp.Robot.load("alex_psyonic").description
    assert (
        "joint 'Left_index_q2' mimics 'index_q1', which is not in this file; read as "
        "'Left_index_q1'" in d.notes
    )
    followers = {j.name: j.mimic for j in d.joints if j.mimic is not None}
    assert (
        followers["Left_index_q2"] == "Left_index_q1"
        and followers["Right_pinky_q2"] == "Right_pinky_q1"
    )
    names = {j.name for j in d.joints}
    assert len(followers) == 8 and set(followers.values()) < names


@pytest.mark.parametrize(
    ("limits", "told"),
    [
        (
            ["-180 180"],
            ["joint 'j0' has a limit of 180 rad, possibly in degrees; URDF angles are in rad"],
        ),
        (
            ["-2 2", "-90 120", "-175 170"],
            ["joint 'j2' has a limit of 175 rad (and 1 more such limits), possibly in degrees"],
        ),
        (["-12.5 12.5"], []),
        (["-1e16 2", "-1e4 1e4"], []),  # no limit at all
    ],
)
def test_limits_that_look_like_degrees_are_asked_about(
    tmp_path: Path, limits: list[str], told: list[str]
) -> None:
    lines = [
        joint(f"j{i}", "revolute", f"l{i}", f"l{i + 1}", limit=limit)
        for i, limit in enumerate(limits)
    ]
    (tmp_path / "r.urdf").write_text(
        robot(links(*(f"l{i}" for i in range(len(limits) + 1))), *lines)
    )
    notes = rp.Robot.load(tmp_path / "r.urdf").description.notes
    assert len(notes) == len(told) and all(
        note.startswith(words) for note, words in zip(notes, told, strict=True)
    )


def test_slides_may_be_long(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(
        robot(links("a", "b"), joint(kind="prismatic", limit="-20 20"))
    )
    assert rp.Robot.load(tmp_path / "r.urdf").description.notes == ()


KIND = {
    "version": (
        '<?xml version="0.0"?>\n' + ONE_JOINT,
        ["ignored: the version in <?xml version=…?>; read as 1.0"],
    ),
    "late declaration": (
        '\n<!-- mine -->\n<?xml version="1.0"?>\n' + ONE_JOINT,
        ["ignored: <?xml …?> that is not at the start of the file"],
    ),
    "zeros": (ONE_JOINT + "\0\0", ["ignored: zero bytes at the end of the file"]),
    "prefix": (
        robot(
            links("a", "b"),
            '<drake:joint name="x"/><sensor:camera/>',
            joint().replace("<axis", '<axis drake:x="1"'),
        ),
        [
            "ignored: elements and attributes with a prefix that the file does not declare: "
            "drake:, sensor:"
        ],
    ),
    "prefix of links": (
        robot(links("a", "b"), '<my:link name="c"/>', joint()),
        ["ignored: elements and attributes with a prefix that the file does not declare: my:"],
    ),
    "colour": (
        robot(
            '<link name="a"/>',
            '<material name="m">\n<color rgba="1 0 0 0 1"/></material>',
            links("b"),
            joint(),
        ),
        ["ignored: the colour in line 4, rgba = '1 0 0 0 1' is not 4 numbers"],
    ),
    "xacro": (
        robot(links("a", "b"), '<xacro:property name="x" value="${pi}"/><xacro:arm/>', joint()),
        [
            "ignored: <xacro:property>, <xacro:arm> in line 3, left over from xacro; "
            "run xacro to add the missing elements"
        ],
    ),
}


@pytest.mark.parametrize("name", KIND)
def test_what_pinocchio_reads_is_read_and_told(tmp_path: Path, name: str) -> None:
    text, told = KIND[name]
    (tmp_path / "r.urdf").write_text(text)
    d = rp.Robot.load(tmp_path / "r.urdf").description
    assert (d.links, [j.name for j in d.joints], list(d.notes)) == (("a", "b"), ["j"], told)
    # which Pinocchio reads after a line break, but not after a comment
    if name == "late declaration":
        (tmp_path / "r.urdf").write_text(text.replace("<!-- mine -->", ""))
    theirs, ours = (pin.buildModelFromUrdf(str(tmp_path / "r.urdf")), pin.buildModelFromXML(d.xml))
    assert tuple(theirs.names) == tuple(ours.names) and theirs.joints[1] == ours.joints[1]


def test_an_axis_without_numbers_is_x(tmp_path: Path) -> None:
    """Pinocchio alone takes the zero axis, and turns about nothing."""
    (tmp_path / "r.urdf").write_text(
        robot(links("a", "b"), joint(body='<axis/><origin xyz="0 1 0"/>'))
    )
    task = rp.Robot.load(tmp_path / "r.urdf").task("b", "pose")
    np.testing.assert_allclose(task.jacobian([0.3])[:, 0], [0, 0, 0, 1, 0, 0], atol=1e-15)


def test_a_color_without_numbers_is_none(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    shape = '<sphere radius="1"/></geometry><material name="m"><color/></material><geometry>'
    (tmp_path / "r.urdf").write_text(
        robot(links("a"), with_shape(shape).replace("<geometry></geometry>", ""), joint())
    )
    d = rp.Robot.load(tmp_path / "r.urdf").description
    assert [shape.color for shape in d.shapes] == [None]
    pin.buildModelFromXML(d.xml)
    assert "Error" not in capfd.readouterr().err


def test_many_shapes_are_capped(tmp_path: Path) -> None:
    visual = '<visual><geometry><sphere radius="1"/></geometry></visual>'
    (tmp_path / "r.urdf").write_text(
        robot('<link name="a">' + visual * 1001 + "</link>", links("b"), joint())
    )
    d = rp.Robot.load(tmp_path / "r.urdf").description
    assert len(d.shapes) == 1000 and d.notes == ("only the first 1000 of 1001 shapes are drawn",)


def test_names_that_no_file_can_have(tmp_path: Path) -> None:
    long = "m" * 5000 + ".stl"
    (tmp_path / "r.urdf").write_text(
        robot(links("a"), with_shape(f'<mesh filename="{long}"/>'), joint())
    )
    (warning,) = rp.Robot.load(tmp_path / "r.urdf").warnings
    assert warning.startswith("1 of 1 meshes are missing (mmm") and len(warning) < 250
    for name in ("~nosuchuser/x.urdf", "x" * 5000 + ".urdf"):
        with pytest.raises(rp.UrdfError, match="no such file|cannot be read"):
            rp.Robot.load(name)
    with pytest.raises(rp.InputError, match="there is no folder"):
        rp.Robot.load(tmp_path / "r.urdf", package_dirs=["~nosuchuser"])


def test_a_mimic_of_a_fixed_joint_is_told(tmp_path: Path) -> None:
    follower = joint("k", parent="b", child="c", body='<mimic joint="f"/>')
    (tmp_path / "r.urdf").write_text(
        robot(links("a", "b", "c"), joint("f", "fixed", limit=""), follower)
    )
    d = rp.Robot.load(tmp_path / "r.urdf").description
    assert d.joints[1].kind == "fixed"
    assert d.notes == ("read as fixed: joint 'k', because 'f', the leader, cannot move",)


XACRO = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="length" value="0.5"/>
<xacro:macro name="arm" params="k"><link name="l${k}"/>
<joint name="j${k}" type="revolute"><parent link="l${k - 1}"/><child link="l${k}"/>
<origin xyz="${2 * length} 0 0"/>
<limit lower="${-pi}" upper="${pi}" effort="1" velocity="1"/></joint></xacro:macro>
<link name="l0"/><xacro:arm k="1"/><xacro:arm k="2"/></robot>"""


def test_xacro_is_expanded_where_it_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("xacro")
    path = tmp_path / "r.xacro"
    path.write_text(XACRO)
    machine = rp.Robot.load(path)
    assert machine.joint_names == ("j1", "j2") and machine.upper == pytest.approx([math.pi] * 2)
    assert machine.model.jointPlacements[2].translation[0] == 1.0
    path.write_text(XACRO.replace("2 * length", "2 * nothing"))
    assert "xacro cannot expand it" in (told := refusal(path)) and "nothing" in told
    # a macro that calls itself
    path.write_text(XACRO.replace('<link name="l${k}"/>', '<xacro:arm k="${k}"/>'))
    assert "xacro" in refusal(path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert "pip install xacro" in refusal(path)


@pytest.mark.parametrize(
    "place", some(["package_dirs", "itself", "ROS", "AMENT", "beside"], "package_dirs", "AMENT")
)
def test_xacro_finds_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    """Issue 37, item 20: $(find arm) is looked up where package://arm is; else the remedy says
    where to put it."""
    pytest.importorskip("xacro")
    package = tmp_path / "ws" / "share" / "arm"
    package.mkdir(parents=True)
    (package / "macro.xacro").write_text(XACRO)
    path = tmp_path / "elsewhere" / "r.xacro"
    path.parent.mkdir()
    path.write_text(
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:property name="there" value="$(find arm)"/>'
        '<xacro:include filename="${there}/macro.xacro"/></robot>'
    )
    told = refusal(path)
    assert "'arm' not found" in told and told.endswith(
        "give the folder that contains it (--package-dir, package_dirs=)"
    )
    folders: list[Path] = []
    if place == "ROS":
        monkeypatch.setenv("ROS_PACKAGE_PATH", str(package.parent))
    elif place == "AMENT":
        monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ws"))
    elif place == "beside":
        package.rename(path.parent / "arm")
    else:
        folders = [package if place == "itself" else package.parent]
    robot = rp.Robot.load(path, package_dirs=folders)
    assert robot.joint_names == ("j1", "j2")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_other_encodings(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "r.urdf"
    path.write_bytes(ONE_JOINT.replace('name="j"', 'name="Gelenk_ä"').encode(encoding))
    d = rp.Robot.load(path).description
    assert d.joints[0].name == "Gelenk_ä"
    assert pin.buildModelFromXML(d.xml).names[1] == "Gelenk_ä"


def test_namespaces_and_foreign_elements_are_left_behind(tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    head = '<robot name="r" xmlns="http://ros.org/urdf" xmlns:s="urn:s">'
    extra = (
        '<s:link name="x"/><gazebo><joint name="j"/><link name="a"/></gazebo>'
        '<sensor name="a"/><!-- <link/> -->'
    )
    path.write_text(robot(links("a", "b"), extra, joint(), head=head))
    d = rp.Robot.load(path).description
    assert d.links == ("a", "b")
    assert pin.buildModelFromXML(d.xml).nq == 1


@pytest.mark.parametrize("every", some([1, 6], 6))
def test_every_real_robot_passes_and_stays_what_it_was(every: int) -> None:
    """All 68 files that Pinocchio builds pass; only ur3.urdf, an empty shell, is refused.

    Quickly, each sixth file, and that one."""
    refused = []
    data = rp.Robot.load("panda").description.path.parents[2]
    files = sorted(data.rglob("*.urdf"))
    assert len(files) >= 69
    empty = [path for path in files if path.name == "ur3.urdf"]
    for path in sorted({*files[::every], *empty}):
        try:
            d = rp.Robot.load(path).description
        except rp.UrdfError as error:
            refused.append(path.name)
            assert "no <link>" in str(error)
            continue
        model, raw = pin.buildModelFromXML(d.xml), pin.buildModelFromUrdf(str(path))
        assert model.nq == model.nv == raw.nv, path
        for ours, theirs in zip(model.jointPlacements, raw.jointPlacements, strict=True):
            assert ours == theirs
        for ours, theirs in zip(model.inertias, raw.inertias, strict=True):
            assert ours == theirs
        assert tuple(model.names)[1:] == tuple(
            j.name for j in sorted_as(model, d) if j.kind != "fixed"
        )
        limits = {j.name: (j.lower, j.upper) for j in d.joints}
        for name, lower, upper in zip(
            model.names[1:], model.lowerPositionLimit, model.upperPositionLimit, strict=False
        ):
            assert (max(limits[name][0], -NO_LIMIT), min(limits[name][1], NO_LIMIT)) == (
                lower,
                upper,
            )
    assert refused == ["ur3.urdf"]


def sorted_as(model: pin.Model, d: object) -> list:
    """The joints of a description in Pinocchio's order."""
    order = {name: i for i, name in enumerate(model.names)}
    return sorted(d.joints, key=lambda j: order.get(j.name, -1))


@pytest.mark.parametrize("count", some([30, 200], 30))
def test_what_passes_pinocchio_reads(
    count: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Law, on damaged real files: refused in one line, or built by Pinocchio, which has no
    complaint."""
    dice = random.Random(33)
    junk = [
        "",
        "nan",
        "1e400",
        "-1",
        "0 0 0",
        "0",
        "x",
        "fixed",
        "continuous",
        "floating",
        "a b c d",
        "1 2 3",
        "${x}",
    ]
    sources = [rp.Robot.load(name).description.path for name in ("prr", "panda")]
    trees = [etree.parse(str(source)).getroot() for source in sources]
    outcomes = {"refused": 0, "built": 0}
    for _ in range(count):
        root = copy.deepcopy(dice.choice(trees))
        for _ in range(dice.choice((1, 1, 2))):
            element = dice.choice([e for e in root.iterdescendants() if isinstance(e.tag, str)])
            how = dice.randrange(4)
            if how == 0:
                element.getparent().remove(element)
            elif how == 1 and element.attrib:
                element.set(dice.choice(list(element.attrib)), dice.choice(junk))
            elif how == 2 and element.attrib:
                del element.attrib[dice.choice(list(element.attrib))]
            else:
                element.getparent().append(copy.deepcopy(element))
        path = tmp_path / "damaged.urdf"
        path.write_bytes(etree.tostring(root))
        try:
            d = rp.Robot.load(path).description
        except rp.UrdfError as error:
            outcomes["refused"] += 1
            assert str(error).isprintable() and re.search(r"line \d+: .+: .+", str(error)), error
            continue
        outcomes["built"] += 1
        model = pin.buildModelFromXML(d.xml)
        many = sum({"planar": 1, "floating": 1}.get(j.kind, 0) for j in d.joints)
        assert model.nq == model.nv + many
        assert model.njoints == 1 + sum(j.kind != "fixed" for j in d.joints)
        complaints = [c for c in capfd.readouterr().err.splitlines() if c.startswith("Error")]
        assert not complaints, etree.tostring(root)
    assert min(outcomes.values()) > 0.15 * count, outcomes
