"""Section V of the paper: squares of its sizes under J⁺, k = 0 and k = 1, against the theory's end
points and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from controls import some

import repctl_pin as rp

PI = np.pi
SIDES = [0.4 * i for i in (1, 4, 7, 10)]
ENDS = [SIDES[0], SIDES[-1]]
STEPS = 800


@pytest.fixture(scope="module")
def task() -> rp.Task:
    return rp.Robot.load("ppr").task("tool", "xy")


def inverse_60(task: rp.Task, k: float) -> rp.CustomInverse:
    """(60) as printed, from (40)."""

    def G(q: np.ndarray) -> np.ndarray:
        s, c = np.sin(q[2]), np.cos(q[2])
        J = np.array([[1, 0, -s], [0, 1, c]])
        difference = (k * c + s) / (2 * (k * k + 1)) * np.outer([s, -c, 1.0], [1.0, -k])
        return J.T @ np.linalg.inv(J @ J.T) + difference

    return rp.CustomInverse(task, G)


def potential(q: np.ndarray, k: float) -> np.ndarray:
    """What (60) keeps constant: k d₁ + d₂ − √(1 + k²) ∫ (1 + sin²)/cos, the integral ln((1 +
    sin)/(1 − sin)) − sin."""
    t = q[..., 2] + np.arctan(k)
    integral = np.log((1 + np.sin(t)) / (1 - np.sin(t))) - np.sin(t)
    return k * q[..., 0] + q[..., 1] - np.sqrt(1 + k * k) * integral


def corners(side: float) -> np.ndarray:
    return np.array([[side, 0, 0], [side, -side, 0], [0, -side, 0]])


def square(strategy, side: float, steps: int = STEPS) -> rp.Motion:
    path = rp.polygon(strategy.task, np.zeros(3), corners(side))
    return rp.follow(strategy, path, np.zeros(3), cycles=1, steps=steps, period=4 * side / 0.04)


@pytest.fixture(scope="module", params=some([ENDS, SIDES], ENDS), ids=len)
def sides(request: pytest.FixtureRequest) -> list[float]:
    return request.param


@pytest.fixture(scope="module")
def by_pseudoinverse(task: rp.Task, sides: list[float]) -> dict[float, rp.Motion]:
    return {side: square(rp.Pseudoinverse(task), side) for side in [*sides, 1.0]}


@pytest.fixture(scope="module")
def by_k0(task: rp.Task, sides: list[float]) -> dict[float, rp.Motion]:
    return {side: square(inverse_60(task, 0.0), side) for side in sides}


@pytest.mark.parametrize(
    "side, end",
    [(4.0, (1.37361851, -0.92758245, -4.32948200)), (1.0, (0.06030406, 0.34201102, -0.34905614))],
)
def test_pseudoinverse_ends_where_theory_says(
    by_pseudoinverse: dict[float, rp.Motion], side: float, end
) -> None:
    assert np.abs(by_pseudoinverse[side].q[-1] - end).max() < 1e-7


def test_every_square_drifts_along_the_fiber_under_the_pseudoinverse(
    by_pseudoinverse: dict[float, rp.Motion], sides: list[float]
) -> None:
    for side in sides:
        d1, d2, t = by_pseudoinverse[side].q[-1]
        # the tool is back on (1, 0)
        assert abs(d1 - (1 - np.cos(t))) < 1e-9 and abs(d2 + np.sin(t)) < 1e-9
        assert by_pseudoinverse[side].drift[0] > 0.06
    # the small-loop law
    assert by_pseudoinverse[0.4].drift[0] == pytest.approx(0.4**2 / np.sqrt(8), rel=0.15)


def test_k0_closes_every_square_and_stays_on_one_surface(by_k0: dict[float, rp.Motion]) -> None:
    for motion in by_k0.values():
        assert motion.drift[0] < 1e-10
        assert np.abs(potential(motion.q, 0.0)).max() < 1e-9
        assert motion.tracking_error.max() < 1e-9


def test_pseudoinverse_and_k0_coincide_up_to_C_and_part_after(
    by_pseudoinverse, by_k0, sides: list[float]
) -> None:
    for side in sides:
        gap = np.abs(by_pseudoinverse[side].q - by_k0[side].q).max(axis=1)
        at_C = STEPS // 2
        assert gap[: at_C + 1].max() < 1e-9
        assert gap[at_C + STEPS // 40] > 1e-4
        assert (np.diff(gap[at_C : 3 * at_C // 2]) > 0).all()  # all along C → D


@pytest.fixture(scope="module")
def from_G(task: rp.Task) -> tuple[rp.Motion, rp.Motion]:
    """The largest square once more by J⁺ and k = 1, both from where J⁺ first has θ₃ = −5π/4, on D →
    A."""
    fine = square(rp.Pseudoinverse(task), 4.0, 8000)
    theta = fine.q[:, 2]
    i = int(np.argmax(theta < -5 * PI / 4))
    share = (-5 * PI / 4 - theta[i - 1]) / (theta[i] - theta[i - 1])
    y = -4 + 4 * (i - 1 + share - 6000) / 2000
    assert -4 < y < 0
    q = np.array([1 - np.cos(5 * PI / 4), y + np.sin(5 * PI / 4), -5 * PI / 4])
    assert np.abs(q - (fine.q[i - 1] + share * (fine.q[i] - fine.q[i - 1]))).max() < 1e-6
    path = rp.polygon(task, q, np.vstack([np.zeros(3), corners(4.0)]) - [0, y, 0])
    options = {"cycles": 1, "steps": STEPS, "period": 400.0}
    return rp.follow(rp.Pseudoinverse(task), path, q, **options), rp.follow(
        inverse_60(task, 1.0), path, q, **options
    )


@pytest.mark.slow
def test_k1_matches_the_pseudoinverse_at_G(
    task: rp.Task, from_G: tuple[rp.Motion, rp.Motion]
) -> None:
    desired, one = from_G
    G = one.q[0]
    assert G[2] == -5 * PI / 4 and -np.tan(G[2]) == pytest.approx(1.0)
    assert np.abs(inverse_60(task, 1.0)(G) - rp.Pseudoinverse(task)(G)).max() < 1e-14
    # |sin θ₃|/√2
    assert np.linalg.norm(inverse_60(task, 0.0)(G) - rp.Pseudoinverse(task)(G)) == pytest.approx(
        0.5
    )
    assert np.abs(one.qdot[0] - desired.qdot[0]).max() < 1e-14
    # They touch: with equal velocities and equal ∂(G ẋ)/∂θ₃ but for w's slope, the gap opens with
    # the square of s.
    s = one.t * 0.04
    gap = np.abs(one.q[:, 2] - desired.q[:, 2])
    i, j = np.searchsorted(s, [0.1, 0.2])
    assert gap[j] / gap[i] == pytest.approx((s[j] / s[i]) ** 2, rel=0.15)


@pytest.mark.slow
def test_k1_closes_and_stays_on_its_surface(from_G: tuple[rp.Motion, rp.Motion]) -> None:
    desired, one = from_G
    assert one.drift[0] < 1e-10 and desired.drift[0] > 1
    h = potential(one.q, 1.0)
    assert np.abs(h - h[0]).max() < 1e-8


def test_k0_pays_only_where_the_tool_moves_along_x(
    task: rp.Task, by_k0: dict[float, rp.Motion]
) -> None:
    """Fig. 12: the inverses differ from B on, the velocities only on C → D, where the difference is
    ‖w‖ ‖ẋ‖."""
    motion = by_k0[SIDES[-1]]
    J = task.jacobians(motion.q)
    G = rp.Pseudoinverse(task).batch(motion.q, J)
    xdot = np.einsum("kan,kn->ka", J, motion.qdot)
    assert np.allclose(np.linalg.norm(xdot, axis=1), 0.04, atol=1e-12)
    difference = np.linalg.norm(motion.qdot - np.einsum("kna,ka->kn", G, xdot), axis=1)
    worst = 0.04 * np.abs(np.sin(motion.q[:, 2])) / np.sqrt(2)  # (50)
    side = STEPS // 4
    along_CD = slice(2 * side, 3 * side)
    assert np.allclose(difference[along_CD], worst[along_CD], atol=1e-9)
    assert difference[: 2 * side].max() < 1e-12 and difference[3 * side : -1].max() < 1e-12
    assert worst[2 * side - 1] > 0.02
