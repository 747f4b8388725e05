"""The criterion's laws: gradient, gauge, order and cut of the nodes, and the plain reading of (36)
as an oracle."""

from __future__ import annotations

import numpy as np
import pytest

import repctl_pin as rp
from repctl_pin import redundancy
from repctl_pin.design import batches, criterion, singularity_search

KINDS = {"pose": 1, "axis": 2, "position": 4}


@pytest.fixture(scope="module", params=KINDS)
def setting(
    request: pytest.FixtureRequest, panda: rp.Robot, q_panda_module: np.ndarray
):
    task = panda.task("panda_hand_tcp", request.param)
    box = rp.Box(q_panda_module, 0.4)
    potentials = rp.Polynomial(q_panda_module, 2, 0.4)
    N = criterion.oriented_nullspace(
        task.jacobian(box.center)[None], task, box.center[None]
    )[0]
    builder = criterion.Builder(
        rp.Pseudoinverse(task), potentials, np.arange(potentials.size), N
    )
    Q, weights = box.nodes(256, 3)
    return task, potentials, builder, Q, weights


@pytest.fixture(scope="module")
def q_panda_module() -> np.ndarray:
    return np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])


def some_A(potentials: rp.Polynomial, r: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(potentials.size, r))


def test_cost_is_the_mean_distance_of_the_inverses(setting) -> None:
    """Node by node, with the inverses themselves: no E, no F, no null-space basis."""
    task, potentials, builder, Q, weights = setting
    A = some_A(potentials, task.r, 0)
    expected = 0.0
    for q, w in zip(Q, weights, strict=True):
        J = task.jacobian(q)
        V = potentials.gradients(q[None])[0] @ A
        G_r = np.linalg.inv(np.vstack([J, V.T]))[:, : task.m]  # (31), (37)
        expected += w * np.sum((G_r - np.linalg.pinv(J)) ** 2)
    cost, _ = criterion.cost(builder(Q, weights), A)
    assert np.isclose(cost, expected, rtol=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_gradient_agrees_with_finite_differences_at_random_coefficients(
    setting, seed: int
) -> None:
    task, potentials, builder, Q, weights = setting
    batch = builder(Q, weights)
    A = some_A(potentials, task.r, seed)
    value, half, *_ = criterion.gauss_newton(batch, A)
    gradient = 2 * half
    rng = np.random.default_rng(seed + 10)
    scale = np.linalg.norm(gradient)
    for _ in range(5):
        D = rng.normal(size=A.shape)
        D /= np.linalg.norm(D)
        # Richardson: random coefficients lie near algorithmic singularities of some nodes, where C
        # is steep
        e = 1e-6
        slopes = [
            (criterion.cost(batch, A + s * D)[0] - criterion.cost(batch, A - s * D)[0])
            / (2 * s)
            for s in (e, 2 * e)
        ]
        assert (
            abs((4 * slopes[0] - slopes[1]) / 3 - np.sum(gradient * D))
            < 2e-5 * scale + 1e-8 * value / e * 1e-4
        )


def test_gauss_newton_matrix_is_the_first_order_of_X(setting) -> None:
    task, potentials, builder, Q, weights = setting
    b = builder(Q, weights)
    A = some_A(potentials, task.r, 5)
    D = some_A(potentials, task.r, 6)
    matrix = criterion.gauss_newton(b, A)[2]

    def X(A: np.ndarray) -> np.ndarray:
        return b.F @ A @ np.linalg.inv(b.E @ A)

    e = 1e-7
    dX = (X(A + e * D) - X(A - e * D)) / (2 * e)
    expected = float(weights @ np.sum(dX**2, axis=(1, 2)))
    assert np.isclose(np.einsum("ai,iajb,bj->", D, matrix, D), expected, rtol=1e-3)


def test_gauge_changes_nothing(setting) -> None:
    task, potentials, builder, Q, weights = setting
    b = builder(Q, weights)
    A = some_A(potentials, task.r, 7)
    T = np.random.default_rng(8).normal(size=(task.r, task.r)) + 2 * np.eye(task.r)
    assert np.isclose(criterion.cost(b, A @ T)[0], criterion.cost(b, A)[0], rtol=1e-9)


def test_order_and_cut_of_the_nodes_change_nothing(setting) -> None:
    task, potentials, builder, Q, weights = setting
    A = some_A(potentials, task.r, 9)
    whole = batches.Local(builder, Q, weights, 256).total(criterion.gauss_newton, A)
    order = np.random.default_rng(1).permutation(len(Q))
    for other in (
        batches.Local(builder, Q, weights, 7),
        batches.Local(builder, Q, weights, 64, stream=True),
        batches.Local(builder, Q[order], weights[order], 100),
    ):
        for ours, theirs in zip(
            whole[:3], other.total(criterion.gauss_newton, A)[:3], strict=True
        ):
            assert np.allclose(
                ours, theirs, rtol=1e-10, atol=1e-10 * np.abs(ours).max()
            )


def test_orientation_makes_det_EA_smooth(
    panda: rp.Robot, q_panda_module: np.ndarray
) -> None:
    """With det [J; Nᵀ] > 0 the sign of det(Nᵀ V) is that of det J_V, whatever the factorisation
    does."""
    for kind in KINDS:
        task = panda.task("panda_hand_tcp", kind)
        Q = rp.Box(q_panda_module, 0.8).random(512, 0)
        J = task.jacobians(Q)
        N = criterion.oriented_nullspace(J, task, Q)
        assert np.abs(J @ N).max() < 1e-12
        assert (
            np.linalg.det(np.concatenate([J, np.swapaxes(N, 1, 2)], axis=1)) > 0
        ).all()
        V = np.random.default_rng(0).normal(size=(task.n, task.r))
        J_V = np.concatenate(
            [J, np.broadcast_to(V.T, (len(Q), task.r, task.n))], axis=1
        )
        assert np.array_equal(
            np.sign(np.linalg.det(J_V)),
            np.sign(np.linalg.det(np.swapaxes(N, 1, 2) @ V)),
        )


def test_sides_find_a_singularity_of_V(
    panda_pose: rp.Task, q_panda_module: np.ndarray
) -> None:
    box, potentials = rp.Box(q_panda_module, 0.4), rp.Polynomial(q_panda_module, 1, 0.4)
    N = criterion.oriented_nullspace(
        panda_pose.jacobian(box.center)[None], panda_pose, box.center[None]
    )[0]
    batch = criterion.Builder(
        rp.Pseudoinverse(panda_pose), potentials, np.arange(7), N
    )(*box.nodes(512, 0))
    assert criterion.cost(batch, N)[1].uniform  # V = N(center)
    row = redundancy.pseudoinverse(panda_pose.jacobian(box.center))[
        :, :1
    ]  # in the row space at the center
    sides = criterion.cost(batch, row)[1]
    assert not sides.uniform and sides.positive + sides.negative == 512


def test_signed_leaf_margin_is_the_leaf_margin(
    panda: rp.Robot, q_panda_module: np.ndarray
) -> None:
    """For every redundancy, by the inverse of J_V, against N; and at a singular J_V."""
    Q = rp.Box(q_panda_module, 0.6).random(64, 0)
    for kind in KINDS:
        task = panda.task("panda_hand_tcp", kind)
        A = np.random.default_rng(1).normal(size=(7, task.r))
        potentials = rp.Polynomial(q_panda_module, 1, 0.6).weighted(A)
        found = singularity_search.LeafMargin(task, potentials, q_panda_module)(Q)
        N, V = redundancy.nullspace(task.jacobians(Q)), potentials.gradients(Q)
        np.testing.assert_allclose(
            np.abs(found), redundancy.leaf_margin(N, V), atol=1e-12
        )
    J = task.jacobian(q_panda_module)
    row = rp.Polynomial(q_panda_module, 1, 1.0)
    A = np.linalg.lstsq(row.gradients(q_panda_module[None])[0], J.T, rcond=None)[0]
    flat = row.weighted(
        np.tile(A[:, :1], task.r)
    )  # all gradients are the same row of J
    assert (
        abs(
            singularity_search.LeafMargin(task, flat, q_panda_module)(
                q_panda_module[None]
            )[0]
        )
        < 1e-12
    )


def test_a_singular_node_is_named_whichever_it_is() -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    for k in range(3):
        Q = np.array([[0.1, 0.4, 0.5], [0.2, 0.5, 0.4], [0.3, 0.6, 0.7]])
        Q[k] = [0.7, 0.0, 0.0]  # stretched
        words = r"the Jacobian loses rank near .*theta1 = 0\.700, theta2 = 0\.000"
        with pytest.raises(rp.SingularityError, match=words):
            criterion.oriented_nullspace(task.jacobians(Q), task, Q)


@pytest.mark.parametrize(("factor", "words"), [(1.5, "0.5"), (np.nan, "nan")])
def test_the_node_at_which_a_strategy_is_no_inverse_is_named(
    factor: float, words: str
) -> None:
    """The one with the largest residual, and before it one where G_d is not finite."""
    task = rp.Robot.load("planar3r").task("tool", "xy")
    Q = np.array([[0.1, 0.4, 0.5], [0.2, 0.5, 0.4], [0.3, 0.6, 0.7]])
    potentials = rp.Polynomial(Q[0], 1)

    class Off(rp.Pseudoinverse):
        def batch(self, Q: np.ndarray, J: np.ndarray | None = None) -> np.ndarray:
            G = super().batch(Q, J)
            G[(k + 1) % 3] *= 1.2
            G[k] *= factor
            return G

    for k in range(3):
        says = f"is missed by {words} at theta1 = {Q[k, 0]:.3f}, "
        with pytest.raises(rp.InputError, match=says):
            criterion.evaluate(Off(task), potentials, Q)
