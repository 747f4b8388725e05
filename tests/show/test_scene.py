"""What is inside an animation page: read back, against what went in."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import umsgpack
from page_file import BLUE, Visuals, read, summed
from test_surfaces import DAE

import repctl_pin as rp
from repctl_pin.robot.visuals import Shape
from repctl_pin.show.page import (
    Arm,
    animation_page,
    choose_frames,
    key,
    poses_of,
    read_surface,
)
from repctl_pin.show.page import html as page_html
from repctl_pin.show.page.body_points import corners
from repctl_pin.show.page.html import differences, pack
from repctl_pin.show.page.meshes import record

PATH = np.stack(
    [np.cos(np.linspace(0, 6.3, 50)), np.sin(np.linspace(0, 6.3, 50)), np.zeros(50)], 1
)
WORDS: dict[str, Any] = {"seconds": 4.0, "title": "a title", "caption": "a caption"}


def swinging(name: str, cycles: int = 2, steps: int = 20) -> tuple[Arm, Arm]:
    """Two arms, all joints swinging a little round the reference; numbers enough for a page."""
    robot = rp.Robot.load(name)
    visuals = Visuals.of(robot)
    s = np.linspace(0, cycles, cycles * steps + 1)
    Q = robot.reference + 0.2 * np.sin(2 * np.pi * s)[:, None] * np.cos(
        np.arange(len(robot.reference))
    )
    placements = visuals.placements(Q)
    drift = 0.1 * np.arange(1, cycles + 1)
    tip, elbow = placements[:, -1:, :3, 3], placements[:, 1:2, :3, 3]
    first = Arm("J⁺", visuals.shapes, placements, tip, elbow, drift)
    return first, replace(
        first, label="repeatable", color=BLUE, cycle_drift=1e-13 * drift
    )


def page_of(arms: Sequence[Arm], **words: Any) -> str:
    """The page of arms that hold all samples of all cycles."""
    frames = choose_frames(len(arms[0].tip), len(arms[0].cycle_drift))
    shown = [
        replace(
            a,
            **{
                name: getattr(a, name)[frames.index]
                for name in ("placements", "tip", "elbow")
            },
        )
        for a in arms
    ]
    return animation_page(shown, [PATH], frames=frames, **(WORDS | words))


def vertices(shape: Shape) -> np.ndarray:
    """Every point of a mesh, or the corners that stand for another shape."""
    if shape.kind == "mesh":
        return read_surface(shape.path).points * shape.scale
    return corners([shape])[0]


def matrices(poses: np.ndarray) -> np.ndarray:
    """Poses (T, M, 7) as matrices (T, M, 4, 4), by Pinocchio."""
    return np.array(
        [[pin.XYZQUATToSE3(p).homogeneous for p in row] for row in poses.astype(float)]
    )


@cache
def known(name: str) -> tuple[tuple[Arm, Arm], str]:
    """Two swinging arms and their page, made once."""
    arms = swinging(name)
    return arms, page_of(arms)


@pytest.mark.parametrize(
    "name", ["panda", pytest.param("talos", marks=pytest.mark.slow), "ppr"]
)
def test_page_holds_what_went_in(name: str) -> None:
    arms, page = known(name)
    frames = choose_frames(41, 2)
    scene, commands, motion = read(page)
    assert (scene["title"], scene["caption"], scene["seconds"]) == (
        "a title",
        "a caption",
        4.0,
    )
    assert (scene["cycles"], scene["perCycle"], scene["problems"]) == ([1, 2], 21, [])
    # every distinct body once, for both arms together
    sent = [c for c in commands if c["type"] == "set_object"]
    bodies = list(dict.fromkeys(key(s) for s in arms[0].shapes))
    assert [c["path"] for c in sent] == [f"/library/{k}" for k in range(len(bodies))]
    at = 0
    for arm, told in zip(arms, scene["arms"], strict=True):
        assert (told["label"], told["color"]) == (arm.label, arm.color)
        np.testing.assert_allclose(told["drift"], arm.cycle_drift)
        assert [s["name"] for s in told["shapes"]] == [s.name for s in arm.shapes]
        assert [bodies[s["body"]] for s in told["shapes"]] == [
            key(s) for s in arm.shapes
        ]
        assert [s["scale"] for s in told["shapes"]] == [
            list(s.scale) for s in arm.shapes
        ]
        expected = arm.placements[frames.index]
        moving = [k for k, s in enumerate(told["shapes"]) if s["pose"] is None]
        size = len(frames.index) * len(moving) * 7
        poses = motion[at : at + size].reshape(len(frames.index), len(moving), 7)
        np.testing.assert_allclose(matrices(poses), expected[:, moving], atol=1e-6)
        for k, shape in enumerate(told["shapes"]):
            if shape["pose"] is not None:
                still = matrices(np.array(shape["pose"])[None, None])[0, 0]
                np.testing.assert_allclose(
                    np.broadcast_to(still, expected[:, k].shape),
                    expected[:, k],
                    atol=1e-6,
                )
        at += size
        for point in (arm.tip[:, 0], arm.elbow[:, 0]):
            np.testing.assert_allclose(
                motion[at : at + 3 * len(frames.index)].reshape(-1, 3),
                point[frames.index],
                atol=1e-6,
            )
            at += 3 * len(frames.index)
        # how far each body is off its place in cycle 1, by the points that the page measures with
        first = np.tile(np.r_[:20, 0], 2)  # the same moment of cycle 1
        expected_off = np.zeros(len(frames.index))
        for k, (shape, drawn) in enumerate(
            zip(told["shapes"], arm.shapes, strict=True)
        ):
            if shape["pose"] is not None:
                continue
            points = motion[at : at + 3 * shape["points"]].reshape(-1, 3)
            at += 3 * shape["points"]
            every = vertices(drawn)
            for rows, found in ((every, expected_off), (points, np.zeros(len(first)))):
                moved = np.c_[rows, np.ones(len(rows))] @ (expected - expected[first])[
                    :, k
                ].swapaxes(1, 2)
                np.maximum(found, np.linalg.norm(moved, axis=2).max(axis=1), out=found)
        ends = expected_off[[[0, 20], [21, 41]]]
        np.testing.assert_allclose(told["off"], ends, atol=2e-6)
    np.testing.assert_allclose(motion[at:].reshape(-1, 3), PATH, atol=1e-6)


def test_bodies_are_sent_as_meshcat_sends_them() -> None:
    import meshcat.geometry as g
    from meshcat.commands import SetObject
    from meshcat.path import Path as ScenePath

    shape = next(shape for shape in swinging("ppr")[0].shapes if shape.kind == "box")
    sizes = {"box": (0.1, 0.2, 0.3), "cylinder": (0.05, 0.4)}
    shapes = [
        replace(shape, kind=kind, size=size, path=None) for kind, size in sizes.items()
    ]
    commands = [umsgpack.unpackb(command) for command in record(shapes)[0]]
    sent = [command for command in commands if command["type"] == "set_object"]
    theirs = [g.Mesh(g.Box([0.1, 0.2, 0.3])), g.Mesh(g.Cylinder(0.4, 0.05))]
    for k, (ours, mesh) in enumerate(zip(sent, theirs, strict=True)):
        expected = SetObject(mesh, path=ScenePath(("library", str(k)))).lower()
        names = [
            expected["object"][part][0]["uuid"] for part in ("geometries", "materials")
        ]
        names.append(expected["object"]["object"]["uuid"])
        text = json.dumps(expected)
        for number, name in enumerate(names):
            text = text.replace(name, str(number))
        expected = json.loads(text)
        matrix = ours["object"]["object"].pop("matrix")
        del expected["object"]["object"]["matrix"]
        assert ours == expected
        upright = np.reshape(matrix, (4, 4)).T @ [0, 1, 0, 0]  # three.js reads columns
        assert list(upright) == ([0, 1, 0, 0] if k == 0 else [0, 0, 1, 0])


def test_a_mesh_goes_in_as_its_triangles() -> None:
    arms, page = known("panda")
    _, commands, _ = read(page)
    sent = {c["path"]: c["object"] for c in commands if c["type"] == "set_object"}
    bodies = list(dict.fromkeys(key(s) for s in arms[0].shapes))
    assert len(bodies) == 10  # eleven shapes; the fingers are one mesh
    for k, (kind, path) in enumerate(bodies):
        assert kind == "mesh"
        (geometry,) = sent[f"/library/{k}"]["geometries"]
        data = geometry["data"]
        points = np.frombuffer(
            data["attributes"]["position"]["array"].data, "<f4"
        ).reshape(-1, 3)
        index = data["index"]
        faces = np.frombuffer(
            index["array"].data,
            {"Uint16Array": "<u2", "Uint32Array": "<u4"}[index["type"]],
        )
        surface = read_surface(Path(path))
        np.testing.assert_allclose(points, surface.points, atol=1e-6)
        np.testing.assert_array_equal(faces.reshape(-1, 3), surface.faces)
        normals = (
            np.frombuffer(data["attributes"]["normal"]["array"].data, "i1").reshape(
                -1, 3
            )
            / 127
        )
        np.testing.assert_allclose(normals, surface.normals, atol=0.01)


def test_panda_is_small() -> None:
    assert len(known("panda")[1].encode()) < 6.5e6


def test_many_cycles_do_not_blow_the_page() -> None:
    pages = [page_of(swinging("planar3r", k, 60)) for k in (10, 200)]
    few, many = (read(page)[2].size for page in pages)
    assert few < many <= 2.4 * few  # numbers of 24 cycles, not of 200
    assert len(pages[1]) < 1.5 * len(pages[0])


def test_page_is_self_contained_and_its_text_harmless() -> None:
    arms = swinging("planar3r")
    evil = "</script><script>alert(1)</script><b>&amp;"
    arms = (replace(arms[0], label=evil, unit=evil), arms[1])
    page = page_of(arms, seconds=1, title=evil, caption=evil + "\u2028\n" + evil)
    assert "<script>alert" not in page
    assert "<b>" not in page
    scene, _, _ = read(page)
    assert (scene["title"], scene["arms"][0]["label"]) == (evil, evil)
    assert scene["caption"] == evil + "\u2028\n" + evil
    assert not re.search(r"""(src|href)=["'](?!data:)""", page)
    assert "{{" not in re.sub(r'(?s)<script type="text/plain".*?</script>', "", page)


