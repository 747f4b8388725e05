"""Control torques on the leaf while a push displaces the elbow.

There are no servos: `rp.LeafImpedance` has a spring for the end effector, and one for the leaf that
does not move the end effector. A push of 20 N for 0.5 s displaces the elbow; the elbow returns, and
the end effector hardly moves. Requires MuJoCo: pip install mujoco.

    python examples/torques.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pushed_arm import DT, PushedArm, designed, page

import repctl_pin as rp
from repctl_pin.base.files import prepare_folder, write_whole
from repctl_pin.show.palette import COLOURS

FORCE, SECONDS = 20.0, 0.5
"""Force and duration of the push, N and s."""


def held_by_torques(design: rp.Design, q0: np.ndarray) -> np.ndarray:
    """Hold the end effector by torques while the elbow is pushed; return q after every step
    (T + 1, n)."""
    task, inverse = design.task, design.inverse
    arm = PushedArm(task, q0, servos=False)
    torques = rp.LeafImpedance(inverse, stiffness=(2000.0, 100.0), leaf_frequency=5.0)
    target, leaf, q, visited = task.placement(q0), inverse.leaf(q0), q0, [q0]
    for k in range(round(3.0 / DT)):
        torque = torques.torque(q, arm.data.qvel, target, leaf=leaf)
        q = arm.step(torque, FORCE if k * DT < SECONDS else 0.0)
        visited.append(q)
    return np.array(visited)


def main() -> dict[str, np.ndarray]:
    """Print the displacements; return those of the joints, rad, and of the end effector, m."""
    design = designed()
    task = design.task
    held = held_by_torques(design, np.array(task.reference))
    joints, hand = (np.linalg.norm(x - x[0], axis=1) for x in (held, task.positions(held)))
    later = joints[round(2.5 / DT)]
    print(
        f"torques on the leaf; a push of {FORCE:g} N for {SECONDS:g} s\n"
        f"  largest displacement: joints {joints.max():.2f} rad, "
        f"end effector {1000 * hand.max():.1f} mm\n"
        f"  joints 2 s after the push: {later:.0e} rad"
    )
    # For comparison, the page begins with a cycle without a push.
    unpushed = np.repeat(held[:1], len(held) - 1, axis=0)
    moved = {"torques on the leaf": np.vstack([unpushed, held])}
    html = page(task, moved, [COLOURS["repeatable"]], 2, "a push at the elbow")
    print(f"wrote {write_whole(prepare_folder(Path('repctl-out')) / 'torques.html', html)}")
    return {"joints": joints, "hand": hand}


if __name__ == "__main__":
    found = main()
