"""Formulas of the page room, from inside: mesh files as triangles, the samples that are shown,
poses, packed numbers and colours. What a whole page holds is tested from outside."""

from __future__ import annotations

import os
import re
import struct
import sys
import zipfile
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from controls import some
from page_file import COLOURS, matrices, summed
from PIL import Image

import repctl_pin as rp
from repctl_pin.model.surfaces import distinct, read_surface, smooth
from repctl_pin.show.page import html, scene
from repctl_pin.show.palette import luminance, readable


def sphere(n: int = 40) -> np.ndarray:
    """Triangles (F, 3, 3) of a fine unit sphere, outward."""
    polar, turn = np.meshgrid(
        np.linspace(0, np.pi, n), np.linspace(0, 2 * np.pi, 2 * n), indexing="ij"
    )
    P = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], -1)
    a, b, c, d = P[:-1, :-1], P[:-1, 1:], P[1:, :-1], P[1:, 1:]
    return np.concatenate(
        [np.stack([a, c, b], 2).reshape(-1, 3, 3), np.stack([b, c, d], 2).reshape(-1, 3, 3)]
    )


def write_stl(path: Path, triangles: np.ndarray) -> None:
    record = np.zeros(
        len(triangles), [("normal", "<f4", 3), ("points", "<f4", (3, 3)), ("extra", "<u2")]
    )
    record["points"] = triangles
    path.write_bytes(bytes(80) + struct.pack("<I", len(triangles)) + record.tobytes())


def cube() -> np.ndarray:
    """Triangles (12, 3, 3) of a unit cube round the origin, outward."""
    faces = []
    for axis in range(3):
        for side in (-0.5, 0.5):
            u, v = np.eye(3)[(axis + 1) % 3] / 2, np.eye(3)[(axis + 2) % 3] / 2
            centre = side * np.eye(3)[axis]
            a, b, c, d = centre - u - v, centre + u - v, centre + u + v, centre - u + v
            faces += [[a, b, c], [a, c, d]] if side > 0 else [[a, c, b], [a, d, c]]
    return np.array(faces)


