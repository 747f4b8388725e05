"""The laws in C and in NumPy: the same errors in the same words, and the same rule for large
numbers."""

from __future__ import annotations

import pickle

import numpy as np
import pinocchio as pin
import pytest
from arms import Q_PANDA
from codegen.test_codegen import answer
from controls import in_numpy
from native_library import REQUIRED
from strategies.test_control_step import BAD_STEPS

import repctl_pin as rp

pytestmark = REQUIRED


def test_a_copy_has_the_same_law(panda_design: rp.Design, panda_pose: rp.Task) -> None:
    inverse, target = panda_design.inverse, panda_pose.placement(Q_PANDA + 0.1)
    other = pickle.loads(pickle.dumps(inverse))
    following = inverse.step(Q_PANDA, target, 0.01)
    assert np.array_equal(other.step(Q_PANDA, target, 0.01), following)
    assert np.allclose(in_numpy(inverse).step(Q_PANDA, target, 0.01), following)


def test_a_step_without_limits_reports_none_of_an_earlier_step(
    panda_design: rp.Design, panda_pose: rp.Task
) -> None:
    inverse, target = panda_design.inverse, panda_pose.placement(Q_PANDA + 0.1)
    for one in (inverse, in_numpy(inverse)):
        assert one.damped_step(Q_PANDA, target, 0.01, velocity_limit=0.1, damping=0.05).slowed < 1
        one.step(Q_PANDA, target, 0.01)
        assert one._law.own.report() == (0.0, 1.0)


@pytest.mark.parametrize("case", BAD_STEPS)
def test_bad_steps_get_the_same_line(
    case: str, panda_design: rp.Design, panda_pose: rp.Task
) -> None:
    inverse, (changed, words) = panda_design.inverse, BAD_STEPS[case]
    good = {
        "q": Q_PANDA + 0.01,
        "target": panda_pose.placement(Q_PANDA),
        "dt": 0.01,
        "leaf": inverse.leaf(Q_PANDA),
    }
    said = []
    plain = in_numpy(inverse)
    before = plain.step(**good)
    for one in (inverse, plain):
        with pytest.raises(rp.InputError, match=words) as caught:
            one.step(**(good | changed))
        said.append(str(caught.value))
    assert said[0] == said[1] and "\n" not in said[1]
    assert np.array_equal(plain.step(**good), before)


@pytest.mark.parametrize(
    "q, xdot",
    [
        (np.zeros(6), np.ones(6)),
        (np.zeros(7), np.ones(5)),
        (np.zeros(7), 1.0),
        (np.full(7, np.nan), np.ones(6)),
        (np.zeros(7), np.full(6, np.inf)),
    ],
)
def test_bad_velocities_get_the_same_line(q, xdot, panda_design: rp.Design) -> None:
    said = []
    for one in (panda_design.inverse, in_numpy(panda_design.inverse)):
        with pytest.raises(rp.InputError) as caught:
            one.velocity(q, xdot)
        said.append(str(caught.value))
    assert said[0] == said[1]


def test_singular_is_said_in_the_same_words() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    inverse = rp.RepeatableInverse(task, rp.Polynomial(np.zeros(3), 1).weighted(np.ones((3, 1))))
    said = []
    for one in (inverse, in_numpy(inverse)):
        for question in (
            lambda one=one: one.velocity(np.zeros(3), np.ones(2)),
            lambda one=one: one.step(np.zeros(3), pin.SE3.Identity(), 0.01),
        ):
            with pytest.raises(rp.SingularityError) as caught:
                question()
            said.append(str(caught.value))
    assert said[:2] == said[2:]
    for one in (inverse, in_numpy(inverse)):
        with pytest.raises(rp.SingularityError, match="J_V is singular"):
            one.batch(np.array([[0.3, 0.8, 0.8], [0, 0, 0]]))


# ---- large numbers, and rotations that are none
# ----------------------------------------------------


@pytest.mark.parametrize("size", [1e100, 1e150])
@pytest.mark.parametrize(
    "where", ["q", "leaf", "a coefficient", "xdot", "a twist", "dt", "a target"]
)
def test_large_numbers_have_one_rule_in_python_and_c(
    size: float, where: str, panda_pose: rp.Task
) -> None:
    A = np.append(rp.redundancy.nullspace(panda_pose.jacobian(Q_PANDA))[:, 0], np.full(28, 0.01))[
        :, None
    ]
    A[7] = size if where == "a coefficient" else A[7]
    inverse = rp.RepeatableInverse(panda_pose, rp.Polynomial(Q_PANDA, 2, 0.5).weighted(A))
    plain, q, xdot, twist, far = (
        in_numpy(inverse),
        Q_PANDA + 0.01,
        np.ones(6),
        np.ones(6),
        panda_pose.placement(Q_PANDA),
    )
    leaf, dt = inverse.leaf(Q_PANDA), size if where == "dt" else 0.01
    for name, array in (("q", q), ("xdot", xdot), ("a twist", twist), ("leaf", leaf)):
        array[0] = size if where == name else array[0]
    far = pin.SE3(far.rotation, np.full(3, size)) if where == "a target" else far

    def damped(one: rp.RepeatableInverse) -> np.ndarray:
        return one.step(q, far, dt, twist, leaf=leaf, velocity_limit=1.0, damping=0.1)

    for ask in (
        lambda one: one.velocity(q, xdot),
        lambda one: one.step(q, far, dt, twist, leaf=leaf),
        damped,
    ):
        answers = [answer(lambda one=one, ask=ask: ask(one)) for one in (inverse, plain)]
        if any(isinstance(a, str) for a in answers):
            assert answers[0] == answers[1]
        else:
            assert np.isfinite(answers).all()
            # singular values of rows of 1 and 1e100 are those of rounding
            hard = where in ("q", "a coefficient")
            assert np.allclose(*answers, rtol=1e-6) or (hard and ask is damped)


TURNS = {
    "reflected": np.diag([1.0, 1.0, -1.0]),
    "ones": np.ones((3, 3)),
    "twice": 2.0,
    "1e-5 too large": 1 + 1e-5,
}


@pytest.mark.parametrize("name", TURNS)
def test_what_is_no_rotation_is_refused_in_c_too(name: str, panda_design: rp.Design) -> None:
    inverse, task = panda_design.inverse, panda_design.task
    here = task.placement(Q_PANDA)
    R = TURNS[name] * here.rotation if np.isscalar(TURNS[name]) else TURNS[name]
    said = []
    for one in (inverse, in_numpy(inverse)):
        one.step(Q_PANDA, pin.SE3((1 + 1e-8) * here.rotation, here.translation), 0.01)
        with pytest.raises(rp.InputError) as caught:
            one.step(Q_PANDA, pin.SE3(R, here.translation), 0.01)
        said.append(str(caught.value))
    assert said[0] == said[1]