@pytest.mark.parametrize(
    ("samples", "cycles"),
    [(101, 1), (5001, 10), (4, 3), (100_001, 200), (241, 24), (251, 25)],
)
def test_choose_frames(samples: int, cycles: int) -> None:
    frames = choose_frames(samples, cycles)
    steps = (samples - 1) // cycles
    numbers = np.array(frames.cycles)
    assert (np.diff(numbers) > 0).all()
    assert (numbers[0], numbers[-1]) == (1, cycles)
    assert len(numbers) == cycles if cycles <= 24 else 12 <= len(numbers) <= 24
    assert len(set(np.diff(numbers)[1:].tolist())) <= 1  # evenly, from the last back
    table = frames.index.reshape(len(numbers), frames.per_cycle)
    np.testing.assert_array_equal(
        table[:, 0], (numbers - 1) * steps
    )  # both ends of every cycle
    np.testing.assert_array_equal(table[:, -1], numbers * steps)
    assert (np.diff(table, axis=1) > 0).all()
    assert min(31, steps + 1) <= frames.per_cycle <= min(61, steps + 1)
    assert (
        len(np.unique(np.diff(table, axis=1))) == 1
    )  # these steps have such a divisor


def test_choose_frames_wants_whole_cycles() -> None:
    with pytest.raises(rp.InputError, match="equal steps"):
        choose_frames(102, 3)


