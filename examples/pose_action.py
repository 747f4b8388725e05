"""Let a policy command the pose of a hand, and its elbow: an action wrapper for gymnasium.

`PandaArm` is an environment in MuJoCo whose actions are joint positions, held by servos.
`PoseAction` wraps it: an action is a pose of the hand in a cell, and a level c, which moves the
elbow. The joints are q = F(x; c), a function without a memory: one action always means one
configuration. Differential inverse kinematics, which many simulators offer, drifts instead.

Requires gymnasium and MuJoCo: pip install gymnasium mujoco.

    python examples/pose_action.py
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from pushed_arm import physics

import repctl_pin as rp

SUBSTEPS, STEPS, CYCLES = 10, 100, 5
"""Steps of the simulation per action, actions per cycle, and cycles."""


class PandaArm(gym.Env[np.ndarray, np.ndarray]):
    """An arm with position servos; an action is the joints (n,) that they hold, rad."""

    def __init__(self, task: rp.Task, start: np.ndarray) -> None:
        self.model, self.start = physics(task, servos=True), start
        self.data = mujoco.MjData(self.model)
        self.action_space = gym.spaces.Box(task.lower, task.upper, dtype=np.float64)
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (2 * task.n,), np.float64)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict]:
        """Put the arm at the start, at rest."""
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self.start
        mujoco.mj_forward(self.model, self.data)
        return self.observed(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Hold the joints of the action for some steps of the simulation."""
        self.data.ctrl[:] = action
        mujoco.mj_step(self.model, self.data, SUBSTEPS)
        return self.observed(), 0.0, False, False, {}

    def observed(self) -> np.ndarray:
        """Return the joints and their speeds, (2n,)."""
        return np.concatenate([self.data.qpos, self.data.qvel])


class PoseAction(gym.ActionWrapper):
    """Actions (u, c) in [−1, 1]: u is a pose of the cell, c the level in units of ``elbow``, rad.

    The joints are F(x(u); elbow · c).
    """

    def __init__(self, env: gym.Env, F: rp.InverseFunction, elbow: float) -> None:
        super().__init__(env)
        self.F, self.elbow = F, elbow
        self.action_space = gym.spaces.Box(-1.0, 1.0, (F.cell.k + F.task.r,), np.float64)

    def action(self, action: np.ndarray) -> np.ndarray:
        """Convert an action to joints; those beyond ±1 are clipped."""
        u, c = np.split(np.clip(action, -1.0, 1.0), [self.F.cell.k])
        return self.F(self.F.cell.at(u), leaf=self.elbow * c)


def designed() -> rp.InverseFunction:
    """Find the function of a cell of a panda, ±5 cm and ±0.1 rad."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    cell = rp.Cell(task, task.placement(task.reference), 0.05, 0.1)
    few = rp.FitOptions(samples=128, held_out=128)
    return rp.nearest_inverse_function(rp.Pseudoinverse(task), cell, options=few).function


def cycle(F: rp.InverseFunction) -> np.ndarray:
    """Make a closed path of actions (STEPS, m + r), in which pose and elbow move."""
    s = 2 * np.pi * np.arange(1, STEPS + 1) / STEPS
    phases = np.arange(F.cell.k + F.task.r)
    return 0.5 * (np.sin(s[:, None] + phases) - np.sin(phases))


def main() -> dict[str, np.ndarray]:
    """Print how far the joints are from those after one cycle; return these distances, rad."""
    F = designed()
    task, actions = F.task, cycle(F)
    start = F(F.cell.at(np.zeros(F.cell.k)))
    env = PoseAction(PandaArm(task, start), F, elbow=0.3)
    ends: dict[str, list[np.ndarray]] = {"differential IK": [], "PoseAction": []}
    env.reset(seed=0)
    for _ in range(CYCLES):
        for action in actions:
            observed, *_ = env.step(action)
        ends["PoseAction"].append(observed[: task.n])
    env.reset(seed=0)
    q = start
    for _ in range(CYCLES):
        for action in actions:  # the same hand poses, from the last command by J⁺
            error = task.error(q, F.cell.at(action[: F.cell.k]))
            q = q + np.linalg.pinv(task.jacobian(q)) @ error
            observed, *_ = env.unwrapped.step(q)
        ends["differential IK"].append(observed[: task.n])
    print(f"‖q − q(end of cycle 1)‖ at the end of cycles 2 and {CYCLES}, rad:")
    found = {}
    for name, Q in ends.items():
        off = found[name] = np.linalg.norm(np.array(Q) - Q[0], axis=1)
        shown = (f"{off[k]:.2g}" if off[k] > 1e-4 else "< 1e-4" for k in (1, -1))
        print(f"  {name:15s}  {', '.join(shown)}")
    return found


if __name__ == "__main__":
    found = main()
