"""Synthetic logs of a planar arm with known truth: the hand repeats a path, the elbow may not.

The arm has three unit links. Its joints follow in closed form from the hand position and from the
angle of the last link, which is a smooth function of the hand position plus a level c. The level
alone decides whether the arm repeats.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Level = Callable[[np.ndarray, int, np.random.Generator], np.ndarray]


def steady(s: np.ndarray, cycles: int, rng: np.random.Generator) -> np.ndarray:
    """Drift at one rate; s counts the cycles."""
    return s / cycles


def onset(s: np.ndarray, cycles: int, rng: np.random.Generator) -> np.ndarray:
    """Drift that begins after half to three quarters of the log."""
    begin = rng.uniform(0.5, 0.75) * cycles
    return np.maximum(s - begin, 0) / (cycles - begin)


def saw_tooth(s: np.ndarray, cycles: int, rng: np.random.Generator) -> np.ndarray:
    """Drift that is reset every few cycles."""
    teeth = int(rng.integers(3, max(4, cycles // 2 + 1)))
    return _steps(s, np.arange(cycles + 2) % teeth / (teeth - 1), rng)


def two(s: np.ndarray, cycles: int, rng: np.random.Generator) -> np.ndarray:
    """Two configurations, in turn or in random order."""
    order = np.arange(cycles + 2) % 2
    return _steps(s, order if rng.random() < 0.5 else rng.permutation(order), rng)


def three(s: np.ndarray, cycles: int, rng: np.random.Generator) -> np.ndarray:
    """Three configurations in turn, or another one at every third visit."""
    order = np.arange(cycles + 2) % 3
    return _steps(s, order / 2 if rng.random() < 0.5 else order // 2, rng)


def same(s: np.ndarray, cycles: int, rng: np.random.Generator) -> np.ndarray:
    """No change: the arm repeats."""
    return np.zeros_like(s)


def scattered(s: np.ndarray, cycles: int, rng: np.random.Generator) -> np.ndarray:
    """Another configuration in every cycle, without a trend."""
    return _steps(s, rng.uniform(0, 1, cycles + 2), rng)


def _steps(s: np.ndarray, levels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Hold one level per cycle, with a fast smooth change between two cycles at a random phase."""
    s = s + rng.random()
    whole = np.floor(s).astype(int)
    share = np.clip((s - whole) / 0.04, 0, 1)
    blend = share**2 * (3 - 2 * share)
    before = levels[np.maximum(whole - 1, 0)]
    return before + blend * (levels[whole] - before)


def synthetic_log(
    level: Level,
    seed: int,
    *,
    cycles: int | None = None,
    noise: float | None = None,
    size: float | None = None,
    gaps: bool = False,
    rests: bool | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Make times (T,), s, and joints (T, 3), rad, of the planar arm.

    Parameters
    ----------
    level
        Function of the number of cycles s (T,) that gives the level, between 0 and 1.
    seed
        Random seed of the path, the rate, the noise and all that is not given.
    cycles
        Number of cycles, 6 to 30 by default.
    noise
        Standard deviation of the joints, rad.
    size
        Difference of the last link's angle between the levels 0 and 1, rad.
    gaps
        Leave out four parts of the log.
    rests
        Let the hand rest at one pose of every cycle.
    """
    rng = np.random.default_rng(seed)
    cycles = int(rng.integers(6, 17)) if cycles is None else cycles
    noise = float(rng.choice([0, 1e-5, 1e-4, 1e-3])) if noise is None else noise
    size = (
        float(np.exp(rng.uniform(np.log(max(40 * noise, 2e-3)), np.log(0.3))))
        if size is None
        else size
    )
    rests = bool(rng.random() < 0.5) if rests is None else rests
    rate, period = rng.uniform(30, 50), rng.uniform(2, 5)
    t = np.arange(0, cycles * period + 0.3, 1 / rate)
    if gaps:
        for start in rng.uniform(0, t[-1], 4):
            t = t[(t < start) | (t > start + rng.uniform(0.1, 0.6) * period)]
    s = t / period
    if rests:  # the last third of a cycle
        s = np.floor(s) + np.minimum((s - np.floor(s)) * 1.5, 1.0)
    x = np.array([0.06, 1.69]) + _wave(s, rng, 2, 0.12)
    away = x - x[0]
    angle = 2.5 + away @ rng.uniform(-0.8, 0.8, 2) + 3 * away[:, 0] * away[:, 1]
    angle = angle + rng.choice([-1, 1]) * size * level(t / period, cycles, rng)
    wrist = x - np.stack([np.cos(angle), np.sin(angle)], axis=1)
    second = np.arccos((np.sum(wrist**2, axis=1) - 2) / 2)
    first = np.arctan2(wrist[:, 1], wrist[:, 0]) - second / 2
    q = np.stack([first, second, angle - first - second], axis=1)
    assert np.isfinite(q).all()
    return t, q + noise * rng.standard_normal(q.shape)


def _wave(s: np.ndarray, rng: np.random.Generator, k: int, size: float) -> np.ndarray:
    """Closed random path of k coordinates, at most ``size`` each: three harmonics of the phase."""
    a = rng.normal(size=(2, 3, k)) / np.arange(1, 4)[:, None]
    a *= size / np.abs(a).sum(axis=(0, 1))
    turns = 2 * np.pi * s[:, None] * np.arange(1, 4)
    return np.sin(turns) @ a[0] + (np.cos(turns) - 1) @ a[1]
