"""The same circle, the same control, another start: one breaks a joint limit, the other keeps well
inside.

Under a repeatable control every start has its leaf h(q) = c, and the joint path of all cycles is
known after the first. So the choice that redundancy leaves at the start can be made once, with the
whole cycle in view: `rp.best_leaf` walks along the self-motion of the start, follows one cycle from
each point, and keeps the one with the most room to joint limits, between bodies, and to algorithmic
singularities.

tiago's reference pose holds its torso half-way up its short lift. On a circle of 5 cm the torso
leaves the lift; from the start that is found it does not. (The collision shapes of its column and
first arm link overlap by a centimetre from every start tried, which is said too.) So with a panda
that begins with its elbow far out.

    python examples/best_leaf.py
"""

from __future__ import annotations

import numpy as np

import repctl_pin as rp


def design_round(task: rp.Task, center: np.ndarray, half_width: float) -> rp.Design:
    """Find the quadratic design round a configuration."""
    potentials = rp.Polynomial(center, 2, half_width)
    return rp.nearest_repeatable(rp.Pseudoinverse(task), potentials, rp.Box(center, half_width))


def tiago() -> tuple[rp.BestLeaf, rp.RepeatableInverse, rp.TaskPath]:
    """The torso lift of tiago, 8 joints, r = 2."""
    task = rp.Robot.load("tiago").task("wrist_ft_tool_link", "pose")
    q0 = task.reference
    inverse = design_round(task, q0, 0.08).inverse
    path = rp.circle(task, q0, 0.05, normal="xy", start_angle=np.pi)
    return rp.best_leaf(inverse, path, q0), inverse, path


def panda() -> tuple[rp.BestLeaf, rp.RepeatableInverse, rp.TaskPath]:
    """A panda that somebody left with its elbow 2.5 rad along the self-motion."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    center = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
    inverse = design_round(task, center, 0.4).inverse
    path = rp.circle(task, center, 0.15, normal="yz", start_angle=np.pi / 2)
    q, along = center, None
    for _ in range(25):
        N = rp.redundancy.nullspace(task.jacobian(q))
        along = N if along is None else rp.redundancy.align(N, along)
        q = rp.solve_ik(task, q + 0.1 * along[:, 0], path.placement(0.0))
    return rp.best_leaf(inverse, path, q), inverse, path


def main() -> None:
    """Print both, and make sure of them with ten whole cycles."""
    for name, (found, inverse, path) in {"tiago": tiago(), "panda": panda()}.items():
        print(f"{name}: {found.summary()}")
        motion = rp.follow(inverse, path, found.q0, cycles=10, integrator=rp.LeafLock(2))
        kept = (
            "no joint leaves its limits"
            if motion.first_violation is None
            else f"{motion.first_violation[1]} leaves"
        )
        print(
            f"  ten cycles   {kept}, margin {motion.limit_margin.min():.3g}, drift {motion.drift.max():.1e}\n"
        )


if __name__ == "__main__":
    main()
