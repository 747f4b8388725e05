"""No false refusals: what a lower degree solves a higher one does too, whatever the sample; and
auto goes on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arms import Q_PANDA, spatial_task

import repctl_pin as rp
from repctl_pin.design import (
    batches,
    continuation,
    criterion,
    independence,
    singularity_search,
)


def test_the_verdict_does_not_hang_on_the_sample() -> None:
    """tiago ±0.15, degree 2: a descent on few nodes runs into a singularity between them."""
    task = rp.Robot.load("tiago").task(None, "pose")
    desired, box = rp.Pseudoinverse(task), rp.Box(task.reference, 0.15)
    linear = rp.nearest_repeatable(
        desired, None, box, degree=1, options=rp.FitOptions(samples=2048, held_out=1024)
    )
    found = [
        rp.nearest_repeatable(
            desired,
            None,
            box,
            degree=2,
            options=rp.FitOptions(samples=k, held_out=1024),
        )
        for k in (2048, 4096)
    ]
    for design in found:
        assert design.converged and design.leaf_margin > 0.02
        assert design.cost < 0.05 * linear.cost
    assert found[1].cost == pytest.approx(found[0].cost, rel=0.1)


def test_auto_goes_on_while_it_pays(tmp_path: Path) -> None:
    task, box = spatial_task(4, tmp_path, seed=2), rp.Box(np.full(4, 0.2), 0.5)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        None,
        box,
        degree="auto",
        options=rp.FitOptions(samples=2048, held_out=2048),
    )
    degrees, costs, _ = zip(*design.degrees, strict=True)
    assert degrees[-1] == 6 and costs[4] < 0.6 * costs[3]
    assert design.cost == min(costs)


@pytest.mark.slow
def test_panda_and_xarm_at_higher_degrees(panda_pose: rp.Task) -> None:
    """Costs on held-out nodes; the xarm's tube is that of its study, where degree 4 used to be
    refused."""
    box = rp.Box(Q_PANDA, 0.4)
    assert (
        rp.nearest_repeatable(
            rp.Pseudoinverse(panda_pose), None, box, degree="auto"
        ).cost
        < 0.1525
    )
    study = rp.study(rp.Problem("xarm7", kind="pose"))
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(study.task), None, study.design.region, degree=4
    )
    assert design.cost < 0.84 and design.leaf_margin > 0.3


def test_a_guarded_point_is_one_more_node(panda_pose: rp.Task) -> None:
    box, potentials = rp.Box(Q_PANDA, 0.4), rp.Polynomial(Q_PANDA, 2, 0.4)
    N = criterion.oriented_nullspace(
        panda_pose.jacobian(Q_PANDA)[None], panda_pose, Q_PANDA[None]
    )[0]
    builder = criterion.Builder(
        rp.Pseudoinverse(panda_pose), potentials, np.arange(potentials.size), N
    )
    Q, weights = box.nodes(64, 0)
    guarded = batches.BarrierCost(batches.Local(builder, Q, weights, 16), builder, 0.5)
    A = np.random.default_rng(0).normal(size=(potentials.size, 1))
    plain, _ = guarded.total(criterion.cost, A)
    at = box.random(4, 1)[:2]
    guarded.guard(at)
    inverse = rp.RepeatableInverse(panda_pose, potentials.weighted(A))
    distance = np.sum(
        (inverse.batch(at) - rp.Pseudoinverse(panda_pose).batch(at)) ** 2, axis=(1, 2)
    )
    with_guards, sides = guarded.total(criterion.cost, A)
    assert with_guards == pytest.approx(plain + 0.5 * distance.sum())
    assert sides.positive + sides.negative == len(Q) + 2
    # the first potentials alone: the same as the others' coefficients at 0
    alone = guarded.total(criterion.gauss_newton, A[:7])
    padded = guarded.total(
        criterion.gauss_newton, np.concatenate([A[:7], np.zeros((28, 1))])
    )
    assert alone[0] == pytest.approx(padded[0])
    assert np.allclose(alone[1], padded[1][:7]) and np.allclose(
        alone[2], padded[2][:, :7, :, :7]
    )


@pytest.mark.parametrize("wall", [0.03, 0.5, 0.83])
@pytest.mark.parametrize("bad", [[0.9, 0.0], [0.02, -0.9]])
def test_the_largest_free_box_ends_just_before_a_wall(
    wall: float, bad: list[float]
) -> None:
    """Whether the wall stands on the line to the configuration that is known, or beside it."""
    found = singularity_search.largest_free(
        lambda Q: wall - Q[:, 0], rp.Box(np.zeros(2), 1.0), np.array([bad])
    )
    assert isinstance(found, rp.Box) and (found.half_width < wall).all()
    assert (found.half_width > 0.985 * wall).all()
    nowhere = singularity_search.largest_free(
        lambda Q: -1 - Q[:, 0], rp.Box(np.zeros(2), 1.0), np.array([bad])
    )
    assert nowhere is None


def test_an_arm_stretched_inside_the_region_is_found() -> None:
    """Six joints at 0 at once: σ_min of planar7r is a cone there, on whose side every descent stops
    short."""
    task = rp.Robot.load("planar7r").task("tool", "xy")
    measure = singularity_search.Dexterity(task)
    for center, width in ((np.full(7, 0.3), 0.4), (np.full(7, -0.1), 0.3)):
        box = rp.Box(center, width)
        found = singularity_search.search(measure, box, box.random(2048, 0))
        assert found.value == 0 and box.contains(found.at[None]).all()
        sigma = np.linalg.svd(task.jacobian(found.at), compute_uv=False)
        assert sigma[-1] <= 1e-5 * sigma[0] and np.abs(found.at[1:]).max() < 1e-3
        with pytest.raises(rp.SingularityError, match="loses rank"):
            rp.nearest_repeatable(
                rp.Pseudoinverse(task),
                None,
                box,
                degree=1,
                options=rp.FitOptions(samples=64, held_out=64),
            )
    bent = rp.Box(np.full(7, 0.3), 0.25)  # without a stretched arm
    assert singularity_search.search(measure, bent, bent.random(2048, 0)).value > 0.01


class Open(rp.Box):
    """A box that does not move points back, as a region may that cannot."""

    def clip(self, Q: np.ndarray) -> np.ndarray:
        return np.array(Q)


def test_the_search_for_singularities_stays_in_the_region() -> None:
    task = rp.Robot.load("planar7r").task("tool", "xy")
    for box in (Open(np.full(7, 0.3), 0.25), Open(np.full(7, 0.5), 0.4)):
        for measure in (
            singularity_search.Dexterity(task),
            lambda Q: 2 + Q.sum(axis=1),
        ):
            found = singularity_search.search(measure, box, box.random(256, 0))
            assert found.value > 0 and box.ratio(found.ends).max() <= 1 + 2e-9


@pytest.fixture(scope="module")
def fit_of_planar3r():
    """A function that makes the continuation of a fit of degree 3, with 64 nodes."""
    task = rp.Robot.load("planar3r").task(None, "xy")
    desired, box = rp.Pseudoinverse(task), rp.Box([0.3, 1.0, 0.8], 0.3)
    potentials = rp.Polynomial(box.center, 3, box.half_width)
    Q, weights = box.nodes(64, 0)
    chosen = independence.independent(desired, potentials, Q, weights)
    N = criterion.oriented_nullspace(
        task.jacobian(box.center)[None], task, box.center[None]
    )[0]
    builder = criterion.Builder(desired, potentials, chosen.kept, N)

    def made(warm: np.ndarray | None = None) -> continuation.Continuation:
        nodes = batches.BarrierCost(
            batches.Local(builder, Q, weights, 16), builder, 1 / len(Q)
        )
        problem = continuation.FitProblem(
            desired, potentials, box, rp.FitOptions(), warm
        )
        return continuation.Continuation(problem, chosen, nodes)

    return made


def test_lower_degrees_are_offered_after_the_highest(fit_of_planar3r) -> None:
    first, *ladder = fit_of_planar3r().regular()
    assert [len(one.A) for one in ladder] == [len(first.A), 9, 3]
    assert first.cost == pytest.approx(ladder[0].cost, rel=1e-3)
    assert ladder[0].cost < 0.5 * ladder[1].cost < 0.25 * ladder[2].cost
    assert max(one.steps for one in (first, *ladder)) < 8  # as Newton's method would
    # a design of degree 1 replaces the ladder: it is offered as it is
    warm = fit_of_planar3r(ladder[2].A)
    best, last = warm.regular()
    assert best.cost == pytest.approx(first.cost, rel=1e-3)
    assert np.array_equal(last.A, ladder[2].A) and not last.converged
    assert last.cost == pytest.approx(ladder[2].cost) and last.gradient_norm == 0
    assert last.steps == 0 and last.sides.uniform


def test_the_gradient_norm_belongs_to_the_coefficients_found(fit_of_planar3r) -> None:
    """A descent that begins where another ended stops there, and has the same gradient."""
    way = fit_of_planar3r()
    (first, *_) = way.regular()
    noise = np.random.default_rng(0).normal(size=first.A.shape)
    coarse = way.descend(way.coarse, first.A + 1e-3 * noise, 1e-6, 0.1)
    again = way.descend(way.coarse, coarse.A, 1e-6, np.inf)
    assert coarse.steps > 0 and np.allclose(again.A, coarse.A, rtol=1e-9, atol=0)
    assert coarse.gradient_norm == pytest.approx(again.gradient_norm, rel=1e-6)


def test_nodes_that_do_not_determine_the_potentials_are_said(fit_of_planar3r) -> None:
    """Where no V is found singular, and no error was raised: at the last barrier point."""
    way = fit_of_planar3r()
    Q = way.problem.region.random(32, 0)
    for at in (way.problem.region.center, Q[3]):
        error = way.refusal(Q, None)
        assert "32 nodes do not determine 19 potentials" in str(error)
        assert "give more samples" in str(error) and error.free is None
        assert np.array_equal(error.at, at)
        way.coarse.guard(Q[3:5])
