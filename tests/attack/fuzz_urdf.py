"""Hostile robot files, seeded: mutations of real URDFs, special values at every place, broken
meshes.

Each is refused in one printable line, or read: then inspected, its kinematics compared with what
Pinocchio makes of the same file by itself, and drawn if it is redundant. Anything else (another
exception, over 20 s, a number that is not finite, another kinematics) is a fault, and the exit code
says so. Memory is held to 2 GB.

    python tests/attack/fuzz_urdf.py [--seed 0] [--mutations 3600] [--specials 450] [--meshes 120]
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import io
import os
import random
import resource
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import umsgpack
from lxml import etree

import repctl_pin as rp

sys.path.insert(0, str(Path(__file__).parents[1]))
from commands import main as cli
from page_file import read

SECONDS = 20
NUMBERS = [
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e-308",
    "1e400",
    "0",
    "-1",
    "",
    " ",
    "１２",
    "0x10",
    "1_0",
    "1,5",
    "--1",
    "9" * 400,
    "1e",
    "²",
    "1e5",
    "true",
    "${x}",
    "-0",
    "1 2",
    "\N{NO-BREAK SPACE}1",
]
NAMES = [
    "",
    " ",
    "a,b",
    "a\nb",
    'a"b',
    "a;b",
    "$a_$b",
    "a" * 5000,
    "../../x",
    "~nosuchuser",
    "universe",
    "root_joint",
    "ä\N{COMBINING DIAERESIS}",
    "\N{RIGHT-TO-LEFT OVERRIDE}x",
    "a\tb",
    "l0",
    "j1",
    "<b>",
    "%s%n",
    "{0}",
    "\\",
    "time",
    "CON",
    "//",
    "\N{NULL}".join("ab").replace("\0", "&#0;"),
]
JUNK = [
    *NUMBERS,
    "0 0 0",
    "x",
    "fixed",
    "continuous",
    "floating",
    "planar",
    "a b c d",
    "1 2 3",
    "j1",
    "j2",
    "l0",
    "l1",
]

ARM = """<robot name="arm"><material name="red"><color rgba="1 0 0 1"/></material>
<link name="l0"><visual><geometry><box size="1 1 1"/></geometry></visual></link>
<link name="l1"><inertial><origin xyz="0 0 1"/><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<visual><origin xyz="0 0 1" rpy="0 1 0"/><geometry><cylinder radius="1" length="2"/></geometry>
<material name="red"/></visual></link>
<link name="l2"><visual><geometry><mesh filename="m.stl" scale="1 1 1"/></geometry></visual></link>
<link name="l3"><collision><geometry><sphere radius="1"/></geometry></collision></link>
<joint name="j1" type="revolute"><parent link="l0"/><child link="l1"/>
<origin xyz="0 0 1" rpy="0 0 1"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
<dynamics damping="1" friction="1"/></joint>
<joint name="j2" type="prismatic"><parent link="l1"/><child link="l2"/><origin xyz="0 1 1"/>
<axis xyz="0 0 1"/>
<limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
<joint name="j3" type="revolute"><parent link="l2"/><child link="l3"/><axis xyz="1 0 0"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/>
<mimic joint="j1" multiplier="0.5" offset="0.1"/></joint>
<link name="l4"/><joint name="j4" type="continuous"><parent link="l3"/><child link="l4"/>
<origin xyz="0 0 1"/><axis xyz="0 1 0"/></joint>
</robot>"""

CARRIER = """<robot name="carrier"><link name="base"/>
<link name="l1"/><link name="l2"/><link name="l3"><visual><geometry><mesh filename="{mesh}"/>
</geometry></visual></link>
<joint name="j1" type="continuous"><parent link="base"/><child link="l1"/><axis xyz="0 0 1"/>
</joint>
<joint name="j2" type="continuous"><parent link="l1"/><child link="l2"/><origin xyz="1 0 0"/>
<axis xyz="0 0 1"/></joint>
<joint name="j3" type="continuous"><parent link="l2"/><child link="l3"/><origin xyz="1 0 0"/>
<axis xyz="0 0 1"/></joint></robot>"""
"""An arm that carries one mesh."""

FLOATS = 0x17
"""Type of an array of single precision in a page's commands."""

NOT_REDUNDANT = "no kind of task is redundant there"


class Hang(BaseException):
    """A case took too long."""


