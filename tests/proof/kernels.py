"""The C kernels of proofs, right or wrong, compiled so that tests can call all functions."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from mutants import NATIVE, source
from store import folder, made_once

LEVELLED = ("cell_bounds", "arm_gradients")


@cache
def kernels(name: str = "", piece: str = "", instead: str = "") -> ctypes.CDLL:
    """Compile the kernels, a piece of one file replaced; skip without a compiler.

    The workers of a run share what was compiled."""
    if shutil.which("cc") is None:
        pytest.skip("there is no C compiler")
    key = crc32(repr((name, piece, instead)).encode())
    file = folder[0] / f"kernels-{key:08x}.so"
    return ctypes.CDLL(str(made_once(file, lambda: compiled(name, piece, instead))))


def compiled(name: str, piece: str, instead: str) -> bytes:
    """Compile the kernels, a piece of one file replaced, and return the library."""
    sources = Path(tempfile.mkdtemp(prefix="kernels"))
    shutil.copytree(str(files(NATIVE)), sources, dirs_exist_ok=True)
    shutil.copy(Path(__file__).with_name("probe.c"), sources)
    if name:
        text = source(name, piece, instead, NATIVE)
        (sources / name).write_text(text, encoding="utf-8")
    flags = [
        "-std=c99",
        "-O1" if name == "cell_bounds.c" else "-O0",
        "-w",
        "-fPIC",
        "-shared",
        "-DLEVEL=plain",
    ]
    flags += ["-ffp-contract=off", *(f"-D{f}_plain={f}" for f in LEVELLED)]
    wanted = ["leaf_margin_bounds.c", "inverse_bounds.c"]
    if name in ("", "cell_bounds.c", "taylor.h"):
        wanted.append("probe.c")
    if name in ("", "arm_angle.c", "taylor.h"):
        wanted.append("arm_angle.c")
    line = ["cc", *flags, *wanted, "-o", "wrong.so", "-lm"]
    subprocess.run(line, cwd=sources, check=True)
    library = (sources / "wrong.so").read_bytes()
    shutil.rmtree(sources)
    return library


def use(monkeypatch: pytest.MonkeyPatch, module: Any, library: ctypes.CDLL) -> None:
    """Let a module of the package call these kernels in place of its own."""
    monkeypatch.setattr(module, "required_library", lambda _: library)


def at(values: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)


# ---- chains ------------------------------------------------------------------------------------


def screws(library: ctypes.CDLL, chain: Any, theta: np.ndarray) -> Any:
    """Joint screws (P, 6), and the origin of the last joint (3,), at θ (P,)."""
    xi, tip, theta = np.zeros((len(theta), 6)), np.zeros(3), np.array(theta, float)
    made = chain.struct()
    library.screws(ctypes.byref(made), at(theta), at(xi), at(tip))
    return xi, tip


def columns(library: ctypes.CDLL, chain: Any, theta: np.ndarray) -> Any:
    """J (N, 6) and its slopes (n, N, 6) at θ (P,)."""
    N, n = chain.N, chain.n
    J, dJ, on = np.zeros((N, 6)), np.zeros((n, N, 6)), np.zeros((n, N), np.int8)
    made, theta = chain.struct(), np.array(theta, float)
    library.columns(ctypes.byref(made), at(theta), 0, 6, at(J), at(dJ), at(on))
    return J, dJ


def remainders(library: ctypes.CDLL, chain: Any, theta: np.ndarray, eta: np.ndarray) -> Any:
    """Bounds of the remainders of the columns of J in boxes θ ± η (P,): (N,) and (N,)."""
    linear, angular = np.zeros((2, chain.N))
    made = chain.struct()
    theta, eta = np.array(theta, float), np.array(eta, float)
    library.remainders_of(ctypes.byref(made), at(theta), at(eta), at(linear), at(angular))
    return linear, angular


# ---- one box -----------------------------------------------------------------------------------


def expanded(
    library: ctypes.CDLL, problem: Any, q: np.ndarray, h: np.ndarray
) -> dict[str, np.ndarray]:
    """What C expands J_V to in a box q ± h (n,): A, R, B (n, N, N), V, dV, rest, round."""
    n, N, r = problem.n, problem.N, problem.r
    wide = -(-N // 4) * 4
    out = {
        "A": np.zeros((N, N)),
        "R": np.zeros((N, N)),
        "B": np.zeros((n, N, wide)),
        "on": np.zeros((n, N), np.int8),
        "V": np.zeros((r, n)),
        "dV": np.zeros((r, n, n)),
        "rest": np.zeros((r, n)),
        "round": np.zeros(N),
    }
    made = problem.struct()
    q, h = np.array(q, float), np.array(h, float)
    arms = None
    done = library.expand(ctypes.byref(made), at(q), at(h), arms, 1, *map(at, out.values()))
    if not done:
        raise np.linalg.LinAlgError("J_V has no inverse")
    out["B"] = np.swapaxes(out["B"], 1, 2)[:, :N] * out["on"][:, None]
    return out


def expansion(
    library: ctypes.CDLL, problem: Any, q: np.ndarray, h: np.ndarray
) -> dict[str, np.ndarray]:
    """The same in NumPy, from J, V, their slopes and their remainders."""
    n, N, r = problem.n, problem.N, problem.r
    found = expanded(library, problem, q, h)
    J_V, m = np.zeros((N, N)), N - r
    dJ_V, rests = np.zeros((n, N, N)), np.zeros((m // 3, N))
    for f, chain in enumerate(problem.chains):
        S, some = chain.S[:, :n], slice(6 * f, 6 * f + 6)
        theta, eta = S @ q + chain.o, np.abs(S) @ h
        J, dJ = columns(library, chain, theta)
        J_V[some], dJ_V[:, some] = J.T, np.swapaxes(dJ, 1, 2)
        rests[2 * f : 2 * f + 2] = remainders(library, chain, theta, eta)
    J_V[m:, :n], dJ_V[:, m:, :n] = found["V"], np.moveaxis(found["dV"], 2, 0)
    A = np.linalg.inv(J_V)
    R = np.abs(A @ J_V - np.eye(N)) + (np.abs(A) @ found["round"])[:, None]
    for part, rest in enumerate(rests):
        R += np.linalg.norm(A[:, 3 * part : 3 * part + 3], axis=1)[:, None] * rest
    R[:, :n] += np.abs(A[:, m:]) @ found["rest"]
    B = (A @ dJ_V) * (h != 0)[:, None, None]
    D = R + np.einsum("jic,j->ic", np.abs(B), h)
    return found | {"A": A, "R": R, "B": B, "D": D}


def margin_on(
    library: ctypes.CDLL,
    eps: float,
    h: np.ndarray,
    A: np.ndarray,
    R: np.ndarray,
    B: np.ndarray,
    V: np.ndarray,
    dV: np.ndarray,
    rest: np.ndarray,
) -> float | None:
    """Bound the leaf margin from an expansion of J_V with V_c in place of V; None if not regular.

    B (k, N, N), V (r, n), dV (r, n, k), rest (r, n).
    """
    (r, n), k, N = V.shape, len(h), len(A)
    slopes = np.zeros((k, N, -(-N // 4) * 4))
    slopes[..., :N] = np.swapaxes(B, 1, 2)
    A, V, dV, rest = (np.array(x, float, order="C") for x in (A, V, dV, rest))
    R, Y, on = np.array(R, float), np.zeros((N, N)), np.ones((k, N), np.int8)
    bound, center, split = np.zeros(1), np.zeros(1), np.zeros(1, np.int32)
    arrays = (h, A, R, slopes, on, V, dV, rest, Y, bound, center, split)
    done = library.margin_on(n, N, r, k, ctypes.c_double(eps), *map(at, arrays))
    return float(bound[0]) if done and bound[0] > 0 else None