def test_poses_are_exact_and_do_not_jump() -> None:
    rng = np.random.default_rng(0)
    turns = [pin.exp3(v) for v in rng.normal(size=(300, 3)) * 2]
    turns += [pin.exp3(np.pi * axis) for axis in np.eye(3)] + [np.eye(3)]  # half turns
    M = np.tile(np.eye(4), (len(turns), 1, 1, 1))
    M[:, 0, :3, :3] = turns
    M[:, 0, :3, 3] = rng.normal(size=(len(turns), 3))
    np.testing.assert_allclose(matrices(poses_of(M)), M, atol=1e-14)
    # a steady turn of two revolutions: the quaternion never changes sign
    steady = np.tile(np.eye(4), (400, 1, 1, 1))
    steady[:, 0, :3, :3] = [
        pin.exp3(a * np.array([0.6, 0, 0.8])) for a in np.linspace(0, 4 * np.pi, 400)
    ]
    q = poses_of(steady)[:, 0, 3:]
    assert np.abs(np.diff(q, axis=0)).max() < 0.02


def test_a_body_that_cannot_be_read_is_said_and_the_rest_drawn(tmp_path: Path) -> None:
    first, _ = swinging("planar3r")
    broken = tmp_path / "broken.stl"
    broken.write_bytes(b"not a mesh")
    shapes = (Shape("odd", "mesh", path=broken), *first.shapes[1:])
    scene, commands, _ = read(page_of([replace(first, shapes=shapes)]))
    (problem,) = scene["problems"]
    assert str(broken) in problem
    told = scene["arms"][0]["shapes"]
    assert [s["name"] for s in told if s["body"] is None] == ["odd"]
    sent = [c for c in commands if c["type"] == "set_object"]
    assert len(sent) == len({key(s) for s in first.shapes[1:]})


