"""The bounds of a leaf margin in boxes: each holds wherever it is looked at, is attained or nearly
so, and a wrong one is noticed."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import planar_task, sliding_task, spatial_task
from controls import some as chosen
from inside import boxes, chain, leaf_margin_bounds
from kernels import columns, expanded, expansion, kernels, remainders
from mimic_arm import MIMICS, arm
from mutants import EXPANSION, POTENTIALS, POTENTIALS_C, SCREWS, C, wrong
from proofs import design_of, margins, near_null_space, regular_start, smallest_singular_values
from second_order import crossed, made_up, ratios

import repctl_pin as rp
from repctl_pin import redundancy

FILE = "leaf_margin_bounds.c"

TASKS: dict[str, Callable[[Path], rp.Task]] = {
    "pose, r = 1": lambda folder: spatial_task(7, folder, kind="pose", seed=3),
    "pose, r = 3": lambda folder: spatial_task(9, folder, kind="pose", seed=4),
    "axis": lambda folder: spatial_task(7, folder, kind="axis", seed=5),
    "position": lambda folder: spatial_task(5, folder, seed=6),
    "two coordinates": lambda folder: spatial_task(4, folder, kind="xz", seed=7),
    "planar": lambda folder: planar_task((1.0, 0.9, 0.8, 0.7), folder),
    "mimic joints": lambda folder: rp.Robot.load(arm(folder, MIMICS, n=9)).task("l9", "axis"),
    "another base": lambda _: rp.Robot.load("baxter", base="left_gripper").task(
        "right_gripper", "pose"
    ),
}


@pytest.mark.parametrize("case", chosen(TASKS, "pose, r = 1", "two coordinates"))
def test_every_box_s_bounds_hold_at_its_corners_and_inside(case: str, tmp_path: Path) -> None:
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
        points = Q[:, None] + half[:, None] * np.sign(rng.standard_normal((len(Q), 40, task.n)))
        points[:, 20:] = Q[:, None] + half[:, None] * rng.uniform(-1, 1, (len(Q), 20, task.n))
        true = margins(design, points.reshape(-1, task.n)).reshape(len(Q), -1)
        assert (found.leaf_margin <= true.min(axis=1) + 1e-9).all()
        sigma = smallest_singular_values(task, points.reshape(-1, task.n)).reshape(len(Q), -1)
        assert (found.sigma_min <= sigma.min(axis=1) + 1e-9).all()
        np.testing.assert_allclose(found.center, margins(design, Q), rtol=0.02)
        if width == 1e-9:
            assert (found.leaf_margin > 0.999 * true.min(axis=1) - 1e-6).all()
    assert some > 20


@pytest.mark.parametrize(
    "case", chosen(["pose, r = 3", "axis", "position", "two coordinates", "mimic joints"], "axis")
)
def test_screws_have_the_null_space_of_the_task_seen_from_every_link(
    case: str, tmp_path: Path
) -> None:
    task = TASKS[case](tmp_path)
    q, whole = regular_start(task), chain.chain_of(task)
    for middle in range(len(whole.p) + 1):
        links = whole.seen_from(middle, 0.3)

        def columns_at(q: np.ndarray, links: chain.Chain = links) -> np.ndarray:
            theta = links.S[:, : links.n] @ q + links.o
            return np.asarray(columns(kernels(), links, theta)[0].T)

        J = columns_at(q)
        still = np.linalg.qr(J[:, links.n :], mode="complete")[0][:, links.N - links.n :]
        ours, theirs = (
            np.linalg.svd(still.T @ J[:, : links.n])[2][: task.m],
            np.linalg.svd(task.jacobian(q))[2],
        )
        assert np.abs(ours @ theirs[task.m :].T).max() < 1e-9
        theta = links.S[:, : links.n] @ q + links.o
        by_bracket = columns(kernels(), links, theta)[1]  # (n, N, 6)
        for j, e in enumerate(1e-6 * np.eye(task.n)):
            change = (columns_at(q + e) - columns_at(q - e)) / 2e-6
            np.testing.assert_allclose(by_bracket[j].T, change, atol=1e-7)


def test_few_boxes_cover_a_tube() -> None:
    """All that lies between the samples is in a box, and no section of them has two."""
    t = np.linspace(0, 2 * np.pi, 200)
    samples = 0.3 * np.column_stack([np.cos(t), np.sin(t), np.sin(2 * t), 0.1 * t])
    tube = rp.Tube(samples, np.array([0.1, 0.05, 0.1, 0.02]))
    low, high = boxes.cover(tube)
    rng = np.random.default_rng(0)
    k, share = rng.integers(len(t) - 1, size=4000), rng.uniform(size=(4000, 1))
    edge = rng.uniform(-1, 1, (4000, 4))
    edge[::2] /= np.abs(edge[::2]).max(axis=1, keepdims=True)  # half of them on the sides
    points = samples[k] + share * (samples[k + 1] - samples[k]) + tube.radius * edge
    inside = ((points[:, None] >= low) & (points[:, None] <= high)).all(axis=2)
    assert inside.any(axis=1).all() and len(low) < len(t)


# ---- the theorem's constants -------------------------------------------------------------------


def worst_ratio(task: rp.Task, library: ctypes.CDLL, count: int = 120) -> float:
    """The largest ratio of an actual remainder of a screw to its bound, over random boxes and
    corners of them."""
    whole, rng, worst = chain.chain_of(task), np.random.default_rng(0), 0.0
    P, moves = len(whole.p), whole.S[:, : task.n].any(axis=1)
    for trial in range(count):
        links = whole.seen_from(int(rng.integers(P + 1)), float(rng.uniform()))
        links = replace(links, S=np.eye(P), n=P)  # every joint by itself
        theta = rng.uniform(-2, 2, P)
        eta = rng.uniform(0, 1.0, P) * 10 ** rng.uniform(-2, 0)
        eta = eta * (moves & (rng.uniform(size=P) < 0.7))
        way = rng.uniform(-1, 1, P)
        delta = eta * (np.sign(way) if trial % 2 else way)
        here, slopes = columns(library, links, theta)
        there, _ = columns(library, links, theta + delta)
        rest = there - here - np.einsum("j,jlx->lx", delta, slopes)
        linear, angular = remainders(library, links, theta, eta)
        for actual, bound in ((rest[:, :3], linear), (rest[:, 3:], angular)):
            ratio = np.linalg.norm(actual, axis=1) / (bound + 1e-12)
            worst = max(worst, float(ratio.max()))
    return worst


def test_remainders_of_screws_are_bounded_and_the_bound_is_tight(tmp_path: Path) -> None:
    library = kernels()
    planar = planar_task((1.0, 0.9, 0.8, 0.7), tmp_path)
    assert 0.9 < worst_ratio(planar, library) <= 1
    assert 0.5 < worst_ratio(sliding_task(tmp_path), library) <= 1
    for seed in range(2):
        arm = spatial_task(5, tmp_path, kind="pose", seed=seed)
        assert 0.2 < worst_ratio(arm, library) <= 1


SLOW = pytest.mark.slow


def some(mutants: dict[str, tuple[str, str]], quick: int = 1) -> list[object]:
    """All mutants as parameters; the first one is not slow."""
    return [
        pytest.param(name, marks=[SLOW] if i >= quick else []) for i, name in enumerate(mutants)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("mutant", some(SCREWS))
def test_a_wrong_remainder_is_noticed(mutant: str, tmp_path: Path) -> None:
    tasks = [
        planar_task((1.0, 0.9, 0.8), tmp_path),
        sliding_task(tmp_path),
        spatial_task(5, tmp_path, kind="pose"),
    ]
    library = kernels(FILE, *SCREWS[mutant])
    assert max(worst_ratio(task, library) for task in tasks) > 1


# ---- the second order --------------------------------------------------------------------------

HELD = 1 + 1e-9


def test_the_bound_is_attained_where_all_terms_have_the_worst_signs() -> None:
    found = [f for seed in range(40) if (f := made_up(kernels(), seed)) is not None]
    assert len(found) > 30 and 0.9 < min(found) and 0.999999 < max(found) <= HELD


@pytest.mark.parametrize("r", [1, 2, 3])
def test_the_bound_holds_in_boxes_of_general_position(r: int) -> None:
    for width in (0.001, 0.01, 0.03):
        every = [crossed(kernels(), seed, r, width) for seed in range(20)]
        found = [ratio for ratio in every if ratio is not None]
        assert len(found) > 8 and max(found) <= HELD
        assert width > 0.001 or min(found) > 0.97


LOOSER = ("V_c not taken out of P", "V's rest not projected", "M once")
"""Changes that no made-up box notices: they hardly change the bound."""


@pytest.mark.parametrize("mutant", some({k: v for k, v in C.items() if k not in LOOSER}))
def test_a_wrong_term_is_noticed(mutant: str) -> None:
    assert max(ratios(kernels(FILE, *C[mutant]), 30)) > HELD


# ---- chains ------------------------------------------------------------------------------------


def curved(task: rp.Task, degree: int, width: float, rough: float = 0.2) -> rp.Design:
    """A design of strongly curved potentials, regular at the centre of its box."""
    rng, q = (np.random.default_rng(0), task.reference + 0.3 * (task.n < 7) * np.arange(task.n))
    potentials = rp.Polynomial(q, degree, width)
    A = rough * width * rng.standard_normal((potentials.size, task.r))
    A /= np.sqrt(potentials.size / task.n)
    D = potentials.gradients(q[None])[0]
    A += np.linalg.lstsq(D, redundancy.nullspace(task.jacobian(q)) - D @ A, rcond=None)[0]
    return design_of(task, potentials.weighted(A), rp.Box(q, width))


def boxes_of(design: rp.Design, width: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Random boxes of a design, in which some joints stand still."""
    region, rng = design.region, np.random.default_rng(1)
    shape = count, design.task.n
    Q = region.center + 0.8 * region.half_width * rng.uniform(-1, 1, shape)
    half = width * region.half_width * rng.uniform(0.2, 1, shape)
    return Q, half * (rng.uniform(size=shape) < rng.choice([0.2, 0.5, 1], (count, 1)))


