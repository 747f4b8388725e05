"""The bounds of a leaf margin in boxes: each holds wherever it is looked at, is attained or nearly
so, and a wrong one is noticed."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from arms import planar_task, sliding_task, spatial_task
from mimic_arm import MIMICS, arm
from mutants import NUMPY, POTENTIALS, C, compiled, wrong
from proofs import (
    design_of,
    margins,
    near_null_space,
    regular_start,
    smallest_singular_values,
)
from second_order import Ratios, crossed, in_chain, made_up, worst

import repctl_pin as rp
from repctl_pin import redundancy
from repctl_pin.extensions.proof import (
    chain,
    leaf_margin_bounds,
    regions,
    remainder,
    screws,
)

TASKS: dict[str, Callable[[Path], rp.Task]] = {
    "pose, r = 1": lambda folder: spatial_task(7, folder, kind="pose", seed=3),
    "pose, r = 3": lambda folder: spatial_task(9, folder, kind="pose", seed=4),
    "axis": lambda folder: spatial_task(7, folder, kind="axis", seed=5),
    "position": lambda folder: spatial_task(5, folder, seed=6),
    "two coordinates": lambda folder: spatial_task(4, folder, kind="xz", seed=7),
    "planar": lambda folder: planar_task((1.0, 0.9, 0.8, 0.7), folder),
    "mimic joints": lambda folder: rp.Robot.load(arm(folder, MIMICS, n=9)).task(
        "l9", "axis"
    ),
    "another base": lambda _: rp.Robot.load("baxter", base="left_gripper").task(
        "right_gripper", "pose"
    ),
    "absolute angles": lambda folder: (
        lambda t: t.in_coordinates(rp.absolute_angles(t))
    )(planar_task((1.0, 0.9, 0.8), folder)),
}


@pytest.mark.parametrize("case", TASKS)
def test_every_box_s_bounds_hold_at_its_corners_and_inside(
    case: str, tmp_path: Path
) -> None:
    task = TASKS[case](tmp_path)
    q = regular_start(task)
    box = rp.Box(q, 0.1)
    design = design_of(task, near_null_space(task, q, 0.1, 1), box)
    problem = leaf_margin_bounds.leaf_margin_of(task, design.inverse.potentials, box)
    rng, some = np.random.default_rng(2), 0
    for width in (1e-9, 1e-4, 3e-3, 0.01, 0.03):
        Q = q + rng.uniform(-0.05, 0.05, (12, task.n))
        half = width * rng.uniform(0.2, 1.0, Q.shape)
        found = problem.bounds(Q, half)
        some += np.count_nonzero(found.leaf_margin)
        points = Q[:, None] + half[:, None] * np.sign(
            rng.standard_normal((len(Q), 40, task.n))
        )
        points[:, 20:] = Q[:, None] + half[:, None] * rng.uniform(
            -1, 1, (len(Q), 20, task.n)
        )
        true = margins(design, points.reshape(-1, task.n)).reshape(len(Q), -1)
        assert (found.leaf_margin <= true.min(axis=1) + 1e-9).all()
        sigma = smallest_singular_values(task, points.reshape(-1, task.n)).reshape(
            len(Q), -1
        )
        assert (found.sigma_min <= sigma.min(axis=1) + 1e-9).all()
        np.testing.assert_allclose(found.center, margins(design, Q), rtol=0.02)
        if width == 1e-9:
            assert (found.leaf_margin > 0.999 * true.min(axis=1) - 1e-6).all()
    assert some > 20


@pytest.mark.parametrize(
    "case", ["pose, r = 3", "axis", "position", "two coordinates", "mimic joints"]
)
def test_screws_have_the_null_space_of_the_task_seen_from_every_link(
    case: str, tmp_path: Path
) -> None:
    task = TASKS[case](tmp_path)
    q, whole = regular_start(task), chain.chain_of(task)
    for middle in range(len(whole.p) + 1):
        links = whole.seen_from(middle, 0.3)

        def columns(q: np.ndarray, links: object = links) -> np.ndarray:
            theta = links.S[:, : links.n] @ q + links.o
            return np.einsum(
                "lx,lc->xc", screws.screws(links, theta[None])[0][0], links.S
            )

        J = columns(q)
        still = np.linalg.qr(J[:, links.n :], mode="complete")[0][
            :, links.N - links.n :
        ]
        ours, theirs = (
            np.linalg.svd(still.T @ J[:, : links.n])[2][: task.m],
            np.linalg.svd(task.jacobian(q))[2],
        )
        assert np.abs(ours @ theirs[task.m :].T).max() < 1e-9
        theta = links.S[:, : links.n] @ q + links.o
        by_bracket = screws.slopes(links, *screws.screws(links, theta[None]))[
            0
        ]  # (n, N, 6)
        for j, e in enumerate(1e-6 * np.eye(task.n)):
            np.testing.assert_allclose(
                by_bracket[j].T, (columns(q + e) - columns(q - e)) / 2e-6, atol=1e-7
            )


def test_a_tube_s_boxes_cover_it_and_hardly_overlap() -> None:
    """All that lies between the samples is in a box, and most of it in one only."""
    t = np.linspace(0, 2 * np.pi, 200)
    samples = 0.3 * np.column_stack([np.cos(t), np.sin(t), np.sin(2 * t), 0.1 * t])
    tube = rp.Tube(samples, np.array([0.1, 0.05, 0.1, 0.02]))
    low, high = regions.cover(tube)
    rng = np.random.default_rng(0)
    k, share = rng.integers(len(t) - 1, size=4000), rng.uniform(size=(4000, 1))
    edge = rng.uniform(-1, 1, (4000, 4))
    edge[::2] /= np.abs(edge[::2]).max(
        axis=1, keepdims=True
    )  # half of them on the sides
    points = samples[k] + share * (samples[k + 1] - samples[k]) + tube.radius * edge
    inside = (
        ((points[:, None] >= low) & (points[:, None] <= high)).all(axis=2).sum(axis=1)
    )
    assert (inside >= 1).all() and inside.mean() < 1.5


# ---- the theorem's constants -------------------------------------------------------------------


def worst_ratio(task: rp.Task, count: int = 120) -> float:
    """The largest ratio of an actual remainder of a screw to its bound, over random boxes and
    corners of them."""
    whole, rng, worst = chain.chain_of(task), np.random.default_rng(0), 0.0
    P, moves = len(whole.p), whole.S[:, : task.n].any(axis=1)
    for trial in range(count):
        links = whole.seen_from(int(rng.integers(P + 1)), float(rng.uniform()))
        links = replace(links, S=np.eye(P), n=P)  # every joint by itself
        theta = rng.uniform(-2, 2, (1, P))
        eta = (
            rng.uniform(0, 1.0, (1, P))
            * 10 ** rng.uniform(-2, 0)
            * (moves & (rng.uniform(size=P) < 0.7))
        )
        delta = (
            eta * np.sign(rng.standard_normal(P))
            if trial % 2
            else eta * rng.uniform(-1, 1, P)
        )
        here, tip = screws.screws(links, theta)
        there, _ = screws.screws(links, theta + delta)
        rest = (there - here)[0] - np.einsum(
            "j,jlx->lx", delta[0], screws.slopes(links, here, tip)[0]
        )
        linear, angular = remainder.remainders(links, theta, eta)
        for actual, bound in ((rest[:, :3], linear[0]), (rest[:, 3:], angular[0])):
            worst = max(
                worst, float((np.linalg.norm(actual, axis=1) / (bound + 1e-12)).max())
            )
    return worst


def test_remainders_of_screws_are_bounded_and_the_bound_is_tight(
    tmp_path: Path,
) -> None:
    assert 0.9 < worst_ratio(planar_task((1.0, 0.9, 0.8, 0.7), tmp_path)) <= 1
    assert 0.5 < worst_ratio(sliding_task(tmp_path)) <= 1
    for seed in range(2):
        assert 0.2 < worst_ratio(spatial_task(5, tmp_path, kind="pose", seed=seed)) <= 1


MUTANTS = {
    "half of it": lambda H_R, H_P, L: (
        0.25 * H_R**2 * L + 0.5 * H_R * H_P,
        0.25 * H_R**2,
    ),
    "without the product of turning and sliding": lambda H_R, H_P, L: (
        0.5 * H_R**2 * L,
        0.5 * H_R**2,
    ),
    "half the product of turning and sliding": lambda H_R, H_P, L: (
        0.5 * H_R**2 * L + 0.5 * H_R * H_P,
        0.5 * H_R**2,
    ),
    "half the angular part": lambda H_R, H_P, L: (
        0.5 * H_R**2 * L + H_R * H_P,
        0.25 * H_R**2,
    ),
    "half the linear part": lambda H_R, H_P, L: (
        0.25 * H_R**2 * L + H_R * H_P,
        0.5 * H_R**2,
    ),
    "minus the product": lambda H_R, H_P, L: (
        abs(0.5 * H_R**2 * L - H_R * H_P),
        0.5 * H_R**2,
    ),
    "no angular part": lambda H_R, H_P, L: (0.5 * H_R**2 * L + H_R * H_P, 0.0 * H_R),
    "no lengths": lambda H_R, H_P, L: (0.5 * H_R**2 * 0.5 + H_R * H_P, 0.5 * H_R**2),
}


@pytest.mark.parametrize("mutant", MUTANTS)
def test_a_wrong_remainder_is_noticed(
    mutant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tasks = [
        planar_task((1.0, 0.9, 0.8), tmp_path),
        sliding_task(tmp_path),
        spatial_task(5, tmp_path, kind="pose"),
    ]
    monkeypatch.setattr(remainder, "revolute", MUTANTS[mutant])
    assert max(worst_ratio(task, 40) for task in tasks) > 1


# ---- the second order --------------------------------------------------------------------------

HELD = 1 + 1e-6


def made_up_ratios(module: ModuleType, count: int) -> Iterator[Ratios]:
    """Compare made-up boxes of one and two degrees of redundancy with the bounds of a module."""
    for r in (1, 2):
        for seed in range(count):
            yield made_up(module, seed, r, 0.05)
            yield crossed(module, seed, r, 0.003 if seed % 2 else 0.03)


def test_every_bound_is_attained_where_all_terms_have_the_worst_signs() -> None:
    found = worst(
        [ratios for seed in range(40) if (ratios := made_up(leaf_margin_bounds, seed))]
    )
    for name, ratio in found.items():
        assert 0.999 < ratio <= HELD, name


@pytest.mark.parametrize("r", [1, 2, 3])
def test_every_bound_holds_in_boxes_of_general_position(r: int) -> None:
    for width in (0.001, 0.01, 0.03):
        boxes = [
            b
            for seed in range(20)
            if (b := crossed(leaf_margin_bounds, seed, r, width))
        ]
        assert len(boxes) > 8 and max(worst(boxes).values()) <= HELD
        if width == 0.001:
            assert min(worst(boxes).values()) > 0.5


@pytest.mark.parametrize("mutant", NUMPY)
def test_a_wrong_term_is_noticed(mutant: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module = wrong(monkeypatch, "leaf_margin_bounds.py", *NUMPY[mutant])
    assert any(
        max(found.values(), default=0) > HELD for found in made_up_ratios(module, 12)
    )


# ---- chains ------------------------------------------------------------------------------------


def curved(task: rp.Task, degree: int, width: float, rough: float = 0.2) -> rp.Design:
    """A design of strongly curved potentials, regular at the centre of its box."""
    rng, q = (
        np.random.default_rng(0),
        task.reference + 0.3 * (task.n < 7) * np.arange(task.n),
    )
    potentials = rp.Polynomial(q, degree, width)
    A = rough * width * rng.standard_normal((potentials.size, task.r))
    A /= np.sqrt(potentials.size / task.n)
    D = potentials.gradients(q[None])[0]
    A += np.linalg.lstsq(D, redundancy.nullspace(task.jacobian(q)) - D @ A, rcond=None)[
        0
    ]
    return design_of(task, potentials.weighted(A), rp.Box(q, width))


@pytest.mark.parametrize("degree", [3, 4, 5, 6])
def test_bounds_hold_and_are_nearly_attained_on_planar_arms(
    degree: int, tmp_path: Path
) -> None:
    design = curved(planar_task((1.0, 0.9, 0.8), tmp_path), degree, 0.6)
    parts = [
        in_chain(leaf_margin_bounds, design, width, 1, boxes=16)
        for width in (0.02, 0.1, 0.3)
    ]
    found = worst([ratios for ratios, _ in parts if ratios])
    assert max(found.values()) <= HELD and parts[0][1] > 0.6
    assert min(found[name] for name in ("ν", "P", "SᵀS", "V", "bound")) > 0.7


@pytest.mark.parametrize("degree", [3, 4])
def test_bounds_hold_and_are_nearly_attained_on_panda(
    degree: int, panda_pose: rp.Task
) -> None:
    design = curved(panda_pose, degree, 0.3)
    parts = [
        in_chain(leaf_margin_bounds, design, width, 1, boxes=12)
        for width in (0.02, 0.3)
    ]
    found = worst([ratios for ratios, _ in parts if ratios])
    assert max(found.values()) <= HELD and parts[0][1] > 0.6
    assert min(found[name] for name in ("π", "P", "SᵀS", "V", "bound")) > 0.9
    assert min(found.values()) > 0.25


@pytest.mark.parametrize("degree", [3, 4, 5, 6])
def test_the_bound_of_one_power_is_attained(degree: int, tmp_path: Path) -> None:
    design = powers(planar_task((1.0, 0.9, 0.8), tmp_path), degree)
    assert 0.9 < in_chain(leaf_margin_bounds, design, 0.2, 1, boxes=12)[0]["V"] <= HELD


@pytest.mark.parametrize("mutant", POTENTIALS)
def test_a_wrong_bound_of_the_potentials_is_noticed(
    mutant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Potentials of one power of one joint attain the bounds of their derivatives."""
    task, name = planar_task((1.0, 0.9, 0.8), tmp_path), "potentials.py"
    here, (piece, instead) = leaf_margin_bounds, POTENTIALS[mutant]
    try:
        module = wrong(monkeypatch, name, piece, instead)
        monkeypatch.setattr(leaf_margin_bounds, "features_of", module.features_of)
    except AssertionError:
        here = wrong(monkeypatch, "leaf_margin_bounds.py", piece, instead)
    designs = [powers(task, degree) for degree in (3, 4, 5)]
    found = [in_chain(here, design, 0.2, 1, boxes=12)[0] for design in designs]
    assert max(ratios["V"] for ratios in found) > HELD


