"""What is inside an animation page: read back, against the motions and Pinocchio."""

from __future__ import annotations

import html
import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from arms import planar_urdf
from controls import some
from page_file import COLOURS, Drawn, circling, panes, read, unpack

import repctl_pin as rp

ROOT = Path(__file__).parents[2]


@cache
def known(name: str) -> tuple[dict[str, rp.Motion], str, Drawn]:
    """Two motions of an arm, their page, and what it draws, made once."""
    flat = name == "ppr"
    task = rp.Robot.load(name).task(kind="xy" if flat else "pose")
    start = [0.0, 0.0, 0.5] if flat else task.reference
    radius = 0.3 if flat else 0.05
    motions = circling(task, start, radius=radius, steps=20, other="nearest repeatable")
    return motions, rp.animation(motions, seconds=4.0).page, Drawn(task.robot)


def fastest_in_the_self_motion(task: rp.Task, q: np.ndarray) -> int:
    """The elbow: of the revolute joints in the middle of the arm, if there are any, the fastest."""
    step = 1e-6 * np.linalg.svd(task.jacobian(q))[2][-1]
    ways = task.joint_origins(q + step) - task.joint_origins(q - step)
    stations = np.vstack([task.joint_origins(q), task.placement(q).translation])
    along = np.cumsum(np.linalg.norm(np.diff(stations, axis=0), axis=1))
    share = np.append(0.0, along[:-1]) / along[-1]
    middle = (share >= 0.3) & (share <= 0.7) & task.revolute
    speed = np.linalg.norm(ways[: task.n], axis=1)
    return int((speed * (middle if middle.any() else 1)).argmax())


@pytest.mark.parametrize("name", some(["panda", "talos", "ppr"], "ppr"))
def test_page_holds_what_went_in(name: str) -> None:
    motions, page, drawn = known(name)
    scene, _, numbers = read(page)
    arms, (path,) = panes(scene, numbers)
    task = motions["J⁺"].task
    assert scene["title"] == f"{task.robot.name}: {motions['J⁺'].path.name}"
    assert scene["caption"].startswith(f"{task.frame}: ") and scene["seconds"] == 4.0
    assert (scene["cycles"], scene["perCycle"], scene["problems"]) == ([1, 2], 21, [])
    assert scene["planar"] == (name == "ppr")
    rows = np.r_[:21, 20:41]  # of both cycles, both ends
    first = np.tile(np.r_[:20, 0], 2)  # the same moment of cycle 1
    for key, (label, motion), arm, told in zip(
        ("pseudoinverse", "repeatable"), motions.items(), arms, scene["arms"], strict=True
    ):
        assert (told["label"], told["color"]) == (label, COLOURS[key])
        assert told["drift"] == motion.drift.tolist()
        assert sorted(arm.names) == sorted(drawn.names)
        Q = task.to_robot(motion.q)
        expected = drawn.placements(Q[rows])
        np.testing.assert_allclose(arm.of(drawn), expected, atol=1e-6)
        np.testing.assert_allclose(arm.tip[:, 0], task.positions(motion.q[rows]), atol=1e-6)
        np.testing.assert_allclose(arm.joints, motion.q[rows], atol=1e-4)
        elbow = fastest_in_the_self_motion(task, motion.q[0])
        origins = [task.joint_origins(q)[elbow] for q in motion.q[rows]]
        np.testing.assert_allclose(arm.elbow[:, 0], origins, atol=1e-6)
        # how far each body of the part that is named is off its place in cycle 1, by the points
        # that the page measures with
        shapes = zip(told["shapes"], told["part"], strict=True)
        named = {shape["name"] for shape, its in shapes if its}
        ways = expected - drawn.placements(Q[first])
        off = np.zeros(len(rows))
        for k, body in enumerate(drawn.names):
            if body not in arm.points:
                assert np.ptp(expected[:, k], axis=0).max() < 1e-9
                continue
            every, few = drawn.points[k], arm.points[body]
            by_all, by_few = (
                np.linalg.norm(
                    np.c_[p, np.ones(len(p))] @ ways[:, k, :3].swapaxes(1, 2), axis=2
                ).max(axis=1)
                for p in (every, few)
            )
            np.testing.assert_allclose(by_few, by_all, atol=2e-6)
            off = np.maximum(off, by_all * (body in named))
        np.testing.assert_allclose(told["off"], off[[[0, 20], [21, 41]]], atol=2e-6)
    np.testing.assert_allclose(path, motions["J⁺"].path.points(), atol=1e-6)


