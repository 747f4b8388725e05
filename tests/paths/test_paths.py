"""Paths that turn the frame, stay, come with times or have their corners rounded; and what is no
closed path."""

from __future__ import annotations

import copyreg
from collections.abc import Callable
from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from arms import named_path
from controls import some
from numpy.polynomial import chebyshev
from scipy.spatial.transform import Rotation

import repctl_pin as rp

TILTS = Rotation.from_rotvec(
    [[0, 0, 0], [0.3, 0, 0], [0.2, 0.4, 0], [0, 0.2, 0.5], [-0.2, 0, 0.1], [0, 0, 0]]
)
LOOP = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0.05], [0, 0.05, 0.05], [0, 0, 0]])


def turned(here: pin.SE3) -> list[np.ndarray]:
    return [R @ here.rotation for R in TILTS.as_matrix()]


def nodding(s: float) -> np.ndarray:
    return pin.exp3(
        0.3
        * np.array([np.sin(2 * np.pi * s), 1 - np.cos(2 * np.pi * s), 0.5 * np.sin(4 * np.pi * s)])
    )


PATHS: dict[str, Callable[[rp.Task, np.ndarray], rp.TaskPath]] = {
    "tangent": lambda task, q: rp.circle(task, q, 0.05, normal="x", rotation="tangent"),
    "facing": lambda task, q: rp.circle(task, q, 0.08, start_angle=0.4, rotation=[0.4, 0.1, 0.1]),
    "function": lambda task, q: rp.TaskPath(
        "nodding", *_ring(task, q), lambda s: nodding(s) @ task.placement(q).rotation
    ),
    "scipy's rotations": lambda task, q: rp.TaskPath(
        "nods", *_ring(task, q), lambda s: Rotation.from_matrix(nodding(s))
    ),
    "matrices": lambda task, q: rp.waypoints(
        LOOP + task.placement(q).translation, turned(task.placement(q))
    ),
    "scipy's": lambda task, q: rp.waypoints(LOOP, TILTS),
    "placements": lambda task, q: rp.waypoints(
        [pin.SE3(R, p) for R, p in zip(turned(task.placement(q)), LOOP, strict=True)]
    ),
    "times": lambda task, q: rp.waypoints(LOOP, TILTS, times=[0, 1, 1.5, 4, 5, 7]),
    "blended": lambda task, q: rp.waypoints(LOOP, TILTS, blend=0.01),
    "blended square": lambda task, q: named_path(task, q, "square:0.1:blend=0.02", "yz"),
    "there and back": lambda task, q: rp.polygon(task, q, [[0.1, 0.05, 0]]),
}


def _ring(task: rp.Task, q: np.ndarray) -> tuple[Callable, Callable]:
    path = rp.circle(task, q, 0.05)
    return path.point, path.slope


@pytest.mark.parametrize("case", PATHS)
def test_a_path_closes_and_its_twist_is_its_slope(case: str, panda_pose, q_panda) -> None:
    path = PATHS[case](panda_pose, q_panda)
    first, last = path.placement(0.0), path.placement(1.0)
    assert np.abs(first.homogeneous - last.homogeneous).max() < 1e-12
    rng = np.random.default_rng(0)
    for s in rng.uniform(0, 1, 60):
        e = 1e-6
        if min(abs(s - b) for b in (0.0, *path.breaks, 1.0)) < 3 * e:
            continue
        before, after = path.placement(s - e), path.placement(s + e)
        v = (after.translation - before.translation) / (2 * e)
        w = pin.log3(after.rotation @ before.rotation.T) / (2 * e)
        np.testing.assert_allclose(
            path.twist(s), np.concatenate([v, w]), atol=2e-7, err_msg=path.name
        )


