"""Behaviour cloning of joints from 200 demonstrations, recorded against relabelled.

A panda reaches from one random pose of a cell to another, 200 times, in a model without dynamics.
J⁺ moves the joints. Each demonstration starts at another elbow, which also wanders on the way. A
small network learns the joints from the hand pose, or from the pose and the joints one frame
before. Its hand errors are measured at the poses of demonstrations that it has not seen; with the
joints as input, the network runs in a closed loop. For each seed, everything is drawn again. The
script prints Markdown and writes the figure of docs/how-to/learning.md, in about five minutes of
processor time:

    python tests/benchmarks/cloning.py [SEEDS [FIGURE]]
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from pathlib import Path

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import repctl_pin as rp
from repctl_pin.redundancy import align, nullspace

DEMOS, HELD_OUT, FRAMES = 200, 20, 25
"""Demonstrations to learn from, and to test with, and frames of each."""

ELBOW, WANDER = 0.6, 0.2
"""Largest displacements along the self-motion, rad: of a start, and on the way."""

WIDTH, STEPS, BATCH, RATE = 64, 3000, 256, 3e-3
"""Units of both hidden layers, steps of Adam, rows of a step, and rate, which falls to 0."""

CASES = {
    "recorded, from the pose": ("recorded", False),
    "recorded, from pose and joints": ("recorded", True),
    "relabelled, from the pose": ("relabelled", False),
    "relabelled, from pose and joints": ("relabelled", True),
}
Policy = Callable[[np.ndarray], np.ndarray]


def demonstrations(cell: rp.Cell, count: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Record poses in coordinates of the cell, (count, FRAMES, 6), and joints (…, n)."""
    task, s = cell.task, np.linspace(0, 1, FRAMES)
    ease = s**3 * (10 - 15 * s + 6 * s**2)
    U, Q = np.empty((count, FRAMES, cell.k)), np.empty((count, FRAMES, task.n))
    for k in range(count):
        ends = rng.uniform(-0.95, 0.95, (2, cell.k))
        U[k] = ends[0] + ease[:, None] * (ends[1] - ends[0])
        size, phase = rng.uniform(0, WANDER), rng.uniform(0, 2 * np.pi)
        elbow = rng.uniform(-ELBOW, ELBOW) + size * np.sin(2 * np.pi * s + phase)
        # from the middle to the first pose and elbow, then along the path
        q, way = np.array(task.reference), nullspace(task.jacobian(task.reference))
        u, c = np.zeros(cell.k), 0.0
        for f in range(FRAMES):
            parts = 40 if f == 0 else 2
            for part in np.arange(1, parts + 1) / parts:
                way = align(nullspace(task.jacobian(q)), way)
                q = q + (elbow[f] - c) / parts * way[:, 0]
                target = cell.at(u + part * (U[k, f] - u))
                q = q + np.linalg.pinv(task.jacobian(q)) @ task.error(q, target)
            u, c, Q[k, f] = U[k, f], elbow[f], q
    return U, Q


def cloned(X: np.ndarray, Y: np.ndarray, seed: int) -> Policy:
    """Fit a network of two hidden layers to rows X → Y, by least squares on scaled numbers."""
    shift, scale = Y.mean(axis=0), Y.std(axis=0)
    to, by = X.mean(axis=0), X.std(axis=0)
    data = jnp.asarray((X - to) / by), jnp.asarray((Y - shift) / scale)
    sizes = [X.shape[1], WIDTH, WIDTH, Y.shape[1]]
    keys = jax.random.split(jax.random.key(seed), len(sizes))
    layers = [
        (jax.random.normal(k, (m, n)) / np.sqrt(m), jnp.zeros(n))
        for k, m, n in zip(keys, sizes[:-1], sizes[1:], strict=False)
    ]

    def network(layers: list, x: jax.Array) -> jax.Array:
        for W, b in layers[:-1]:
            x = jnp.tanh(x @ W + b)
        return x @ layers[-1][0] + layers[-1][1]

    def loss(layers: list, x: jax.Array, y: jax.Array) -> jax.Array:
        return jnp.mean((network(layers, x) - y) ** 2)

    def step(state: tuple, given: tuple) -> tuple[tuple, None]:
        layers, m, v = state
        k, key = given
        rows = jax.random.randint(key, (BATCH,), 0, len(data[0]))
        slope = jax.grad(loss)(layers, data[0][rows], data[1][rows])
        m = jax.tree.map(lambda a, g: 0.9 * a + 0.1 * g, m, slope)
        v = jax.tree.map(lambda a, g: 0.999 * a + 0.001 * g**2, v, slope)
        rate = RATE * 0.5 * (1 + jnp.cos(jnp.pi * k / STEPS))
        fix = jnp.sqrt(1 - 0.999 ** (k + 1)) / (1 - 0.9 ** (k + 1))
        layers = jax.tree.map(
            lambda w, a, b: w - rate * fix * a / (jnp.sqrt(b) + 1e-8), layers, m, v
        )
        return (layers, m, v), None

    zeros = jax.tree.map(jnp.zeros_like, layers)
    given = jnp.arange(STEPS), jax.random.split(keys[-1], STEPS)
    (layers, _, _), _ = jax.jit(lambda state: jax.lax.scan(step, state, given))(
        (layers, zeros, zeros)
    )
    run = jax.jit(network)
    return lambda x: np.asarray(run(layers, (x - to) / by), float) * scale + shift