def test_surfaces_are_read_from_the_cache_unless_textures_colour_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same bits, also from a damaged cache; a changed file is read again."""
    kept = tmp_path / "cache" / "repctl_pin" / "meshes"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    ball = trimesh.creation.icosphere(2)
    ball.export(tmp_path / "one.stl")
    first = read_surface(tmp_path / "one.stl")
    (file,) = kept.iterdir()
    for k, content in enumerate((file.read_bytes(), b"", file.read_bytes()[:400])):
        file.write_bytes(content)
        ball.export(tmp_path / f"copy{k}.stl")
        same = read_surface(tmp_path / f"copy{k}.stl")
        for name in ("points", "normals", "colors", "faces"):
            assert np.array_equal(getattr(same, name), getattr(first, name))
    assert len([*kept.iterdir()]) == 1
    ball.apply_scale(2).export(tmp_path / "twice.stl")
    assert np.allclose(read_surface(tmp_path / "twice.stl").points, 2 * first.points, atol=1e-4)
    with pytest.raises(rp.InputError, match="over 100 triangles"):
        read_surface(tmp_path / "one.stl", 100)
    trimesh.creation.box().export(tmp_path / "box.dae")
    text = (tmp_path / "box.dae").read_text(encoding="utf-8")
    image = '<library_images><image id="i"><init_from>red.png</init_from></image></library_images>'
    text = text.replace("<library_geometries", image + "<library_geometries")
    (tmp_path / "box.dae").write_text(text, encoding="utf-8")
    count = len([*kept.iterdir()])
    read_surface(tmp_path / "box.dae")
    assert len([*kept.iterdir()]) == count


def test_round_surfaces_are_smooth_and_edges_sharp(tmp_path: Path) -> None:
    write_stl(tmp_path / "ball.stl", sphere())  # its normals are zero, as in many files
    ball = read_surface(tmp_path / "ball.stl")
    radial = ball.points / np.linalg.norm(ball.points, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", ball.normals, radial).min() > np.cos(np.deg2rad(6))
    write_stl(tmp_path / "cube.stl", cube())
    box = read_surface(tmp_path / "cube.stl")
    assert len(box.points) == 24  # each corner once a face
    triangles = box.points[box.faces]
    flat = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    np.testing.assert_allclose(box.normals[box.faces], np.repeat(flat[:, None], 3, 1), atol=1e-9)


def test_smooth_is_the_mean_over_the_faces_within_the_angle() -> None:
    """A crumpled sheet, some of it flat and some with creases, against pairs of corners."""
    rng = np.random.default_rng(0)
    x, y = (a.ravel() for a in np.meshgrid(np.arange(9.0), np.arange(9.0)))
    points = np.c_[x, y, np.where(x < 4, 0.05, 1.2) * rng.normal(size=len(x))]
    first = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    faces = np.r_[np.c_[first, first + 1, first + 9], np.c_[first + 1, first + 10, first + 9]]
    a, b, c = points[faces].swapaxes(0, 1)
    flat = np.cross(b - a, c - a)
    unit = flat / np.linalg.norm(flat, axis=1, keepdims=True)
    corners = faces.ravel()
    sums = np.zeros((len(corners), 3))
    for k, corner in enumerate(corners):
        near = np.flatnonzero(corners == corner) // 3
        sums[k] = flat[near[unit[near] @ unit[k // 3] > np.cos(np.deg2rad(38))]].sum(axis=0)
    expected = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    np.testing.assert_allclose(smooth(points[corners], flat), expected, atol=1e-12)


def test_smooth_weighs_faces_by_area() -> None:
    # two faces round one edge, 30° apart, one of them twice as long
    t = np.deg2rad(30)
    a, b = np.zeros(3), np.array([0.0, 1, 0])
    left, right = np.array([-2.0, 0, 0]), np.array([np.cos(t), 0, -np.sin(t)])
    corners = np.array([left, a, b, a, right, b])
    flat = np.array([np.cross(a - left, b - left), np.cross(right - a, b - a)])
    mean = flat.sum(0) / np.linalg.norm(flat.sum(0))
    normals = smooth(corners, flat)
    np.testing.assert_allclose(normals[[1, 2, 3, 5]], np.tile(mean, (4, 1)), atol=1e-12)
    np.testing.assert_allclose(normals[0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(normals[4], flat[1], atol=1e-12)


@pytest.mark.parametrize(
    "name", some(["panda", "ur5", "baxter", "kinova", "talos"], "panda", "kinova")
)
def test_surfaces_are_as_large_as_pinocchios(name: str) -> None:
    import coal

    robot = rp.Robot.load(name)
    named = {name.split("package://")[-1].lstrip("/") for name in robot.description.meshes}
    paths = {
        file
        for folder in robot.package_dirs
        for mesh in named
        if (file := Path(folder) / mesh).exists()
    }
    assert len(paths) >= 6
    for path in sorted(paths, key=lambda p: p.stat().st_size)[:6]:
        mesh = coal.MeshLoader().load(str(path), np.ones(3))
        mesh.computeLocalAABB()
        surface = read_surface(path)
        used = surface.points[np.unique(surface.faces)]
        size = np.abs(mesh.aabb_local.max_ - mesh.aabb_local.min_).max()
        np.testing.assert_allclose(
            used.min(0), mesh.aabb_local.min_, atol=1e-4 * size, err_msg=path.name
        )
        np.testing.assert_allclose(
            used.max(0), mesh.aabb_local.max_, atol=1e-4 * size, err_msg=path.name
        )


DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="centimeter" meter="0.01"/><up_axis>Y_UP</up_axis></asset>
<library_images><image id="i"><init_from>paint.png</init_from></image></library_images>
<library_effects><effect id="red"><profile_COMMON><technique sid="c"><phong><diffuse>
<color>1 0 0 1</color></diffuse>
</phong></technique></profile_COMMON></effect>
<effect id="pic"><profile_COMMON><newparam sid="s"><surface type="2D"><init_from>i</init_from>
</surface></newparam>
<newparam sid="t"><sampler2D><source>s</source></sampler2D></newparam><technique sid="c"><phong>
<diffuse>
<texture texture="t" texcoord="UV"/></diffuse></phong></technique></profile_COMMON></effect>
</library_effects>
<library_materials><material id="mr"><instance_effect url="#red"/></material>
<material id="mp"><instance_effect url="#pic"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 100 0 0 100 200 0 0 200 0</float_array>
<technique_common>
<accessor source="#pa" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<source id="u"><float_array id="ua" count="8">0 0 1 0 1 1 0 1</float_array><technique_common>
<accessor source="#ua" count="4" stride="2"><param name="S" type="float"/>
<param name="T" type="float"/></accessor>
</technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles material="a" count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p>
</triangles>
<triangles material="b" count="1"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#u" offset="1" set="0"/><p>0 0 2 2 3 3</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><translate>0 0 50</translate>
<instance_geometry url="#g"><bind_material>
<technique_common><instance_material symbol="a" target="#mr"/>
<instance_material symbol="b" target="#mp"/>
</technique_common></bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def test_collada_units_colours_and_textures(tmp_path: Path) -> None:
    paint = Image.new("RGB", (8, 8), (255, 255, 255))
    colors = {(0, 7): (153, 102, 51), (7, 0): (0, 0, 255), (0, 0): (0, 255, 0)}
    for pixel, color in colors.items():  # counted from the top left corner
        paint.putpixel(pixel, color)
    paint.save(tmp_path / "paint.png")
    (tmp_path / "two.dae").write_text(DAE)
    surface = read_surface(tmp_path / "two.dae")
    # a plate of 1 m × 2 m, lifted by 0.5 m; up_axis is not obeyed, as nowhere in ROS
    np.testing.assert_allclose(surface.points.min(0), [0, 0, 0.5], atol=1e-4)
    np.testing.assert_allclose(surface.points.max(0), [1, 2, 0.5], atol=1e-4)
    red, green, blue, brown = np.eye(3)[0], np.eye(3)[1], np.eye(3)[2], [0.6, 0.4, 0.2]
    places = {(0, 0): brown, (1, 2): blue, (0, 2): green}  # of the texture
    plain, painted = surface.faces
    assert (surface.colors[plain] == red).all()
    for point, color in zip(surface.points[painted], surface.colors[painted], strict=True):
        wanted = places[tuple(np.round(point[:2]).astype(int).tolist())]
        np.testing.assert_allclose(color, wanted, atol=1e-2)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    bad = tmp_path / "bad.dae"
    bad.write_text("<COLLADA><broken")
    with pytest.raises(rp.InputError, match=r"bad\.dae cannot be read"):
        read_surface(bad)
    empty = tmp_path / "empty.stl"
    write_stl(empty, np.zeros((0, 3, 3)))
    with pytest.raises(rp.InputError, match=r"empty\.stl"):
        read_surface(empty)


def test_odd_meshes_are_one_line_each(tmp_path: Path) -> None:
    """Infinite corners, units that are none, archives, pipes beside them, sizes that cannot be
    drawn."""
    infinite = cube()
    infinite[0, 0, 0] = np.inf
    write_stl(tmp_path / "infinite.stl", infinite)
    for meter in ("nan", "0", "-1", "inf", "one"):
        (tmp_path / f"unit_{meter}.dae").write_text(DAE.replace('meter="0.01"', f'meter="{meter}"'))
    with zipfile.ZipFile(tmp_path / "mesh.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("m.stl", bytes(10_000_000))
    (tmp_path / "huge.stl").write_bytes(b"")
    os.truncate(tmp_path / "huge.stl", 50_000_001)
    os.mkfifo(tmp_path / "pipe.stl")
    expected = {
        "infinite.stl": "not finite",
        "mesh.zip": "unsupported format",
        "huge.stl": "larger than 50 MB",
    }
    expected |= {"pipe.stl": "not a regular file"}
    expected |= {
        f"unit_{meter}.dae": "has the unit of length" for meter in ("nan", "0", "-1", "inf", "one")
    }
    for name, words in expected.items():
        with pytest.raises(rp.InputError, match=words) as caught:
            read_surface(tmp_path / name)
        assert str(caught.value).startswith(f"mesh {tmp_path / name} ")


def test_a_pipe_that_a_mesh_names_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mtl")
    (tmp_path / "m.obj").write_text(
        "mtllib pipe.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    )
    assert len(read_surface(tmp_path / "m.obj").faces) == 1


def test_a_decimal_comma_in_a_unit_is_read(tmp_path: Path) -> None:
    (tmp_path / "comma.dae").write_text(DAE.replace('meter="0.01"', 'meter="0,01"'))
    (tmp_path / "point.dae").write_text(DAE)
    comma, point = (read_surface(tmp_path / f"{name}.dae").points for name in ("comma", "point"))
    np.testing.assert_array_equal(comma, point)


def test_too_many_triangles_are_left_out(tmp_path: Path) -> None:
    write_stl(tmp_path / "cube.stl", cube())
    with pytest.raises(rp.InputError, match="over 11 triangles"):
        read_surface(tmp_path / "cube.stl", 11)
    assert len(read_surface(tmp_path / "cube.stl", 12).faces) == 12


def test_what_no_longer_fits_on_a_page_is_left_out_with_the_limit_of_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not with what is left of the limit, as if that were the limit of a file."""
    surfaces = sys.modules[read_surface.__module__]
    monkeypatch.setattr(surfaces, "_MOST_IN_ALL", 25)
    paths = [tmp_path / f"{name}.stl" for name in "abcd"]
    for path in paths[:3]:
        write_stl(path, cube())
    write_stl(paths[3], cube()[:1])
    shapes = [surfaces.Shape("link_0", "link", "mesh", path=path) for path in paths]
    found = surfaces.read_surfaces(shapes)
    assert [len(getattr(found[path], "faces", [])) for path in paths] == [12, 12, 0, 1]
    assert str(found[paths[2]]).endswith(
        "c.stl is left out: with it, the page would have over 25 triangles; simplify the meshes"
    )


