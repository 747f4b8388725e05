"""The length of lines whose lifts stay in their boxes: never longer than sampled rates allow, even
where the first guess of the rates is too low; a wrong term of lifts.py is noticed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arms import sliding_task, spatial_task
from inside import lifts
from mutants import wrong
from proofs import design_of, near_null_space, regular_start
from test_closing_radius import problem_of

import repctl_pin as rp

MUTANTS = {
    "bounds of undecided boxes not counted": (
        "np.maximum.at(rates, (self.place, self.within), bound)",
        "pass",
    ),
    "boxes not evaluated count as 0": (
        "self.bound = np.full(self.low.shape, np.inf)",
        "self.bound = np.zeros(self.low.shape)",
    ),
    "one joint decides a box": ("joined[3]]).all(axis=1)", "joined[3]]).any(axis=1)"),
    "boxes of a quarter": ("half = (high - low) / 2 *", "half = (high - low) / 4 *"),
    "one half of a box dropped": (
        "return low, high, self.place",
        "return low, (low + high) / 2, self.place",
    ),
    "half of the first box": ("-half.reshape(K * M, n)", "0 * half.reshape(K * M, n)"),
    "boxes of the wrong places": (
        "np.divmod(np.arange(K * M), M)",
        "np.divmod(np.arange(K * M), K)",
    ),
    "no extent of a place": (
        "half = self.widths + self.places.extent[:, None] * (1 + 1e-12)",
        "half = self.widths",
    ),
    "no rotation": (
        "self.rates[place, within], self.ratios",
        "self.rates[place, within], 0 * self.ratios",
    ),
    "the slowest joint": ("step = left.min(axis=1)", "step = left.max(axis=1)"),
    "joints that do not move": ("step[:, None] * finite", "0 * finite"),
    "the best place": ("worst = int(np.argmin(length))", "worst = int(np.argmax(length))"),
    "more than the clearance": (
        "((places.clearance - width) /",
        "((2 * places.clearance - width) /",
    ),
    "no widest angle": ("min(radius, _WIDEST / self.ratio)", "radius"),
    "rates of smaller boxes not kept": ("rates = np.maximum.accumulate(rates, axis=1)", "pass"),
}
"""What is wrong: a piece of lifts.py, and what is put in its place."""


def cases(folder: Path) -> list[tuple[rp.Design, float]]:
    """Designs, and radians per metre."""
    out = []
    for seed, task in enumerate(
        [sliding_task(folder), spatial_task(7, folder, kind="pose", seed=1)]
    ):
        q = regular_start(task, seed)
        field = near_null_space(task, q, 0.3, seed, rough=0.3, degree=2)
        out.append((design_of(task, field, rp.Box(q, 0.3)), 2.0 * seed))
    return out


def allowed(design: rp.Design, places: Any, widths: np.ndarray, ratio: float) -> np.ndarray:
    """Length that the largest sampled rates in the boxes allow at each place, (K,)."""
    rng, n = np.random.default_rng(1), design.task.n
    task, field, out = design.task, design.inverse.potentials, []
    for center, extent, wide in zip(places.center, places.extent, widths, strict=True):
        moved, most, length = np.zeros(n), np.zeros(n), 0.0
        for w in wide:
            U = rng.uniform(-1, 1, (400, n))
            U[::2] = np.sign(U[::2])
            Q = center + U * (w + extent)
            V = np.swapaxes(field.gradients(Q), 1, 2)
            G = np.linalg.inv(np.concatenate([task.jacobians(Q), V], axis=1))
            G = G[:, :, : task.m]
            k = 3 if ratio else task.m
            rate = np.linalg.norm(G[:, :, :k], axis=2)
            rate += ratio * np.linalg.norm(G[:, :, k:], axis=2)
            most = np.maximum(most, rate.max(axis=0))
            step = ((w - moved) / most).min()
            moved, length = moved + step * most, length + step
        out.append(length)
    return np.array(out)


def covers(search: Any, places: Any) -> bool:
    """Test whether every S_k is covered by boxes of S_1 to S_k, and boxes by their halves."""
    rng = np.random.default_rng(2)
    for place, extent in enumerate(places.extent):
        for k, w in enumerate(search.widths[place]):
            own = (search.place == place) & (search.within <= k)
            X = rng.uniform(-1, 1, (200, 1, len(w))) * (w + extent)
            held = (search.low[own] <= X) & (search.high[own] >= X)
            if not held.all(axis=2).any(axis=1).all():
                return False
    search.split[:] = 0
    low, high, *_ = search._halved(np.arange(len(search.low)))
    whole = np.prod(search.high - search.low, axis=1).sum()
    search.split[:] = -1
    return bool(abs(np.prod(high - low, axis=1).sum() / whole - 1) < 1e-9)


def is_sound(module: Any, given: list[tuple[rp.Design, float]]) -> bool:
    """Test whether the search bounds the length, for guesses of the rates that are too low."""
    module._SLACK, module._SAMPLES = (-0.3, -0.3), 1
    for design, ratio in given:
        problem = problem_of(design)
        n, q = design.task.n, design.region.center
        places = module.Places(
            q + np.array([[0.0], [0.05]]),
            np.full((2, n), 0.01),
            np.array([[0.1], [0.02]]) * np.linspace(0.5, 1, n),
        )
        args = problem, design.task, design.inverse.potentials, places, ratio, None
        module._WIDEST = 3.1
        search = module._Search(*args)
        most = allowed(design, places, search.widths, ratio)
        if (search.widths > places.clearance[:, None] * (1 + 1e-9)).any():
            return False
        if not covers(search, places):
            return False
        for _ in range(12):
            found = search.reach()
            if not 0 <= found.radius <= most.min():
                return False
            if not len(search.low):
                break
            search.advance()
        module._WIDEST = 1e-3
        if ratio and not search.reach().radius * ratio <= 1e-3:
            return False
        search.place, search.within = search.place[:0], search.within[:0]
        search.bound = search.bound[:0]
        search.rates[:, 0] = 100 * search.rates.max(axis=1)
        if search.reach().radius > (search.widths[:, -1] / search.rates[:, 0]).min():
            return False
    return True


@pytest.mark.slow
def test_lengths_of_rates_guessed_too_low(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert is_sound(wrong(monkeypatch, "lifts.py", "", ""), cases(tmp_path))


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTANTS)
def test_a_wrong_term_of_a_lift_is_noticed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = wrong(monkeypatch, "lifts.py", *MUTANTS[name])
    assert not is_sound(module, cases(tmp_path))


def test_boxes_that_suffice_are_evaluated_whole(tmp_path: Path) -> None:
    """Near the start, where rates hardly change, one evaluation decides each S_k."""
    (design, ratio), *_ = cases(tmp_path)
    n, q = design.task.n, design.region.center
    places = lifts.Places(q + np.array([[0.0], [0.05]]), np.zeros((2, n)), np.full((2, n), 1e-3))
    task, potentials = design.task, design.inverse.potentials
    args = problem_of(design), task, potentials, places, ratio, None
    found = lifts.bound_reach(*args, 60, np.inf)
    assert found.complete and found.radius > 0
    assert found.boxes == lifts._Search(*args).widths[..., 0].size
