"""Proofs: bounds hold wherever they are looked at, false ones fail, and the theorem's constants are
tight."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from time import thread_time
from types import SimpleNamespace

import numpy as np
import pytest
from arms import planar_task, spatial_task
from commands import main, refused, told
from proofs import design_of, margins, regular_start, smallest_singular_values

import repctl_pin as rp

# ---- whole regions -----------------------------------------------------------------------------


def test_the_worst_box_may_be_an_older_one_that_is_now_decided() -> None:
    """A box whose bound suffices since another margin was found counts with its place."""
    low = np.array([[0.0, 0.0], [1.0, 0.0]])
    module = sys.modules[import_module(rp.prove.__module__).bound_leaf_margin.__module__]
    search = module._Search(None, low, low + 1, None)
    search.bound, search.split = np.array([0.9, 0.5]), np.zeros(2, np.int32)
    search.decided = 0.7
    left = search._still_short(0.4, np.ones(2, bool))
    assert not left.any() and search.decided == 0.5
    np.testing.assert_allclose(search.at_least_bound[0], [1.5, 0.5])


@pytest.mark.slow
def test_panda_s_box_is_proved_within_a_few_per_cent_of_the_sampled_margin(
    panda_design: rp.Design,
) -> None:
    proof = rp.prove(panda_design, margin=0.5)
    assert proof and proof.proved and proof.leaf_margin >= 0.5 and proof.boxes < 20_000
    best = rp.prove(panda_design, seconds=20)
    assert best and 0.9 * panda_design.leaf_margin < best.leaf_margin < panda_design.leaf_margin
    assert (
        0
        < best.sigma_min
        < smallest_singular_values(panda_design.task, panda_design.region.random(512, 0)).min()
    )
    assert "proved: panda" in best.summary() and repr(best).startswith(
        "<Proof: proved, leaf margin > 0.7"
    )
    Q = panda_design.region.random(4096, 3)
    assert margins(panda_design, Q).min() > best.leaf_margin


def test_what_is_false_is_not_proved_and_the_place_is_shown(panda_design: rp.Design) -> None:
    proof = rp.prove(panda_design, margin=0.9, closes=False)
    assert (
        not proof
        and proof.reason
        == f"the leaf margin there is {margins(panda_design, proof.worst[None])[0]:.4g}"
    )
    assert (
        panda_design.region.contains(proof.worst[None])[0]
        and margins(panda_design, proof.worst[None])[0] < 0.9
    )
    limits = rp.prove(panda_design, margin=0.3, limit_margin=1.0, closes=False)
    assert not limits and "limit margin" in limits.reason


def test_limit_margin_is_that_of_the_region(panda_design: rp.Design) -> None:
    proof = rp.prove(panda_design, margin=0.3, limit_margin=-0.3, closes=False)
    box, task = panda_design.region, panda_design.task
    exact = min((box.lower - task.lower).min(), (task.upper - box.upper).min())
    assert proof and exact - 1e-12 < proof.limit_margin <= exact


def test_a_tube_is_proved_with_all_that_lies_between_its_samples(panda_design: rp.Design) -> None:
    center = panda_design.region.center
    samples = center + 0.3 * np.linspace(-1, 1, 5)[:, None] * np.array([1, -1, 1, -1, 1, -1, 1])
    tube = rp.Tube(samples, 0.01)  # the samples are farther from each other than the radius
    proof = rp.prove(panda_design, region=tube)
    between = (samples[1:] + samples[:-1]) / 2
    assert proof and not tube.contains(between).any()
    assert proof.leaf_margin < margins(panda_design, between).min()
    assert proof.leaf_margin > 0.9 * margins(panda_design, np.concatenate([between, samples])).min()


def test_a_workspace_box_is_proved_on_the_joints_it_selects_from(panda_design: rp.Design) -> None:
    task, box = panda_design.task, panda_design.region.shrunk(0.2)
    region = rp.WorkspaceBox(task, task.placement(box.center).translation, 0.05, within=box)
    proof = rp.prove(panda_design, region=region, margin=0.8, closes=False)
    assert proof
    assert proof.boxes == rp.prove(panda_design, region=box, margin=0.8, closes=False).boxes


def test_no_smaller_region_is_without_the_singularity_at_its_centre(
    panda_design: rp.Design, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ω is scaled about its centre, so a proof would be of Ω itself; here anything is proved."""
    certify = sys.modules[rp.prove.__module__]
    monkeypatch.setattr(certify, "bound_leaf_margin", lambda *_: True)
    region, report = panda_design.region, lambda *_: None
    assert "0.95 of its width" in certify._without(panda_design, region, 1.0, report)
    assert certify._without(panda_design, region, 0.0, report) == ""