def test_equal_rows_are_one_row_the_first_of_them() -> None:
    rng = np.random.default_rng(0)
    for columns, largest in ((1, 3), (3, 4), (11, 2), (3, 2**40)):
        rows = rng.integers(-largest, largest, (500, columns))
        first, group = distinct(rows)
        assert len(first) == len(np.unique(rows, axis=0))
        assert (rows[first][group] == rows).all()
        assert all(np.flatnonzero(group == k)[0] == at for k, at in enumerate(first))
    first, group = distinct(np.empty((0, 3), np.int64))
    assert len(first) == len(group) == 0


@pytest.mark.parametrize(
    ("samples", "cycles"), [(101, 1), (5001, 10), (4, 3), (100_001, 200), (241, 24), (251, 25)]
)
def test_choose_frames(samples: int, cycles: int) -> None:
    frames = scene.choose_frames(samples, cycles)
    steps = (samples - 1) // cycles
    numbers = np.array(frames.cycles)
    assert (np.diff(numbers) > 0).all()
    assert (numbers[0], numbers[-1]) == (1, cycles)
    assert len(numbers) == cycles if cycles <= 24 else 12 <= len(numbers) <= 24
    assert len(set(np.diff(numbers)[1:].tolist())) <= 1  # evenly, from the last back
    table = frames.index.reshape(len(numbers), frames.per_cycle)
    np.testing.assert_array_equal(table[:, 0], (numbers - 1) * steps)  # both ends of every cycle
    np.testing.assert_array_equal(table[:, -1], numbers * steps)
    assert (np.diff(table, axis=1) > 0).all()
    assert min(31, steps + 1) <= frames.per_cycle <= min(61, steps + 1)
    assert len(np.unique(np.diff(table, axis=1))) == 1  # these steps have such a divisor


