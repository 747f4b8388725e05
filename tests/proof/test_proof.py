"""Proofs: bounds hold wherever they are looked at, false ones fail, and the theorem's constants are
tight."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import planar_task, sliding_task, spatial_task
from commands import main, refused, told
from mimic_arm import MIMICS, arm
from proofs import design_of, margins, near_null_space, smallest_singular_values

import repctl_pin as rp
from repctl_pin.proof import chain as chains
from repctl_pin.proof import leaf_margin_bounds as kernels
from repctl_pin.proof import regions, remainder, screws

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


def regular_start(task: rp.Task, seed: int = 0) -> np.ndarray:
    """The configuration of some random ones at which J is farthest from losing rank."""
    rng = np.random.default_rng(seed)
    Q = task.reference + rng.uniform(-0.7, 0.7, (64, task.n))
    return np.asarray(Q[np.argmax(smallest_singular_values(task, Q))])


@pytest.mark.parametrize("case", TASKS)
def test_every_box_s_bounds_hold_at_its_corners_and_inside(
    case: str, tmp_path: Path
) -> None:
    task = TASKS[case](tmp_path)
    q = regular_start(task)
    box = rp.Box(q, 0.1)
    design = design_of(task, near_null_space(task, q, 0.1, 1), box)
    problem = kernels.leaf_margin_of(task, design.inverse.potentials, box)
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
    "case", ["pose, r = 1", "pose, r = 3", "position", "mimic joints"]
)
def test_c_and_numpy_find_the_same_bounds(case: str, tmp_path: Path) -> None:
    task = TASKS[case](tmp_path)
    q = regular_start(task)
    polynomial = rp.Polynomial(q, 4, 0.3)
    potentials = polynomial + rp.Fourier(task.n, 1)
    A = np.random.default_rng(0).standard_normal((potentials.size, task.r))
    problem = kernels.leaf_margin_of(task, potentials.weighted(A), rp.Box(q, 0.1))
    library = kernels._library()
    if library is None:
        pytest.skip("there is no C compiler")
    rng = np.random.default_rng(1)
    Q, half = (
        q + rng.uniform(-0.1, 0.1, (200, task.n)),
        10 ** rng.uniform(-6, -2, (200, task.n)),
    )
    C, numpy = (
        kernels._in_c(problem, library, Q, half),
        kernels.in_numpy(problem, Q, half),
    )
    for name in ("leaf_margin", "center", "sigma_min"):
        np.testing.assert_allclose(
            getattr(C, name), getattr(numpy, name), rtol=1e-6, atol=1e-9
        )
    assert (C.leaf_margin > 0).mean() > 0.3


@pytest.mark.parametrize(
    "case", ["pose, r = 3", "axis", "position", "two coordinates", "mimic joints"]
)
def test_screws_have_the_null_space_of_the_task_seen_from_every_link(
    case: str, tmp_path: Path
) -> None:
    task = TASKS[case](tmp_path)
    q, whole = regular_start(task), chains.chain_of(task)
    for middle in range(len(whole.p) + 1):
        chain = whole.seen_from(middle, 0.3)

        def columns(q: np.ndarray, chain: object = chain) -> np.ndarray:
            theta = chain.S[:, : chain.n] @ q + chain.o
            return np.einsum(
                "lx,lc->xc", screws.screws(chain, theta[None])[0][0], chain.S
            )

        J = columns(q)
        still = np.linalg.qr(J[:, chain.n :], mode="complete")[0][
            :, chain.N - chain.n :
        ]
        ours, theirs = (
            np.linalg.svd(still.T @ J[:, : chain.n])[2][: task.m],
            np.linalg.svd(task.jacobian(q))[2],
        )
        assert np.abs(ours @ theirs[task.m :].T).max() < 1e-9
        theta = chain.S[:, : chain.n] @ q + chain.o
        by_bracket = screws.slopes(chain, *screws.screws(chain, theta[None]))[
            0
        ]  # (n, N, 6)
        for j, e in enumerate(1e-6 * np.eye(task.n)):
            np.testing.assert_allclose(
                by_bracket[j].T, (columns(q + e) - columns(q - e)) / 2e-6, atol=1e-7
            )


# ---- the theorem's constants -------------------------------------------------------------------


def worst_ratio(task: rp.Task, count: int = 120) -> float:
    """The largest ratio of an actual remainder of a screw to its bound, over random boxes and
    corners of them."""
    whole, rng, worst = chains.chain_of(task), np.random.default_rng(0), 0.0
    P, moves = len(whole.p), whole.S[:, : task.n].any(axis=1)
    for trial in range(count):
        chain = whole.seen_from(int(rng.integers(P + 1)), float(rng.uniform()))
        chain = replace(chain, S=np.eye(P), n=P)  # every joint by itself
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
        here, tip = screws.screws(chain, theta)
        there, _ = screws.screws(chain, theta + delta)
        rest = (there - here)[0] - np.einsum(
            "j,jlx->lx", delta[0], screws.slopes(chain, here, tip)[0]
        )
        linear, angular = remainder.remainders(chain, theta, eta)
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


# ---- whole regions -----------------------------------------------------------------------------


def test_panda_s_box_is_proved_within_a_few_per_cent_of_the_sampled_margin(
    panda_design: rp.Design,
) -> None:
    proof = rp.prove(panda_design, margin=0.5)
    assert proof and proof.proved and proof.leaf_margin >= 0.5 and proof.boxes < 20_000
    best = rp.prove(panda_design, seconds=20)
    assert (
        best
        and 0.9 * panda_design.leaf_margin < best.leaf_margin < panda_design.leaf_margin
    )
    assert (
        0
        < best.sigma_min
        < smallest_singular_values(
            panda_design.task, panda_design.region.random(512, 0)
        ).min()
    )
    assert "proved: panda" in best.summary() and repr(best).startswith(
        "<Proof: proved, leaf margin > 0.7"
    )
    Q = panda_design.region.random(4096, 3)
    assert margins(panda_design, Q).min() > best.leaf_margin


def test_what_is_false_is_not_proved_and_the_place_is_shown(
    panda_design: rp.Design,
) -> None:
    proof = rp.prove(panda_design, margin=0.9)
    assert (
        not proof
        and proof.reason
        == f"the leaf margin there is {margins(panda_design, proof.worst[None])[0]:.4g}"
    )
    assert (
        panda_design.region.contains(proof.worst[None])[0]
        and margins(panda_design, proof.worst[None])[0] < 0.9
    )
    limits = rp.prove(panda_design, margin=0.3, limit_margin=1.0)
    assert not limits and "limit margin" in limits.reason


def test_limit_margin_is_that_of_the_region(panda_design: rp.Design) -> None:
    proof = rp.prove(panda_design, margin=0.3, limit_margin=-0.3)
    box, task = panda_design.region, panda_design.task
    exact = min((box.lower - task.lower).min(), (task.upper - box.upper).min())
    assert proof and exact - 1e-12 < proof.limit_margin <= exact


def test_a_tube_is_proved_with_all_that_lies_between_its_samples(
    panda_design: rp.Design,
) -> None:
    center = panda_design.region.center
    samples = center + 0.3 * np.linspace(-1, 1, 5)[:, None] * np.array(
        [1, -1, 1, -1, 1, -1, 1]
    )
    tube = rp.Tube(
        samples, 0.01
    )  # the samples are farther from each other than the radius
    proof = rp.prove(replace(panda_design, region=tube))
    between = (samples[1:] + samples[:-1]) / 2
    assert proof and not tube.contains(between).any()
    assert proof.leaf_margin < margins(panda_design, between).min()
    assert (
        proof.leaf_margin
        > 0.9 * margins(panda_design, np.concatenate([between, samples])).min()
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


def test_a_workspace_box_is_proved_on_the_joints_it_selects_from(
    panda_design: rp.Design,
) -> None:
    task, box = panda_design.task, panda_design.region.shrunk(0.2)
    region = rp.WorkspaceBox(
        task, task.placement(box.center).translation, 0.05, within=box
    )
    proof = rp.prove(replace(panda_design, region=region), margin=0.8)
    assert (
        proof
        and proof.boxes == rp.prove(replace(panda_design, region=box), margin=0.8).boxes
    )


def test_what_has_no_bounds_is_refused_by_name(panda_design: rp.Design) -> None:
    task, center = panda_design.task, panda_design.region.center
    own = rp.CustomPotentials([lambda q: q[0] + q[2] ** 2], names=["mine"])
    with pytest.raises(rp.InputError, match="given as functions.*use polynomials"):
        rp.prove(design_of(task, own.weighted(np.ones((1, 1))), panda_design.region))

    class Ball:
        center = bounds = nodes = random = weights = ratio = clip = shrunk = None

    with pytest.raises(rp.InputError, match="a Ball: its shape is not known"):
        rp.prove(replace(panda_design, region=Ball()))
    with pytest.raises(rp.InputError, match="must be a design"):
        rp.prove(center)
    with pytest.raises(rp.InputError, match="margin must be from 0 to 1"):
        rp.prove(panda_design, margin=1.5)


def planted(
    task: rp.Task, at: np.ndarray, center: np.ndarray, width: float, seed: int
) -> rp.Design:
    """A design whose leaf margin is 0 at one configuration, and near 1 at the centre of its box."""

    potentials, rng = rp.Polynomial(center, 2, width), np.random.default_rng(seed)
    A = 0.1 * width * rng.standard_normal((potentials.size, task.r))
    N, N_at = (
        rp.redundancy.nullspace(task.jacobian(center)),
        rp.redundancy.nullspace(task.jacobian(at)),
    )
    across = np.linalg.svd(N_at.T)[2][task.r :].T @ rng.standard_normal(
        (task.n - task.r, task.r)
    )
    V_at = across / np.linalg.norm(across)  # all of it in the row space of J
    D = np.concatenate(
        [potentials.gradients(center[None])[0], potentials.gradients(at[None])[0]]
    )
    A += np.linalg.lstsq(D, np.concatenate([N, V_at]) - D @ A, rcond=None)[0]
    return design_of(task, potentials.weighted(A), rp.Box(center, width))


@pytest.mark.parametrize(
    "seed",
    [pytest.param(k, marks=[pytest.mark.slow] if k > 5 else []) for k in range(24)],
)
def test_no_planted_singularity_is_proved_away(seed: int, tmp_path: Path) -> None:
    """A third inside the box, a third a little outside it, a third with none: the proof is never
    contradicted."""
    check_planted(seed, tmp_path)


def check_planted(
    seed: int, folder: Path, seconds: float = 0.25
) -> tuple[float, float]:
    """Hold a proof to a search of another kind: the margin that it proves, and the smallest that
    the search finds."""
    rng = np.random.default_rng(seed)
    task = [
        lambda: planar_task(tuple(rng.uniform(0.5, 1, 3)), folder),
        lambda: planar_task(tuple(rng.uniform(0.5, 1, 4)), folder),
        lambda: spatial_task(4, folder, seed=seed),
        lambda: spatial_task(4, folder, kind="xy", seed=seed),
    ][seed % 4]()
    center, width = regular_start(task, seed), 0.15
    where = rng.uniform(-1, 1, task.n)
    kind = seed % 3
    if kind:
        where *= (rng.uniform(1.02, 1.5) if kind == 1 else 4.0) / np.abs(where).max()
    design = planted(task, center + width * where, center, width, seed)
    proof = rp.prove(design, seconds=seconds)
    Q = np.concatenate(
        [
            design.region.random(4096, seed),
            center + width * np.clip(where, -1, 1) * np.ones((1, task.n)),
        ]
    )
    found = margins(design, Q)
    if not kind:
        assert (
            not proof
            and proof.leaf_margin == 0
            and not rp.prove(design, margin=0, seconds=0.1)
        )
    best = Q[np.argmin(found)]
    for step in width * 0.5 ** np.arange(
        1, 18
    ):  # a search of another kind: shrinking random steps downhill
        tries = design.region.clip(best + step * rng.uniform(-1, 1, (64, task.n)))
        values = margins(design, tries)
        if values.min() < found.min():
            best, found = tries[np.argmin(values)], values
    assert proof.leaf_margin <= found.min() + 1e-9
    return proof.leaf_margin, float(found.min())


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_two_hundred_random_designs_are_never_contradicted(tmp_path: Path) -> None:
    """No proof is above what the search finds, and where there is a margin it is proved."""
    found = np.array([check_planted(seed, tmp_path) for seed in range(100, 300)])
    proved, least = found.T
    far = least > 0.05
    assert (proved[least <= 0] == 0).all() and (least < 1e-3).sum() > 60
    assert far.sum() > 20 and (proved[far] > 0).mean() > 0.9


# ---- against rigorous arithmetic ---------------------------------------------------------------


def test_boxes_against_ball_arithmetic(panda_design: rp.Design) -> None:
    """In tiny boxes the bound is within rounding of the margin itself, and must stay below it."""
    pytest.importorskip("flint")
    from arb_margin import leaf_margin_in_balls

    task, box = panda_design.task, panda_design.region
    problem: kernels.LeafMarginProblem = kernels.leaf_margin_of(
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


# ---- certificates ------------------------------------------------------------------------------


def test_a_certificate_is_saved_with_the_design_and_holds_again(
    panda_design: rp.Design, tmp_path: Path
) -> None:
    panda_design = replace(panda_design, held_out=64)  # a quick summary
    assert "found, not proved" in panda_design.summary()
    proof = rp.prove(panda_design, margin=0.6)
    design = replace(panda_design, proof=proof)
    assert "at worst, proved > 0.6" in design.summary()
    loaded = rp.load(rp.save(design, tmp_path / "design.json"))
    assert (
        repr(loaded.proof) == repr(proof) and loaded.proof.summary() == proof.summary()
    )
    again = rp.prove(loaded, margin=0.6)
    assert (again.leaf_margin, again.boxes) == (proof.leaf_margin, proof.boxes)
    without = rp.load(rp.save(panda_design, tmp_path / "design.json"))
    assert without.proof is None and "proof" not in (
        tmp_path / "design.json"
    ).read_text(encoding="utf-8")


def test_the_commands_prove_and_check_what_they_saved(
    panda_design: rp.Design, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(rp.save(panda_design, tmp_path / "plain.json"))
    found = told(capsys, "check", file, "--prove")
    assert found["proved"] and found["leaf_margin"] > 0.7
    start = (
        "planar3r",
        "--task",
        "xy",
        "--region",
        "0.1",
        "--degree",
        "2",
        "--samples",
        "256",
        "--held-out",
        "256",
    )
    assert main(["design", *start, "--prove", "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "proved: planar3r" in said and "at worst, proved > " in said
    assert main(["check", str(tmp_path / "out" / "design.json"), "--prove"]) == 0
    said = capsys.readouterr().out
    assert "(asked: " in said and said.startswith("proved")
    assert "mutually exclusive" in refused(
        capsys, "check", file, "--prove", "--region", "0.1"
    )
    assert "requires a saved design" in refused(capsys, "check", "panda", "--prove")
