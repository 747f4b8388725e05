"""Parts of the governor in C: motions of the frame, nodes of interpolation, way along a leaf."""

from __future__ import annotations

import ctypes
import re
import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from controls import NEEDS_C, c_compiler, control, some
from store import folder, made_once

import repctl_pin as rp
from repctl_pin.strategies.native_arm import native_arm

FOLDER = Path(rp.__file__).parent / "native"
DOUBLE = ctypes.c_double
Q0 = np.array([0.3, 0.8, 0.8])

pytestmark = NEEDS_C


MOST_FRAMES = 32
MOST_N = 64


class Pose(ctypes.Structure):
    """Placement of a frame."""

    _fields_ = (("p", DOUBLE * 3), ("R", DOUBLE * 9))


class Course(ctypes.Structure):
    """Placements of the frames, and the coordinates of a single one in a cell."""

    _fields_ = (("place", Pose * MOST_FRAMES), ("y", DOUBLE * 6), ("leaf", DOUBLE * MOST_N))


class Motion(ctypes.Structure):
    """Polynomial of the coordinates in time."""

    _fields_ = (
        ("start", Course),
        ("C", DOUBLE * (6 * (6 * MOST_FRAMES + MOST_N))),
        ("begin", DOUBLE),
        ("duration", DOUBLE),
    )