def test_the_orientation_of_waypoints_is_met_and_turns_without_a_jump_of_rate() -> None:
    path = rp.waypoints(LOOP, TILTS)
    knots = [0.0, *path.breaks, 1.0]
    for s, R in zip(knots, TILTS.as_matrix(), strict=True):
        np.testing.assert_allclose(path.placement(s).rotation, R, atol=1e-14)

    def rate(s: float) -> np.ndarray:
        return path.twist(s % 1.0)[3:]

    for s in knots:  # from both sides, round the start too
        e = 1e-5
        np.testing.assert_allclose(rate(s - 1e-12), rate(s + 1e-12), atol=1e-9)
        left, right = ((rate(s - 1e-12) - rate(s - e)) / e, (rate(s + e) - rate(s + 1e-12)) / e)
        assert np.abs(left - right).max() < 1e-2 * np.abs(left).max()
    dense = Rotation.from_rotvec(
        [[0.3 * np.cos(a), 0.3 * np.sin(a), 0] for a in np.linspace(0, 2 * np.pi, 81)]
    )
    ring = [[np.cos(a), np.sin(a), 0] for a in np.linspace(0, 2 * np.pi, 81)]
    spline = rp.waypoints(ring, dense)
    for s in np.linspace(0, 1, 33):  # a fourth-order spline through a smooth curve
        meant = Rotation.from_rotvec(
            [0.3 * np.cos(2 * np.pi * s), 0.3 * np.sin(2 * np.pi * s), 0]
        ).as_matrix()
        assert np.abs(spline.placement(s).rotation - meant).max() < 2e-6


@pytest.mark.parametrize("kind", some(["pose", "axis"], "pose"))
@pytest.mark.parametrize("case", ["tangent", "facing", "function", "matrices"])
def test_a_turning_path_is_followed(case: str, kind: str, panda, q_panda) -> None:
    task = panda.task("panda_hand_tcp", kind)
    motion = rp.follow(
        rp.Pseudoinverse(task), PATHS[case](task, q_panda), q_panda, cycles=1, steps=200
    )
    assert motion.tracking_error.max() < 5e-6 and motion.turning_error.max() < 5e-6


def test_tangent_turns_with_the_circle_and_facing_keeps_its_point(panda_pose, q_panda) -> None:
    path = rp.circle(panda_pose, q_panda, 0.05, normal="x", rotation="tangent")
    for s in np.linspace(0, 1, 9):  # the tangent stands still in the frame's own axes
        tangent = path.placement(s).rotation.T @ path.slope(s)
        np.testing.assert_allclose(
            tangent, path.placement(0.0).rotation.T @ path.slope(0.0), atol=1e-12
        )
    target = np.array([0.4, 0.1, 0.1])
    path = rp.circle(panda_pose, q_panda, 0.08, rotation=target)
    seen = [path.placement(s).actInv(target) for s in np.linspace(0, 1, 9)]
    seen = [v / np.linalg.norm(v) for v in seen]
    np.testing.assert_allclose(seen, [seen[0]] * 9, atol=1e-12)
    np.testing.assert_allclose(
        path.placement(0.0).homogeneous, panda_pose.placement(q_panda).homogeneous, atol=1e-15
    )
    for wrong, why in (
        ("along", "'fixed', 'tangent'"),
        ([0, 1], "3 finite"),
        (path.point(0.3), "passes through"),
    ):
        with pytest.raises(rp.InputError, match=why):
            rp.circle(panda_pose, q_panda, 0.08, rotation=wrong)


@pytest.mark.parametrize("normal", ["x", "y", "z"])
def test_circles_go_round_their_normal(normal: str, panda_pose, q_panda) -> None:
    axis = np.eye(3)["xyz".index(normal)]
    for sign, way in ((1, normal), (-1, f"-{normal}")):
        path = rp.circle(panda_pose, q_panda, 0.1, normal=way, start_angle=0.5)
        center = path.points(201)[:-1].mean(axis=0)
        turn = np.cross(path.point(0.2) - center, path.slope(0.2)) / (2 * np.pi * 0.1**2)
        np.testing.assert_allclose(turn, sign * axis, atol=1e-9)


