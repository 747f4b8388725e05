"""Wrong versions of the bounds of a proof: a term dropped, halved, or of the other sign."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import sys
from importlib.resources import files
from pathlib import Path
from types import ModuleType

import pytest

PACKAGE = "repctl_pin.extensions.proof"
NATIVE = "repctl_pin.native"

LEVELLED = ("cell_bounds", "arm_gradients", "inverse_bounds")

NUMPY = {
    "no products of slopes": (
        "np.abs(pairs + np.swapaxes(pairs, 1, 2)) / 2",
        "0 * pairs",
    ),
    "half the products": (
        "np.swapaxes(pairs, 1, 2)) / 2",
        "np.swapaxes(pairs, 1, 2)) / 4",
    ),
    "products subtracted": ("np.abs(pairs + np.", "np.abs(pairs - np."),
    "no R N_j": ("at.R @ first + D @ rough", "D @ rough"),
    "half of R N_j": ("at.R @ first + D @ rough", "0.5 * at.R @ first + D @ rough"),
    "no D R X": ("at.R @ first + D @ rough", "at.R @ first"),
    "half of D R X": ("at.R @ first + D @ rough", "at.R @ first + 0.5 * D @ rough"),
    "R not in D": ("D = at.R + np.einsum", "D = np.einsum"),
    "half of R in D": ("D = at.R + np.einsum", "D = 0.5 * at.R + np.einsum"),
    "no R X": ("rough + Y[:, :, 6:]", "Y[:, :, 6:]"),
    "half of R X": ("rough + Y[:, :, 6:]", "0.5 * rough + Y[:, :, 6:]"),
    "no z": ("rough + Y[:, :, 6:]", "rough"),
    "half of z": ("rough + Y[:, :, 6:]", "rough + 0.5 * Y[:, :, 6:]"),
    "N turns the other way": ("dN = -B @", "dN = B @"),
    "V's slopes in J_c": ("B[..., :n] -= X[:, None] @ slopes", "pass"),
    "V_c not taken out of P": (" - V[:, None] @ np.swapaxes(M, 2, 3)", ""),
    "V_c added to P": (" - V[:, None] @ np.swap", " + V[:, None] @ np.swap"),
    "V's slopes not in M": ("_size(_summed(M, half) + ", "_size("),
    "V's rest not in M": (" + at.rest @ np.abs(V) + tiny", " + tiny"),
    "half of V's rest in M": (
        " + at.rest @ np.abs(V) + tiny",
        " + 0.5 * at.rest @ np.abs(V) + tiny",
    ),
    "half of V's rest": ("pi = rest + np", "pi = 0.5 * rest + np"),
    "V's rest not projected": ("np.abs(V) @ (np.abs(at.V) @ rest)", "0"),
    "M once": ("(turned / (1 - turned) * slack)", "turned"),
    "M not at all": ("pi = pi + row[:, :, None]", "pass"),
    "slopes of P not in its rows": ("((P + pi) ** 2)", "(pi**2)"),
    "P without its rest": ("return dP, pi, P + pi, turned", "return dP, pi, P, turned"),
    "β without slopes of N": ("@ (first + nu)", "@ nu"),
    "β without half of those": ("@ (first + nu)", "@ (0.5 * first + nu)"),
    "β without ν": ("@ (first + nu)", "@ first"),
    "β without half of ν": ("@ (first + nu)", "@ (first + 0.5 * nu)"),
    "β without π": ("np.swapaxes(pi, 1, 2) @ np.abs(T) + tiny", "tiny"),
    "β with half of π": (
        "+ np.swapaxes(pi, 1, 2) @",
        "+ 0.5 * np.swapaxes(pi, 1, 2) @",
    ),
    "b without slopes": ("b = _summed(PT, half) + beta", "b = beta"),
    "b with half of the slopes": (
        "b = _summed(PT, half)",
        "b = 0.5 * _summed(PT, half)",
    ),
    "b without β": ("b = _summed(PT, half) + beta", "b = _summed(PT, half)"),
    "ρ without ν": ("rho = nu + pi + np", "rho = pi + np"),
    "ρ with half of ν": ("rho = nu + pi + np", "rho = 0.5 * nu + pi + np"),
    "ρ without π": ("rho = nu + pi + np", "rho = nu + np"),
    "ρ with half of π": ("rho = nu + pi + np", "rho = nu + 0.5 * pi + np"),
    "ρ without β": ("np.abs(T) @ beta + tiny", "tiny"),
    "ρ with half of β": ("np.abs(T) @ beta + tiny", "0.5 * np.abs(T) @ beta + tiny"),
    "ρ without b": ("rho + again + row[:, :, None]", "rho"),
    "ρ with half of b": (
        "rho + again + row[:, :, None]",
        "rho + 0.5 * again + row[:, :, None]",
    ),
    "ρ with b once": ("rho + again + row[:, :, None]", "rho + again"),
    "b² only": ("(size / (1 - size) * slack)", "size"),
    "slopes not in |S − T_c|": ("again = (wide + rho) @ b", "again = rho @ b"),
    "ρ not in |S − T_c|": ("again = (wide + rho) @ b", "again = wide @ b"),
    "S without P": ("dS = dN - dP - ", "dS = dN - "),
    "S with P added": ("dS = dN - dP - ", "dS = dN + dP - "),
    "S without the product": ("- T[:, None] @ PT\n", "\n"),
    "S with the product added": ("- T[:, None] @ PT\n", "+ T[:, None] @ PT\n"),
    "no first order of SᵀS": ("np.abs(T_T @ T) + both.sum(axis=1)", "np.abs(T_T @ T)"),
    "half of the first order": ("+ both.sum(axis=1)", "+ 0.5 * both.sum(axis=1)"),
    "no T_c ρ": ("+ cross + np.swapaxes(cross, 1, 2)", ""),
    "half of T_c ρ": ("+ cross + np.swapaxes(cross, 1, 2)", "+ cross"),
    "no square": ("square += np.swapaxes(wide + rho, 1, 2) @ (wide + rho)", "pass"),
    "half of the square": ("square += np.swap", "square += 0.5 * np.swap"),
    "slopes not in the square": ("1, 2) @ (wide + rho)", "1, 2) @ rho"),
    "ρ not in the square": ("1, 2) @ (wide + rho)", "1, 2) @ wide"),
    "the margin without P": ("1 + square * (1 + P**2 * (1 + eps))", "1 + square"),
    "the margin with half of P": ("(1 + P**2 * (1 + eps))", "(1 + 0.5 * P**2)"),
    "half of S": ("1 + square * (", "1 + 0.5 * square * ("),
}
"""What is wrong: a piece of leaf_margin_bounds.py, and what is put in its place."""

C = {
    "half of V's rest": ("rest[a][i] = 0.5 * e", "rest[a][i] = 0.25 * e"),
    "no fourth derivatives": ("(l > j ? 2 : 1) + t / 3)", "(l > j ? 2 : 1))"),
    "pairs of third derivatives once": ("(l > j ? 2 : 1)", "1"),
    "half of a turning joint's rest": (
        "? 0.5 * H_R * H_R * L + H_R * H_P",
        "? 0.25 * H_R * H_R * L + H_R * H_P",
    ),
    "no product of turning and sliding": ("H_R * L + H_R * H_P", "H_R * L"),
    "half of a sliding joint's rest": (": 0.5 * H_R * H_R;\n", ": 0.25 * H_R * H_R;\n"),
    "half of the angular rest": ("? 0.5 * H_R * H_R : 0", "? 0.25 * H_R * H_R : 0"),
    "no linear rest": ("tiny + a_v * linear[c]", "tiny"),
    "no angular rest": (" + a_w * angular[c]", ""),
    "no products of slopes": ("F[i][6 + a] += both *", "F[i][6 + a] += 0 * both *"),
    "half the products": ("F[i][6 + a] += both *", "F[i][6 + a] += 0.5 * both *"),
    "one of two products": ("if (turns[k][c] && k > j)", "if (0)"),
    "no R N_j": ("+= R[i][c] * first[c][a] + D", "+= D"),
    "no D R X": (" + D[i][c] * rough[c][a]", ""),
    "R not in D": (
        "D[i][c] = R[i][c] = e + fabs(s)",
        "D[i][c] = 0, R[i][c] = e + fabs(s)",
    ),
    "no R X": ("e[i][a] = rough[i][a] + Y[i][6 + a]", "e[i][a] = Y[i][6 + a]"),
    "no z": ("e[i][a] = rough[i][a] + Y[i][6 + a]", "e[i][a] = rough[i][a]"),
    "N turns the other way": ("dN[j][i][a] -= s[i]", "dN[j][i][a] += s[i]"),
    "V_c not taken out of P": ("dP[i][a] -= V[c][i] * s;", ";"),
    "V's slopes not in M": ("M[a][c] += h[j] * fabs(s);", ";"),
    "V's rest not in M": ("s += rest[a][i] * fabs(V[c][i]);", ";"),
    "V's rest not projected": ("s += fabs(V[c][i]) * fabs(V[c][l]) * rest[a][l];", ";"),
    "M not at all": ("loose[i][a] += row, all", "all"),
    "β without slopes of N": (
        "all[i][a] * (first[i][c] + e[i][c])",
        "all[i][a] * e[i][c]",
    ),
    "β without ν": ("(first[i][c] + e[i][c])", "first[i][c]"),
    "β without π": (" + loose[i][a] * fabs(T[i][c]);", ";"),
    "b without slopes": ("b[a][c] += h[j] * fabs(PT[a][c]);", ";"),
    "b without β": ("bent[a][c] = s, b[a][c] += s;", "bent[a][c] = s;"),
    "ρ without ν": ("m[a] = e[i][a] + loose", "m[a] = loose"),
    "ρ without π": ("+ loose[i][a] + defect;", "+ defect;"),
    "ρ without β": ("m[a] += fabs(T[i][c]) * bent[c][a];", ";"),
    "ρ without b": ("e[i][a] = m[a] + w[a] + row", "e[i][a] = m[a]"),
    "ρ with b once": ("e[i][a] = m[a] + w[a] + row", "e[i][a] = m[a] + w[a]"),
    "slopes not in |S − T_c|": ("(wide[i][c] + m[c]) * b", "m[c] * b"),
    "S without P": ("s = dN[j][i][a] - dP[i][a]", "s = dN[j][i][a]"),
    "S without the product": ("s -= T[i][c] * PT[c][a]", ""),
    "no first order of SᵀS": ("K[a][c] += s, part", "part"),
    "half of T_c ρ": (" + e[i][a] * fabs(T[i][c]) + (wide", " + (wide"),
    "no square": (" + (wide[i][a] + e[i][a]) * (wide[i][c] + e[i][c]);", ";"),
    "the margin without P": ("most * (1 + size * size * slack)", "most"),
}
"""What is wrong: a piece of leaf_margin_bounds.c, and what is put in its place."""


POTENTIALS = {
    "half of the third derivatives": (
        '0.5 * np.einsum("aijl,Kj',
        '0.25 * np.einsum("aijl,Kj',
    ),
    "no third derivatives": ('0.5 * np.einsum("aijl,Kj', '0 * np.einsum("aijl,Kj'),
    "half of those at the centre": (
        "rest + 0.5 * np.einsum",
        "rest + 0.25 * np.einsum",
    ),
    "no fourth derivatives": ("third += np.einsum", "0 * np.einsum"),
    "half of the fourth derivatives": ("half) / 3", "half) / 6"),
    "powers' factors forgotten": ("by_m * size / scale[m]", "size / scale[m]"),
    "fourth derivatives at the centre": (
        "= [self._most(v) for v in z]",
        "= [0.0] * len(z)",
    ),
    "one scale missing": ("by_l / scale[l]", "by_l"),
    "half of a third power": ("+= np.abs(cubic)", "+= 0.5 * np.abs(cubic)"),
}
"""What is wrong with V's remainder, in potentials.py or leaf_margin_bounds.py."""


