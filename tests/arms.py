"""Arms as URDF files made on the spot: planar ones of any link lengths, and random spatial ones."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import repctl_pin as rp

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

KINDS = [
    "panda",
    "xarm7",
    "ur5",
    "kinova",
    "z1",
    "so100",
    "baxter",
    "pr2",
    "tiago",
    "talos",
    "g1",
    "ppr",
    "planar3r",
    "planar7r",
]
"""Known robots of every kind: arms, a lift, humanoids, joints without limits, planar arms."""

Q_PANDA = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
"""The panda's configuration of the theory's reference numbers."""

KINDS = ("pose", "axis", "position", "xy", "xz", "yz")
"""Kinds of tasks."""


def catalogue() -> dict[str, dict[str, Any]]:
    """The table of known robots, as the package's data have it: a row per name."""
    file = Path(rp.__file__).parent / "model" / "arms.toml"
    return tomllib.loads(file.read_text(encoding="utf-8"))


def heed_interrupts() -> None:
    """Let a child process take Ctrl-C, even where the tests themselves run in a shell's
    background."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def planar_urdf(lengths: Sequence[float], *, range_: float = 7.0) -> str:
    """Write an n-link planar arm about z, links along x, relative angles, end link ``tool``."""
    links = ['<link name="base"/>']
    joints = []
    offset, parent = 0.0, "base"
    for i, length in enumerate(lengths, 1):
        links.append(f'<link name="link{i}"/>')
        joints.append(
            f'<joint name="theta{i}" type="revolute"><parent link="{parent}"/><child '
            f'link="link{i}"/>'
            f'<origin xyz="{offset} 0 0"/><axis xyz="0 0 1"/>'
            f'<limit lower="{-range_}" upper="{range_}" effort="1" velocity="1"/></joint>'
        )
        offset, parent = length, f"link{i}"
    links.append('<link name="tool"/>')
    joints.append(
        f'<joint name="tip" type="fixed"><parent link="{parent}"/><child link="tool"/>'
        f'<origin xyz="{offset} 0 0"/></joint>'
    )
    parts = ('<?xml version="1.0"?>', '<robot name="planar">', "".join(links), "".join(joints))
    return "\n".join((*parts, "</robot>", ""))


def upright_urdf(tilt: float = 0.0) -> str:
    """Write an arm of seven joints, about z and y in turn, which is stretched upward at 0.

    The first joint's axis is tilted by ``tilt``, rad, about x.
    """
    rows = ['<link name="base"/>']
    lengths, ranges = (0.15, 0.21, 0.21, 0.19, 0.2, 0.2, 0.08), (2.9, 2.1)
    for i, length in enumerate(lengths):
        before, end, rpy = f"link{i}" if i else "base", ranges[i % 2], tilt * (not i)
        rows += [
            f'<link name="link{i + 1}"/><joint name="joint{i + 1}" type="revolute">',
            f'<parent link="{before}"/><child link="link{i + 1}"/>',
            f'<origin xyz="0 0 {length}" rpy="{rpy!r} 0 0"/>',
            f'<axis xyz="0 {i % 2} {1 - i % 2}"/>',
            f'<limit lower="{-end}" upper="{end}" effort="1" velocity="1"/></joint>',
        ]
    tip = '<parent link="link7"/><child link="tool"/><origin xyz="0 0 0.1"/>'
    rows.append(f'<link name="tool"/><joint name="tip" type="fixed">{tip}</joint>')
    return f'<?xml version="1.0"?><robot name="upright">{"".join(rows)}</robot>'


def planar_task(lengths: Sequence[float], folder: Path) -> rp.Task:
    """Load such an arm; its ``xy`` task."""
    path = folder / f"planar{len(lengths)}.urdf"
    path.write_text(planar_urdf(lengths), encoding="utf-8")
    return rp.Robot.load(path).task("tool", "xy")


def spatial_urdf(n: int, seed: int) -> str:
    """Write an arm of n joints with random axes and offsets, every third one prismatic."""
    rng = np.random.default_rng(seed)
    links, joints = ['<link name="base"/>'], []
    parent = "base"
    for i in range(1, n + 1):
        kind = "prismatic" if i % 3 == 0 else "revolute"
        xyz, rpy, axis = (
            " ".join(f"{v:.6f}" for v in rng.uniform(-1, 1, 3) * s) for s in (0.4, 1.5, 1.0)
        )
        links.append(f'<link name="link{i}"/>')
        joints.append(
            f'<joint name="q{i}" type="{kind}"><parent link="{parent}"/><child link="link{i}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
        parent = f"link{i}"
    links.append('<link name="tool"/>')
    joints.append(
        f'<joint name="tip" type="fixed"><parent link="{parent}"/><child link="tool"/>'
        '<origin xyz="0.3 0.1 0.2"/></joint>'
    )
    parts = ('<?xml version="1.0"?>', '<robot name="spatial">', "".join(links), "".join(joints))
    return "\n".join((*parts, "</robot>", ""))


def spatial_task(n: int, folder: Path, *, kind: str = "position", seed: int = 0) -> rp.Task:
    """Load such an arm; its position task has r = n − 3."""
    path = folder / f"spatial{n}_{seed}.urdf"
    path.write_text(spatial_urdf(n, seed), encoding="utf-8")
    return rp.Robot.load(path).task("tool", kind)


def sliding_task(folder: Path) -> rp.Task:
    """A planar arm: revolute, prismatic along the link, revolute."""
    kinds = [
        ("revolute", "0 0 1", "0 0 0"),
        ("prismatic", "1 0 0", "0.1 0 0"),
        ("revolute", "0 0 1", "0.1 0 0"),
        ("prismatic", "0 1 0", "0.1 0 0"),
        ("revolute", "0 0 1", "0.1 0 0"),
    ]
    text = '<robot name="sliding"><link name="l0"/>'
    for i, (kind, axis, xyz) in enumerate(kinds):
        text += (
            f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
            f'<origin xyz="{xyz}"/>'
            f'<axis xyz="{axis}"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
            f'<link name="l{i + 1}"/>'
        )
    file = folder / "sliding.urdf"
    file.write_text(text + "</robot>", encoding="utf-8")
    return rp.Robot.load(file).task("l5", "xy")


def sliders_task(angles: Sequence[float], folder: Path) -> rp.Task:
    """An arm of prismatic joints alone, at these angles in a plane; its ``xy`` task is linear."""
    text = '<robot name="sliders"><link name="l0"/>'
    for i, angle in enumerate(angles):
        text += (
            f'<joint name="j{i}" type="prismatic"><parent link="l{i}"/><child link="l{i + 1}"/>'
            f'<axis xyz="{np.cos(angle)} {np.sin(angle)} 0"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
            f'<link name="l{i + 1}"/>'
        )
    file = folder / "sliders.urdf"
    file.write_text(text + "</robot>", encoding="utf-8")
    return rp.Robot.load(file).task(f"l{len(angles)}", "xy")


def chain_with_bodies(folder: Path) -> Path:
    """Three unit links in a plane; balls of 0.1 m at the root and at the tip, and a mesh that is
    not there."""
    link = (
        '<link name="{}"><collision><origin xyz="{} 0 0"/>'
        "<geometry>{}</geometry></collision></link>"
    )
    joint = (
        '<joint name="j{}" type="revolute"><parent link="{}"/><child link="{}"/><origin xyz="{} 0 '
        '0"/>'
        '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
    )
    ball, lost = '<sphere radius="0.1"/>', '<mesh filename="lost.stl"/>'
    links = [
        ("base", 0, ball),
        ("a", 0.5, lost),
        ("b", 0.5, '<box size="0.2 0.1 0.1"/>'),
        ("tip", 1, ball),
    ]
    joints = [("base", "a", 0), ("a", "b", 1), ("b", "tip", 1)]
    text = "".join(link.format(*one) for one in links)
    text += "".join(joint.format(k, *one) for k, one in enumerate(joints))
    file = folder / "chain.urdf"
    file.write_text(f'<robot name="chain">{text}</robot>', encoding="utf-8")
    return file


def named_path(task: rp.Task, q: np.ndarray, spec: str, plane: str | None = None) -> rp.TaskPath:
    """The path that a problem makes of such words as ``square:0.2``."""
    return rp.Problem(task, start=q, path=spec, plane=plane).cycle