def test_a_texture_goes_into_the_page(tmp_path: Path) -> None:
    from PIL import Image

    Image.new("RGB", (8, 8), (0, 200, 0)).save(tmp_path / "paint.png")
    (tmp_path / "two.dae").write_text(DAE)
    first, _ = swinging("planar3r")
    shapes = (
        Shape("two", "mesh", path=tmp_path / "two.dae", textured=True),
        *first.shapes[1:],
    )
    scene, commands, _ = read(page_of([replace(first, shapes=shapes)]))
    sent = next(
        c["object"]
        for c in commands
        if c["path"] == f"/library/{scene['arms'][0]['shapes'][0]['body']}"
    )
    assert scene["arms"][0]["shapes"][0]["color"] is None
    materials = {m["uuid"]: m for m in sent["materials"]}
    maps = [materials[uuid].get("map") for uuid in sent["object"]["material"]]
    assert [m is not None for m in maps].count(True) == 1
    (texture,) = sent["textures"]
    (image,) = sent["images"]
    assert texture["uuid"] in maps
    assert texture["image"] == image["uuid"]
    assert image["url"].startswith("data:image/jpeg;base64,/9j/")


def test_no_two_modules_of_the_page_share_a_name() -> None:
    """They are joined into one scope, in which the later of two would silently take the place of
    the first."""
    folder = Path(page_html.__file__).parent / "assets" / "scripts"
    assert sorted(page_html.SCRIPTS) == sorted(
        file.stem for file in folder.glob("*.js")
    )
    declared = r"^(?:export )?(?:async )?(?:function|class|const|let) +(\w+)"
    names = [
        name
        for file in folder.glob("*.js")
        for name in re.findall(declared, file.read_text("utf-8"), flags=re.MULTILINE)
    ]
    assert sorted(names) == sorted(set(names))


@pytest.mark.parametrize("size", [1.0, 5000.0])  # 5 km: beyond 32 bits of 0.1 µm
def test_numbers_of_a_page_come_back(size: float) -> None:
    rng = np.random.default_rng(0)
    series = [rng.uniform(-size, size, shape) for shape in ((50, 7), (0, 3), (2, 3))]
    data, unit = differences(series)
    back = summed(data, [list(s.shape) for s in series], unit)
    assert unit <= max(1e-7, 2e-9 * size)
    np.testing.assert_allclose(
        back, np.concatenate([s.ravel() for s in series]), atol=0.51 * unit, rtol=0
    )
    smooth = np.sin(np.linspace(0, 6, 501))[:, None]
    assert len(pack(differences([smooth])[0])) < 0.25 * len(pack(smooth.astype("<f4")))
