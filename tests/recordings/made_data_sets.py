"""Small data sets in the true layouts of LeRobot (2.1 and 3.0) and of robomimic."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

FPS = 20
VERSIONS = ("v2.1", "v3.0")
_PATHS = {
    "v2.1": (
        "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
    ),
    "v3.0": (
        "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
    ),
}


def statistics(X: np.ndarray, quantiles: bool) -> dict[str, list]:
    """What LeRobot keeps of a column (K, w), or (K,)."""
    wide = X.reshape(len(X), -1)
    made = {name: getattr(wide, name)(axis=0).tolist() for name in ("min", "max", "mean", "std")}
    levels = (1, 10, 50, 90, 99) if quantiles else ()
    more = {f"q{k:02d}": np.quantile(wide, k / 100, axis=0).tolist() for k in levels}
    return made | {"count": [len(X)]} | more


def table_of(columns: dict[str, np.ndarray], frames: np.ndarray) -> pa.Table:
    """A table with the metadata of the library ``datasets``, and an image in each row."""
    arrays, features = {}, {}
    for name, X in columns.items():
        one = {"dtype": str(X.dtype), "_type": "Value"}
        features[name] = one
        arrays[name] = pa.array(X) if X.ndim == 1 else pa.array(X.tolist(), pa.list_(pa.float32()))
        if X.ndim == 2:
            features[name] = {"feature": one, "length": X.shape[1], "_type": "Sequence"}
    image = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
    cells = [{"bytes": b"\x89PNG" + bytes([k % 256]), "path": None} for k in frames]
    arrays["observation.images.wrist"] = pa.array(cells, image)
    features["observation.images.wrist"] = {"_type": "Image"}
    schema = pa.table(arrays).schema
    info = json.dumps({"info": {"features": features}})
    return pa.table(arrays, schema=schema.with_metadata({"huggingface": info}))


def lerobot(
    root: Path,
    version: str,
    episodes: Sequence[np.ndarray],
    actions: Sequence[np.ndarray],
    names: object,
    *,
    action_names: object = "state",
    velocity: bool = True,
) -> Path:
    """Write a data set: state and action (K, n + 1 gripper), a video, an image, velocities."""
    names_of = {"observation.state": names, "action": names}
    if action_names != "state":
        names_of["action"] = action_names
    tables, stats, start = [], [], 0
    for e, (Q, A) in enumerate(zip(episodes, actions, strict=True)):
        frames = np.arange(len(Q))
        columns = {
            "observation.state": Q.astype(np.float32),
            "action": A.astype(np.float32),
            "observation.velocity": np.gradient(Q, axis=0).astype(np.float32),
            "observation.environment_state": np.ones((len(Q), 2), np.float32) * e,
            "timestamp": (frames / FPS).astype(np.float32),
            "frame_index": frames,
            "episode_index": np.full(len(Q), e),
            "index": start + frames,
            "task_index": np.zeros(len(Q), int),
            "next.done": frames == len(Q) - 1,
        }
        if not velocity:
            del columns["observation.velocity"]
        start += len(Q)
        tables.append(table_of(columns, frames))
        quantiles = version == "v3.0"
        numbers = {k: x for k, x in columns.items() if x.dtype != bool}
        stats.append({k: statistics(x, quantiles) for k, x in numbers.items()})
    features = {
        name: {
            "dtype": str(x.dtype),
            "shape": list(x.shape[1:]) or [1],
            "names": names_of.get(name),
        }
        for name, x in columns.items()
    }
    features["observation.images.wrist"] = {"dtype": "image", "shape": [3, 8, 8], "names": None}
    features["observation.images.top"] = {"dtype": "video", "shape": [3, 8, 8], "names": None}
    data_path, video_path = _PATHS[version]
    info = {
        "codebase_version": version,
        "robot_type": "planar",
        "total_episodes": len(episodes),
        "total_frames": start,
        "total_tasks": 1,
        "chunks_size": 1000,
        "fps": FPS,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": data_path,
        "video_path": video_path,
        "features": features,
    }
    (root / "meta").mkdir(parents=True)
    (root / "meta" / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8")
    (root / "README.md").write_text("a card\n", encoding="utf-8")
    writer = _write_21 if version == "v2.1" else _write_30
    writer(root, tables, stats)
    return root


def _write_21(root: Path, tables: list[pa.Table], stats: list[dict]) -> None:
    (root / "data" / "chunk-000").mkdir(parents=True)
    lines = {"tasks": [json.dumps({"task_index": 0, "task": "reach"})], "episodes": []}
    lines["episodes_stats"] = []
    for e, (table, one) in enumerate(zip(tables, stats, strict=True)):
        pq.write_table(table, root / "data" / "chunk-000" / f"episode_{e:06d}.parquet")
        video = root / "videos" / "chunk-000" / "observation.images.top" / f"episode_{e:06d}.mp4"
        video.parent.mkdir(parents=True, exist_ok=True)
        video.write_bytes(b"a video %d" % e)
        length = {"episode_index": e, "tasks": ["reach"], "length": len(table)}
        lines["episodes"].append(json.dumps(length))
        lines["episodes_stats"].append(json.dumps({"episode_index": e, "stats": one}))
    for name, texts in lines.items():
        (root / "meta" / f"{name}.jsonl").write_text("\n".join(texts) + "\n", encoding="utf-8")


def _write_30(root: Path, tables: list[pa.Table], stats: list[dict]) -> None:
    """Two files of data, with one group of rows per demonstration."""
    cut = (len(tables) + 1) // 2
    for k, part in enumerate((tables[:cut], tables[cut:])):
        file = root / "data" / "chunk-000" / f"file-{k:03d}.parquet"
        file.parent.mkdir(parents=True, exist_ok=True)
        with pq.ParquetWriter(file, part[0].schema, compression="snappy") as writer:
            for table in part:
                writer.write_table(table)
    video = root / "videos" / "observation.images.top" / "chunk-000" / "file-000.mp4"
    video.parent.mkdir(parents=True)
    video.write_bytes(b"a video")
    rows, start = [], 0
    for e, (table, one) in enumerate(zip(tables, stats, strict=True)):
        flat = {f"stats/{n}/{s}": v for n, each in one.items() for s, v in each.items()}
        place = {"data/chunk_index": 0, "data/file_index": int(e >= cut)}
        ends = {"dataset_from_index": start, "dataset_to_index": start + len(table)}
        about = {"episode_index": e, "tasks": ["reach"], "length": len(table)}
        rows.append(about | place | ends | flat)
        start += len(table)
    file = root / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    file.parent.mkdir(parents=True)
    pq.write_table(pa.Table.from_pylist(rows), file)
    pq.write_table(pa.table({"task_index": [0], "task": ["reach"]}), root / "meta/tasks.parquet")
    whole = {}
    for name in stats[0]:
        X = np.concatenate([np.array(t[name].to_pylist()) for t in tables])
        whole[name] = statistics(X, True)
    text = json.dumps(whole, indent=4)
    (root / "meta" / "stats.json").write_text(text, encoding="utf-8")


def robomimic(
    file: Path,
    episodes: Sequence[np.ndarray],
    actions: Sequence[np.ndarray],
    *,
    controller: object = "OSC_POSE",
) -> Path:
    """Write an HDF5 file as robosuite's: joints, their cosines, speeds, images, masks."""
    kwargs = {"control_freq": FPS}
    if controller is not None:
        kwargs["controller_configs"] = {"type": controller}
    with h5py.File(file, "w") as h5:
        data = h5.create_group("data")
        data.attrs["total"] = sum(map(len, episodes))
        data.attrs["env_args"] = json.dumps(
            {"env_name": "Lift", "env_type": 1, "env_kwargs": kwargs}
        )
        for e, (Q, A) in enumerate(zip(episodes, actions, strict=True)):
            demo = data.create_group(f"demo_{e}")
            demo.attrs["num_samples"] = len(Q)
            demo.attrs["model_file"] = "<mujoco/>"
            demo["actions"] = A
            demo["rewards"] = np.zeros(len(Q))
            demo["dones"] = np.eye(len(Q))[-1].astype(int)
            demo["states"] = np.c_[np.arange(len(Q)), Q]
            for group, X in (("obs", Q), ("next_obs", np.r_[Q[1:], Q[-1:]])):
                demo.create_dataset(
                    f"{group}/robot0_joint_pos", data=X, chunks=(4, Q.shape[1]), compression="gzip"
                )
                demo[f"{group}/robot0_joint_pos"].attrs["unit"] = "rad"
                demo[f"{group}/robot0_joint_pos_cos"] = np.cos(X)
                demo[f"{group}/robot0_joint_pos_sin"] = np.sin(X)
                demo[f"{group}/robot0_joint_vel"] = np.zeros_like(X)
                demo[f"{group}/robot0_eef_pos"] = np.full((len(X), 3), 0.1 * e)
                demo[f"{group}/robot0_gripper_qpos"] = np.full((len(X), 2), 0.02)
                demo[f"{group}/object"] = np.ones((len(X), 10))
                demo[f"{group}/agentview_image"] = np.full((len(X), 8, 8, 3), e, np.uint8)
        h5["mask/train"] = np.array([b"demo_0", b"demo_1"])
        h5["mask/valid"] = np.array([b"demo_2"])
    return file