TAYLOR = {
    "no products of degree 1 and 3": ("a[..., 1] * b[..., 3] + a[..., 2]", "a[..., 2]"),
    "no squares of degree 2": ("(b[..., 2] + b[..., 3])\n", "b[..., 3]\n"),
    "no products of degree 2 and 3": (
        "a[..., 2] * (b[..., 2] + b[..., 3])",
        "a[..., 2] * b[..., 2]",
    ),
    "no products of degree 3 and 1": ("a[..., 3] * (b[..., 1] + ", "a[..., 3] * ("),
    "half of degree 3": ("beyond + a[..., 3]", "beyond + 0.5 * a[..., 3]"),
    "the left rest dropped": ("            + self.r * two\n", ""),
    "the right rest dropped": ("            + one * other.r\n", ""),
    "both rests dropped": ("            + self.r * other.r\n", ""),
    "a rest dropped in a sum": ("(self.r + other.r)", "self.r"),
    "a rest not scaled": ("self.r * np.abs(factor)", "self.r"),
    "a negative factor": ("(np.abs(A) @ self.r", "(A @ self.r"),
    "a sine of the other sign": ("[s, c, -s / 2, -c / 6]", "[s, c, s / 2, -c / 6]"),
    "a cosine's third term": ("-c / 2, s / 6]", "-c / 2, -s / 6]"),
    "half of the sine's rest": ("-s / 2, -c / 6], 1 / 24", "-s / 2, -c / 6], 1 / 48"),
    "half of the cosine's rest": ("-c / 2, s / 6], 1 / 24", "-c / 2, s / 6], 1 / 48"),
    "no rest of a series": ("fourth * d.most**4", "0 * d.most"),
    "a smaller fourth derivative": ("np.arange(1.0, 9 + m)", "np.arange(1.0, 10 + m)"),
}
"""What is wrong with Taylor models: a piece of taylor.py, and what is put in its place."""


