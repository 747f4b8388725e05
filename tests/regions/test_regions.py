"""Regions: nodes integrate what they should, searches stay inside, bad ones are refused."""

from __future__ import annotations

import warnings
from itertools import product

import numpy as np
import pytest
from designs import judged, over
from scipy.spatial import cKDTree

import repctl_pin as rp

Q0 = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])


@pytest.mark.parametrize("n", [1, 2, 3])
def test_gauss_grids_are_exact_on_polynomials(n: int) -> None:
    center, half = np.arange(1.0, n + 1), 0.5 + np.arange(n)
    Q, w = rp.Box(center, half).nodes(6**n, 0)
    assert len(Q) == 6**n and np.isclose(w.sum(), 1)
    u = (Q - center) / half
    for power in range(0, 12, 2):  # mean of u^p over [−1, 1] is 1 / (p + 1)
        assert np.isclose(w @ np.prod(u**power, axis=1), (1 / (power + 1)) ** n, rtol=1e-12)


def test_sobol_nodes_fill_the_box_evenly_and_change_with_the_seed() -> None:
    box = rp.Box(Q0, 0.4)
    Q, w = box.nodes(1000, 0)
    assert len(Q) == 1024 and np.isclose(w.sum(), 1) and box.contains(Q).all()
    counts = [np.histogram((Q[:, j] - Q0[j]) / 0.4, bins=8, range=(-1, 1))[0] for j in range(7)]
    # a (t, m, s) net: every eighth holds its share
    assert np.abs(np.array(counts) - 128).max() == 0
    assert not np.isclose(box.random(1024, 1), Q).any()


def test_density_moves_the_mean() -> None:
    for box in (
        rp.Box([0.0, 0.0], 1.0, density=lambda Q: 1 + Q[:, 0]),
        rp.Box(np.zeros(5), 1.0, density=lambda Q: 1 + Q[:, 0]),
        rp.Tube(np.zeros((1, 5)), 1.0, density=lambda Q: 1 + Q[:, 0]),
    ):
        Q, w = box.nodes(4096, 0)
        assert np.isclose(w.sum(), 1) and abs(w @ Q[:, 0] - 1 / 3) < 1e-3  # ∫ u (1 + u) / 2 = 1/3


def test_a_design_with_a_density_is_nearer_where_it_counts(panda_pose: rp.Task) -> None:
    corner = Q0 + 0.25
    options = {"degree": 1, "options": rp.FitOptions(samples=2048, held_out=2048)}
    desired = rp.Pseudoinverse(panda_pose)
    plain = rp.nearest_repeatable(desired, None, rp.Box(Q0, 0.4), **options)
    here = rp.Box(Q0, 0.4, density=lambda Q: np.exp(-20 * np.sum((Q - corner) ** 2, axis=1)))
    leaning = rp.nearest_repeatable(desired, None, here, **options)
    Q = rp.Box(corner, 0.1).random(256, 0)
    near, far = (
        np.mean(np.sum((d.inverse.batch(Q) - desired.batch(Q)) ** 2, axis=(1, 2)))
        for d in (leaning, plain)
    )
    assert near < 0.7 * far