def looked_at(design: rp.Design, width: float, count: int = 16) -> tuple[float, float]:
    """The largest ratio of a bound of the leaf margin to a sample; the share of boxes with one."""
    problem = leaf_margin_bounds.leaf_margin_of(
        design.task, design.inverse.potentials, design.region
    )
    Q, half = boxes_of(design, width, count)
    found, rng = problem.bounds(Q, half), np.random.default_rng(2)
    least = np.full(count, np.inf)
    for trial in range(16):
        way = rng.uniform(-1, 1, Q.shape)
        points = Q + half * (np.sign(way) if trial % 4 else way)
        least = np.minimum(least, margins(design, points))
    return float((found.leaf_margin / least).max()), float((found.leaf_margin > 0).mean())


def gradients_off(
    design: rp.Design, width: float, library: ctypes.CDLL, *, law: object = leaf_margin_bounds
) -> float:
    """The largest ratio of what V differs from its expansion by to its bound."""
    potentials, rng = design.inverse.potentials, np.random.default_rng(3)
    problem = law.leaf_margin_of(design.task, potentials, design.region)
    worst = 0.0
    for q, h in zip(*boxes_of(design, width, 12), strict=True):
        at = expanded(library, problem, q, h)
        gauge = np.linalg.lstsq(potentials.gradients(q[None])[0], at["V"].T, rcond=None)[0]
        for trial in range(16):
            way = rng.uniform(-1, 1, len(q))
            delta = h * (np.sign(way) if trial % 4 else way)
            V = potentials.gradients((q + delta)[None])[0] @ gauge
            off = V - at["V"].T - (at["dV"] @ delta).T
            worst = max(worst, float((np.abs(off) / (at["rest"].T + 1e-11)).max()))
    return worst