def test_a_stay_takes_its_time_and_nothing_moves_meanwhile() -> None:
    stay = np.array([0, 1, 1, 2, 3, 4, 5])
    path = rp.waypoints(LOOP[stay], TILTS[stay], times=[0, 1, 3, 4, 5, 6, 8])
    assert path.period == 8 and path.breaks == (1 / 8, 3 / 8, 4 / 8, 5 / 8, 6 / 8)
    for s in np.linspace(0.1251, 0.3749, 7):
        assert np.abs(path.twist(s)).max() < 1e-14
        np.testing.assert_allclose(path.placement(s).rotation, TILTS[1].as_matrix(), atol=1e-14)
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q0 = np.array([0.3, 0.8, 0.8])
    here = task.placement(q0)
    square = here.translation + LOOP[[0, 1, 1, 2, 5]] * [1, 1, 0]
    motion = rp.follow(
        rp.Pseudoinverse(task),
        rp.waypoints(square, here.rotation, times=[0, 1, 2, 3, 4]),
        q0,
        cycles=2,
    )
    assert motion.t[-1] == 8 and motion.tracking_error.max() < 1e-9
    still = (motion.t > 1 + 1e-9) & (motion.t < 2 - 1e-9)
    assert np.ptp(motion.q[still], axis=0).max() < 1e-12
    without = rp.waypoints(square, here.rotation)
    assert np.isclose(without.breaks[1] - without.breaks[0], 0.25)  # as long as the mean edge


def test_blended_corners_have_continuous_curvature(panda_pose, q_panda) -> None:
    """A right angle of radius ρ takes ρ of both edges, as an arc does; its curvature is 6 φ u (1 −
    u) / length."""
    path = named_path(panda_pose, q_panda, "square:0.1:blend=0.02", "xy")
    assert path.spec == "square:0.1:blend=0.02"
    np.testing.assert_allclose(
        path.point(0.0), panda_pose.placement(q_panda).translation, atol=1e-15
    )
    length = np.linalg.norm(path.slope(0.0))
    assert np.isclose(path.length, length, rtol=1e-5)
    s = np.linspace(0, 1, 4001)
    slopes = np.array([path.slope(x) for x in s])
    np.testing.assert_allclose(np.linalg.norm(slopes, axis=1), length, rtol=1e-12)  # constant speed
    points = np.array([path.point(x) for x in s])
    np.testing.assert_allclose(np.ptp(points, axis=0), [0.1, 0.1, 0.0], atol=1e-12)
    straight = np.abs(slopes).max(axis=1) > length * (1 - 1e-12)
    assert np.isclose(straight.mean() * length, 4 * 0.06, rtol=2e-3)
    bends = np.linalg.norm(np.gradient(slopes, s, axis=0), axis=1)[1:-1] / length**2
    turned = (length - 0.24) / 4
    assert (
        np.isclose(bends.max(), 1.5 * (np.pi / 2) / turned, rtol=1e-4) and bends.max() < 1.5 / 0.02
    )
    assert np.abs(np.diff(bends)).max() < 0.02 * bends.max()  # an arc jumps to its 50 per m
    assert np.isclose(bends.mean() * length, 2 * np.pi, rtol=1e-3)
    motion = rp.follow(rp.Pseudoinverse(panda_pose), path, q_panda, cycles=1, steps=200)
    assert motion.tracking_error.max() < 1e-8
    for words, why in (
        (
            "square:0.1:blend=0.06",
            "do not fit the edge of 0.1 m from point . to .; use a blend radius of at most 0.05 m",
        ),
        ("square:0.1:blend=", "not a number above 0"),
        ("circle:0.1:blend=0.01", "have corners to blend"),
        ("polygon:100000:0.1", "more than 3000 corners"),
    ):
        with pytest.raises(rp.InputError, match=why):
            named_path(panda_pose, q_panda, words)
    named_path(panda_pose, q_panda, "square:0.1:blend=0.05")  # nothing straight is left


