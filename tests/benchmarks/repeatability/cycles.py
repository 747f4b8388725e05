"""Go round, and measure what became of the joints."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from ours import Step
from scenes import Scene

import repctl_pin as rp


@dataclass(frozen=True)
class Row:
    """One program in one scene: a line of results.csv. Angles in rad, lengths in m; nan where it
    did not get so far."""

    arm: str
    path: str
    start: str
    lag_ms: float
    program: str
    drift_1: float
    drift_10: float
    drift_100: float
    last_cycle: float
    extra_speed: float
    jump: float
    tracking: float
    limit_margin: float
    body_distance: float
    microseconds: float
    of_pinv: float
    failure: str


MOST_SECONDS = 10.0
"""A program that takes longer is stopped after ten cycles, or at the end of a later one."""


def joints_of(step: Step, scene: Scene, cycles: int, share: float = 1.0) -> tuple[np.ndarray, str]:
    """Go round: the joints (T + 1, n), and why the program stopped, if it did.

    The joints go a share of the way to what is commanded, 1 where the servo does not lag, and the
    program is told where they are."""
    Q, q, k, steps = [scene.q0], scene.q0, 0, len(scene.targets)
    begin = time.process_time()
    try:
        for k in range(cycles * steps):
            if k >= 10 * steps and k % steps == 0 and time.process_time() - begin > MOST_SECONDS:
                break
            commanded = step(q, scene.targets[k % steps])
            q = commanded if share == 1.0 else q + share * (commanded - q)
            Q.append(q)
        stopped = ""
    except Exception as error:  # whatever a program raises: it did not get round
        text = " ".join(str(error).split())[:80]
        stopped = f"cycle {1 + k // steps}: {type(error).__name__}: {text}"
    return np.array(Q), stopped


def measure(
    scene: Scene, program: str, Q: np.ndarray, reference: np.ndarray, lag: float, stopped: str
) -> Row:
    """Judge the joints (T + 1, n) of a program, beside those of the pinv loop on the first
    cycle."""
    steps, task = len(scene.targets), scene.task
    ends = Q[steps::steps]
    drift = np.linalg.norm(ends - Q[0], axis=1)
    places = np.array([target.translation for target in scene.targets])
    wanted = np.tile(places, (-(-len(Q) // steps), 1))[: len(Q) - 1]
    looked = np.vstack([Q[: steps + 1 : 5], Q[-steps - 1 :: 5]])
    return Row(
        arm=scene.arm,
        path=scene.path,
        start=scene.start,
        lag_ms=lag,
        program=program,
        **{f"drift_{k}": float(drift[k - 1]) if len(drift) >= k else np.nan for k in (1, 10, 100)},
        last_cycle=float(np.linalg.norm(ends[-1] - Q[len(ends) * steps - steps]))
        if len(ends)
        else np.nan,
        extra_speed=_speed(Q, steps) / _speed(reference, steps) - 1 if len(Q) > steps else np.nan,
        jump=float(np.abs(np.diff(Q, axis=0)).max()) if len(Q) > 1 else np.nan,
        tracking=float(np.linalg.norm(task.positions(Q[1:]) - wanted, axis=1).max())
        if len(Q) > 1
        else np.nan,
        limit_margin=float(task.limit_margin(Q).min()),
        body_distance=float(rp.Bodies(task).distances(looked).min()),
        microseconds=np.nan,
        of_pinv=np.nan,
        failure=stopped,
    )


def _speed(Q: np.ndarray, steps: int) -> float:
    """Root mean square of the steps of the first cycle."""
    return float(np.sqrt(np.mean(np.sum(np.diff(Q[: steps + 1], axis=0) ** 2, axis=1))))


def microseconds(
    loops: dict[str, Step], scene: Scene, rounds: int = 50, burst: int = 20
) -> dict[str, float]:
    """Take the processor time of a step, µs: the loops take turns in short bursts, and the best
    burst counts. A loop that stops, or whose burst takes over 0.4 s, has no further one."""
    best = dict.fromkeys(loops, np.nan)
    where = dict.fromkeys(loops, (0, scene.q0))
    for _ in range(rounds):
        for name, (k, q) in list(where.items()):
            step = loops[name]
            targets = [scene.targets[(k + i) % len(scene.targets)] for i in range(burst)]
            begin = time.process_time()
            try:
                for target in targets:
                    q = step(q, target)
            except Exception:  # why is said by the row of its cycles
                del where[name]
                continue
            took = time.process_time() - begin
            best[name] = np.fmin(best[name], took / burst * 1e6)
            where[name] = (k + burst) % len(scene.targets), q
            if took > 0.4:
                del where[name]
    return best
