"""The largest sector of an arm, and what it is made of: floods, rectangles, cuts of sides."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arms import planar_task
from commands import refused
from numpy.typing import NDArray

import repctl_pin as rp
from repctl_pin.extensions.cells.geometry.cut import cut_sides
from repctl_pin.extensions.cells.table.flood import rectangles

FEW = rp.FitOptions(samples=128, held_out=256)


def largest_by_hand(mask: NDArray[np.bool_]) -> int:
    """Area of the largest rectangle of a mask, by comparison of all rectangles."""
    rows, columns = mask.shape
    return max(
        (
            (b - a) * (d - c)
            for a in range(rows)
            for b in range(a, rows)
            for c in range(columns)
            for d in range(c, columns)
            if mask[a : b + 1, c : d + 1].all()
        ),
        default=0,
    )


def test_the_largest_rectangle_is_that_of_all_rectangles() -> None:
    rng = np.random.default_rng(0)
    masks = rng.random((20, 6, 7)) < 0.8
    found = rectangles(masks)
    for mask, area, first, last in zip(masks, *found, strict=True):
        assert area == largest_by_hand(mask)
        assert mask[first[0] : last[0] + 1, first[1] : last[1] + 1].all()


@pytest.mark.parametrize("k", [1, 2, 4])
def test_a_cut_leaves_no_bad_pose_and_keeps_what_is_far_from_them(k: int) -> None:
    U = np.random.default_rng(k).uniform(-1, 1, (500, k))
    bad = U[:, 0] > 0.6
    low, high = cut_sides(U, bad)
    assert not (bad & ((U >= low) & (U <= high)).all(axis=1)).any()
    assert (low == -1).all() and (high[1:] == 1).all() and 0.5 < high[0] < 0.7


def test_shrink_moves_the_side_that_is_out_of_reach(tmp_path: Path) -> None:
    """Closed form: the arm reaches 1.2 m; only the far side of the box moves, not the near one."""
    task = planar_task([0.5, 0.4, 0.3], tmp_path)
    cell = rp.Cell(task, np.array([0.95, 0.0, 0.0]), (0.3, 0.1))
    found = rp.nearest_inverse_function(
        rp.Pseudoinverse(task), cell, incomplete="shrink", degree=2, options=FEW
    )
    p, w = found.cell.placement.translation, found.cell.half_width
    assert p[0] - w[0] == pytest.approx(0.65, abs=0.05)  # the near side stands
    assert np.hypot(p[0] + w[0], w[1]) < 1.2
    assert found.evaluation.everywhere


@pytest.mark.slow
def test_the_whole_table_of_a_panda_holds_at_random_poses(panda_pose: rp.Task) -> None:
    """No numbers: at 2,000 random poses one configuration, inside the limits, free of collisions;
    and no locked joint covers more."""
    place = rp.best_cell(panda_pose, orientation="down")
    assert place.table is not None
    found, F = place.table.design, place.table.design.function
    assert place.table.area > 0.85 * place.table.rectangle > 0.2
    assert found.extra_speed < 0.05 and found.extra_speed_worst < 0.31
    assert place.table.locked is not None and place.table.locked.share <= 1
    U = np.random.default_rng(1).uniform(-1, 1, (2000, F.cell.k))
    Q = F.batch(U)
    assert panda_pose.limit_margin(Q).min() >= -1e-9
    assert rp.Bodies(panda_pose).distances(Q).min() > 0
    for u, q in zip(U[:200], Q, strict=False):
        assert np.abs(panda_pose.error(q, F.cell.at(u))).max() < 1e-9
        assert F.cell.at(u).rotation[2, 2] == pytest.approx(-1)


def test_what_cannot_be_is_refused(capsys: pytest.CaptureFixture[str], panda: rp.Robot) -> None:
    with pytest.raises(rp.InputError, match="leaves the rotation free"):
        rp.best_cell(panda.task(None, "position"))
    with pytest.raises(rp.InputError, match="must rise"):
        rp.best_cell(panda.task(), orientation="down", heights=(1, 0))
    with pytest.raises(rp.InputError, match="at requires size"):
        rp.best_cell(panda.task(), orientation="down", at=(0, 0, 0))
    for options, why in (
        ("--down --degree 3", "--down with --degree requires --size"),
        ("--heights 0,1", "--heights requires --down, --forward or --rpy"),
        ("--down --size 0.1 --heights 0,1", "--heights and --size are mutually exclusive"),
    ):
        assert why in refused(capsys, "cell", "panda", *options.split())