@pytest.mark.parametrize("degree", chosen([3, 4, 5, 6], 5))
def test_bounds_hold_and_are_nearly_attained_on_planar_arms(degree: int, tmp_path: Path) -> None:
    design = curved(planar_task((1.0, 0.9, 0.8), tmp_path), degree, 0.6)
    found = [looked_at(design, width) for width in (0.02, 0.1, 0.3)]
    assert max(ratio for ratio, _ in found) <= HELD
    assert found[0][0] > 0.9 and found[0][1] > 0.6
    off = [gradients_off(design, width, kernels()) for width in (0.02, 0.3)]
    assert 0.5 < max(off) <= HELD


@pytest.mark.parametrize("degree", [3, 4])
def test_bounds_hold_and_are_nearly_attained_on_panda(degree: int, panda_pose: rp.Task) -> None:
    design = curved(panda_pose, degree, 0.3)
    found = [looked_at(design, width) for width in (0.02, 0.3)]
    assert max(ratio for ratio, _ in found) <= HELD
    assert found[0][0] > 0.9 and found[0][1] > 0.6


@pytest.mark.parametrize("degree", [3, 4, 5, 6])
def test_the_bound_of_one_power_is_attained(degree: int, tmp_path: Path) -> None:
    design = powers(planar_task((1.0, 0.9, 0.8), tmp_path), degree)
    assert 0.9 < gradients_off(design, 0.2, kernels()) <= HELD