def fate(question: Callable[[], None]) -> str:
    """Say how a case ends: ``read``, ``refused``, or the fault."""
    start = time.process_time()
    signal.alarm(SECONDS * 30)  # the machine may be busy: what counts is processor time
    try:
        question()
    except rp.InputError as error:
        told = str(error)
        return (
            "refused"
            if told.isprintable() and len(told) < 6000
            else f"fault: not one line: {told[:200]!r}"
        )
    except Hang:
        return "fault: hangs"
    except Exception as error:
        return f"fault: {type(error).__name__}: {str(error)[:150]!r}"
    finally:
        signal.alarm(0)
    taken = time.process_time() - start
    return "read" if taken < SECONDS else f"fault: takes {taken:.0f} s"


def load_and_look(path: Path) -> None:
    """Load, inspect and draw a robot, and compare its kinematics with Pinocchio's."""
    robot = rp.Robot.load(path)
    code, text = told("inspect", str(path))
    if code:
        raise ArithmeticError(f"inspect ends with {code}: {text[:150]}")
    if robot.chain(robot.default_frame):
        task = robot.task(None, "position")
        assert np.isfinite(task.jacobian(task.reference)).all(), (
            "J holds a number that is not finite"
        )
    q = robot.reference + 0.1
    if not np.isfinite(q).all() or "nan" in text.split():
        raise ArithmeticError("a number is not finite")
    compare(robot, path, q)
    if robot.joint_names:
        draw(path, robot, q)


def told(*words: str) -> tuple[int, str]:
    """Run a command here: its exit code, and all that it printed."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        code = cli([*words])
    return code, out.getvalue()


Page = tuple[dict[str, Any], list[dict[str, Any]]]


def draw(path: Path, robot: rp.Robot, q: np.ndarray) -> Page | None:
    """Write a page of a motion from q and back; return its scene and the commands that fill it.

    A robot that is not redundant has no page."""
    rows = np.array([q, robot.reference, q])
    motion = path.with_name("motion.csv")
    lines = [",".join(robot.joint_names), *(",".join(map(repr, r)) for r in rows.tolist())]
    motion.write_text("\n".join(lines) + "\n", encoding="utf-8")
    page = path.with_name("page")
    code, text = told("animate", str(path), "--motion", str(motion), "--out", str(page))
    if code == 2 and NOT_REDUNDANT in text:
        return None
    if code:
        raise ArithmeticError(f"animate ends with {code}: {text[:150]}")
    scene, commands, numbers = read((page / "animation.html").read_text(encoding="utf-8"))
    if not (np.isfinite(numbers).all() and all_finite([scene, commands])):
        raise ArithmeticError("a number of the page is not finite")
    return scene, commands


def all_finite(held: Any) -> bool:
    """Whether all numbers of nested lists and dictionaries are finite, packed arrays too."""
    if isinstance(held, dict):
        return all(all_finite(value) for value in held.values())
    if isinstance(held, list):
        return all(all_finite(value) for value in held)
    if isinstance(held, umsgpack.Ext) and held.type == FLOATS:
        return bool(np.isfinite(np.frombuffer(held.data, "<f4")).all())
    return not isinstance(held, float) or bool(np.isfinite(held))


def compare(robot: rp.Robot, path: Path, q: np.ndarray) -> None:
    """Compare the placements of all links with those of the model that Pinocchio itself makes of
    the file."""
    split = any(note.startswith("joint") and "read as" in note for note in robot.description.notes)
    with silence():
        try:
            theirs = pin.buildModelFromUrdf(str(path))
        except ValueError:
            return  # stricter than we are
    tree = etree.parse(str(path), etree.XMLParser(recover=True))
    odd = any(axis.get("xyz") is None for axis in tree.iter("axis"))  # Pinocchio takes a zero axis
    if split or odd:
        return
    values = (
        dict(zip(robot.model.names[1:], robot.coupling.joints(q), strict=True))
        if not robot.locked
        else {}
    )
    full = pin.neutral(theirs)
    for name in list(theirs.names)[1:]:
        joint = theirs.joints[theirs.getJointId(name)]
        if name not in values:
            return
        full[joint.idx_q] = values[name] if joint.nq == 1 else np.cos(values[name])
        if joint.nq == 2:
            full[joint.idx_q + 1] = np.sin(values[name])
    data, own = theirs.createData(), robot.model.createData()
    pin.framesForwardKinematics(theirs, data, full)
    pin.framesForwardKinematics(robot.model, own, robot.coupling.joints(q))
    for frame in robot.frames:
        there, here = (
            model.getFrameId(frame, pin.FrameType.BODY) for model in (theirs, robot.model)
        )
        away = np.abs(data.oMf[there].homogeneous - own.oMf[here].homogeneous)
        if not away.max() <= 1e-9 * max(1.0, np.abs(data.oMf[there].translation).max()):
            raise ArithmeticError(
                f"{frame} lies elsewhere than in Pinocchio's own model: {away.max():.3g}"
            )


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Silence Pinocchio, which complains on the process's own stderr."""
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


