"""The closing radius in exported C: the decisions of ``ClosingRadius.contains``, at 1e-12."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA
from controls import NEEDS_C, control, own_cache  # noqa: F401
from test_governor_c import DOUBLE, Pose, in_c

import repctl_pin as rp

OK, OUTSIDE = 0, 3
OTHERS = [
    ("axis", "start"),
    ("xz", "path"),
    ("axis", "path"),
    ("position", "path"),
    ("pose", "start"),
]
"""Tasks, and what their closing radius is around, that only the slow tests try."""


def radius(task: rp.Task, around: str, kind: str = "") -> rp.ClosingRadius:
    """Create a radius of 4 cm, and 0.2 rad if the task turns, around one pose or five."""
    rng, kind = np.random.default_rng(0), kind or str(task.kind)
    Q = Q_PANDA + rng.uniform(-0.05, 0.05, (5 if around == "path" else 1, 7))
    poses = [task.placement(q) for q in Q]
    return rp.ClosingRadius(
        0.04,
        0.2 if kind in ("pose", "axis") else None,
        around,
        kind,
        Q[0],
        np.array([pose.translation for pose in poses]),
        np.array([pose.rotation for pose in poses]),
        1,
        True,
        "",
    )


def on_the_edge(closes: rp.ClosingRadius, rng: np.random.Generator) -> list[pin.SE3]:
    """Sample poses at 1 ± 1e-12 of one pose's distance or angle, and others far in and out."""
    used = ["xyz".index(c) for c in closes.kind] if len(closes.kind) == 2 else [0, 1, 2]
    poses = []
    for k in range(300):
        a = k % len(closes.positions)
        p, R = closes.positions[a], closes.rotations[a]
        near = 1 + rng.choice([-1e-12, 1e-12])
        metres, radians = rng.uniform(0, 1.2, 2) * [0.04, 0.2]
        if k % 3 == 0:
            metres = 0.04 * near
        elif k % 3 == 1:  # the angle up to the tolerance of constant orientation
            radians = (0.2 + 1e-7) * near
        away = rng.normal(size=3)
        way = np.isin(np.arange(3), used) * away
        shift = metres * way / np.linalg.norm(way) + np.where(way == 0, away, 0)
        axis = rng.normal(size=3)
        if closes.kind == "axis":  # the tool axis turns, then the tool about it
            axis = np.cross(R[:, 2], axis)
        turn = pin.exp3(radians * axis / np.linalg.norm(axis))
        spin = rng.normal() if closes.kind == "axis" else 0.0
        poses.append(pin.SE3(turn @ R @ pin.exp3(np.array([0, 0, spin])), p + shift))
    return poses


@NEEDS_C
@pytest.mark.parametrize(
    ("kind", "around"),
    [
        ("pose", "path"),
        *(pytest.param(kind, around, marks=pytest.mark.slow) for kind, around in OTHERS),
    ],
)
def test_c_decides_as_python_does(kind: str, around: str, tmp_path: Path) -> None:
    task = rp.Robot.load("panda").task("panda_hand_tcp", kind)
    inverse = control(task, Q_PANDA, rp.Polynomial(Q_PANDA, 1, 0.5))
    closes = radius(task, around)
    rp.export_c(inverse, tmp_path, "arm", closes=closes)
    within = in_c(tmp_path).arm_within_closing_radius
    within.argtypes = [ctypes.POINTER(Pose)]

    def asked(pose: pin.SE3) -> int:
        R = (DOUBLE * 9)(*np.ravel(pose.rotation))
        return int(within(ctypes.byref(Pose((DOUBLE * 3)(*pose.translation), R))))

    said = [closes.contains(pose) for pose in on_the_edge(closes, _rng())]
    assert {True, False} == set(said)
    assert [asked(pose) for pose in on_the_edge(closes, _rng())] == [
        OK if inside else OUTSIDE for inside in said
    ]
    assert asked(pin.SE3(np.eye(3), np.full(3, np.nan))) == OUTSIDE


def _rng() -> np.random.Generator:
    return np.random.default_rng(1)


def test_the_decision_is_that_of_distance_and_angle() -> None:
    """An independent measure: the norm of the displacement and of log(R R₀ᵀ)."""
    for kind in ("pose", "axis"):
        task = rp.Robot.load("panda").task("panda_hand_tcp", kind)
        closes = radius(task, "path")
        for pose in on_the_edge(closes, _rng()):
            away = np.linalg.norm(pose.translation - closes.positions, axis=1)
            if kind == "pose":
                angle = [np.linalg.norm(pin.log3(pose.rotation @ R.T)) for R in closes.rotations]
            else:
                z = closes.rotations[:, :, 2]
                across = np.linalg.norm(np.cross(z, pose.rotation[:, 2]), axis=1)
                angle = np.arctan2(across, z @ pose.rotation[:, 2])
            slack = np.maximum(away / 0.04, np.array(angle) / (0.2 + 1e-7)).min() - 1
            if abs(slack) > 3e-13:
                assert closes.contains(pose) == (slack < 0)


def test_without_a_radius_there_is_no_function(tmp_path: Path) -> None:
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    inverse = control(task, Q_PANDA, rp.Polynomial(Q_PANDA, 1, 0.5))
    files = rp.export_c(inverse, tmp_path)
    assert not any("closing_radius" in file.read_text() for file in files)
    with pytest.raises(rp.InputError, match="closes= is for axis tasks"):
        rp.export_c(inverse, tmp_path, closes=radius(task, "start", "axis"))
    with pytest.raises(rp.InputError, match="closes"):
        rp.export_c(inverse, tmp_path, closes=0.05)  # type: ignore[arg-type]