COMMUTATOR = {
    "joints beyond forgotten": ("= turns[:, beyond] @ away[beyond]", "= 0"),
    "half of the joints beyond": ("= turns[:, beyond] @", "= 0.5 * turns[:, beyond] @"),
    "joint l forgotten": ("joints >= max(joint, k)", "joints >= max(joint + 1, k)"),
    "joints between forgotten": ("+= away[joint]", "+= 0 * away[joint]"),
    "half of the joints between": ("+= away[joint]", "+= 0.5 * away[joint]"),
    "prismatic joints forgotten": (
        "K[:, joint] += slides[:, joints > joint].sum(axis=1)",
        "pass",
    ),
    "turned prismatic joints": ("= turns[:, among].sum(axis=1)\n", "= 0\n"),
    "no mean": ("mean = (0.5 * Omega", "mean = (0 * Omega"),
    "no spin": ("return np.where(spins, step[", "return np.where(spins, 0 * step["),
}
"""What is wrong with the bounds of two solutions: a piece of commutator.py, and what is put in its
place."""

_CELL, _TAYLOR = "cell_bounds.c", "taylor.h"
CELL_C = {
    "no products of degree 1 and 3": (_TAYLOR, "r = a[1] * b[3] + a[2]", "r = a[2]"),
    "no squares of degree 2": (_TAYLOR, "a[2] * (b[2] + b[3])", "a[2] * b[3]"),
    "no products of degree 3": (_TAYLOR, " + a[3] * (b[1] + b[2] + b[3]);", ";"),
    "the right rest dropped": (_TAYLOR, "one * y->r + ", ""),
    "the left rest dropped": (_TAYLOR, "x->r * two + ", ""),
    "no rest of a series": (_TAYLOR, "r = fourth * most", "r = 0 * most"),
    "the rest of a sum": (_TAYLOR, "fabs(a) * x->r + fabs(b) * y->r", "fabs(a) * x->r"),
    "no fourth derivatives": (_CELL, "out[c].r += v *", "out[c].r += 0 * v *"),
    "the tilt of the other sign": (_CELL, "{0, b[2], -b[1],", "{0, -b[2], b[1],"),
    "joints towards the base turn forwards": (
        _CELL,
        "if (sign < 0) scale",
        "if (0) scale",
    ),
    "the frame's place forgotten": (
        _CELL,
        "add(g, e + i, -1, f->tip + i, e + i);",
        ";",
    ),
    "no rest in J": (
        _CELL,
        "* (y->r + s->chain->eps * size_of(y));\n      }\n      rest",
        "* 0;\n      }\n      rest",
    ),
    "no higher degrees in J": (
        _CELL,
        "if (m > k) e += absolute(v);",
        "if (m > k) e += 0;",
    ),
    "no slopes beside the chart": (
        _CELL,
        "e += fabs(B[(j * rows + i) * N + c]) * mean[j];",
        ";",
    ),
    "no remainder of screws": (
        _CELL,
        "norm3(x) * (two_v[c] - one_v[c] * (1 - 1e-12))",
        "0",
    ),
    "no angular remainder": (
        _CELL,
        " + norm3(x + 3) * (two_w[c] - one_w[c] * (1 - 1e-12));",
        ";",
    ),
    "the way not turned": (
        _CELL,
        "linear += turned * (at->e + at->p * angle + at->e * angle) +",
        "linear +=",
    ),
    "the middle link not moved": (_CELL, " + moved * angle;", ";"),
    "no linear part of it": (
        _CELL,
        "at->step[i] + norms[2 * i] * linear",
        "at->step[i]",
    ),
}
"""What is wrong with a cell's kernel: the file, a piece of it, and what is put in its place."""