def test_columns_are_taken_by_their_names(tmp_path, panda_pose, q_panda) -> None:
    file, turns = tmp_path / "loop.csv", TILTS.as_quat()
    file.write_text("y,X, z\n" + "".join(f"{y},{x},{z}\n" for x, y, z in LOOP))
    np.testing.assert_array_equal(rp.read_waypoints(file).points, LOOP)
    lines = [",".join(map(repr, map(float, row))) for row in np.hstack([LOOP, turns])]
    for head in ("", "x,y,z,qx,qy,qz,qw\n"):
        file.write_text(head + "\n".join(lines))
        found = rp.read_waypoints(file)
        np.testing.assert_allclose(found.points, LOOP, atol=1e-15)
        np.testing.assert_allclose(found.rotations, TILTS.as_matrix(), atol=1e-15)
        assert found.times is None and rp.waypoints(found).period is None
    times = [0.5, 1, 2, 4, 5, 6.5]
    file.write_text(
        "time,qw,qx,qy,qz,x,y,z\n"
        + "\n".join(
            ",".join(map(str, [t, w, x, y, z, *p]))
            for t, (x, y, z, w), p in zip(times, turns.tolist(), LOOP.tolist(), strict=True)
        )
    )
    same = rp.waypoints(LOOP, TILTS, times=times)
    read = rp.waypoints(rp.read_waypoints(file))
    with pytest.raises(rp.InputError, match="the waypoints already have times; omit times="):
        rp.waypoints(rp.read_waypoints(file), times=times)
    assert read.period == 6 and read.breaks == same.breaks
    for s in np.linspace(0, 1, 17):
        np.testing.assert_allclose(
            read.placement(s).homogeneous, same.placement(s).homogeneous, atol=1e-12
        )


WRONG: dict[str, tuple[Callable[[], object], str]] = {
    "open": (
        lambda: rp.TaskPath(
            "mine", lambda s: np.array([s, 0, 0]), lambda s: np.array([1, 0, 0]), np.eye(3)
        ),
        "mine is open: point.1. differs from point.0. by 1 m",
    ),
    "slope": (
        lambda: rp.TaskPath("mine", _round, lambda s: 6 * _round(s + 0.25), np.eye(3)),
        "mine: at s = .* m per c",
    ),
    "turn": (
        lambda: rp.TaskPath("mine", _round, _rate, lambda s: pin.exp3(np.array([0, 0, s]))),
        "rotation.1. differs from rotation.0. by 1 rad",
    ),
    "spin": (
        lambda: rp.TaskPath("mine", _round, _rate, nodding, spin=lambda s: np.ones(3)),
        "rad per cycle",
    ),
    "no rotation": (
        lambda: rp.TaskPath("mine", _round, _rate, np.ones((3, 3))),
        "rotation must be a rotation matrix",
    ),
    "a rotation that ends": (
        lambda: rp.TaskPath("mine", _round, _rate, lambda s: np.eye(3) if s < 0.5 else None),
        r"mine: rotation\(0.\d+\) must be a rotation matrix",
    ),
    "a point that ends": (
        lambda: rp.TaskPath("mine", lambda s: _round(s) if s < 0.5 else None, _rate, np.eye(3)),
        r"mine: point\(0.\d+\) must be three finite numbers",
    ),
    "mirror": (lambda: rp.TaskPath("mine", _round, _rate, np.diag([1, 1, -1])), "det R = −1"),
    "not three": (
        lambda: rp.TaskPath("mine", lambda s: np.zeros(2), _rate, np.eye(3)),
        "three finite numbers",
    ),
    "breaks": (
        lambda: rp.TaskPath("mine", _round, _rate, np.eye(3), (0.5, 0.2)),
        "breaks must increase",
    ),
    "rotations": (
        lambda: rp.waypoints(LOOP, [np.eye(3)] * 4),
        "6 waypoints require 1 or 6 rotations, but rotation= has 4",
    ),
    "no rotations": (lambda: rp.waypoints(LOOP), "have no orientations; add rotation="),
    "both": (lambda: rp.waypoints([pin.SE3.Identity()] * 3, np.eye(3)), "omit rotation="),
    "no function": (
        lambda: rp.TaskPath("mine", None, _rate, np.eye(3)),
        "point must be a function of s",
    ),
    "spin of two": (
        lambda: rp.TaskPath("mine", _round, _rate, nodding, spin=lambda s: np.ones(2)),
        "three finite",
    ),
    "no breaks": (lambda: rp.TaskPath("mine", _round, _rate, np.eye(3), None), "breaks must be"),
    "no points": (lambda: rp.waypoints(None, np.eye(3)), "waypoints must be rows"),
    "no matrix": (lambda: rp.waypoints(LOOP, 3.0), "rotation must be a rotation matrix"),
    "half a turn": (
        lambda: rp.waypoints(LOOP[[0, 1, 5]], [np.eye(3), np.diag([1, -1, -1]), np.eye(3)]),
        "half a turn",
    ),
    "ends turned": (lambda: rp.waypoints(LOOP, TILTS[[1, 1, 2, 3, 4, 0]]), "open by 0.3 rad"),
    "times": (
        lambda: rp.waypoints(LOOP, np.eye(3), times=[0, 1, 2, 2, 3, 4]),
        "times must be 6 increasing",
    ),
    "times and arcs": (
        lambda: rp.waypoints(LOOP, np.eye(3), times=range(6), blend=0.01),
        "times= and blend= are mutually exclusive",
    ),
    "nowhere": (lambda: rp.waypoints(np.zeros((4, 3)), np.eye(3)), "all points are the same"),
    "100,000": (lambda: rp.waypoints(np.zeros((100_000, 3)), np.eye(3)), "reduce them to at most"),
}