def mutations(dice: random.Random, count: int) -> Iterator[bytes]:
    """Damage real files: in their tree, or byte by byte."""
    names = ("prr", "panda", "kinova", "z1", "ur5", "xarm7")
    sources = [rp.Robot.load(name).description.path for name in names]
    texts = [ARM.encode(), *(source.read_bytes() for source in sources)]
    trees = [etree.fromstring(text) for text in texts]
    for k in range(count):
        if k % 3 == 2:
            data = bytearray(dice.choice(texts))
            for _ in range(dice.choice((1, 3, 30))):
                at = dice.randrange(len(data))
                data[at : at + dice.choice((0, 1, 50))] = dice.choice(
                    [
                        b"",
                        b"<",
                        b">",
                        b'"',
                        b"\0",
                        b"&",
                        b"\xff",
                        bytes([dice.randrange(256)]),
                        b"<!--",
                        b"]]>",
                        b"9",
                    ]
                )
            yield bytes(data)
            continue
        root = copy.deepcopy(dice.choice(trees))
        for _ in range(dice.choice((1, 1, 2, 5))):
            element = dice.choice(
                [e for e in root.iterdescendants() if isinstance(e.tag, str)] or [root]
            )
            how = dice.randrange(5)
            if how == 0 and element is not root:
                element.getparent().remove(element)
            elif how == 1 and element.attrib:
                element.set(dice.choice(list(element.attrib)), dice.choice(JUNK))
            elif how == 2 and element.attrib:
                del element.attrib[dice.choice(list(element.attrib))]
            elif how == 3:
                other = dice.choice([e for e in root.iter() if isinstance(e.tag, str)])
                other.append(copy.deepcopy(element))
            elif element is not root:
                element.tag = dice.choice(
                    ["link", "joint", "axis", "limit", "mimic", "origin", "visual", "geometry"]
                )
        yield etree.tostring(root)


def specials() -> Iterator[bytes]:
    """Put every special number, and every special name, at every place of a small arm."""
    tree = etree.fromstring(ARM)
    naming = ("name", "link", "joint", "filename", "type")
    for k, element in enumerate(tree.iter()):
        for attribute, value in element.attrib.items():
            values = (
                NAMES
                if attribute in naming
                else [" ".join([number, *value.split()[1:]]) for number in NUMBERS]
            )
            for special in values:
                changed = copy.deepcopy(tree)
                with contextlib.suppress(ValueError):  # what no XML can hold
                    list(changed.iter())[k].set(attribute, special)
                    yield etree.tostring(changed)
    star = "".join(
        f'<link name="b{i}"/><joint name="s{i}" type="{{kind}}"><parent link="l3"/>'
        f'<child link="b{i}"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for i in range(999)
    )
    for kind in ("revolute", "fixed", "continuous"):
        yield ARM.replace("</robot>", star.format(kind=kind) + "</robot>").encode()
    yield ARM.replace(
        '<link name="l3">', '<link name="l3" ' + " ".join(f'a{i}="1"' for i in range(300_000)) + ">"
    ).encode()
    yield ARM.replace(
        '<collision><geometry><sphere radius="1"/></geometry></collision>',
        '<visual><geometry><sphere radius="1"/></geometry></visual>' * 50_000,
    ).encode()
    ring = ARM.replace('velocity="1"/><dynamics', 'velocity="1"/><mimic joint="j3"/><dynamics')
    yield ring.encode()
    yield ARM.replace("<axis xyz=", "<axis XYZ=").encode()
    yield (ARM + "\0" * 100).encode()