def array(values: object) -> ctypes.Array:
    flat = np.ravel(values)
    return (DOUBLE * len(flat))(*flat)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The library with all functions that its files share visible."""
    path = made_once(folder[0] / "parts.so", lambda: compiled(tmp_path_factory.mktemp("parts")))
    found = ctypes.CDLL(str(path))
    found.longest_landing.restype = found.regularity.restype = DOUBLE
    return found


def compiled(into: Path) -> bytes:
    """Compile the files as one library, and return it."""
    names = ["arm", "chart", "law", "straight_lines", "joint_plan", "target_joints", "governor"]
    files = [str(FOLDER / f"{name}.c") for name in names]
    flags = ["-std=c99", "-O0", "-w", "-fPIC", "-shared"]
    compiler = c_compiler()
    assert compiler is not None
    subprocess.run([*compiler, *flags, *files, "-o", str(into / "parts.so"), "-lm"], check=True)
    return (into / "parts.so").read_bytes()


@cache
def planar() -> tuple[rp.RepeatableInverse, object]:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    inverse = control(task, Q0, rp.Polynomial(Q0, 2, 0.5))
    return inverse, native_arm(task, inverse.potentials)


@cache
def hands() -> rp.Task:
    both = [("panda_link4", "xy"), ("panda_hand_tcp", "position")]
    return rp.Robot.load("panda").task(both)


class Line:
    """A motion of the frames of planar3r, or of two frames, evaluated in C."""

    def __init__(
        self, library: ctypes.CDLL, kind: str, starts: list[pin.SE3], *given: object
    ) -> None:
        self.library, self.motion, self.frames = library, Motion(), len(starts)
        self.arm = planar()[1] if len(starts) == 1 else native_arm(hands())
        course = Course()
        for place, start in zip(course.place, starts, strict=False):
            place.p, place.R = array(start.translation), array(start.rotation)
        *rows, time = given
        library[f"motion_{kind}"](
            ctypes.byref(self.arm),
            ctypes.byref(self.motion),
            ctypes.byref(course),
            *(array([*row, *[0.0] * MOST_N]) for row in rows),
            DOUBLE(time),
        )

    def placements(self, t: float) -> list[pin.SE3]:
        course, arm = Course(), ctypes.byref(self.arm)
        motion = ctypes.byref(self.motion)
        self.library.motion_course_at(arm, motion, DOUBLE(t), ctypes.byref(course))
        found = course.place[: self.frames]
        return [pin.SE3(np.reshape(x.R, (3, 3)), np.array(x.p)) for x in found]

    def rates(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        zeros = [0] * (6 * self.frames + MOST_N)
        twist, rate, arm = array(zeros), array(zeros), ctypes.byref(self.arm)
        motion = ctypes.byref(self.motion)
        self.library.motion_rates(arm, motion, DOUBLE(t), twist, rate)
        frames = 6 * self.frames
        return np.array(twist)[:frames], np.array(rate)[:frames]


@pytest.mark.parametrize("frames", some([1, 2], 2))
def test_the_rates_of_frame_motions_are_derivatives(library: ctypes.CDLL, frames: int) -> None:
    """ω and ω̇ by finite differences of the placements; the ends of each kind of motion."""
    rng, step = np.random.default_rng(0), 1e-4
    starts = [pin.SE3.Random() for _ in range(frames)]
    twist, rate, later, way = rng.normal(size=(4, 6 * frames))
    motions = [
        Line(library, "change", starts, twist, rate, later, 0.8),
        Line(library, "brake", starts, twist, rate, 1.1),
        Line(library, "land", starts, twist, rate, 1.5 * way, 0.9),
    ]
    for motion in motions:
        for t in (0.01, 0.3, 0.79):
            before, after = (motion.placements(t + k * step) for k in (-1, 1))
            expected = [
                [*(b.translation - a.translation), *pin.log3(b.rotation @ a.rotation.T)]
                for a, b in zip(before, after, strict=True)
            ]
            found, derivative = motion.rates(t)
            np.testing.assert_allclose(found, np.ravel(expected) / (2 * step), atol=1e-6)
            ahead, behind = motion.rates(t + step)[0], motion.rates(t - step)[0]
            slope = (ahead - behind) / (2 * step)
            np.testing.assert_allclose(derivative, slope, atol=1e-5)
        first = motion.rates(0.0)
        np.testing.assert_allclose(first[0], twist, atol=1e-12)
        np.testing.assert_allclose(first[1], rate, atol=1e-12)
    for motion in motions[1:]:
        rest = motion.rates(motion.motion.duration)
        np.testing.assert_allclose(rest, np.zeros((2, 6 * frames)), atol=1e-9)
    ends = motions[2].placements(0.9)
    for start, end, by in zip(starts, ends, 1.5 * way.reshape(-1, 6), strict=True):
        turned = pin.exp3(by[3:]) @ start.rotation
        np.testing.assert_allclose(end.rotation, turned, atol=1e-12)
        np.testing.assert_allclose(end.translation, start.translation + by[:3])


def test_a_landing_is_as_long_as_it_can_be_without_turning_back(library: ctypes.CDLL) -> None:
    """The quintic to rest over the distance 1: its last derivative that is not 0 changes sign."""

    def longest(speed: float, rate: float) -> float:
        return float(library.longest_landing(DOUBLE(speed), DOUBLE(rate)))

    one = np.eye(6)[0]
    for speed, rate in ((1.0, -0.4), (1.0, 0.0), (0.3, 2.0), (0.0, 1.0)):
        for share, turns_back in ((0.99, False), (1.01, True)):
            T, free = share * longest(speed, rate), [pin.SE3.Identity()]
            motion = Line(library, "land", free, speed * one, rate * one, one, T)
            t = np.linspace(0.0, T, 2001)
            way = np.array([motion.placements(s)[0].translation[0] for s in t])
            assert (way.max() > 1 + 1e-12) == turns_back
    assert longest(1.0, -1.0) == longest(0.0, 0.0) == np.inf


def tables(name: str) -> list[np.ndarray]:
    """The two tables of a name in joint_plan.c, of degrees 4 and 10."""
    text = (FOLDER / "joint_plan.c").read_text()
    body = text[text.index(f"double {name}[") :].partition(" = ")[2].partition(";")[0]
    rows = [[float(x) for x in row.split(",")] for row in re.findall(r"{([^{}]+)}", body)]
    if name == "NODE_SHARE":
        return [np.array(row) for row in rows]
    parts = rows[:5], rows[5:]
    return [np.array([row + [0.0] * (len(part) - len(row)) for row in part]) for part in parts]


@pytest.mark.parametrize("table", [0, 1])
def test_the_nodes_interpolate_polynomials(table: int) -> None:
    """Chebyshev–Lobatto nodes; coefficients in u, and extrapolation from the nodes before and the
    slope at the first one, both exact for polynomials of the degree that they can be exact for."""
    share, ahead, monomials = (
        tables(name)[table] for name in ("NODE_SHARE", "NODE_AHEAD", "NODE_MONOMIALS")
    )
    d = (4, 10)[table]
    expected = (1 - np.cos(np.pi * np.arange(d + 1) / d)) / 2
    np.testing.assert_allclose(share, expected, atol=1e-15)
    u = 2 * share - 1
    np.testing.assert_allclose(
        monomials @ u[:, None] ** np.arange(d + 1), np.eye(d + 1), atol=1e-10
    )
    for j in range(1, d + 1):
        for power in range(j + 1):
            known = share[:j] ** power
            found = ahead[j, :j] @ known + ahead[j, j] * (power == 1)
            assert found == pytest.approx(share[j] ** power, abs=1e-9)


def test_the_direction_is_along_the_leaf_and_around_a_singularity(library: ctypes.CDLL) -> None:
    inverse, arm = planar()

    def direction(q: np.ndarray, goal: np.ndarray) -> np.ndarray:
        d = array([0] * 3)
        library.leaf_direction(ctypes.byref(arm), array(q), array(goal), d)
        return np.array(d)

    def regular(q: np.ndarray) -> float:
        """The smallest sine between a row of J and the other rows of J_V."""
        J, G = inverse.task.jacobian(q), inverse(q)
        return 1 / (np.linalg.norm(J, axis=1) * np.linalg.norm(G, axis=0)).max()

    def tangent(q: np.ndarray, x: np.ndarray) -> np.ndarray:
        V = inverse.potentials.gradients(q[None])[0]
        return x - V @ np.linalg.lstsq(V, x, rcond=None)[0]

    q, goal = Q0, Q0 + [0.2, -0.5, 0.4]
    assert regular(q) > 0.1
    in_c = library.regularity(ctypes.byref(arm), array(q))
    assert in_c == pytest.approx(regular(q), rel=1e-12)
    np.testing.assert_allclose(direction(q, goal), tangent(q, goal - q), atol=1e-12)
    far = np.array([5.0, 5.0])
    while regular(q) > 0.025:  # towards the edge of the reach
        q = q + 0.002 * inverse(q) @ (far / np.linalg.norm(far))
    beyond = q + 0.3 * inverse(q) @ far
    d = direction(q, beyond)
    np.testing.assert_allclose(tangent(q, d), d, rtol=0, atol=1e-9 * np.linalg.norm(d))
    e = 1e-5 * d / np.linalg.norm(d)
    assert regular(q + e) > regular(q) > regular(q + 1e-5 * tangent(q, beyond - q))
