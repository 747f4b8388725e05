"""Laws of the generalized inverses on random Jacobians: Penrose, (21)–(23), (30)–(32), (37),
(38)."""

from __future__ import annotations

import numpy as np
import pytest

from repctl_pin import InputError, SingularityError, redundancy

SIZES = [(2, 3), (6, 7), (3, 5), (3, 7), (2, 6)]


@pytest.fixture(params=SIZES, ids=lambda s: f"m{s[0]}n{s[1]}")
def J(request: pytest.FixtureRequest) -> np.ndarray:
    m, n = request.param
    return np.random.default_rng(m + 10 * n).normal(size=(20, m, n))


def transpose(A: np.ndarray) -> np.ndarray:
    return np.swapaxes(A, -1, -2)


def test_pseudoinverse_obeys_the_penrose_identities(J: np.ndarray) -> None:
    G = redundancy.pseudoinverse(J)
    m = J.shape[1]
    assert np.abs(J @ G - np.eye(m)).max() < 1e-11
    assert np.abs(G @ J @ G - G).max() < 1e-11
    assert np.abs(G @ J - transpose(G @ J)).max() < 1e-11
    assert np.allclose(G, np.linalg.pinv(J), rtol=0, atol=1e-10)  # an independent oracle


def test_weighted_pseudoinverse_is_the_formula_and_minimises_the_weighted_norm(
    J: np.ndarray,
) -> None:
    rng = np.random.default_rng(1)
    n, m = J.shape[2], J.shape[1]
    B = rng.normal(size=(n, n))
    M = B @ B.T + np.eye(n)
    G = redundancy.weighted_pseudoinverse(J, M)
    M_inv = np.linalg.inv(M)
    assert np.allclose(G, M_inv @ transpose(J) @ np.linalg.inv(J @ M_inv @ transpose(J)), atol=1e-9)
    assert np.abs(J @ G - np.eye(m)).max() < 1e-10
    # least norm: M G is orthogonal to the null space
    assert np.abs(transpose(redundancy.nullspace(J)) @ M @ G).max() < 1e-9


def test_weight_that_is_not_positive_is_refused(J: np.ndarray) -> None:
    with pytest.raises(SingularityError, match="positive definite"):
        redundancy.weighted_pseudoinverse(J, -np.eye(J.shape[2]))


def test_nullspace_is_orthonormal_and_annihilated(J: np.ndarray) -> None:
    N = redundancy.nullspace(J)
    r = J.shape[2] - J.shape[1]
    assert np.abs(J @ N).max() < 1e-12
    assert np.abs(transpose(N) @ N - np.eye(r)).max() < 1e-12


def test_null_vector_is_the_closed_form_of_the_paper() -> None:
    # (11), (12): prismatic joint and two links in absolute angles
    p2, p3 = 0.7, -1.9
    J = np.array([[1, -np.sin(p2), -np.sin(p3)], [0, np.cos(p2), np.cos(p3)]])
    n = redundancy.null_vector(J)
    assert np.allclose(n, [np.sin(p3 - p2), -np.cos(p3), np.cos(p2)], atol=1e-15)
    assert np.isclose(n @ n, np.linalg.det(J @ J.T))


def test_null_vector_is_smooth_where_a_factorisation_flips() -> None:
    rng = np.random.default_rng(3)
    J0, J1 = rng.normal(size=(2, 6, 7))
    steps = np.linspace(0, 1, 2001)[:, None, None]
    n = redundancy.null_vector(J0 + steps * (J1 - J0))
    jumps = np.linalg.norm(np.diff(n, axis=0), axis=1) / np.linalg.norm(n, axis=1).max()
    assert jumps.max() < 0.02


def test_align_takes_out_any_rotation(J: np.ndarray) -> None:
    N = redundancy.nullspace(J)
    rng = np.random.default_rng(5)
    r = N.shape[-1]
    U = np.linalg.qr(rng.normal(size=(len(N), r, r)))[0]
    assert np.abs(redundancy.align(N @ U, N) - N).max() < 1e-12


def test_pseudoinverse_derivative_agrees_with_finite_differences(J: np.ndarray) -> None:
    rng = np.random.default_rng(7)
    m, n = J.shape[1:]
    H = rng.normal(size=(m, n, n))
    dG = redundancy.pseudoinverse_derivative(J[0], H)
    e = 1e-6
    for k in range(n):
        plus, minus = (redundancy.pseudoinverse(J[0] + s * e * H[:, :, k]) for s in (1, -1))
        assert np.allclose(dG[:, :, k], (plus - minus) / (2 * e), atol=1e-6 * np.abs(dG).max())


def test_null_component_and_inverse_are_each_others_reverse(J: np.ndarray) -> None:
    rng = np.random.default_rng(9)
    N = redundancy.nullspace(J)
    W = rng.normal(size=(len(J), J.shape[1], N.shape[-1]))
    G = redundancy.from_null_component(J, N, W)  # (21)
    assert np.abs(J @ G - np.eye(J.shape[1])).max() < 1e-11
    assert np.abs(redundancy.null_component(G, N) - W).max() < 1e-11  # (22)
    n_G = transpose(J) @ W - N  # (23)
    assert np.abs(transpose(G) @ n_G).max() < 1e-10