def test_choose_frames_wants_whole_cycles() -> None:
    with pytest.raises(rp.InputError, match="equal steps"):
        scene.choose_frames(102, 3)


def test_poses_are_exact_and_do_not_jump() -> None:
    rng = np.random.default_rng(0)
    turns = [pin.exp3(v) for v in rng.normal(size=(300, 3)) * 2]
    turns += [pin.exp3(np.pi * axis) for axis in np.eye(3)] + [np.eye(3)]  # half turns
    M = np.tile(np.eye(4), (len(turns), 1, 1, 1))
    M[:, 0, :3, :3] = turns
    M[:, 0, :3, 3] = rng.normal(size=(len(turns), 3))
    np.testing.assert_allclose(matrices(scene.poses_of(M)), M, atol=1e-14)
    # a steady turn of two revolutions: the quaternion never changes sign
    steady = np.tile(np.eye(4), (400, 1, 1, 1))
    steady[:, 0, :3, :3] = [
        pin.exp3(a * np.array([0.6, 0, 0.8])) for a in np.linspace(0, 4 * np.pi, 400)
    ]
    q = scene.poses_of(steady)[:, 0, 3:]
    assert np.abs(np.diff(q, axis=0)).max() < 0.02


@pytest.mark.parametrize("size", [1.0, 5000.0])  # 5 km: beyond 32 bits of 0.1 µm
def test_numbers_of_a_page_come_back(size: float) -> None:
    rng = np.random.default_rng(0)
    series = [rng.uniform(-size, size, shape) for shape in ((50, 7), (0, 3), (2, 3))]
    data, unit = html.differences(series)
    back = summed(data, [list(s.shape) for s in series], unit)
    assert unit <= max(1e-7, 2e-9 * size)
    np.testing.assert_allclose(
        back, np.concatenate([s.ravel() for s in series]), atol=0.51 * unit, rtol=0
    )
    smooth = np.sin(np.linspace(0, 6, 501))[:, None]
    packed = html.pack(html.differences([smooth])[0])
    assert len(packed) < 0.25 * len(html.pack(smooth.astype("<f4")))


