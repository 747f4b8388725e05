"""Potentials given as functions; dependent and useless ones are found and named."""

from __future__ import annotations

import numpy as np
import pytest

import repctl_pin as rp

Q0 = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])


def bump(q: np.ndarray) -> float:
    return float(np.exp(-np.sum(q**2)))


def bump_gradient(q: np.ndarray) -> np.ndarray:
    return -2 * q * bump(q)


def test_given_and_numerical_gradients_agree_and_say_which_they_are() -> None:
    given, numerical = (rp.CustomPotentials([(bump, bump_gradient)]), rp.CustomPotentials([bump]))
    Q = np.random.default_rng(0).normal(size=(5, 3))
    assert np.allclose(given.gradients(Q), numerical.gradients(Q), atol=1e-9)
    assert given.numerical == (False,) and numerical.numerical == (True,)
    assert numerical.names == ("bump (gradient by differences)",) and given.names == ("bump",)
    assert "differences" in repr(numerical) and "differences" not in repr(given)


def test_weighted_sum_is_the_sum() -> None:
    potentials = rp.CustomPotentials(
        [(bump, bump_gradient), lambda q: q[0] * q[1]], names=["bump", "product"]
    )
    A = np.array([[1.0, 2.0], [3.0, -1.0]])
    q = np.array([0.3, -0.2, 0.5])
    h = potentials.weighted(A)
    assert np.allclose(h.value(q), np.array([bump(q), q[0] * q[1]]) @ A)
    assert np.allclose(
        h.gradient(q), np.column_stack([bump_gradient(q), [q[1], q[0], 0]]) @ A, atol=1e-9
    )
    assert np.allclose(h.gradients(q[None])[0], h.gradient(q))


@pytest.mark.slow
def test_functions_design_like_the_polynomials_they_are(panda_pose: rp.Task) -> None:
    box, desired = rp.Box(Q0, 0.3), rp.Pseudoinverse(panda_pose)
    linear = rp.CustomPotentials(
        [(lambda q, i=i: q[i], lambda q, i=i: np.eye(7)[i]) for i in range(7)]
    )
    options = rp.FitOptions(samples=512, held_out=512)
    ours = rp.nearest_repeatable(desired, linear, box, options=options)
    theirs = rp.nearest_repeatable(desired, rp.Polynomial(Q0, 1, 0.3), box, options=options)
    assert np.isclose(ours.cost, theirs.cost, rtol=1e-6)


def test_dependent_potentials_are_dropped_by_name(panda_pose: rp.Task) -> None:
    box, desired = rp.Box(Q0, 0.3), rp.Pseudoinverse(panda_pose)
    options = rp.FitOptions(samples=512, held_out=512)
    base = rp.Polynomial(Q0, 1, 0.3)
    extra = rp.CustomPotentials(
        [
            (lambda q: 1.0, lambda q: np.zeros(7)),
            (lambda q: q[0] - 2 * q[3], lambda q: np.array([1.0, 0, 0, -2, 0, 0, 0])),
        ],
        names=["one", "again"],
    )
    design = rp.nearest_repeatable(desired, base + extra, box, options=options)
    assert len(design.dropped) == 2
    assert design.dropped[0].startswith("one: constant")
    assert design.dropped[1].startswith("again: depends linearly")
    assert np.array_equal(design.coefficients[7:], np.zeros((2, 1)))
    plain = rp.nearest_repeatable(desired, base, box, options=options)
    assert np.isclose(design.cost, plain.cost, rtol=1e-9)
    assert "again" in design.summary()


def test_potentials_in_the_row_space_are_dropped_by_name(panda: rp.Robot) -> None:
    """The height of the hand is a function of x = f(q): as V it would make J_V singular
    everywhere."""
    task = panda.task("panda_hand_tcp", "position")
    height = rp.CustomPotentials(
        [(lambda q: task.placement(q).translation[2], lambda q: task.jacobian(q)[2])],
        names=["height"],
    )
    options = rp.FitOptions(samples=512, held_out=512)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), rp.Polynomial(Q0, 1, 0.2) + height, rp.Box(Q0, 0.2), options=options
    )
    assert [text.partition(":")[0] for text in design.dropped] == ["height"]
    assert "row space" in design.dropped[0]
    with pytest.raises(rp.InputError, match=r"height.*row space"):
        few = rp.Polynomial(Q0, 1, 0.2, variables=[0, 1, 2]) + height
        rp.nearest_repeatable(rp.Pseudoinverse(task), few, rp.Box(Q0, 0.2), options=options)


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: rp.CustomPotentials([]), "at least one"),
        (lambda: rp.CustomPotentials(3), "list of functions"),
        (lambda: rp.CustomPotentials([3]), "potential 1"),
        (lambda: rp.CustomPotentials([bump, (bump, 3)]), "potential 2"),
        (lambda: rp.CustomPotentials([(bump, bump_gradient, bump)]), "potential 1"),
        (lambda: rp.CustomPotentials([(3, None)]), "potential 1"),
        (
            lambda: rp.CustomPotentials([lambda q: q[5]], names=["bad"]).values(np.zeros((1, 3))),
            "bad",
        ),
        (
            lambda: rp.CustomPotentials([lambda q: q + "x"], names=["bad"]).values(
                np.zeros((1, 3))
            ),
            "bad",
        ),
        (lambda: rp.CustomPotentials([bump], names=["a", "b"]), "2 names for 1"),
        (
            lambda: rp.CustomPotentials([lambda q: np.nan], names=["bad"]).gradients(
                np.zeros((1, 3))
            ),
            "bad must be one finite number",
        ),
        (
            lambda: rp.CustomPotentials([lambda q: "x"], names=["bad"]).values(np.zeros((1, 3))),
            "bad must be one finite number.*'x'",
        ),
        (
            lambda: rp.CustomPotentials([(bump, lambda q: np.zeros(2))]).gradients(
                np.zeros((1, 3))
            ),
            "3 finite numbers",
        ),
        (
            lambda: rp.CustomPotentials([(bump, lambda q: q * np.nan)]).gradients(np.ones((1, 3))),
            "finite",
        ),
    ],
)
def test_bad_input_gets_one_clear_line(make, message: str) -> None:
    with pytest.raises(rp.InputError, match=message) as error:
        make()
    assert "\n" not in str(error.value)