def powers_off(folder: Path, library: ctypes.CDLL) -> float:
    """The same for powers of one joint, which attain the bounds of their derivatives, and for
    potentials of all joints."""
    task = planar_task((1.0, 0.9, 0.8), folder)
    designs = [powers(task, degree) for degree in (3, 4, 5)]
    return max(gradients_off(design, 0.2, library) for design in designs)


@pytest.mark.parametrize("mutant", POTENTIALS)
def test_a_wrong_bound_of_the_potentials_is_noticed(
    mutant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = wrong(monkeypatch, "potentials.py", *POTENTIALS[mutant])
    monkeypatch.setattr(leaf_margin_bounds, "features_of", module.features_of)
    assert powers_off(tmp_path, kernels()) > HELD


@pytest.mark.slow
@pytest.mark.parametrize("mutant", some(POTENTIALS_C))
def test_a_wrong_bound_of_the_potentials_in_c_is_noticed(mutant: str, tmp_path: Path) -> None:
    assert powers_off(tmp_path, kernels(FILE, *POTENTIALS_C[mutant])) > HELD


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


# ---- the expansion -----------------------------------------------------------------------------


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


def expansions_off(
    cases: list[tuple[leaf_margin_bounds.LeafMarginProblem, rp.Design]], library: ctypes.CDLL
) -> float:
    """The largest relative difference of C's expansion of J_V from NumPy's."""
    most = 0.0
    for problem, design in cases:
        problem = replace(problem, round=1e6 * problem.round)  # rounding is seen
        for q, h in zip(*boxes_of(design, 0.1, 3), strict=True):
            ours = expanded(library, problem, q, h)
            theirs = expansion(kernels(), problem, q, h)
            for name in ("A", "R", "B"):
                away = np.abs(ours[name] - theirs[name]).max()
                most = max(most, float(away / np.abs(theirs[name]).max()))
    return most


def test_c_and_numpy_expand_j_v_the_same(panda_pose: rp.Task, tmp_path: Path) -> None:
    assert expansions_off(problems(tmp_path, panda_pose), kernels()) < 1e-11


@pytest.mark.slow
def test_a_wrong_expansion_is_noticed(panda_pose: rp.Task, tmp_path: Path) -> None:
    cases = problems(tmp_path, panda_pose)
    for name, change in EXPANSION.items():
        if name != "A is exact":  # rounding of A, which is bounded below
            assert expansions_off(cases, kernels(FILE, *change)) > 1e-9, name


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
    points = Q + half * np.where(rng.uniform(size=(300, 1)) < 0.3, 0, rng.uniform(-1, 1, (300, 7)))
    assert (found.leaf_margin > 0).mean() > 0.9
    for q, bound in zip(points, found.leaf_margin, strict=True):
        assert leaf_margin_in_balls(panda_design, q) > bound  # of balls: certain, or False
