"""Find the best start for a circle: from one start a joint limit is violated, from another start
the same controller respects all limits.

Under a repeatable controller every start has its leaf h(q) = c, and the joint path of all cycles is
known after the first. So the start can be chosen once, for the whole motion: `rp.best_leaf` moves
along the self-motion of the start, follows one cycle from each point, and keeps the point with the
largest margins (joint limits, body distance, leaf margin).

The reference configuration of tiago holds the torso in the middle of its short lift. On a circle of
5 cm, the torso exceeds the limits of the lift; from the best start it does not. (The collision
shapes of the column and the first arm link overlap by a centimetre from every start tried; the
output names them.) The second example is a panda that starts with its elbow displaced.

    python examples/best_leaf.py
"""

from __future__ import annotations

import numpy as np

import repctl_pin as rp


def design_around(task: rp.Task, center: np.ndarray, half_width: float) -> rp.Design:
    """Find the quadratic design around a configuration."""
    potentials = rp.Polynomial(center, 2, half_width)
    return rp.nearest_repeatable(rp.Pseudoinverse(task), potentials, rp.Box(center, half_width))


def tiago() -> tuple[rp.BestLeaf, rp.RepeatableInverse, rp.TaskPath]:
    """Search the leaves of tiago, whose torso lift is short: 8 joints, r = 2."""
    task = rp.Robot.load("tiago").task("wrist_ft_tool_link", "pose")
    q0 = task.reference
    inverse = design_around(task, q0, 0.08).inverse
    path = rp.circle(task, q0, 0.05, normal="xy", start_angle=np.pi)
    return rp.best_leaf(inverse, path, q0), inverse, path


def panda() -> tuple[rp.BestLeaf, rp.RepeatableInverse, rp.TaskPath]:
    """Search the leaves of a panda that starts with its elbow 2.5 rad along the self-motion."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    center = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
    inverse = design_around(task, center, 0.4).inverse
    path = rp.circle(task, center, 0.15, normal="yz", start_angle=np.pi / 2)
    q, along = center, None
    for _ in range(25):
        N = rp.redundancy.nullspace(task.jacobian(q))
        along = N if along is None else rp.redundancy.align(N, along)
        q = rp.solve_ik(task, q + 0.1 * along[:, 0], path.placement(0.0))
    return rp.best_leaf(inverse, path, q), inverse, path


def main() -> None:
    """Print the best start of both, and check it over ten cycles."""
    for name, (found, inverse, path) in {"tiago": tiago(), "panda": panda()}.items():
        print(f"{name}: {found.summary()}")
        motion = rp.follow(inverse, path, found.q0, cycles=10, integrator=rp.LeafLock(2))
        violation = motion.first_violation
        respected = "joint limits respected"
        limits = respected if violation is None else f"{violation[1]} exceeds a limit"
        margin = f"margin {motion.limit_margin.min():.3g}"
        print(f"  ten cycles   {limits}, {margin}, drift {motion.drift.max():.1e}\n")


if __name__ == "__main__":
    main()