def test_what_has_no_bounds_is_refused_by_name(panda_design: rp.Design) -> None:
    task, center = panda_design.task, panda_design.region.center
    own = rp.CustomPotentials([lambda q: q[0] + q[2] ** 2], names=["mine"])
    with pytest.raises(rp.InputError, match="given as functions.*use polynomials"):
        rp.prove(design_of(task, own.weighted(np.ones((1, 1))), panda_design.region))

    class Ball(rp.Box.__base__):
        center = bounds = random = ratio = clip = shrunk = None

    with pytest.raises(rp.InputError, match="a Ball: its shape is not known"):
        rp.prove(panda_design, region=Ball())
    with pytest.raises(rp.InputError, match="region must be a region of joint space"):
        rp.prove(panda_design, region="all")
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
    across = np.linalg.svd(N_at.T)[2][task.r :].T @ rng.standard_normal((task.n - task.r, task.r))
    V_at = across / np.linalg.norm(across)  # all of it in the row space of J
    D = np.concatenate([potentials.gradients(center[None])[0], potentials.gradients(at[None])[0]])
    A += np.linalg.lstsq(D, np.concatenate([N, V_at]) - D @ A, rcond=None)[0]
    return design_of(task, potentials.weighted(A), rp.Box(center, width))


@pytest.mark.parametrize(
    "seed", [pytest.param(k, marks=[pytest.mark.slow] if k else []) for k in range(24)]
)
def test_no_planted_singularity_is_proved_away(seed: int, tmp_path: Path) -> None:
    """A third inside the box, a third a little outside it, a third with none: the proof is never
    contradicted."""
    check_planted(seed, tmp_path)


def determinants_at(design: rp.Design, proof: rp.Proof) -> np.ndarray:
    """Determinants of J_V at the two configurations that a reason names."""
    points = re.findall(r"q = \(([^)]*)\)", proof.reason)
    Q = [np.array([float(v) for v in point.split(",")]) for point in points]
    task, h = design.task, design.inverse.potentials
    J_V = [np.concatenate([task.jacobian(q), h.gradient(q).T]) for q in Q]
    return np.linalg.det(J_V)


def check_planted(seed: int, folder: Path, seconds: float = 0.25) -> tuple[float, float]:
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
    proof = rp.prove(design, seconds=seconds, closes=False)
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
            and not rp.prove(design, margin=0, seconds=0.1, closes=False)
        )
        if abs(where).max() < 0.9:  # nearer to an edge, one sign may have next to no room
            named = "singular between q = " in proof.reason
            assert named and np.prod(np.sign(determinants_at(design, proof))) < 0
    best = Q[np.argmin(found)]
    # a search of another kind: shrinking random steps downhill
    for step in width * 0.5 ** np.arange(1, 18):
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


# ---- certificates ------------------------------------------------------------------------------


