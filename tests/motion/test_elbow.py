"""An operator's elbow: the level whose elbow is nearest, a function of pose and point."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA
from cell_functions import function_of
from controls import NEEDS_C, control, iiwa, some

import repctl_pin as rp
from repctl_pin.redundancy.nullspace import nullspace

Q0 = np.array([0.3, 0.8, 0.8])
LIMITS = rp.Limits(velocity=2.0, acceleration=6.0, jerk=400.0)


def panda(kind: str = "pose") -> rp.RepeatableInverse:
    task = rp.Robot.load("panda").task("panda_hand_tcp", kind)
    return control(task, Q_PANDA, rp.Polynomial(Q_PANDA, 2, 0.5))


def planar() -> rp.RepeatableInverse:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    return control(task, Q0, rp.Polynomial(Q0, 2, 0.5))


ARMS = pytest.mark.parametrize(("make", "q0"), [(panda, Q_PANDA), (planar, Q0)])


@ARMS
def test_the_elbow_of_another_configuration_at_the_pose_is_found(make: object, q0: object) -> None:
    inverse, rng = make(), np.random.default_rng(0)  # type: ignore[operator]
    for _ in range(20):
        q = q0 + rng.normal(size=inverse.task.n) * 0.1
        place, leaf = inverse.task.placement(q), inverse.leaf(q) + rng.uniform(-0.15, 0.15)
        other = inverse.solve(place, q, leaf=leaf)
        found = inverse.leaf_toward(q, elbow=inverse.elbow(other))
        assert found.unique and found.distance < 1e-9
        np.testing.assert_allclose(found.leaf, leaf, atol=1e-8)
        np.testing.assert_allclose(found.q, other, atol=1e-8)


@pytest.mark.parametrize(
    ("make", "q0"), [pytest.param(panda, Q_PANDA, marks=pytest.mark.slow), (planar, Q0)]
)
@pytest.mark.parametrize("points", some([2, 4], 2))
def test_no_elbow_of_the_self_motion_is_nearer(make: object, q0: object, points: int) -> None:
    """Points out of reach; the way along the self-motion is searched by steps of 0.01 rad."""
    inverse, rng = make(), np.random.default_rng(1)  # type: ignore[operator]
    task = inverse.task
    for _ in range(points):
        point = inverse.elbow(q0) + rng.normal(size=3) * 0.2
        found = inverse.leaf_toward(q0, elbow=point)
        assert np.abs(task.error(found.q, task.placement(q0))).max() < 1e-12
        assert task.limit_margin(found.q).min() > 0
        assert abs(np.linalg.norm(inverse.elbow(found.q) - point) - found.distance) < 1e-12
        for sign in (1, -1):
            q, way = q0, sign * nullspace(task.jacobian(q0))[:, 0]
            for _ in range(200):
                N = nullspace(task.jacobian(q))[:, 0]
                way = N * np.sign(N @ way)
                q = q + 0.01 * way
                for _ in range(2):
                    q = q + np.linalg.pinv(task.jacobian(q)) @ task.error(q, task.placement(q0))
                if task.limit_margin(q).min() < 0:
                    break
                assert np.linalg.norm(inverse.elbow(q) - point) > found.distance - 1e-4


def test_a_point_on_the_line_from_shoulder_to_wrist_moves_nothing(tmp_path: Path) -> None:
    """The iiwa's elbow is on a circle around this line; every place is as near."""
    task = iiwa(tmp_path).task(kind="pose")
    q0 = np.array([0.1, 0.6, 0.0, -1.2, 0.0, 0.9, 0.0])
    inverse = control(task, q0, rp.Polynomial(q0, 2, 0.5))
    shoulder, wrist = (task.joint_origins(q0)[i] for i in (1, 5))
    e, line = inverse.elbow(q0) - shoulder, (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
    center = shoulder + (e @ line) * line
    found = inverse.leaf_toward(q0, elbow=center)
    assert not found.unique and (found.q == q0).all()
    np.testing.assert_array_equal(found.leaf, inverse.leaf(q0))
    beside = inverse.leaf_toward(q0, elbow=center + 0.1 * np.cross(line, e))
    assert beside.unique and np.abs(beside.q - q0).max() > 0.1


def test_a_self_motion_that_moves_no_elbow_is_told() -> None:
    """From joints that have a history the level has one; from F(x), it is a function."""
    found = panda("axis").leaf_toward(Q_PANDA, elbow=[0.3, 0.2, 0.5])
    assert not found.unique
    function = function_of("tool axes")
    inverse, cell, rng = function.inverse, function.cell, np.random.default_rng(5)
    x = cell.placement
    point = inverse.elbow(function(x)) + [0.05, 0.03, 0.02]
    turned = function(x, leaf=[0.1, 0.1])
    a, b = (inverse.leaf_toward(q, elbow=point) for q in (function(x), turned))
    assert np.abs(a.leaf - b.leaf).max() > 0.05 and abs(a.distance - b.distance) < 1e-5
    first = function.leaf_toward(x, elbow=point)
    for _ in range(3):
        other = cell.at(rng.uniform(-0.8, 0.8, cell.k))
        function.leaf_toward(other, elbow=point + rng.normal(size=3) * 0.1)
        again = function.leaf_toward(x, elbow=point)
        assert (again.leaf == first.leaf).all() and not again.unique


def test_the_margin_is_kept_by_every_result() -> None:
    """With four self-motions, curved ways ended 3 cm beyond it; from beyond, it moves back."""
    inverse, rng, near = panda("position"), np.random.default_rng(2), 0
    task = inverse.task
    for size in (0.05, 0.1, 0.3) * 6:
        q = Q_PANDA + rng.normal(size=7) * 0.15
        q = np.clip(q, task.lower + 0.05, task.upper - 0.05)
        found = inverse.leaf_toward(
            q, elbow=inverse.elbow(q) + rng.normal(size=3) * size, margin=0.03
        )
        near += task.limit_margin(found.q).min() < 0.0302
        assert task.limit_margin(found.q).min() >= 0.03
        assert np.abs(task.error(found.q, task.placement(q))).max() < 1e-9
    assert near


def test_the_elbow_of_an_arm_whose_reference_is_singular() -> None:
    """The xarm7 is stretched there; its elbow has a name all the same."""
    task = rp.Robot.load("xarm7").task(None, "pose")
    q0 = np.array([0.1, 0.3, 0.2, 0.9, 0.1, 0.6, 0.0])
    inverse = control(task, q0, rp.Polynomial(q0, 2, 0.5))
    place, leaf = task.placement(q0), inverse.leaf(q0) + 0.1
    other = inverse.solve(place, q0, leaf=leaf)
    found = inverse.leaf_toward(q0, elbow=inverse.elbow(other))
    assert found.unique and np.abs(found.q - other).max() < 1e-7


@pytest.mark.parametrize("bend", [-0.8, -0.34, 0.2, 0.53])
def test_the_search_ends_before_a_singularity_of_the_arm(bend: float) -> None:
    """57.3: a folded arm on the way; results were 4e-7 from it, at a leaf margin of 1."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    folded = np.array([0.1, 0.0, np.pi])
    place = task.placement(folded)
    q0 = rp.solve_ik(task, [0.1, bend, np.pi], place)
    inverse = control(task, q0, rp.Polynomial(q0, 2, 0.5))
    found = inverse.leaf_toward(q0, elbow=inverse.elbow(folded))
    values = np.linalg.svd(task.jacobian(found.q))[1]
    assert values[-1] / values[0] >= 0.01
    assert np.abs(task.error(found.q, place)).max() < 1e-12
    assert np.abs(inverse.solve(place, q0, leaf=found.leaf) - found.q).max() < 1e-9
    before = np.linalg.norm(inverse.elbow(q0) - inverse.elbow(folded))
    assert found.distance <= before


@NEEDS_C
def test_the_joints_come_back_whenever_hand_and_elbow_do() -> None:
    """Closed paths in (x, p_e) by a governor; the elbow is at the nearest place at rest."""
    function = function_of("poses")
    task, rng = function.task, np.random.default_rng(3)
    home = function.cell.placement
    q0 = function(home)
    governor = rp.Governor(function.inverse, 0.001, LIMITS)
    governor.start(q0)
    begin = function.inverse.elbow(q0)

    def to(place: pin.SE3, point: np.ndarray) -> np.ndarray:
        found = function.leaf_toward(place, elbow=point, margin=0.01)
        np.testing.assert_allclose(function(place, leaf=found.leaf), found.q, atol=1e-9)
        for _ in range(6000):
            q, status = governor.step(place, leaf=found.leaf)
            if status is rp.Status.OK:
                break
        assert status is rp.Status.OK
        assert np.abs(function.inverse.elbow(q) - function.inverse.elbow(found.q)).max() < 1e-9
        return q

    first = to(home, begin)
    for _ in range(4):
        for _ in range(2):
            place = pin.SE3(home.rotation, home.translation + rng.uniform(-0.06, 0.06, 3))
            to(place, begin + rng.uniform(-0.1, 0.1, 3))
        assert np.abs(to(home, begin) - first).max() < 1e-9
    assert task.limit_margin(first).min() > 0


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"elbow": [0.1, 0.2]}, "elbow"),
        ({"elbow": [0.1, np.nan, 0.3]}, "elbow"),
        ({"elbow": "left"}, "elbow"),
        ({"elbow": np.zeros(3), "link": "elbow_of_mine"}, "no frame .elbow_of_mine."),
        ({"elbow": np.zeros(3), "link": 4}, "link"),
        ({"elbow": np.zeros(3), "link": "panda_link0"}, "moved by no joint"),
        ({"elbow": np.zeros(3), "margin": -1.0}, "margin"),
    ],
)
def test_bad_elbows_are_refused_in_one_line(given: dict[str, object], said: str) -> None:
    with pytest.raises(rp.InputError, match=said) as error:
        panda().leaf_toward(Q_PANDA, **given)  # type: ignore[arg-type]
    assert "\n" not in str(error.value)


def test_a_point_far_away_is_the_same_as_its_direction() -> None:
    inverse = panda()
    away = np.array([0.3, 1.0, 0.2])
    far, farther = (inverse.leaf_toward(Q_PANDA, elbow=s * away) for s in (1e4, 1e8))
    assert far.unique and np.abs(far.leaf - farther.leaf).max() < 1e-3