ARM = {
    "the wrist's force of the other sign": (
        "return alpha, turning - beta",
        "return alpha, turning + beta",
    ),
    "no connection": ("return alpha, turning - beta", "return alpha, -beta"),
    "the connection of the other sign": (
        "return alpha, turning - beta",
        "return alpha, -turning - beta",
    ),
    "the elbow's force of the other sign": (
        "alpha = (rho * lever) * a",
        "alpha = -(rho * lever) * a",
    ),
    "the elbow's force without ρ": ("alpha = (rho * lever) * a", "alpha = lever * a"),
    "the wrist's force without 1/ρ": (
        "dot(w, e) * inverse * lever",
        "dot(w, e) * lever",
    ),
    "t on the other side": ("rho * (rho - along)", "rho * (rho + along)"),
    "r × w for w × r": ("w.combined(-skew(", "w.combined(skew("),
    "the shoulder does not balance": (
        "[-(alpha + beta), alpha, beta]",
        "[-alpha, alpha, beta]",
    ),
    "the wrist's moment forgotten": (
        "cross(e, alpha) + cross(w, beta)",
        "cross(e, alpha)",
    ),
    "moments about the base": (
        "cross(points[f] - origins[joint], forces[f])",
        "cross(points[f], forces[f])",
    ),
    "prismatic joints turn": (
        "a[joint], chain.revolute[joint], R",
        "a[joint], True, R",
    ),
    "couplings forgotten": ("one.scaled(chain.S[joint, i])", "one"),
    "offsets forgotten": (
        "theta + fixed(theta, chain.o)",
        "theta",
    ),
    "no terms of higher degree": ("np.abs(P[..., 1 + k :]).sum(axis=-1) + r", "r"),
    "half of the terms of higher degree": (
        "more = np.abs(P[..., 1 + k :])",
        "more = 0.5 * np.abs(P[..., 1 + k :])",
    ),
    "no remainder": (".sum(axis=-1) + r\n        more", ".sum(axis=-1)\n        more"),
    "slopes not divided": ("P[..., 1 : 1 + k] / h, 0.0", "P[..., 1 : 1 + k], 0.0"),
}
"""What is wrong with an arm angle's gradient: a piece of arm_angle.py, and what is put in its
place."""