@pytest.mark.slow
def test_every_body_is_sent_once() -> None:
    """Eleven shapes of panda, whose fingers are one mesh, for both arms together."""
    _, page, drawn = known("panda")
    scene, commands, _ = read(page)
    solids = dict(zip(drawn.names, drawn.solids, strict=True))
    sent = [c["path"] for c in commands if c["type"] == "set_object"]
    assert sent == [f"/library/{k}" for k in range(10)]
    for arm in scene["arms"]:
        files = {}
        for shape in arm["shapes"]:
            solid = solids[shape["name"]]
            files.setdefault(shape["body"], set()).add(solid.meshPath)
            assert shape["scale"] == solid.meshScale.tolist()
        assert sorted(files) == list(range(10))
        assert all(len(one) == 1 for one in files.values())


def test_a_mesh_goes_in_as_its_triangles() -> None:
    """As many as Pinocchio reads, of the same box and volume, with normals outward."""
    _, page, drawn = known("panda")
    scene, commands, _ = read(page)
    sent = {c["path"]: c["object"] for c in commands if c["type"] == "set_object"}
    solids = dict(zip(drawn.names, drawn.solids, strict=True))
    for shape in scene["arms"][0]["shapes"]:
        (geometry,) = sent[f"/library/{shape['body']}"]["geometries"]
        kept = geometry["data"]["attributes"]
        points = np.frombuffer(kept["position"]["array"].data, "<f4").reshape(-1, 3)
        normals = np.frombuffer(kept["normal"]["array"].data, "i1").reshape(-1, 3)
        index = geometry["data"]["index"]
        kind = {"Uint16Array": "<u2", "Uint32Array": "<u4"}[index["type"]]
        faces = np.frombuffer(index["array"].data, kind).reshape(-1, 3)
        triangles = points.astype(float)[faces]
        theirs = solids[shape["name"]].geometry
        corners, size = theirs.vertices(), np.ptp(theirs.vertices())
        assert 0.999 * theirs.num_tris < len(faces) <= theirs.num_tris  # but for needles
        for end in (np.min, np.max):
            np.testing.assert_allclose(end(triangles, axis=(0, 1)), end(corners, axis=0), atol=2e-6)
        volume = (
            np.einsum("fi,fi->", triangles[:, 0], np.cross(*triangles[:, 1:].swapaxes(0, 1))) / 6
        )
        assert volume == pytest.approx(theirs.computeVolume(), abs=1e-5 * size**3)
        flat = np.cross(*np.diff(triangles, axis=1).swapaxes(0, 1))
        size = np.linalg.norm(flat, axis=1)
        big = size > 1e-9
        turned = np.einsum(
            "fi,fci->fc", flat / np.maximum(size, 1e-9)[:, None], normals[faces] / 127
        )
        assert turned[big].min() > 0.7  # smoothed within 38°
        np.testing.assert_allclose(np.linalg.norm(normals / 127, axis=1), 1, atol=0.01)


def test_bodies_are_sent_as_meshcat_sends_them() -> None:
    import meshcat.geometry as g
    from meshcat.commands import SetObject
    from meshcat.path import Path as ScenePath

    _, page, drawn = known("ppr")
    scene, commands, _ = read(page)
    sent = {c["path"]: c for c in commands if c["type"] == "set_object"}
    for kind in ("Box", "Cylinder"):
        solid = next(s for s in drawn.solids if type(s.geometry).__name__ == kind)
        body = next(
            shape["body"] for shape in scene["arms"][0]["shapes"] if shape["name"] == solid.name
        )
        ours = sent[f"/library/{body}"]
        shape = solid.geometry
        theirs = (
            g.Box((2 * shape.halfSide).tolist())
            if kind == "Box"
            else g.Cylinder(2 * shape.halfLength, shape.radius)
        )
        expected = SetObject(g.Mesh(theirs), path=ScenePath(("library", str(body)))).lower()
        names = [expected["object"][part][0]["uuid"] for part in ("geometries", "materials")]
        names.append(expected["object"]["object"]["uuid"])
        text = json.dumps(expected)
        for number, name in enumerate(names):
            text = text.replace(name, str(number))
        expected = json.loads(text)
        matrix = ours["object"]["object"].pop("matrix")
        del expected["object"]["object"]["matrix"]
        sizes = ours["object"]["geometries"][0], expected["object"]["geometries"][0]
        for one in sizes:  # 0.3 is not twice 0.15 to the last bit
            one.update({k: round(v, 12) for k, v in one.items() if type(v) is float})
        assert ours == expected
        upright = np.reshape(matrix, (4, 4)).T @ [0, 1, 0, 0]  # three.js reads columns
        assert list(upright) == ([0, 1, 0, 0] if kind == "Box" else [0, 0, 1, 0])


