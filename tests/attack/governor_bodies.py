"""Ticks of a governor that keeps a body distance, on arms and two hands, with a table and a post.

Run: python tests/attack/governor_bodies.py [ticks per arm] [arm ...]

Random targets and twists, many of them beyond the table and the post, reversals, jumps and garbage.
Every 50 ticks coal measures the full meshes of every checked pair, apart from the guard. Whenever a
body has stopped the arm for 0.4 s, it is asked to go away: it counts as stuck if none of 20 targets
within 0.15 m moves a frame by 5 mm. Times are processor times of a tick."""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

import repctl_pin as rp

sys.path.insert(0, str(Path(__file__).parents[1]))

from controls import control

DT, EVERY, DISTANCE = 1e-3, 50, 0.02

WORKCELL = """<robot name="workcell"><link name="room"/>
<link name="table"><collision><geometry><box size="2 2 0.02"/></geometry></collision></link>
<joint name="a" type="fixed"><parent link="room"/><child link="table"/>
<origin xyz="0 0 {table}"/></joint>
<link name="post"><collision><geometry><cylinder radius="0.03" length="1.2"/></geometry></collision>
</link><joint name="b" type="fixed"><parent link="room"/><child link="post"/>
<origin xyz="{x} {y} 0.5"/></joint></robot>"""

ARMS = {
    "panda": ("panda_hand_tcp", -0.07, 0.55, 0.3),
    "xarm7": (None, -0.07, 0.5, 0.3),
    "baxter": ("left_gripper", -0.2, 0.7, 0.6),
    "baxter, both hands": (("left_gripper", "right_gripper"), -0.2, 0.8, 0.0),
}
"""Frame or frames, height of the table, position of the post."""

Places = tuple[pin.SE3, ...]
"""Placement of each frame."""


class FullMeshes:
    """Distances of the exact shapes of all checked pairs, by coal alone."""

    def __init__(self, bodies: rp.Bodies) -> None:
        self.model, drive = bodies.task.bodies_model()
        self.joints = drive.joints
        self.data, found = self.model.createData(), bodies._model
        self.shapes = [body.exact for body in found._bodies]
        self.joint, self.place = found._joint, found._place
        self.pairs, self.contact = found.pairs.tolist(), found._only_contact

    def __call__(self, q: np.ndarray) -> tuple[float, float]:
        """Measure the minimum distance, and that of pairs checked for collisions only."""
        pin.forwardKinematics(self.model, self.data, self.joints(q))
        at = [self.data.oMi[j] * p for j, p in zip(self.joint, self.place, strict=True)]
        at = [coal.Transform3s(place.rotation, place.translation) for place in at]
        least, contact = np.inf, np.inf
        for (a, b), only in zip(self.pairs, self.contact, strict=True):
            one, other = self.shapes[a], self.shapes[b]
            apart = np.linalg.norm(
                at[a].transform(one.aabb_center) - at[b].transform(other.aabb_center)
            )
            if apart - one.aabb_radius - other.aabb_radius > 0.1:
                continue
            result = coal.DistanceResult()
            d = coal.distance(one, at[a], other, at[b], coal.DistanceRequest(), result)
            if only:
                contact = min(contact, d)
            else:
                least = min(least, d)
        return least, contact


def start_of(task: rp.Task, bodies: rp.Bodies) -> np.ndarray:
    """Choose the least singular of some configurations with room."""
    middle = (task.lower + task.upper) / 2
    half = np.minimum((task.upper - task.lower) / 2, np.pi)
    Q = middle + 0.6 * half * np.random.default_rng(7).uniform(-1, 1, (256, task.n))
    Q = np.vstack([task.reference, Q])
    Q = Q[bodies.distances(Q) > 0.06]
    return Q[int(np.argmax(np.linalg.svd(task.jacobians(Q), compute_uv=False)[:, -1]))]


def near(places: Places, size: float, rng: np.random.Generator) -> Places:
    """Displace and turn placements at random."""
    return tuple(
        pin.SE3(
            pin.exp3(0.4 * rng.normal(size=3)) @ place.rotation,
            place.translation + size * rng.normal(size=3),
        )
        for place in places
    )


