"""Issue 58, 4: the action term for Isaac Lab on the learning page fits the types of its interface.

The stubs have the part of Isaac Lab 2 that the term uses. Nothing is simulated.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "learning.md"
STUBS = {
    "isaaclab/__init__.pyi": "",
    "isaaclab/envs.pyi": "class ManagerBasedEnv: ...\n",
    "isaaclab/utils.pyi": "def configclass[T](cls: type[T]) -> type[T]: ...\n",
    "isaaclab/managers.pyi": """
from abc import ABC, abstractmethod
from collections.abc import Sequence
from torch import Tensor
from .envs import ManagerBasedEnv

class Data:
    default_joint_pos: Tensor

class Articulation:
    data: Data
    def find_joints(
        self, name_keys: str | Sequence[str], joint_subset: list[str] | None = None,
        preserve_order: bool = False,
    ) -> tuple[list[int], list[str]]: ...
    def set_joint_position_target(
        self, target: Tensor, joint_ids: Sequence[int] | slice | None = None,
        env_ids: Sequence[int] | None = None,
    ) -> None: ...

class ActionTermCfg:
    class_type: type[ActionTerm]
    asset_name: str

class ActionTerm(ABC):
    _asset: Articulation
    def __init__(self, cfg: ActionTermCfg, env: ManagerBasedEnv) -> None: ...
    @property
    def num_envs(self) -> int: ...
    @property
    def device(self) -> str: ...
    @property
    @abstractmethod
    def action_dim(self) -> int: ...
    @property
    @abstractmethod
    def raw_actions(self) -> Tensor: ...
    @property
    @abstractmethod
    def processed_actions(self) -> Tensor: ...
    @abstractmethod
    def process_actions(self, actions: Tensor) -> None: ...
    @abstractmethod
    def apply_actions(self) -> None: ...
""",
    "torch.pyi": """
from typing import Any

class Tensor:
    def __getitem__(self, at: Any) -> Tensor: ...
    def __setitem__(self, at: Any, value: Tensor) -> None: ...
    def __iadd__(self, other: Tensor) -> Tensor: ...
    def clone(self) -> Tensor: ...
    def repeat(self, *sizes: int) -> Tensor: ...

def tensor(data: list[Any], *, device: str) -> Tensor: ...
def zeros(*size: int, device: str) -> Tensor: ...
def isfinite(input: Tensor) -> Tensor: ...
def where(condition: Tensor, input: Tensor, other: Tensor) -> Tensor: ...
""",
}


def term() -> str:
    """The action term as the page shows it."""
    (found,) = re.findall(r"```python title=.*?\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    return found


def test_the_term_is_short_and_has_the_methods_of_an_action_term() -> None:
    assert len(term().splitlines()) < 60
    classes = {n.name: n for n in ast.parse(term()).body if isinstance(n, ast.ClassDef)}
    methods = {n.name for n in classes["PoseAction"].body if isinstance(n, ast.FunctionDef)}
    abstract = re.findall(r"@abstractmethod\s+def (\w+)", STUBS["isaaclab/managers.pyi"])
    assert methods == {"__init__", *abstract}


def checked(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    (folder / "term.py").write_text(code, encoding="utf-8")
    skip = "[mypy]\nstrict = True\n[mypy-repctl_pin.*]\nfollow_imports = skip\n"
    (folder / "mypy.ini").write_text(skip, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--python-version", "3.12", "term.py"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_the_term_fits_the_types_of_isaac_lab(tmp_path: Path) -> None:
    """And a term that does not fit is found."""
    for name, text in STUBS.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    done = checked(term(), tmp_path)
    assert done.returncode == 0, done.stdout
    for right, wrong in (("joint_ids=", "joints="), ("return 4", "return None")):
        assert right in term() and checked(term().replace(right, wrong), tmp_path).returncode == 1