POWER = {
    "no rest": ("/ 24 * least ** (s - 4)", "* 0"),
    "half of the rest": ("/ 24 * least ** (s - 4)", "/ 48 * least ** (s - 4)"),
    "the rest at the centre": ("* least ** (s - 4)", "* x ** (s - 4)"),
    "a third of the second term": (
        "((s - i) / ((i + 1) * x))",
        "((s - i) / ((i + 2) * x))",
    ),
    "a sign": ("f = f * ((s - i)", "f = f * ((i - s)"),
}
"""What is wrong with a power: a piece of taylor.py, and what is put in its place."""

ARM_C = {
    "the rest of a power": ("/ 24 * pow(least, s - 4)", "/ 48 * pow(least, s - 4)"),
    "a power's slopes": ("((s - i) / ((i + 1) * c))", "((s - i) / ((i + 2) * c))"),
    "the connection's sign": ("hat[9] = {0, d[2], -d[1],", "hat[9] = {0, -d[2], d[1],"),
    "the shoulder": (", scale(g, -1, F[0] + i);", ";"),
    "t on the other side": (
        "add(g, &rho, -1, &along, &x)",
        "add(g, &rho, 1, &along, &x)",
    ),
    "the wrist's force": ("add(g, F[2] + i, -1, F[0] + i, F[2] + i);", ";"),
    "the wrist's moment": ("add(g, whole + i, 1, x + i, whole + i);", ";"),
    "moments about the base": (
        "add(g, points[c] + i, -1, f->origin + i, way + i)",
        "way[i] = points[c][i]",
    ),
    "prismatic joints": (
        "times_model(g, &theta, f->axis, x);",
        "times_model(g, &theta, f->axis, x), x[0].p[0] += all(1);",
    ),
    "couplings": (
        "add(g, V + i, s->S[l * k + i], &one, V + i)",
        "add(g, V + i, 2, &one, V + i)",
    ),
    "the places of the points": (
        "add(g, f->o + i, 1, points[c] + i, points[c] + i);",
        ";",
    ),
}
"""What is wrong with an arm angle's kernel: a piece of arm_angle.c, and what is put instead."""