def _round(s: float) -> np.ndarray:
    return np.array([np.cos(2 * np.pi * s), np.sin(2 * np.pi * s), 0])


def _rate(s: float) -> np.ndarray:
    return 2 * np.pi * _round(s + 0.25)


@pytest.mark.parametrize("case", WRONG)
def test_what_is_no_closed_path_is_refused_by_name(case: str) -> None:
    make, why = WRONG[case]
    with pytest.raises(rp.InputError, match=why) as error:
        make()
    assert "\n" not in str(error.value)


class Wave:
    """A closed path of one's own class: no more than the protocol asks for."""

    name, breaks = "wave", ()

    def __init__(self, start: pin.SE3, way: float = 1.0) -> None:
        self.start, self.way = start, way

    def placement(self, s: float) -> pin.SE3:
        return pin.SE3(
            self.start.rotation, self.start.translation + 0.03 * (_round(s) - _round(0.0))
        )

    def twist(self, s: float) -> np.ndarray:
        return self.way * np.concatenate([0.03 * _rate(s), np.zeros(3)])


def test_a_class_of_ones_own_goes_everywhere_and_is_tried_first(q_panda) -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    q0 = np.array([0.3, 0.8, 0.8])
    wave = Wave(task.placement(q0))
    motion = rp.follow(rp.Pseudoinverse(task), wave, q0, cycles=1, steps=60)
    assert motion.tracking_error.max() < 1e-7 and np.isclose(
        motion.path.length, 0.06 * np.pi, rtol=1e-4
    )
    assert "wave" in rp.animation({"mine": motion}).page
    assert (
        rp.study(
            rp.Problem("planar3r", path=wave, start=q0), cycles=1, steps=60, degree=1
        ).path.name
        == "wave"
    )
    with pytest.raises(rp.InputError, match="wave: at s = "):
        rp.follow(rp.Pseudoinverse(task), Wave(task.placement(q0), way=-1.0), q0)
    with pytest.raises(rp.InputError, match="path must be a closed path"):
        rp.follow(rp.Pseudoinverse(task), "circle", q0)


@pytest.mark.slow
def test_a_study_takes_the_words_of_a_path() -> None:
    found = rp.study(rp.Problem("planar3r", path="circle:0.3"), cycles=1, steps=60, degree=1)
    assert found.path.spec.startswith("circle:0.3:") and found.path.plane == "xy"
    assert found.path.name == "circle of radius 0.3 m in xy"


def test_a_path_of_pieces_has_the_bits_of_numpy(panda_pose, q_panda) -> None:
    """Pickled and saved paths are Chebyshev series of any degree, of three or seven columns."""
    rng = np.random.default_rng(5)
    for path in (
        rp.circle(panda_pose, q_panda, 0.1),
        rp.circle(panda_pose, q_panda, 0.05, normal="x", rotation="tangent"),
        rp.polygon(panda_pose, q_panda, [[0.1, 0, 0], [0.1, 0.1, 0]]),
    ):
        make, (series, rotation) = copyreg.dispatch_table[rp.TaskPath](path)
        of_pieces = make(series, rotation)
        for one, s in product(series, rng.uniform(0, 1, 10)):
            if not one.begin <= s < one.end:
                continue
            u = (2 * s - one.begin - one.end) / (one.end - one.begin)
            slope = chebyshev.chebder(one.coefficients) * (2 / (one.end - one.begin))
            for found, known in ((of_pieces.point, one.coefficients), (of_pieces.slope, slope)):
                assert np.array_equal(found(s), chebyshev.chebval(u, known)[:3])