def test_repeatable_inverse_is_the_first_block_of_the_augmented_inverse(J: np.ndarray) -> None:
    rng = np.random.default_rng(11)
    m, n = J.shape[1:]
    V = rng.normal(size=(len(J), n, n - m))
    N = redundancy.nullspace(J)
    G_d = redundancy.from_null_component(J, N, rng.normal(size=(len(J), m, n - m)))
    G_r = redundancy.repeatable_inverse(G_d, N, V)  # (32)
    scale = np.abs(G_r).max()
    assert np.abs(G_r - redundancy.augmented_inverse(J, V)[:, :, :m]).max() < 1e-10 * scale  # (31)
    assert np.abs(J @ G_r - np.eye(m)).max() < 1e-10 * scale
    assert np.abs(transpose(V) @ G_r).max() < 1e-10 * scale
    one_V = redundancy.augmented_inverse(J, V[0])  # one V at many configurations, and many V at one
    assert np.array_equal(one_V, redundancy.augmented_inverse(J, np.broadcast_to(V[0], V.shape)))
    one_J = redundancy.augmented_inverse(J[0], V)
    assert np.array_equal(one_J, redundancy.augmented_inverse(np.broadcast_to(J[0], J.shape), V))
    # (38), with the minus sign that (33) lacks
    difference = redundancy.null_component(G_r, N) - redundancy.null_component(G_d, N)
    assert (
        np.abs(difference + transpose(G_d) @ V @ np.linalg.inv(transpose(N) @ V)).max()
        < 1e-9 * scale
    )
    # gauge: only the column space of V matters
    T = rng.normal(size=(n - m, n - m)) + 3 * np.eye(n - m)
    assert np.abs(redundancy.repeatable_inverse(G_d, N, V @ T) - G_r).max() < 1e-9 * scale


def test_leaf_margin_is_a_sine_free_of_gauge(J: np.ndarray) -> None:
    rng = np.random.default_rng(13)
    m, n = J.shape[1:]
    N = redundancy.nullspace(J)
    assert np.allclose(redundancy.leaf_margin(N, N), 1)
    V = rng.normal(size=(len(J), n, n - m))
    sigma = redundancy.leaf_margin(N, V)
    T = rng.normal(size=(n - m, n - m)) + 3 * np.eye(n - m)
    assert np.allclose(redundancy.leaf_margin(N, V @ T), sigma, atol=1e-10)
    V[:, :, 0] = J[:, 0]  # a column in the row space: singular
    assert redundancy.leaf_margin(N, V).max() < 1e-12


def test_determinant_law_of_the_augmented_jacobian(J: np.ndarray) -> None:
    rng = np.random.default_rng(15)
    m, n = J.shape[1:]
    V = rng.normal(size=(len(J), n, n - m))
    J_V = np.concatenate([J, transpose(V)], axis=1)
    N = redundancy.nullspace(J)
    left = np.linalg.det(J_V) ** 2
    right = np.linalg.det(J @ transpose(J)) * np.linalg.det(transpose(N) @ V) ** 2
    assert np.allclose(left, right, rtol=1e-9)


def test_rank_loss_is_a_named_error() -> None:
    J = np.random.default_rng(0).normal(size=(5, 3, 6))
    J[2, 2] = J[2, 0] + J[2, 1]
    for function in (redundancy.pseudoinverse, redundancy.nullspace):
        with pytest.raises(SingularityError, match="1 of 5"):
            function(J)
        # of one, none is counted
        with pytest.raises(SingularityError, match="loses rank: the arm"):
            function(J[2])


def test_regular_is_told_by_the_sine_between_rows() -> None:
    """Of a stack: two rows 2e-6 rad apart, in other units, and two rows 0.5e-6 apart."""
    A = np.array([np.eye(3), np.eye(3)])
    for one, sine in zip(A, (2e-6, 0.5e-6), strict=True):
        one[1, :2] = np.sqrt(1 - sine**2), sine
    A[0] = np.diag([1e4, 1.0, 1e-3]) @ A[0]
    J, V = A[:, :2], transpose(A[:, 2:])
    assert np.allclose(redundancy.augmented_inverse(J[0], V[0]) @ A[0], np.eye(3))
    with pytest.raises(SingularityError, match="J_V is singular.*row space$"):
        redundancy.augmented_inverse(J[1], V[1])
    with pytest.raises(SingularityError, match="at 1 of 2 configurations"):
        redundancy.augmented_inverse(J, V)


def test_the_null_vector_is_of_one_redundant_joint() -> None:
    for m, n in ((2, 2), (1, 3)):
        with pytest.raises(InputError, match=f"J is {m} × {n}, but a null vector requires"):
            redundancy.null_vector(np.ones((m, n)))