def run(name: str, ticks: int, seed: int, folder: Path) -> dict[str, object]:
    """Drive one arm; what was measured."""
    frame, table, x, y = ARMS[name]
    around = folder / "workcell.urdf"
    around.write_text(WORKCELL.format(table=table, x=x, y=y), encoding="utf-8")
    robot = rp.Robot.load(name.partition(",")[0], surroundings=around)
    several = isinstance(frame, tuple)
    task = robot.task([(one, "pose") for one in frame]) if several else robot.task(frame, "pose")
    bodies, rng = rp.Bodies(task), np.random.default_rng(seed)
    q0, full = start_of(task, bodies), FullMeshes(bodies)
    inverse = control(task, q0, rp.Polynomial(q0, 2, 0.5))
    governor = rp.Governor(
        inverse, DT, rp.Limits(acceleration=8.0, jerk=2000.0),
        margin=0.02, bodies=bodies, body_distance=DISTANCE,
    )  # fmt: skip
    governor.start(q0)
    home, said, times = task.placements(q0), Counter(), []
    least, contact, checks, stops, asked, stuck, blocked, done = (np.inf, np.inf, *6 * [0])
    Q = [q0] * 4
    worst, limits = np.zeros(3), (task.velocity_limit, 8.0, 2000.0)

    def tick(target: Places | None, twist: np.ndarray | None) -> rp.Status:
        nonlocal least, contact, checks, done
        given = target if target is None or several else target[0]
        began = time.thread_time()
        q, status = governor.step(given, twist)
        times.append(time.thread_time() - began)
        done += 1
        said[status.name] += 1
        Q.append(q)
        del Q[0]
        for k, most in enumerate(limits, 1):
            share = np.abs(np.diff(Q, k, axis=0)[-1]) / DT**k / most
            worst[k - 1] = max(worst[k - 1], share.max())
        if done % EVERY == 0:
            measured = full(q)
            least, contact = min(least, measured[0]), min(contact, measured[1])
            checks += 1
        return status

    def leaves() -> bool:
        here = task.placements(Q[-1])
        for _ in range(20):
            away = near(here, 0.1, rng)
            for _ in range(400):
                tick(away, None)
            there = zip(task.placements(Q[-1]), here, strict=True)
            if max(np.linalg.norm(x.translation - y.translation) for x, y in there) > 5e-3:
                return True
        return False

    size = (len(home), 6) if several else 6
    while done < ticks:
        target, twist = None, None
        kind = rng.random()
        if kind < 0.6:
            target = near(home, rng.choice([0.05, 0.3, 0.5]), rng)
        elif kind < 0.65:
            target = home
        elif kind < 0.95:
            twist = rng.normal(size=size) * rng.choice([0.1, 1.0, 10.0])
        else:
            twist = np.full(size, rng.choice([np.nan, 1e200]))
        before = blocked
        for _ in range(int(rng.choice([3, 20, 100, 400, 1500]))):
            status = tick(target, twist)
            blocked = blocked + 1 if status is rp.Status.BODIES else 0
            stops += blocked == 1 and before == 0
            before = blocked
            if blocked >= 400:
                asked += 1
                stuck += not leaves()
                blocked = 0
                break
    spent = 1e6 * np.array(times)
    return {
        "ticks": done, "checks": checks, "least mm": 1e3 * least, "contact mm": 1e3 * contact,
        "stops": int(stops), "asked to leave": asked, "stuck": stuck, "pairs": len(full.pairs),
        "mean us": spent.mean(),
        "over 1 ms %": 100 * (spent > 1e3).mean(), "per mille us": np.percentile(spent, 99.9),
        "worst us": spent.max(), "limits": worst.max(), **said,
    }  # fmt: skip


def main() -> None:
    """Print one line per arm."""
    ticks = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
    for name in sys.argv[2:] or ARMS:
        with tempfile.TemporaryDirectory() as folder:
            found = run(name, ticks, 1, Path(folder))
        told = ", ".join(
            f"{key} {value:.6g}" if isinstance(value, float) else f"{key} {value}"
            for key, value in found.items()
        )
        print(name, told, flush=True)


if __name__ == "__main__":
    main()
