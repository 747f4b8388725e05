"""Section III of the paper as identities on random arms, r = 1 to 4, with the corrected signs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arms import spatial_task

import repctl_pin as rp
from repctl_pin import redundancy


class Setting:
    """A random arm at random configurations, a desired inverse G_d that is not J⁺, and
    potentials."""

    def __init__(self, r: int, folder: Path) -> None:
        rng = np.random.default_rng(r)
        self.r, self.task = r, spatial_task(3 + r, folder, seed=10 + r)
        n = self.task.n
        self.Q = rng.uniform(-0.4, 0.4, (30, n))
        self.J = self.task.jacobians(self.Q)
        self.N = redundancy.nullspace(self.J)
        B = rng.normal(size=(n, n))
        self.desired = rp.WeightedInverse(self.task, B @ B.T + np.eye(n))
        self.G_d = self.desired.batch(self.Q)
        self.potentials = rp.Polynomial(np.zeros(n), 2)
        self.D = self.potentials.gradients(self.Q)  # (K, n, potentials)
        self.A = rng.normal(size=(self.potentials.size, r))
        self.V = self.D @ self.A  # (35)
        self.G_r = redundancy.repeatable_inverse(self.G_d, self.N, self.V)  # (32)
        self.W_d = redundancy.null_component(self.G_d, self.N)
        self.W_r = redundancy.null_component(self.G_r, self.N)


@pytest.fixture(scope="module", params=[1, 2, 3, 4], ids=lambda r: f"r{r}")
def setting(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Setting:
    return Setting(request.param, tmp_path_factory.mktemp("arms"))


def t(A: np.ndarray) -> np.ndarray:
    return np.swapaxes(A, -1, -2)


def close(a: np.ndarray, b: np.ndarray) -> bool:
    """Equal to 1e-10 of their size, configuration by configuration."""
    axes = tuple(range(1, np.ndim(a)))
    return bool(
        (np.abs(a - b).max(axis=axes) <= 1e-10 * np.maximum(1, np.abs(b).max(axis=axes))).all()
    )


def test_every_inverse_is_the_pseudoinverse_and_a_null_part(setting: Setting) -> None:
    """Issue 37, item 22: beside 0, rounding is relative to the terms that cancel, for any seed."""
    for G, W in ((setting.G_d, setting.W_d), (setting.G_r, setting.W_r)):
        size = np.linalg.norm(G, axis=(1, 2))[:, None, None]
        eye = np.broadcast_to(np.eye(3), (30, 3, 3))
        assert close(setting.J @ G / size, eye / size)
        assert close(redundancy.from_null_component(setting.J, setting.N, W), G)  # (21), (22)
        n_G = t(setting.J) @ W - setting.N  # (23)
        assert close(t(G) @ n_G / size**2, np.zeros((30, 3, setting.r)))


def test_the_distance_of_two_inverses_is_that_of_their_null_parts(setting: Setting) -> None:
    difference, null_part = setting.G_r - setting.G_d, setting.W_r - setting.W_d
    assert close(difference, setting.N @ t(null_part))  # (27)
    frobenius = np.linalg.norm(difference, axis=(1, 2))
    assert close(frobenius[:, None], np.linalg.norm(null_part, axis=(1, 2))[:, None])  # (28), (29)
    spectral = np.linalg.norm(difference, 2, axis=(1, 2))
    if setting.r == 1:  # the paper's norm is the spectral one: the same for an outer product
        assert close(spectral[:, None], frobenius[:, None])
    else:
        rank = min(3, setting.r)  # equal near an algorithmic singularity
        assert (spectral <= frobenius * (1 + 1e-12)).all()
        assert (frobenius <= np.sqrt(rank) * spectral * (1 + 1e-12)).all()
        assert np.median(spectral / frobenius) < 1 - 1e-6


def test_the_inverse_of_the_augmented_jacobian_block_by_block(setting: Setting) -> None:
    whole = redundancy.augmented_inverse(setting.J, setting.V)  # (30), (37)
    left, right = whole[:, :, :3], whole[:, :, 3:]
    assert close(left, setting.G_r)  # (31), (32)
    # (31), its last columns
    assert close(right, setting.N @ np.linalg.inv(t(setting.V) @ setting.N))
    # any inverse G_d gives the same G_r: only V counts
    plain = redundancy.repeatable_inverse(redundancy.pseudoinverse(setting.J), setting.N, setting.V)
    assert close(plain, setting.G_r)


def test_the_null_part_of_a_repeatable_inverse_with_its_sign(setting: Setting) -> None:
    formula = -t(setting.G_d) @ setting.V @ np.linalg.inv(t(setting.N) @ setting.V)  # (38)
    assert close(setting.W_r - setting.W_d, formula)
    if setting.r == 1:  # (33) is printed without the minus sign, which (34) cannot tell
        printed = t(setting.G_d) @ setting.V / (t(setting.N) @ setting.V)
        assert close(setting.W_r - setting.W_d, -printed)
        assert not close(setting.W_r - setting.W_d, printed)


def test_the_criterion_in_terms_of_coefficients(setting: Setting) -> None:
    difference = np.sum((setting.G_r - setting.G_d) ** 2, axis=(1, 2))
    if setting.r == 1:
        v, n, a = setting.V[:, :, 0], setting.N[:, :, 0], setting.A[:, 0]
        ratio = (
            np.sum((t(setting.G_d) @ v[:, :, None]) ** 2, axis=(1, 2)) / np.sum(n * v, axis=1) ** 2
        )
        assert close(difference[:, None], ratio[:, None])  # (34)
        gram = t(setting.D) @ setting.G_d @ t(setting.G_d) @ setting.D  # v_iᵀ G_d G_dᵀ v_j
        below = np.einsum("k,Kk->K", a, np.einsum("Ki,Kij->Kj", n, setting.D)) ** 2
        # (36)
        assert close(difference[:, None], (np.einsum("i,Kij,j->K", a, gram, a) / below)[:, None])
    E, F = t(setting.N) @ setting.D, t(setting.G_d) @ setting.D
    X = F @ setting.A @ np.linalg.inv(E @ setting.A)
    assert close(difference[:, None], np.sum(X**2, axis=(1, 2))[:, None])


def test_gradient_potentials_satisfy_the_bracket_condition(setting: Setting) -> None:
    """(24), ``n_Gᵀ [g_a, g_b] = 0``, of the G that is evaluated: by differences that know nothing
    of potentials, and as the defects that the package reports."""
    G_r = rp.RepeatableInverse(setting.task, setting.potentials.weighted(setting.A))
    # away from algorithmic singularities
    clear = redundancy.leaf_margin(setting.N, setting.V) > 0.1
    Q = setting.Q[clear][:6]
    assert len(Q) >= 4 and close(G_r.batch(Q), setting.G_r[clear][:6])

    def residual(inverse: rp.RepeatableInverse | rp.WeightedInverse) -> np.ndarray:
        """The largest ``n_Gᵀ [g_a, g_b]`` relative to its factors, at every row of Q."""
        G, e = inverse.batch(Q), 1e-5
        dG = np.stack(
            [
                (inverse.batch(Q + e * d) - inverse.batch(Q - e * d)) / (2 * e)
                for d in np.eye(setting.task.n)
            ],
            axis=-1,
        )
        along = np.einsum("Kibk,Kka->Kabi", dG, G)  # (∂g_b/∂q) g_a
        brackets = along - np.swapaxes(along, 1, 2)  # (4)
        N = redundancy.nullspace(setting.task.jacobians(Q))
        n_G = t(setting.task.jacobians(Q)) @ redundancy.null_component(G, N) - N  # (23)
        sizes = [np.abs(A).reshape(len(Q), -1).max(axis=1) for A in (dG, G, n_G)]
        found = np.abs(brackets @ n_G[:, None]).reshape(len(Q), -1).max(axis=1)
        return found / np.prod(sizes, axis=0)

    assert residual(G_r).max() < 1e-8 < 1e-3 < residual(setting.desired).max()
    by_difference = rp.CustomInverse(setting.task, G_r)
    for q in Q:
        against = np.abs(rp.bracket_defect(setting.desired, q, relative=True)).max()
        for inverse, bound in ((G_r, 1e-11), (by_difference, 1e-7)):
            found = np.abs(rp.bracket_defect(inverse, q, relative=True)).max()
            assert found < bound * max(1, against)
        assert against > 1e-2  # G_d itself does not
