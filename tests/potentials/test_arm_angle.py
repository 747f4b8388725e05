"""The arm angle as a potential: its gradient, its meaning, its singular directions, and a control
made of it."""

from __future__ import annotations

import numpy as np
import pytest
from arms import Q_PANDA

import repctl_pin as rp

FRAMES = ("panda_link2", "panda_link4", "panda_link6")


def angle(singular: object = None, frames: tuple[str, str, str] = FRAMES) -> rp.ArmAngle:
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    return rp.ArmAngle(task, *frames, singular=singular)


@pytest.mark.parametrize(
    "frames", [FRAMES, ("panda_link4", "panda_link6", "panda_hand_tcp")], ids=["fixed", "moving"]
)
@pytest.mark.parametrize("singular", [None, (-1.0, 0.2, 0.3)])
def test_gradient_against_differences(singular: object, frames: tuple[str, str, str]) -> None:
    """With a shoulder that stands still, as an arm's does, and with a point that moves in its
    place."""
    potentials = angle(singular, frames)
    rng = np.random.default_rng(0)
    Q = Q_PANDA + 0.4 * rng.normal(size=(6, 7))
    for q, g in zip(Q, potentials.gradients(Q)[:, :, 0], strict=True):
        for d in 1e-6 * np.eye(7):
            up, down = (potentials.values([q + s * d])[0, 0] for s in (1, -1))
            assert (up - down) / 2e-6 == pytest.approx(g @ d / 1e-6, abs=1e-7)


@pytest.mark.parametrize("singular", [None, (-1.0, 0.0, 0.0)])
def test_it_is_the_turn_of_the_elbow_about_the_line_to_the_wrist(singular: object) -> None:
    """Shoulder and wrist held, the elbow turned by δ: the angle changes by δ, to first order along
    the self-motion."""
    potentials = angle(singular)
    assert potentials.names[0].startswith(
        "arm angle panda" if singular is None else "stereographic arm angle panda"
    )
    q = Q_PANDA + 0.2
    (e, J_e), (w, J_w) = potentials._points(q)
    # the wrist and the hand's turn held
    n = np.linalg.svd(np.vstack([J_w, potentials.task.jacobian(q)[3:]]))[2][-1]
    axis = w / np.linalg.norm(w)
    rate = axis @ np.cross(e - axis * (axis @ e), J_e @ n) / np.sum(np.cross(axis, e) ** 2)
    assert abs(rate) > 0.1
    assert potentials.gradients([q])[0, :, 0] @ n == pytest.approx(rate, rel=1e-6)


def test_where_it_is_singular() -> None:
    """The conventional angle along the reference and against it, the stereographic one on one side
    alone."""
    r, t = np.array([0.0, 0.0, 1.0]), np.array([-1.0, 0.0, 0.0])
    conventional, stereographic = angle(), angle(t)
    for w in (r, -r):
        assert np.linalg.norm(conventional._zero(w)[0]) < 1e-12
        assert np.linalg.norm(stereographic._zero(w)[0]) > 0.9
    assert (
        np.linalg.norm(stereographic._zero(t)[0]) < 1e-12
        and np.linalg.norm(stereographic._zero(-t)[0]) > 0.9
    )
    rng = np.random.default_rng(0)
    for w in rng.normal(size=(50, 3)):
        w /= np.linalg.norm(w)
        assert abs(stereographic._zero(w)[0] @ w) < 1e-12  # across the line
        assert np.linalg.norm(stereographic._zero(w)[0]) > 0.2 * np.linalg.norm(w - t) ** 2
    assert 0 < conventional.distance(Q_PANDA) <= np.pi / 2


@pytest.mark.slow
def test_a_control_that_holds_it_repeats_and_polynomials_correct_it(quick_choices: None) -> None:
    potentials = angle((-1.0, 0.0, 0.0))
    task = potentials.task
    held = rp.RepeatableInverse(task, potentials.weighted([[1.0]]))
    path = rp.circle(task, Q_PANDA, 0.1, normal="x")
    assert (
        rp.follow(held, path, Q_PANDA, cycles=2, steps=60, integrator=rp.LeafLock(3)).drift.max()
        < 1e-9
    )
    box = rp.Box(Q_PANDA, 0.3)
    desired = rp.Pseudoinverse(task)
    alone = rp.nearest_repeatable(
        desired, potentials, box, options=rp.FitOptions(samples=128, held_out=64)
    )
    joined = rp.nearest_repeatable(
        desired,
        potentials + rp.Polynomial(Q_PANDA, 1, 0.3),
        box,
        options=rp.FitOptions(samples=128, held_out=64),
    )
    assert joined.cost < 0.9 * alone.cost


def test_wrong_arguments() -> None:
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    with pytest.raises(rp.InputError, match="no_such"):
        rp.ArmAngle(task, "panda_link2", "no_such", "panda_link6")
    with pytest.raises(rp.InputError, match="singular= is parallel to reference="):
        rp.ArmAngle(task, *FRAMES, singular=(0, 0, 1))
    with pytest.raises(rp.InputError, match="three finite numbers"):
        rp.ArmAngle(task, *FRAMES, reference=(0, 0))