def powers(task: rp.Task, degree: int) -> rp.Design:
    """A design of one linear potential and a power of one joint: one term, nothing cancels."""
    q = task.reference + 0.3 * np.arange(task.n)
    along = redundancy.nullspace(task.jacobian(q))[:, 0]
    potentials = rp.Polynomial(q, degree, 0.6)
    A = np.zeros((potentials.size, 1))
    power = 0.1 * np.polynomial.legendre.poly2leg(np.eye(degree + 1)[degree])
    for k, part in enumerate(power[1:], 1):  # in the basis's own Legendre polynomials
        A[(potentials.exponents == [k, 0, 0]).all(axis=1)] = part / np.sqrt(2 * k + 1)
    A[:3, 0] += along / np.sqrt(3)
    return design_of(task, potentials.weighted(A), rp.Box(q, 0.6))


# ---- C -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "case", ["pose, r = 1", "pose, r = 3", "position", "mimic joints"]
)
def test_c_and_numpy_find_the_same_bounds(case: str, tmp_path: Path) -> None:
    task = TASKS[case](tmp_path)
    q = regular_start(task)
    polynomial = rp.Polynomial(q, 4, 0.3)
    potentials = polynomial + rp.Fourier(task.n, 1)
    A = np.random.default_rng(0).standard_normal((potentials.size, task.r))
    problem = leaf_margin_bounds.leaf_margin_of(
        task, potentials.weighted(A), rp.Box(q, 0.1)
    )
    library = leaf_margin_bounds.library()
    if library is None:
        pytest.skip("there is no native library")
    rng = np.random.default_rng(1)
    Q, half = (
        q + rng.uniform(-0.1, 0.1, (100, task.n)),
        10 ** rng.uniform(-6, -2, (100, task.n)),
    )
    C, numpy = (
        leaf_margin_bounds._in_c(problem, library, Q, half),
        leaf_margin_bounds.in_numpy(problem, Q, half),
    )
    for name in ("leaf_margin", "center", "sigma_min"):
        np.testing.assert_allclose(
            getattr(C, name), getattr(numpy, name), rtol=1e-6, atol=1e-9
        )
    assert (C.leaf_margin > 0).mean() > 0.3