def source(name: str, piece: str, instead: str, package: str = PACKAGE) -> str:
    """Read a file of the package, with one piece replaced."""
    text = files(package).joinpath(name).read_text(encoding="utf-8")
    assert not piece or text.count(piece) == 1, (
        f"{piece!r} is there {text.count(piece)} times"
    )
    return text.replace(piece, instead) if piece else text


def wrong(
    monkeypatch: pytest.MonkeyPatch, name: str, piece: str, instead: str
) -> ModuleType:
    """Make a module of the package with one piece replaced."""
    module = ModuleType(f"{PACKAGE}.wrong")
    module.__package__ = PACKAGE
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(source(name, piece, instead), name, "exec"), module.__dict__)
    return module


def compiled(folder: Path, name: str, piece: str, instead: str) -> ctypes.CDLL:
    """Compile the kernels of proofs, a piece of one file replaced; skip without a compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    wrong = folder / f"wrong{len(list(folder.iterdir()))}"
    shutil.copytree(str(files(NATIVE)), wrong, ignore=shutil.ignore_patterns("*.so"))
    text = source(name, piece, instead, NATIVE)
    (wrong / name).write_text(text, encoding="utf-8")
    kernels = {"leaf_margin_bounds.c", name.replace("taylor.h", "cell_bounds.c")}
    flags = ["-std=c99", "-O1", "-w", "-fPIC", "-shared", "-DLEVEL=plain"]
    flags += [f"-D{f}_plain={f}" for f in LEVELLED]
    line = [compiler, *flags, *kernels, "-o", "wrong.so", "-lm"]
    subprocess.run(line, cwd=wrong, check=True)
    return ctypes.CDLL(str(wrong / "wrong.so"))


INVERSE_C = {
    "no R Z_j": ("R[i][c] * first + D[i][c]", "D[i][c]"),
    "half of R Z_j": ("R[i][c] * first +", "0.5 * R[i][c] * first +"),
    "no D R Z_c": (" + D[i][c] * rough[c][k];", ";"),
    "half of D R Z_c": ("D[i][c] * rough[c][k]", "0.5 * D[i][c] * rough[c][k]"),
    "no R Z_c": ("z[k] = Y[i][k] + rough[i][k]", "z[k] = Y[i][k]"),
    "half of R Z_c": ("Y[i][k] + rough[i][k]", "Y[i][k] + 0.5 * rough[i][k]"),
    "no ζ": ("z[k] = Y[i][k] + rough[i][k]", "z[k] = rough[i][k]"),
    "half of ζ": ("z[k] = Y[i][k] +", "z[k] = 0.5 * Y[i][k] +"),
    "R not in D": (
        "D[i][c] = R[i][c] = e + fabs(s)",
        "D[i][c] = 0, R[i][c] = e + fabs(s)",
    ),
    "slopes not in D": ("D[i][c] += h[j] * fabs(s);", ";"),
    "half of them": ("D[i][c] += h[j] * fabs(s);", "D[i][c] += 0.5 * h[j] * fabs(s);"),
    "Z turns the other way": ("dZ[j][i][k] -= s", "dZ[j][i][k] += s"),
    "V without slopes": ("s += x[6 + a] * dV[a][c][j];", ";"),
    "V without rest": (", e += fabs(x[6 + a]) * rest[a][c];", ";"),
    "half of V's rest": (
        "e += fabs(x[6 + a]) * rest",
        "e += 0.5 * fabs(x[6 + a]) * rest",
    ),
    "no rounding of J_V": ("tiny += fabs(x[a]) * round[a];", ";"),
    "no rounding of Z_c": ("eps * (norm(A[i]) * g->beta + norm(A[i] + 3));", "0;"),
    "no rounding of the tool": ("dd) + eps * g->beta;", "dd);"),
    "no rounding of sums": ("F[i][c] = eps;", "F[i][c] = 1e-30;"),
    "no rounding at the end": ("(all + eps) * (1 + 64 * eps)", "all"),
    "J without linear rest": ("tiny + norm(x) * linear[c]", "tiny"),
    "J without angular rest": (" + norm(x + 3) * angular[c];", ";"),
    "no second order": ("F[i][k] += both * fabs(s)", "F[i][k] += 0 * fabs(s)"),
    "half of it": ("F[i][k] += both * fabs(s)", "F[i][k] += 0.5 * both * fabs(s)"),
    "one of two products": ("if (turns[l][c] && l > j)", "if (0)"),
    "one of two products of V": (
        "(l > j ? dV[a][c][l] * dZ[j][c][k] : 0)",
        "0",
    ),
    "no second order of V": (
        "X[6 + a][k] += dV[a][c][j] * dZ[l][c][k]",
        "X[6 + a][k] += 0 * dZ[l][c][k]",
    ),
    "the tool stands still": ("moved += h[j] * norm(dd[j]), ", ""),
    "the tool has no slopes": (
        "dZ[j][i][k] + (k < 3 ? 0 : x[k - 3])",
        "dZ[j][i][k]",
    ),
    "the tool goes straight": ("norm(Z[i]) * bent)", "0)"),
    "half of its bend": (
        "0.5 * H_R * H_R * L + H_R * H_P",
        "0.25 * H_R * H_R * L + H_R * H_P",
    ),
    "no bend of turning and sliding": (
        "0.5 * H_R * H_R * L + H_R * H_P",
        "0.5 * H_R * H_R * L",
    ),
    "no slide": ("cross(xi[p] + 3, tip, x);", "x[0] = x[1] = x[2] = 0;"),
    "no changes times moves": ("(norm(wide) + norm(z)) * moved", "0"),
    "no squares": (
        "+ both + square_v / (2 * v) + ratio * square_w / (2 * w)",
        "+ both",
    ),
    "no linear square": ("+ both + square_v / (2 * v) +", "+ both +"),
    "no angular square": (" + ratio * square_w / (2 * w);", ";"),
    "no slopes along": ("+ both + square_v", "+ square_v"),
    "apart without slopes": (
        "sqrt(v * v + 2 * apart_v + square_v)",
        "sqrt(v * v + square_v)",
    ),
    "apart without angular slopes": (
        "sqrt(w * w + 2 * apart_w + square_w)",
        "sqrt(w * w + square_w)",
    ),
    "apart without squares": ("2 * apart_v + square_v)", "2 * apart_v)"),
    "apart without angular squares": ("2 * apart_w + square_w)", "2 * apart_w)"),
    "the twist about the middle link": (
        "Z[i][3 + k] += x[3 + k];",
        "Z[i][3 + k] = x[3 + k];",
    ),
}
"""What is wrong with the kernel of the rates of G_r, inverse_bounds.c."""

_CELL = "cell_bounds.c"

CELL_V = {
    "no slopes of the normals": (_CELL, "* n + i] * Y[i];", "* n + i] * 0;"),
    "half of these": (_CELL, "* n + i] * Y[i];", "* n + i] * 0.5 * Y[i];"),
    "J at q_ref": (
        _CELL,
        "J_rest[c] = beside[(N + f) * N + c] + linear",
        "J_rest[c] = linear",
    ),
    "J of the middle link at F": (
        _CELL,
        " + linear * away[0][c] + angular * away[1][c];",
        ";",
    ),
    "W is W'": (_CELL, "x += z[y] * most;", ";"),
    "no terms of higher degree": (
        _CELL,
        "double x = at->V_rest[f * n + i] + J_rest[i]",
        "double x = J_rest[i]",
    ),
    "J times the other W": (
        _CELL,
        "product(g, W + x, work->J",
        "product(g, W + 5 - x, work->J",
    ),
    "n_ref' dq_ref without F": (
        _CELL,
        "product(g, &slope, eta + i, &part), add(g, y, -1, &part, y);",
        ";",
    ),
    "of the other sign": (
        _CELL,
        "eta + i, &part), add(g, y, -1, &part, y);",
        "eta + i, &part), add(g, y, 1, &part, y);",
    ),
    "no label": (_CELL, "v -= A[i * N + x] * w->label[x - 6].p[m];", ";"),
    "no moment of the twists": (
        _CELL,
        "add(g, x + i, 1, moment + i, x + i), copy",
        "copy",
    ),
    "the right Jacobian": (
        _CELL,
        "add(g, out + i, -1, &along, out + i);",
        "add(g, out + i, 1, &along, out + i);",
    ),
    "no second order of it": (_CELL, "add(g, out + i, -W[i], &y, out + i);", ";"),
    "derivatives without their factor": (
        _CELL,
        "x->p[m] * power * unit",
        "x->p[m] * unit",
    ),
}
"""What is wrong with V along F: a file, a piece of it, and what is put instead."""