def test_panda_is_small() -> None:
    assert len(known("panda")[1].encode()) < 6.5e6


def test_many_cycles_do_not_blow_the_page() -> None:
    task = rp.Robot.load("planar3r").task(kind="xy")
    q0 = np.array([0.3, 0.8, 0.8])
    path, pages = rp.circle(task, q0, 0.2), []
    for cycles in (10, 200):
        motion = rp.follow(rp.Pseudoinverse(task), path, q0, cycles=cycles, steps=30)
        pages.append(rp.animation({"J⁺": motion}).page)
    few, many = (read(page)[2].size for page in pages)
    assert few < many <= 2.4 * few  # numbers of 24 cycles, not of 200
    assert len(pages[1]) < 1.5 * len(pages[0])


EVIL = "</script><script>alert(1)</script><b>&amp;"


@pytest.fixture
def evil(tmp_path: Path) -> rp.Robot:
    """A robot and its tool with names that would be markup."""
    text = planar_urdf([1, 0.8, 0.6])
    for name in ('"planar"', '"tool"'):
        assert name in text
        text = text.replace(name, f'"{html.escape(EVIL)}"')
    (tmp_path / "evil.urdf").write_text(text, encoding="utf-8")
    return rp.Robot.load(tmp_path / "evil.urdf")


def test_page_is_self_contained_and_its_text_harmless(evil: rp.Robot) -> None:
    task = evil.task(EVIL, "xy")
    motions = circling(task, [0.3, 0.8, 0.8], radius=0.1, steps=8)
    label = EVIL + "\u2028\n" + EVIL
    page = rp.animation({label: motions["J⁺"]}).page
    assert "<script>alert" not in page
    assert "<b>&" not in page and "\u2028" not in page.partition('id="scene"')[2]
    scene, _, _ = read(page)
    assert scene["title"].startswith(f"{EVIL}: ")
    assert scene["caption"].startswith(f"{EVIL}: x and y, ")
    assert scene["arms"][0]["label"] == label
    assert not re.search(r"""(src|href)=["'](?!data:)""", page)
    # but in the packed data and in BibTeX
    packed = r'(?s)<script type="text/plain".*?</script>|<pre>@software.*?</pre>'
    assert "{{" not in re.sub(packed, "", page)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("pose", "position and orientation, 7 joints, 1 redundant"),
        ("axis", "position and tool axis, 7 joints, 2 redundant"),
        ("position", "position, 7 joints, 4 redundant"),
        ("xz", "x and z, 7 joints, 5 redundant"),
    ],
)
def test_what_a_task_controls_is_spelt_out(kind: str, words: str) -> None:
    task = rp.Robot.load(ROOT / "examples" / "my_arm.urdf").task(kind=kind)
    q0 = task.reference
    path = rp.polygon(task, q0, [[0.01, 0, 0], [0.01, 0, 0.01]])
    motion = rp.follow(rp.Pseudoinverse(task), path, q0, cycles=1, steps=4)
    scene, _, _ = read(rp.animation({"J⁺": motion}).page)
    assert scene["caption"] == f"{task.frame}: {words}"


def with_mesh(folder: Path, mesh: str) -> rp.Robot:
    """A planar arm one of whose boxes is a mesh, without a colour in the URDF."""
    text = (ROOT / "urdf" / "planar3r.urdf").read_text(encoding="utf-8")
    drawn, count = re.subn(
        r'(?s)<geometry><box size="[^"]*"/></geometry>\s*<material name="\w+"/>',
        f'<geometry><mesh filename="{mesh}"/></geometry>',
        text,
        count=1,
    )
    assert count == 1
    (folder / "arm.urdf").write_text(drawn, encoding="utf-8")
    return rp.Robot.load(folder / "arm.urdf")