def meshes(folder: Path) -> Iterator[Path]:
    """Write broken meshes of every format."""
    import trimesh

    box = trimesh.creation.box()
    good = {
        kind: box.export(file_type=kind)
        for kind in ("stl", "stl_ascii", "obj", "ply", "off", "glb", "dae")
    }
    good = {
        kind: text.encode() if isinstance(text, str) else bytes(text) for kind, text in good.items()
    }
    good["gltf"] = (
        b'{"asset":{"version":"2.0"},"buffers":[{"uri":"pipe","byteLength":9}],"meshes":[{"primitives":[]}]}'
    )
    os.mkfifo(folder / "pipe")
    os.symlink("/dev/zero", folder / "zero.stl")
    yield folder / "zero.stl"
    for kind, data in good.items():
        broken = {
            "whole": data,
            "empty": b"",
            "half": data[: len(data) // 2],
            "head": data[:90],
            "twice": data + data,
            "zeros": bytes(len(data)),
            "ones": b"\xff" * len(data),
            "count": data[:80] + b"\xff\xff\xff\x7f" + data[84:],
            "nan": data.replace(b"0.5", b"nan").replace(
                np.float32(0.5).tobytes(), np.float32(np.nan).tobytes()
            ),
            "inf": data.replace(b"0.5", b"inf").replace(
                np.float32(0.5).tobytes(), np.float32(np.inf).tobytes()
            ),
            "huge": data.replace(b"0.5", b"1e30").replace(
                np.float32(0.5).tobytes(), np.float32(1e30).tobytes()
            ),
            "comma": data.replace(b"0.5", b"0,5"),
            "index": data.replace(b" 7", b" 999999999").replace(b"7//", b"-999//"),
            "pipe": b"mtllib pipe\nusemtl a\n" + data,
            "html": b"<html>" + data,
        }
        for name, content in broken.items():
            path = folder / f"{kind}_{name}.{kind.partition('_')[0]}"
            path.write_bytes(content)
            yield path
    for meter in ("nan", "0", "-1", "inf", "0,01", "1e308", "", "x"):
        path = folder / f"unit_{len(meter)}{ord(meter[:1] or ' ')}.dae"
        path.write_bytes(good["dae"].replace(b'meter="1"', f'meter="{meter}"'.encode()))
        yield path
    import zipfile

    for name in ("bomb.zip", "bomb.3mf", "bomb.stl", "bomb.glb"):
        with zipfile.ZipFile(folder / name, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("m.stl", bytes(50_000_000))
        yield folder / name


def look_at(path: Path) -> None:
    """Draw a mesh, and see that all of it is finite; refused if the page says so in its place."""
    urdf = path.with_name("carrier.urdf")
    urdf.write_text(CARRIER.format(mesh=path), encoding="utf-8")
    robot = rp.Robot.load(urdf)
    page = draw(urdf, robot, robot.reference + 0.1)
    assert page is not None
    scene, commands = page
    for refused in (*robot.warnings, *scene["problems"]):
        raise rp.InputError(refused)
    objects = [c["object"] for c in commands if c["type"] == "set_object"]
    data = [
        body["data"]
        for one in objects
        for body in one["geometries"]
        if body["type"] == "BufferGeometry"
    ]
    if not data or any(len(body["index"]["array"].data) == 0 for body in data):
        raise ArithmeticError("a mesh has neither triangles nor a problem")


def main() -> int:
    """Run all, print the faults and the counts."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    for name, count in (("seed", 0), ("mutations", 3600), ("specials", 450), ("meshes", 120)):
        parser.add_argument(f"--{name}", type=int, default=count)
    options = parser.parse_args()
    dice = random.Random(options.seed)
    resource.setrlimit(resource.RLIMIT_DATA, (2 << 30, 2 << 30))

    def hang(*_: object) -> None:
        raise Hang

    signal.signal(signal.SIGALRM, hang)
    counts: Counter[str] = Counter()

    def tell(part: str, name: str, how: str) -> None:
        counts[f"{part}: {how.partition(':')[0]}"] += 1
        if how.startswith("fault"):
            print(f"{part} {name}: {how}", flush=True)

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r.urdf"
        every = list(specials())
        last = every[-8:]  # the large ones
        chosen = dice.sample(every[:-8], min(len(every) - 8, max(options.specials - 8, 0))) + last
        for part, cases in (("mutation", mutations(dice, options.mutations)), ("special", chosen)):
            for k, data in enumerate(cases):
                path.write_bytes(data)
                how = fate(lambda: load_and_look(path))
                tell(part, str(k), how)
                if how.startswith("fault"):
                    (Path(tempfile.gettempdir()) / f"fault_{part}_{k}.urdf").write_bytes(data)
        for k, mesh in enumerate(meshes(Path(folder))):
            if k < options.meshes:
                tell("mesh", mesh.name, fate(lambda mesh=mesh: look_at(mesh)))
    print("; ".join(f"{kind} {count}" for kind, count in sorted(counts.items())))
    return int(any(kind.endswith("fault") for kind in counts))


if __name__ == "__main__":
    sys.exit(main())
