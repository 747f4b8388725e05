"""Proofs of a task of several frames: a waist and two arms, and a frame relative to the other."""

from __future__ import annotations

from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from controls import some
from kernels import expanded, expansion, kernels
from mutants import EXPANSION
from proofs import design_of, margins, near_null_space, smallest_singular_values
from test_closing_radius import problem_of
from test_proof import planted

import repctl_pin as rp

Q0 = np.array([0.1, 0.5, 0.7, 0.6, -0.5, -0.7, -0.6])


def tree(folder: Path, axis: str = "0 0 1") -> rp.Robot:
    """A waist and two arms of three joints; the second joints of the arms turn about `axis`."""
    rows = ['<link name="base"/>']

    def joint(name: str, parent: str, x: float, y: float, axis: str = "0 0 1") -> None:
        rows.append(
            f'<link name="{name}"/><joint name="j_{name}" type="revolute">'
            f'<parent link="{parent}"/><child link="{name}"/><axis xyz="{axis}"/>'
            f'<origin xyz="{x} {y} 0"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )

    joint("waist", "base", 0.0, 0.0)
    for side, y in (("left", 0.3), ("right", -0.3)):
        joint(f"{side}0", "waist", 0.4, y)
        joint(f"{side}1", f"{side}0", 0.5, 0.0, axis)
        joint(f"{side}2", f"{side}1", 0.4, 0.0)
        rows.append(
            f'<link name="{side}"/><joint name="t_{side}" type="fixed">'
            f'<parent link="{side}2"/><child link="{side}"/><origin xyz="0.3 0 0"/></joint>'
        )
    path = folder / "tree.urdf"
    path.write_text(f'<?xml version="1.0"?><robot name="tree">{"".join(rows)}</robot>')
    return rp.Robot.load(path)


def tasks(folder: Path) -> list[rp.Task]:
    """Both hands; in space, of two kinds; and a hand relative to the other."""
    flat, bent = tree(folder), tree(folder, "0 0.8 0.6")
    return [
        bent.task([("left", "position"), ("right", "xy")]),
        flat.task(["left", "right"], "xy"),
        flat.task([("left", "xy"), ("right", "xy", "left")]),
    ]


def design_over(task: rp.Task, width: float, seed: int = 1) -> rp.Design:
    field = near_null_space(task, Q0, width, seed, rough=0.1)
    return design_of(task, field, rp.Box(Q0, width))


def test_every_box_s_bounds_hold_at_its_corners_and_inside(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    for task in tasks(tmp_path):
        design = design_over(task, 0.1)
        problem = problem_of(design)
        for width in (1e-9, 0.002, 0.02):
            Q = Q0 + rng.uniform(-0.05, 0.05, (12, 7))
            half = width * rng.uniform(0.2, 1.0, Q.shape)
            found = problem.bounds(Q, half)
            way = rng.uniform(-1, 1, (24, *Q.shape))
            points = Q + half * np.where(np.arange(24)[:, None, None] % 2, way, np.sign(way))
            true = margins(design, points.reshape(-1, 7)).reshape(24, -1).min(axis=0)
            sigma = smallest_singular_values(task, points.reshape(-1, 7))
            assert (found.leaf_margin <= true + 1e-9).all()
            assert (found.sigma_min <= sigma.reshape(24, -1).min(axis=0) + 1e-9).all()
            if width < 0.02:
                assert (found.leaf_margin > 0.8 * true - 1e-6).all()


@pytest.mark.slow
@pytest.mark.parametrize("k", some(range(3), 2))
def test_whole_boxes_are_proved_and_samples_do_not_contradict(k: int, tmp_path: Path) -> None:
    task = tasks(tmp_path)[k]
    design = design_over(task, 0.02)
    corners = Q0 + 0.02 * np.array(list(product((-1.0, 1.0), repeat=7)))
    Q = np.concatenate([design.region.random(2000, 3), corners])
    least = margins(design, Q).min()
    proof = rp.prove(design, margin=0.8 * least, closes=False)
    assert proof and 0.8 * least <= proof.leaf_margin < least, proof.reason
    assert 0 < proof.sigma_min < smallest_singular_values(task, Q).min()


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed", [pytest.param(k, marks=[pytest.mark.slow] if k else []) for k in range(6)]
)
def test_no_planted_singularity_is_proved_away(seed: int, tmp_path: Path) -> None:
    task, rng = tasks(tmp_path)[1 + seed % 2], np.random.default_rng(seed)
    at = Q0 + 0.1 * rng.uniform(-0.9, 0.9, 7)
    design = planted(task, at, Q0, 0.1, seed)
    assert margins(design, at[None])[0] < 1e-9
    for goal in (None, 0.0):
        proof = rp.prove(design, margin=goal, seconds=0.2, closes=False)
        assert not proof and proof.leaf_margin == 0


def off(problem: Any, library: object) -> float:
    """The largest relative difference of C's expansion of J_V from NumPy's."""
    h = np.full(7, 0.02)
    ours, theirs = (expanded(library, problem, Q0, h), expansion(kernels(), problem, Q0, h))
    return max(
        float(np.abs(ours[name] - theirs[name]).max() / np.abs(theirs[name]).max())
        for name in ("A", "R", "B")
    )


def test_frames_stand_one_below_the_other(tmp_path: Path) -> None:
    for task in tasks(tmp_path):
        assert off(problem_of(design_over(task, 0.1)), kernels()) < 1e-11


FRAMES = {
    "one frame's rows": ("columns(chain, theta, 6 * f,", "columns(chain, theta, 0 * f,"),
    "one frame's remainders": ("const double *x = A[i] + 6 * f;", "const double *x = A[i];"),
    "the first frame only": (
        "const Chain *chain = g->frame + f;",
        "const Chain *chain = g->frame;",
    ),
    "no linear rest": EXPANSION["no linear rest"],
}
"""What is wrong with several frames: a piece of leaf_margin_bounds.c, and what is put instead."""


@pytest.mark.slow
@pytest.mark.parametrize("mutant", some(FRAMES, "one frame's rows"))
def test_wrong_rows_are_noticed(mutant: str, tmp_path: Path) -> None:
    problem = problem_of(design_over(tasks(tmp_path)[1], 0.1))
    library = kernels("leaf_margin_bounds.c", *FRAMES[mutant])
    with suppress(np.linalg.LinAlgError):  # J_V has no inverse: noticed
        assert off(problem, library) > 1e-9
