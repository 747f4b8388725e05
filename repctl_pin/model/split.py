"""Splitting of planar and floating joints into joints with one coordinate each."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from lxml import etree

from .rules import axis_of
from .xml import bad

Step: TypeAlias = tuple[str, str, tuple[float, ...]]  # suffix, kind, axis

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_FLOATING: tuple[Step, ...] = (
    ("x", "prismatic", _X),
    ("y", "prismatic", _Y),
    ("z", "prismatic", _Z),
    ("yaw", "continuous", _Z),
    ("pitch", "continuous", _Y),
    ("roll", "continuous", _X),
)


def split_joints(robot: etree._Element, notes: list[str]) -> None:
    """Replace planar joints by 3 joints, floating joints by 6, with one coordinate each.

    The joints of a planar joint translate in the plane normal to its axis, and rotate about the
    axis. The rotations of a floating joint are yaw, pitch and roll, singular where the pitch is
    ±π/2. ``notes`` receives a note for each joint that is replaced.
    """
    names = {element.get("name") for element in robot}
    for joint in robot.findall("joint"):
        if joint.get("type") not in ("planar", "floating"):
            continue
        steps = _planar(axis_of(joint)) if joint.get("type") == "planar" else _FLOATING
        named = [f"{joint.get('name')}_{suffix}" for suffix, _, _ in steps]
        taken = names & {*named, *(f"{name}_link" for name in named)}
        if taken:
            raise bad(
                joint,
                f"is split into {', '.join(named)}, but {taken.pop()!r} is taken; rename it",
            )
        notes.append(
            f"joint {joint.get('name')!r} is {joint.get('type')}: read as {', '.join(named)}; "
            "to hold them still, lock them, or choose a base link beyond them"
        )
        _replace(robot, joint, steps, named)


def _planar(axis: tuple[float, float, float]) -> tuple[Step, ...]:
    """Return the three joints that replace a planar joint with a given unit axis.

    Two are prismatic, along directions in the plane (x and y if the axis is z); the third is
    continuous, about the axis.
    """
    a = np.array(axis)
    u = np.eye(3)[(int(np.argmax(np.abs(a))) + 1) % 3]
    u = u - (u @ a) * a
    u /= np.linalg.norm(u)
    return (
        ("x", "prismatic", (*u,)),
        ("y", "prismatic", (*np.cross(a, u),)),
        ("yaw", "continuous", axis),
    )


def _replace(
    robot: etree._Element,
    joint: etree._Element,
    steps: tuple[Step, ...],
    names: list[str],
) -> None:
    """Replace a joint by a chain of single-axis joints, with massless links between them."""
    at = robot.index(joint)
    parent = joint.find("parent").get("link")
    robot.remove(joint)
    for name, (_, kind, axis) in zip(names, steps, strict=True):
        new = etree.Element("joint", name=name, type=kind)
        last = name == names[-1]
        child = joint.find("child").get("link") if last else f"{name}_link"
        etree.SubElement(new, "parent", link=parent)
        etree.SubElement(new, "child", link=child)
        etree.SubElement(new, "axis", xyz=" ".join(repr(float(x)) for x in axis))
        if kind == "prismatic":
            etree.SubElement(new, "limit", lower="-1e16", upper="1e16")
        if name == names[0] and joint.find("origin") is not None:
            new.append(joint.find("origin"))
        added = [new] if last else [new, etree.Element("link", name=child)]
        for element in added:
            element.sourceline = joint.sourceline
            robot.insert(at, element)
            at += 1
        parent = child