def page_of(robot: rp.Robot) -> str:
    task = robot.task(kind="xy")
    motions = circling(task, [0.3, 0.8, 0.8], radius=0.1, steps=8)
    return rp.animation({"J⁺": motions["J⁺"]}).page


def test_a_body_that_cannot_be_read_is_said_and_the_rest_drawn(tmp_path: Path) -> None:
    (tmp_path / "broken.stl").write_bytes(b"not a mesh")
    scene, commands, _ = read(page_of(with_mesh(tmp_path, "broken.stl")))
    (problem,) = scene["problems"]
    assert str(tmp_path / "broken.stl") in problem
    told = scene["arms"][0]["shapes"]
    assert [s["name"] for s in told if s["body"] is None] == ["link1_1"]
    sent = [c for c in commands if c["type"] == "set_object"]
    assert len(sent) == len({s["body"] for s in told} - {None}) > 3


def test_no_name_of_the_pages_script_is_declared_twice() -> None:
    """Its modules are joined into one scope, in which the later of two would silently take the
    place of the first."""
    page = known("ppr")[1]
    packed = re.search(r'(?s)<script type="text/plain" id="code">(.*?)</script>', page)
    begin = re.search(r"(?s)<script>(.*?)</script>", page)
    assert packed and begin
    script = begin[1] + unpack(packed[1]).decode()
    assert not re.search(r"(?m)^(import|export) ", script)
    folder = Path(rp.__file__).parent / "show" / "page" / "assets" / "scripts"
    declared = re.compile(r"(?m)^(?:export )?(?:async )?(?:function|class|const|let) +(\w+)")
    by_file = {f.stem: declared.findall(f.read_text("utf-8")) for f in folder.rglob("*.js")}
    names = [name for found in by_file.values() for name in found]
    assert len(names) > 50 and sorted(names) == sorted(set(names))
    left_out = {stem for stem, found in by_file.items() if not all(n in script for n in found)}
    assert left_out == {"live", "cover", "potentials", "table"}  # of the live viewer and of cells


def test_every_limb_leaves_its_traces_and_what_is_violated_is_marked(tmp_path: Path) -> None:
    """Two hands of a robot without its meshes, which a page holds for long; one of them leaves the
    limits of a joint."""
    text = rp.Robot.load("baxter").description.xml
    bones = tmp_path / "bones.urdf"
    bones.write_text(re.sub(r"(?s)<(visual|collision)\b.*?</\1>", "", text), "utf-8")
    robot, done = rp.Robot.load(bones), {}
    for side in ("left", "right"):
        task = robot.task(f"{side}_gripper")
        path = rp.circle(task, task.reference, 0.02)
        done[side] = rp.follow(rp.Pseudoinverse(task), path, task.reference, cycles=1, steps=10)
    left, right = (motion.task for motion in done.values())
    q = done["left"].q.copy()
    q[7:, 2] += left.upper[2] - q[7, 2] + 0.1
    done["left"] = replace(done["left"], q=q)
    scene, _, numbers = read(rp.animation(done).page)
    arms, paths = panes(scene, numbers)
    for motion, path in zip(done.values(), paths, strict=True):
        np.testing.assert_allclose(path, motion.path.points(), atol=1e-6)
    for motion, arm in zip(done.values(), arms, strict=True):
        whole = motion.task.to_robot(motion.q)
        for k, task in enumerate((left, right)):
            Q = np.array([task.from_robot(row) for row in whole])
            np.testing.assert_allclose(arm.tip[:, k], task.positions(Q), atol=1e-6)
            elbow = fastest_in_the_self_motion(task, Q[0])
            origins = np.array([task.joint_origins(row) for row in Q])
            np.testing.assert_allclose(arm.elbow[:, k], origins[:, elbow], atol=1e-6)
    broken = scene["arms"][0]["broken"]
    name = left.joint_names[2]
    assert broken["words"] == f"{name} past its limit" and broken["cycle"] == 1
    assert broken["at"] == pytest.approx(0.7)
    origins = [left.joint_origins(row)[2] for row in q]
    np.testing.assert_allclose(arms[0].origin, origins, atol=1e-6)
    assert scene["arms"][1]["broken"] is None
    assert "left_gripper" in scene["caption"] and "right_gripper" in scene["caption"]