def problems(
    folder: Path, panda: rp.Task
) -> list[tuple[leaf_margin_bounds.LeafMarginProblem, rp.Design]]:
    """Leaf margins to bound: r = 1, 2 and 3, with prismatic joints, of high degree."""
    designs = [
        curved(panda, 4, 0.3, 0.05),
        curved(planar_task((1.0, 0.9, 0.8, 0.7), folder), 5, 0.4),
        curved(spatial_task(9, folder, kind="pose", seed=4), 3, 0.3, 0.05),
        curved(spatial_task(5, folder, seed=6), 4, 0.3),
    ]
    return [
        (leaf_margin_bounds.leaf_margin_of(d.task, d.inverse.potentials, d.region), d)
        for d in designs
    ]


def wide_boxes(design: rp.Design, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Boxes in which the second order matters."""
    rng, region = np.random.default_rng(0), design.region
    Q = region.random(128, 0)[:count]
    half = region.half_width * 10 ** rng.uniform(-2.5, -0.3, (count, 1))
    return Q, half * rng.uniform(0.2, 1, Q.shape)


def differs(
    cases: list[tuple[leaf_margin_bounds.LeafMarginProblem, rp.Design]],
    library: ctypes.CDLL,
    count: int,
) -> float:
    """The largest difference of C's bounds from NumPy's."""
    most = 0.0
    for problem, design in cases:
        boxes = wide_boxes(design, count)
        ours, theirs = (
            leaf_margin_bounds._in_c(problem, library, *boxes),
            leaf_margin_bounds.in_numpy(problem, *boxes),
        )
        assert (theirs.leaf_margin > 0).sum() > count / 10
        difference = np.abs(ours.leaf_margin - theirs.leaf_margin)
        most = max(most, float(np.nan_to_num(difference, nan=1.0).max()))
    return most


def test_c_and_numpy_find_the_same_bounds_in_wide_boxes(
    panda_pose: rp.Task, tmp_path: Path
) -> None:
    library = leaf_margin_bounds.library()
    if library is None:
        pytest.skip("there is no native library")
    assert differs(problems(tmp_path, panda_pose), library, 100) < 1e-8


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_wrong_term_in_c_is_noticed(panda_pose: rp.Task, tmp_path: Path) -> None:
    if leaf_margin_bounds.library() is None:
        pytest.skip("there is no native library")
    cases = problems(tmp_path, panda_pose)
    for name, (piece, instead) in C.items():
        library = compiled(tmp_path, "leaf_margin_bounds.c", piece, instead)
        assert differs(cases, library, 60) > 1e-6, name


# ---- against rigorous arithmetic ---------------------------------------------------------------


def test_boxes_against_ball_arithmetic(panda_design: rp.Design) -> None:
    """In tiny boxes the bound is within rounding of the margin itself, and must stay below it."""
    pytest.importorskip("flint")
    from arb_margin import leaf_margin_in_balls

    task, box = panda_design.task, panda_design.region
    problem: leaf_margin_bounds.LeafMarginProblem = leaf_margin_bounds.leaf_margin_of(
        task, panda_design.inverse.potentials, box
    )
    rng = np.random.default_rng(0)
    Q = box.center + box.half_width * rng.uniform(-1, 1, (300, 7))
    half = 10 ** rng.uniform(-15, -1.5, (300, 1)) * np.ones((1, 7))
    found = problem.bounds(Q, half)
    points = Q + half * np.where(
        rng.uniform(size=(300, 1)) < 0.3, 0, rng.uniform(-1, 1, (300, 7))
    )
    assert (found.leaf_margin > 0).mean() > 0.9
    for q, bound in zip(points, found.leaf_margin, strict=True):
        assert (
            leaf_margin_in_balls(panda_design, q) > bound
        )  # of balls: certain, or False