def test_text_in_a_colour_can_be_read() -> None:
    """Contrast 4.5:1 on white, by WCAG's formula; every colour stays darker or as it is."""
    for colour in (*COLOURS.values(), "#56B4E9", "#F0E442", "#595959"):
        text = readable(colour)
        assert 1.05 / (luminance(text) + 0.05) >= 4.5
        assert all(int(text[k : k + 2], 16) <= int(colour[k : k + 2], 16) for k in (1, 3, 5))
    assert luminance("#ffffff") == pytest.approx(1) and luminance("#000000") == 0


def test_no_two_scripts_define_the_same_name() -> None:
    """The page joins its scripts into one scope, where a second function replaces the first."""
    scripts = Path(rp.__file__).parent / "show" / "page" / "assets" / "scripts"
    declared = r"(?m)^(?:export )?(?:async )?(?:function\*?|class|const|let) (\w+)"
    names = [
        name
        for script in scripts.rglob("*.js")
        for name in re.findall(declared, script.read_text("utf-8"))
    ]
    assert len(names) > 100
    assert sorted(set(names)) == sorted(names)


def test_each_script_follows_the_scripts_it_imports() -> None:
    """Joined in this order, no script uses a name that is not defined yet; the folders import one
    way: the chrome the arm, the own loop and the live viewer both, and nothing imports these."""
    scripts = Path(rp.__file__).parent / "show" / "page" / "assets" / "scripts"
    stems = [file.relative_to(scripts).with_suffix("").as_posix() for file in scripts.rglob("*.js")]
    order = (*html.BEGIN, *html.SCRIPTS)
    assert sorted(stems) == sorted(order)
    both = {"arm", "chrome"}
    allowed = {"arm": set(), "chrome": {"arm"}, "own": both, "live": both}
    for script in order:
        text = (scripts / f"{script}.js").read_text("utf-8")
        folder = Path(script).parent
        for name in re.findall(r'(?m)^(?:import .*|}) from "(.*?)\.js"', text):
            target = Path(os.path.normpath(folder / name)).as_posix()
            assert order.index(target) < order.index(script), (script, target)
            if folder.name and "/" in target:
                room = Path(target).parent.name
                assert room in allowed[folder.name] | {folder.name}, (script, target)


def test_lines_of_scripts_and_styles_are_short() -> None:
    """At most 100 characters; prettier keeps code short, not strings and comments."""
    assets = Path(rp.__file__).parent / "show" / "page" / "assets"
    files = [*assets.rglob("*.js"), *assets.rglob("*.css")]
    long = [
        f"{file.name}:{k}"
        for file in files
        for k, line in enumerate(file.read_text("utf-8").splitlines(), 1)
        if len(line) > 100
    ]
    assert len(files) > 20 and long == []


def test_lines_of_glsl_that_begin_with_a_sign_stay_lines() -> None:
    """A shader whose #ifdef followed a bracket lost its line break, and did not compile."""
    shader = "const CODE = `void main() {\n  #ifdef TINT\n  tint();\n  #endif\n}`;\n"
    assert html._joined([shader]) == (
        '"use strict";\nconst CODE = `void main() {\n#ifdef TINT\ntint();\n#endif\n}`;\n'
    )
    assert html._joined(["f({\n  a,\n});\n"]) == '"use strict";\nf({a});\n'


def test_styles_reach_the_page_without_comments() -> None:
    assert html._dense("/* a\n b */\na b > c {\n  d: e, f;\n}\n") == "\na b > c{d:e,f;}"
