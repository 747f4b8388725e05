"""Learn where people hold the elbow: levels c(x) fitted to demonstrations are one function F again.

Ten synthetic demonstrations move a Panda's hand along lines. Their elbow prefers a level c(x), and
wanders around it. c(x) is fitted to eight of them, and evaluated on the other two."""

from itertools import chain

import numpy as np
import pinocchio as pin

import repctl_pin as rp

SIDE, WANDER = 0.06, 0.03  # of the box, m, to either side; of the elbow, in levels


def features(p: np.ndarray) -> np.ndarray:
    """Evaluate 1, p and the products of p, a position in the box from −1 to 1."""
    return np.array([1.0, *p, *np.outer(p, p)[np.triu_indices(3)]])


def pose(start: pin.SE3, p: np.ndarray) -> pin.SE3:
    return pin.SE3(start.rotation, start.translation + SIDE * p)


def demonstrate(inverse: rp.RepeatableInverse, q: np.ndarray, rng: np.random.Generator) -> list:
    """Move the hand along three lines with a wandering elbow: (p, c, q) per sample."""
    start, c0, samples = inverse.task.placement(q), inverse.leaf(q), []
    corners, (phase, rate) = rng.uniform(-1, 1, (4, 3)), rng.uniform([0, 0.05], [6.3, 0.15])
    for k in range(60):
        p = corners[k // 20] + (k % 20) / 20 * (corners[k // 20 + 1] - corners[k // 20])
        c = c0 + 0.1 * p[0] - 0.06 * p[2] + 0.05 * p[1] ** 2 + WANDER * np.sin(rate * k + phase)
        q = inverse.solve(pose(start, p), q, leaf=c)
        samples.append((p, c, q))
    return samples


def main() -> None:
    """Fit c(x), and print how far elbows are from those of the demonstrations held out."""
    task, rng = rp.Robot.load("panda").task(), np.random.default_rng(0)
    q0, desired = task.reference, rp.Pseudoinverse(task)
    design = rp.nearest_repeatable(desired, rp.Polynomial(q0, 1, 0.5), rp.Box(q0, 0.5))
    inverse, start = design.inverse, task.placement(q0)
    demos = [demonstrate(inverse, q0, rng) for _ in range(10)]
    rows = list(chain(*demos[:8]))
    A, b = np.array([features(p) for p, _, _ in rows]), np.array([c for _, c, _ in rows])
    weights = np.linalg.lstsq(A, b, rcond=None)[0]
    for name, fixed in (("one level", True), ("c(x)", False)):
        off, gap = [], 0.0
        for p, _, q in chain(*demos[8:]):
            x, c = pose(start, p), inverse.leaf(q0) if fixed else features(p) @ weights
            own, again = (inverse.solve(x, begin, leaf=c) for begin in (q0, q))
            off.append(np.linalg.norm(inverse.elbow(own) - inverse.elbow(q)))
            gap = max(gap, float(np.abs(own - again).max()))
        mm = 1e3 * np.sqrt(np.mean(np.square(off)))
        print(f"{name}: elbow {mm:.1f} mm off (rms); from elsewhere, joints within {gap:.0e} rad")


if __name__ == "__main__":
    main()