def test_a_certificate_is_saved_with_the_design_and_holds_again(
    panda_design: rp.Design, tmp_path: Path
) -> None:
    panda_design = replace(panda_design, held_out=64)  # a quick summary
    assert "found, not proved" in panda_design.summary()
    proof = rp.prove(panda_design, margin=0.6, closes=0.005)
    design = replace(panda_design, proof=proof)
    assert "at worst, proved > 0.6" in design.summary()
    loaded = rp.load(rp.save(design, tmp_path / "design.json"))
    assert repr(loaded.proof) == repr(proof) and loaded.proof.summary() == proof.summary()
    again = rp.prove(loaded, margin=0.6, closes=0.005)
    assert (again.leaf_margin, again.boxes) == (proof.leaf_margin, proof.boxes)
    without = rp.load(rp.save(panda_design, tmp_path / "design.json"))
    assert without.proof is None and "proof" not in (tmp_path / "design.json").read_text(
        encoding="utf-8"
    )


def test_the_commands_prove_and_check_what_they_saved(
    panda_design: rp.Design,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    quick_choices: None,
    blank_pictures: None,
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
    made = str(tmp_path / "out" / "design.json")
    asked = ["--prove", "--leaf", "0.02", "--out", str(tmp_path / "out")]
    assert main(["design", *start, *asked]) == 0
    said = capsys.readouterr().out
    assert "proved: planar3r" in said and "at worst, proved > " in said
    assert "of hand and elbow within" in said and "0.02 of its levels close" in said
    for options, leaf in (([], 0.02), (["--leaf", "0.01"], 0.01)):
        assert main(["check", made, "--prove", *options]) == 0
        said = capsys.readouterr().out
        assert "(asked: " in said and said.startswith("proved")
        assert f"{leaf} of its levels close" in said
    for command in (["check", file], ["design", *start]):
        assert "--leaf requires --prove" in refused(capsys, *command, "--leaf", "0.1")
    assert "mutually exclusive" in refused(capsys, "check", file, "--prove", "--region", "0.1")
    assert "requires a saved design" in refused(capsys, "check", "panda", "--prove")


@pytest.mark.parametrize("decided", [False, True])
def test_a_proof_that_decides_nothing_is_given_up_early(decided: bool) -> None:
    """A quarter of its time; a proof with one box that is decided takes all of it."""
    found = import_module(rp.prove.__module__).bound_leaf_margin

    class Undecided:
        """Bounds that take 10 ms, and decide one box at most."""

        first = decided

        def bounds(self, Q: np.ndarray, half: np.ndarray) -> SimpleNamespace:
            end = thread_time() + 0.01
            while thread_time() < end:
                pass
            bound = np.zeros(len(Q))
            if len(Q) > 1:
                bound[0] = float(self.first)
                self.first = False
            return SimpleNamespace(
                leaf_margin=bound,
                center=np.ones(len(Q)),
                sigma_min=bound,
                split=np.zeros(len(Q), np.int32),
            )

        def undefined(self, Q: np.ndarray, half: np.ndarray) -> np.ndarray:
            return np.zeros(len(Q), bool)

    begin = thread_time()
    low, high = np.zeros((1, 2)), np.ones((1, 2))
    proof = found(Undecided(), low, high, 0.5, 0.2, lambda step, share: None, 0.25)
    spent = thread_time() - begin
    assert not proof and (spent > 0.2 if decided else 0.05 < spent < 0.15)
    assert proof.reason == "stopped after " + (
        "0.2 s" if decided else "0.05 s, with no box decided"
    )


@pytest.mark.slow
def test_a_study_says_that_its_time_did_not_suffice_for_a_proof(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from inside import study_certificate

    monkeypatch.setattr(study_certificate, "with_certificate", lambda design, spent, say: design)
    found = rp.study("planar3r", cycles=1)
    (note,) = [note for note in found.notes if "not proved" in note]
    assert "--prove" in note and note in study_certificate.unproved_note(found.design)
    proved = replace(found.design, proof=rp.prove(found.design, margin=0.1, closes=False))
    assert study_certificate.unproved_note(proved) == []
