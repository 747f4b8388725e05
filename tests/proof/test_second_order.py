"""The second-order remainders of proofs: each bound holds, is attained or nearly so, and a wrong
one is noticed."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from arms import planar_task, spatial_task
from mutants import NUMPY, POTENTIALS, C, compiled, source, wrong
from proofs import design_of
from second_order import Ratios, crossed, in_chain, made_up, worst

import repctl_pin as rp
from repctl_pin import redundancy
from repctl_pin.proof import leaf_margin_bounds as kernels

HELD = 1 + 1e-6


def made_up_ratios(module: ModuleType, count: int) -> Iterator[Ratios]:
    """Compare made-up boxes of one and two degrees of redundancy with the bounds of a module."""
    for r in (1, 2):
        for seed in range(count):
            yield made_up(module, seed, r, 0.05)
            yield crossed(module, seed, r, 0.003 if seed % 2 else 0.03)


def test_every_bound_is_attained_where_all_terms_have_the_worst_signs() -> None:
    found = worst([ratios for seed in range(40) if (ratios := made_up(kernels, seed))])
    for name, ratio in found.items():
        assert 0.999 < ratio <= HELD, name


@pytest.mark.parametrize("r", [1, 2, 3])
def test_every_bound_holds_in_boxes_of_general_position(r: int) -> None:
    for width in (0.001, 0.01, 0.03):
        boxes = [b for seed in range(20) if (b := crossed(kernels, seed, r, width))]
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
        in_chain(kernels, design, width, 1, boxes=16) for width in (0.02, 0.1, 0.3)
    ]
    found = worst([ratios for ratios, _ in parts if ratios])
    assert max(found.values()) <= HELD and parts[0][1] > 0.6
    assert min(found[name] for name in ("ν", "P", "SᵀS", "V", "bound")) > 0.7


@pytest.mark.parametrize("degree", [3, 4])
def test_bounds_hold_and_are_nearly_attained_on_panda(
    degree: int, panda_pose: rp.Task
) -> None:
    design = curved(panda_pose, degree, 0.3)
    parts = [in_chain(kernels, design, width, 1, boxes=12) for width in (0.02, 0.3)]
    found = worst([ratios for ratios, _ in parts if ratios])
    assert max(found.values()) <= HELD and parts[0][1] > 0.6
    assert min(found[name] for name in ("π", "P", "SᵀS", "V", "bound")) > 0.9
    assert min(found.values()) > 0.25


@pytest.mark.parametrize("degree", [3, 4, 5, 6])
def test_the_bound_of_one_power_is_attained(degree: int, tmp_path: Path) -> None:
    design = powers(planar_task((1.0, 0.9, 0.8), tmp_path), degree)
    assert 0.9 < in_chain(kernels, design, 0.2, 1, boxes=12)[0]["V"] <= HELD


@pytest.mark.parametrize("mutant", POTENTIALS)
def test_a_wrong_bound_of_the_potentials_is_noticed(
    mutant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Potentials of one power of one joint attain the bounds of their derivatives."""
    task, name = planar_task((1.0, 0.9, 0.8), tmp_path), "potentials.py"
    here, (piece, instead) = kernels, POTENTIALS[mutant]
    try:
        module = wrong(monkeypatch, name, piece, instead)
        monkeypatch.setattr(kernels, "features_of", module.features_of)
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


def problems(
    folder: Path, panda: rp.Task
) -> list[tuple[kernels.LeafMargin, rp.Design]]:
    """Leaf margins to bound: r = 1, 2 and 3, with prismatic joints, of high degree."""
    designs = [
        curved(panda, 4, 0.3, 0.05),
        curved(planar_task((1.0, 0.9, 0.8, 0.7), folder), 5, 0.4),
        curved(spatial_task(9, folder, kind="pose", seed=4), 3, 0.3, 0.05),
        curved(spatial_task(5, folder, seed=6), 4, 0.3),
    ]
    return [
        (kernels.leaf_margin_of(d.task, d.inverse.potentials, d.region), d)
        for d in designs
    ]


def wide_boxes(design: rp.Design, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Boxes in which the second order matters."""
    rng, region = np.random.default_rng(0), design.region
    Q = region.random(128, 0)[:count]
    half = region.half_width * 10 ** rng.uniform(-2.5, -0.3, (count, 1))
    return Q, half * rng.uniform(0.2, 1, Q.shape)


def differs(
    cases: list[tuple[kernels.LeafMargin, rp.Design]], library: ctypes.CDLL, count: int
) -> float:
    """The largest difference of C's bounds from NumPy's."""
    most = 0.0
    for problem, design in cases:
        boxes = wide_boxes(design, count)
        ours, theirs = (
            kernels._in_c(problem, library, *boxes),
            kernels.in_numpy(problem, *boxes),
        )
        assert (theirs.leaf_margin > 0).sum() > count / 10
        difference = np.abs(ours.leaf_margin - theirs.leaf_margin)
        most = max(most, float(np.nan_to_num(difference, nan=1.0).max()))
    return most


def test_c_and_numpy_find_the_same_bounds_in_wide_boxes(
    panda_pose: rp.Task, tmp_path: Path
) -> None:
    library = kernels._library()
    if library is None:
        pytest.skip("there is no C compiler")
    assert differs(problems(tmp_path, panda_pose), library, 100) < 1e-8


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_wrong_term_in_c_is_noticed(panda_pose: rp.Task, tmp_path: Path) -> None:
    if kernels._library() is None:
        pytest.skip("there is no C compiler")
    cases = problems(tmp_path, panda_pose)
    for name, (piece, instead) in C.items():
        text = source("leaf_margin_bounds.c", piece, instead)
        assert differs(cases, compiled(text, tmp_path), 60) > 1e-6, name