@pytest.mark.parametrize("native", ["yes", "no"])
def test_the_nearest_sample_of_a_tube_is_scipys(
    native: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In C and in NumPy, against a k-d tree; the motion ends where it began, so there are ties."""
    monkeypatch.setenv("REPCTL_NATIVE", native)
    rng = np.random.default_rng(3)
    samples = np.cumsum(rng.normal(0, 0.02, (80, 6)), axis=0)
    radius = rng.uniform(0.05, 0.3, 6)
    tube = rp.Tube(np.concatenate([samples, samples[::-1]]), radius)
    Q = samples[rng.integers(80, size=500)] + radius * rng.uniform(-3, 3, (500, 6))
    due, _ = cKDTree(tube.samples / radius).query(Q / radius, p=np.inf)
    which, distance = tube.nearest(Q)
    assert np.array_equal(distance, due)
    away = np.abs((Q - tube.samples[which]) / radius).max(axis=1)
    assert np.allclose(away, due, rtol=1e-13, atol=0)
    assert (which < 80).all()  # of two equally near, the first
    assert [len(part) for part in tube.nearest(Q[:0])] == [0, 0]


@pytest.mark.slow
def test_a_tube_follows_its_samples(panda_pose: rp.Task) -> None:
    path = rp.circle(panda_pose, Q0, radius=0.1, normal="yz")
    cycle = rp.follow(rp.Pseudoinverse(panda_pose), path, Q0, cycles=1, steps=200).cycle(0)
    tube = rp.Tube(cycle, 0.1)
    Q, w = tube.nodes(4096, 0)
    nearest = np.abs(Q[:, None] - tube.samples).max(axis=2).min(axis=1)
    assert nearest.max() <= 0.1 + 1e-12 and np.isclose(w.sum(), 1)
    assert np.allclose(tube.ratio(Q), nearest / 0.1)
    outside = Q + 0.5
    assert not tube.contains(outside).any() and tube.contains(tube.clip(outside)).all()
    assert tube.shrunk(0.5).contains(Q).mean() < 1 and tube.bounds.contains(Q).all()
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(panda_pose),
        None,
        tube,
        degree=2,
        options=rp.FitOptions(samples=2048, held_out=2048),
    )
    box = rp.nearest_repeatable(
        rp.Pseudoinverse(panda_pose),
        None,
        tube.bounds,
        degree=2,
        options=rp.FitOptions(samples=2048, held_out=2048),
    )
    # fitted to the tube it is nearer to J⁺ there than the design for the box around it
    assert design.cost < judged(box).cost
    assert design.cost < judged(over(box, design.region)).cost


@pytest.mark.slow
def test_a_workspace_box_is_a_mean_over_positions_and_self_motions() -> None:
    """Planar 3R: the weighted nodes land evenly in the workspace, as the coarea formula says they
    should."""
    task = rp.Robot.load("planar3r").task(None, "xy")
    within = rp.Box([0.2, 1.2, 0.9], [1.5, 0.9, 0.7])
    middle = task.positions(within.center[None])[0, :2]
    region = rp.WorkspaceBox(task, middle, 0.2, within=within)
    Q, w = region.nodes(16_384, 0)
    p = task.positions(Q)[:, :2]
    assert np.abs(p - middle).max() <= 0.2 and within.contains(Q).all() and region.contains(Q).all()
    # each position's self-motion has a length; the weighted density over x is proportional to it
    cells = 3
    which = np.clip(((p - middle + 0.2) / 0.4 * cells).astype(int), 0, cells - 1)
    for i in range(cells):
        for j in range(cells):
            share = w[(which == [i, j]).all(axis=1)].sum() * cells**2
            at = middle - 0.2 + 0.4 * (np.array([i, j]) + 0.5) / cells
            lengths.setdefault((i, j), (share, fibre_length(task, at, within)))
    shares, fibres = np.array(list(lengths.values())).T
    assert np.allclose(shares, fibres / fibres.mean(), rtol=0.05)


lengths: dict[tuple[int, int], tuple[float, float]] = {}


def fibre_length(task: rp.Task, at: np.ndarray, within: rp.Box) -> float:
    """Length of {q in the box: f(q) = at}, traced by θ₁: two-link inverse kinematics for the
    rest."""
    total = 0.0
    theta = np.linspace(within.lower[0], within.upper[0], 4001)
    rest = at - np.column_stack([np.cos(theta), np.sin(theta)])
    reach = np.linalg.norm(rest, axis=1)
    ok = reach < 2
    for sign in (1, -1):
        third = sign * np.arccos(np.clip(reach**2 / 2 - 1, -1, 1))
        second = np.arctan2(rest[:, 1], rest[:, 0]) - third / 2 - theta
        second = (second + np.pi) % (2 * np.pi) - np.pi
        q = np.column_stack([theta, second, third])
        inside = ok & within.contains(q)
        steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
        both = inside[1:] & inside[:-1] & (steps < 0.1)
        total += float(steps[both].sum())
    return total


@pytest.mark.slow
def test_a_design_over_a_workspace_box() -> None:
    task = rp.Robot.load("planar3r").task(None, "xy")
    within = rp.Box([0.2, 1.2, 0.9], 0.5)
    region = rp.WorkspaceBox(task, task.positions(within.center[None])[0, :2], 0.2, within=within)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        None,
        region,
        degree=2,
        options=rp.FitOptions(samples=1024, held_out=512),
    )
    other = rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        None,
        within,
        degree=2,
        options=rp.FitOptions(samples=1024, held_out=512),
    )
    assert design.converged and design.leaf_margin > 0.3
    assert design.cost < judged(over(other, design.region)).cost


def test_boxes_are_cut_to_limits(panda_pose: rp.Task) -> None:
    wide = rp.Box(Q0, 3.0)
    cut = wide.inside(panda_pose.lower, panda_pose.upper)
    assert (cut.lower >= panda_pose.lower - 1e-12).all() and (
        cut.upper <= panda_pose.upper + 1e-12
    ).all()
    share = rp.nearest_repeatable(
        rp.Pseudoinverse(panda_pose),
        None,
        rp.Box(Q0, [0.1, 0.1, 0.1, 0.9, 0.1, 0.1, 0.1]),
        degree=1,
        options=rp.FitOptions(held_out=4096),
    ).inside_limits
    expected = (Q0[3] + 0.9 - panda_pose.lower[3]) / 1.8  # joint 4 alone goes over its lower limit
    assert abs(share - expected) < 2e-3 < 1 - expected


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: rp.Box([], 0.4), "finite numbers"),
        (lambda: rp.Box([0.0, np.nan], 0.4), "finite numbers"),
        (lambda: rp.Box([0.0, 0.0], 0.0), "above 0"),
        (lambda: rp.Box([0.0, 0.0], [0.1, -0.1]), "above 0"),
        (lambda: rp.Box([0.0, 0.0], np.inf), "above 0"),
        (lambda: rp.Box([0.0, 0.0], [0.1, 0.1, 0.1]), "half-width"),
        (lambda: rp.Box("ab", 1.0), "center"),
        (
            lambda: rp.Box.between([0.0, 1.0], [1.0, 0.5]),
            "joint 1 .* has lower = 1 and upper = 0.5",
        ),
        (lambda: rp.Box.between([0.0, 1.0], [1.0, 1.0]), "lower < upper"),
        (
            lambda: rp.Box.between([0.0, 1.0], [1.0]),
            "upper corner of a box must be 2 finite numbers",
        ),
        (lambda: rp.Tube([], 0.1), "samples"),
        (lambda: rp.Tube([[0.0, np.nan]], 0.1), "finite"),
        (lambda: rp.Tube([[0.0, 0.0]], 0.0), "radius"),
        (lambda: rp.Tube([[0.0, 0.0]], [0.1, 0.1, 0.1]), "radius"),
        (
            lambda: rp.Box([0.0], 1.0, density=lambda Q: np.zeros(len(Q))).weights(
                np.zeros((3, 1))
            ),
            "0 everywhere",
        ),
        (
            lambda: rp.Box([0.0], 1.0, density=lambda Q: np.full(len(Q), np.nan)).weights(
                np.zeros((3, 1))
            ),
            "finite",
        ),
        (
            lambda: rp.Box([0.0], 1.0, density=lambda Q: 1.0).weights(np.zeros((3, 1))),
            "one number per configuration",
        ),
    ],
)
def test_bad_regions_get_one_clear_line(make, message: str) -> None:
    with pytest.raises(rp.InputError, match=message) as error:
        make()
    assert "\n" not in str(error.value)


def test_a_workspace_box_out_of_reach_is_refused() -> None:
    task = rp.Robot.load("planar3r").task(None, "xy")
    with pytest.raises(rp.InputError, match="bring 'tool' into the workspace box"):
        rp.WorkspaceBox(task, [5.0, 0.0], 0.1, within=rp.Box([0.2, 1.2, 0.9], 0.5))
    with pytest.raises(rp.InputError, match="2 finite numbers"):
        rp.WorkspaceBox(task, [5.0, 0.0, 1.0], 0.1, within=rp.Box([0.2, 1.2, 0.9], 0.5))


@pytest.mark.parametrize("seed", [0, 3, 20_000])
def test_sobol_points_are_those_of_scipy(seed: int) -> None:
    from scipy.stats import qmc

    for n, power in product((1, 2, 7, 8, 31, 32, 33, 40), (1, 5, 10)):
        box = rp.Box(np.zeros(n), 0.5)
        ours = box.random(2**power, seed) + 0.5
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            theirs = qmc.Sobol(n, scramble=True, rng=seed).random_base2(power)
        np.testing.assert_allclose(ours, theirs, atol=2e-16)