def hand_errors(cell: rp.Cell, U: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Distance of the hand from its pose for each row, mm; its rotation is not counted."""
    wanted = np.array([cell.at(u).translation for u in U])
    return 1e3 * np.linalg.norm(cell.task.positions(Q) - wanted, axis=1)


def errors(design: rp.CellDesign, seed: int) -> dict[str, np.ndarray]:
    """Draw the demonstrations of a seed, train a network for each case, and measure its errors."""
    cell, rng = design.cell, np.random.default_rng(seed)
    U, Q = demonstrations(cell, DEMOS, rng)
    held, began = demonstrations(cell, HELD_OUT, rng)
    session = np.repeat(np.arange(DEMOS), FRAMES)
    recording = rp.Recording(cell.task, joints=Q.reshape(-1, cell.task.n), sessions=session)
    done = rp.relabel(recording, design=design)
    labels = {"recorded": Q, "relabelled": done.joints.reshape(Q.shape)}
    F = design.function
    first = [F(cell.at(u), leaf=done.leaf) for u in held[:, 0]]
    starts = {"recorded": began[:, 0], "relabelled": np.array(first)}
    print(
        f"seed {seed}: {int(done.found.sum())} of {len(session)} frames relabelled; ambiguity "
        f"{done.residual_before:.2g} → {done.residual_after:.2g} rad",
        flush=True,
    )
    found = {}
    for name, (label, joints) in CASES.items():
        Y = labels[label]
        X = np.concatenate([U[:, 1:], Y[:, :-1]], axis=2) if joints else U
        Y = Y[:, 1:] if joints else Y
        good = np.isfinite(Y).all(axis=2) & np.isfinite(X).all(axis=2)
        policy = cloned(X[good], Y[good], seed)
        if not joints:
            found[name] = hand_errors(
                cell, held.reshape(-1, cell.k), policy(held.reshape(-1, cell.k))
            )
            continue
        q, rows = starts[label], []
        for k in range(1, FRAMES):
            q = policy(np.concatenate([held[:, k], q], axis=1))
            rows.append(hand_errors(cell, held[:, k], q))
        found[name] = np.concatenate(rows)
    return found


def figure(found: dict[str, list[np.ndarray]]) -> Figure:
    """Draw the share of held-out poses below each hand error, one line per seed."""
    made = Figure(figsize=(7.2, 3.8), layout="constrained")
    axes = made.subplots()
    for name, each in found.items():
        label, joints = CASES[name]
        colour = "#D55E00" if label == "recorded" else "#0072B2"  # vermilion and blue
        for k, e in enumerate(each):
            share = 100 * np.arange(1, len(e) + 1) / len(e)
            style = "--" if joints else "-"
            axes.plot(np.sort(e), share, style, color=colour, lw=1, label=None if k else name)
    axes.set(xscale="log", xlabel="hand error at a held-out pose, mm", ylabel="poses below it, %")
    axes.set(ylim=(0, 100))
    axes.grid(alpha=0.3)
    axes.legend(loc="upper left", fontsize=8)
    return made


def main(seeds: int = 5, picture: Path | None = None) -> dict[str, list[np.ndarray]]:
    """Print a table of hand errors, and draw them; return them, in mm, by case and seed."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    cell = rp.Cell(task, task.placement(task.reference), 0.1, 0.25)
    design = rp.nearest_inverse_function(rp.Pseudoinverse(task), cell)
    every = [errors(design, seed) for seed in range(seeds)]
    found = {name: [one[name] for one in every] for name in CASES}
    print("\n| labels, policy | median, mm | worst, mm |\n| --- | --- | --- |")
    for name, each in found.items():
        cells = []
        for values in ([np.median(e) for e in each], [e.max() for e in each]):
            cells.append(f"{np.median(values):.2g} ({min(values):.2g} to {max(values):.2g})")
        print(f"| {name} | {' | '.join(cells)} |")
    if picture is not None:
        drawn = io.BytesIO()
        figure(found).savefig(drawn, dpi=150)
        Image.open(drawn).convert("RGB").quantize(64).save(picture, optimize=True)
    return found


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:2]), *(Path(a) for a in sys.argv[2:3]))
