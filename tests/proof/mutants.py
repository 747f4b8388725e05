"""Wrong versions of the bounds of a proof: a term dropped, halved, or of the other sign."""

from __future__ import annotations

import sys
from importlib.resources import files
from types import ModuleType

import pytest

PACKAGE = "repctl_pin.extensions.proof"
NATIVE = "repctl_pin.native"

SCREWS = {
    "half of a turning joint's rest": (
        "? 0.5 * by.H_R * by.H_R * by.L + by.H_R * by.H_P",
        "? 0.25 * by.H_R * by.H_R * by.L + by.H_R * by.H_P",
    ),
    "no product of turning and sliding": ("by.H_R * by.L + by.H_R * by.H_P", "by.H_R * by.L"),
    "half of that product": (
        "by.H_R * by.L + by.H_R * by.H_P",
        "by.H_R * by.L + 0.5 * by.H_R * by.H_P",
    ),
    "minus the product": ("by.H_R * by.L + by.H_R * by.H_P", "by.H_R * by.L - by.H_R * by.H_P"),
    "half of a sliding joint's rest": (": 0.5 * by.H_R * by.H_R;\n", ": 0.25 * by.H_R * by.H_R;\n"),
    "half of the angular rest": ("? 0.5 * by.H_R * by.H_R : 0", "? 0.25 * by.H_R * by.H_R : 0"),
    "no angular rest": ("? 0.5 * by.H_R * by.H_R : 0", "? 0 : 0"),
    "no lengths of slides": (
        "by.H_P += moved[p], by.L += fabs",
        "by.H_P += moved[p], by.L += 0 * fabs",
    ),
}
"""What is wrong with the remainders of screws: a piece of leaf_margin_bounds.c, and what is put in
its place."""

POTENTIALS_C = {
    "half of V's rest": ("rest[a][i] = 0.5 * e", "rest[a][i] = 0.25 * e"),
    "no fourth derivatives": ("(l > j ? 2 : 1) + t / 3)", "(l > j ? 2 : 1))"),
    "half of the fourth derivatives": ("(l > j ? 2 : 1) + t / 3)", "(l > j ? 2 : 1) + t / 6)"),
    "no third derivatives": ("e += *T++ * (h[j] * h[l]);", "T++;"),
    "no third derivatives at the centre": ("(fabs(s) * (l > j", "(0 * fabs(s) * (l > j"),
}
"""What is wrong with V's remainder: a piece of leaf_margin_bounds.c, and what is put instead."""

EXPANSION = {
    "no linear rest": ("e += norm(x) * linear[f][c] + norm", "e += norm"),
    "no angular rest": (" + norm(x + 3) * angular[f][c];", ";"),
    "V without rest": ("e += fabs(A[i][m + a]) * rest[a][c]", "e += 0"),
    "no rounding": ("tiny += fabs(A[i][a]) * round[a]", "tiny += 0"),
    "A is exact": ("R[i][c] = e + fabs(s)", "R[i][c] = e"),
    "V without slopes": ("add_times(N, dV[a][c][j],", "add_times(N, 0 * dV[a][c][j],"),
    "J without slopes": ("add_times(N, dJ[j][c][a],", "add_times(N, 0 * dJ[j][c][a],"),
    "slopes of the other frame": ("A_T[m + a], B[j][c]", "A_T[a], B[j][c]"),
}
"""What is wrong with the expansion of J_V: a piece of leaf_margin_bounds.c, and what is put
instead."""

C = {
    "no products of slopes": ("add_sizes(N, both, S[a]", "add_sizes(N, 0, S[a]"),
    "half the products": ("add_sizes(N, both, S[a]", "add_sizes(N, 0.5 * both, S[a]"),
    "one of two products": ("a < w && on[l][c] && l > j", "0"),
    "no R N_j": ("+= R[i][c] * first[c][a] + D", "+= D"),
    "no D R X": (" + D[i][c] * rough[c][a];", ";"),
    "half of D R X": ("D[i][c] * rough[c][a]", "0.5 * D[i][c] * rough[c][a]"),
    "R not in D": ("D[i][c] = R[i][c] + sum[c][i]", "D[i][c] = sum[c][i]"),
    "half of R in D": ("D[i][c] = R[i][c] + sum", "D[i][c] = 0.5 * R[i][c] + sum"),
    "slopes not in D": ("R[i][c] + sum[c][i]", "R[i][c]"),
    "no R X": ("e[i][a] = rough[i][a] + Y[i][m + a]", "e[i][a] = Y[i][m + a]"),
    "no z": ("e[i][a] = rough[i][a] + Y[i][m + a]", "e[i][a] = rough[i][a]"),
    "half of z": ("rough[i][a] + Y[i][m + a]", "rough[i][a] + 0.5 * Y[i][m + a]"),
    "N turns the other way": ("add_times(N, -Z[c][a]", "add_times(N, Z[c][a]"),
    "V_c not taken out of P": ("dP[i][a] -= V[c][i] * s;", ";"),
    "V's slopes not in M": ("M[a][c] += h[j] * fabs(s);", ";"),
    "V's rest not in M": ("s += rest[a][i] * fabs(V[c][i]);", ";"),
    "V's rest not projected": ("s += fabs(V[c][i]) * fabs(V[c][l]) * rest[a][l];", ";"),
    "V's rest forgotten": ("double s = rest[a][i] + defect", "double s = defect"),
    "M not at all": ("loose[i][a] += row, all", "all"),
    "M once": ("row = sqrt(row) * turned / (1 - turned)", "row = sqrt(row) * turned"),
    "β without slopes of N": ("all[i][a] * (first[i][c] + e[i][c])", "all[i][a] * e[i][c]"),
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
    "ρ not in |S − T_c|": ("(wide[i][c] + m[c]) * b", "wide[i][c] * b"),
    "S without P": ("s = dN[j][i][a] - dP[i][a]", "s = dN[j][i][a]"),
    "S with P added": ("s = dN[j][i][a] - dP[i][a]", "s = dN[j][i][a] + dP[i][a]"),
    "S without the product": ("s -= T[i][c] * PT[c][a]", ""),
    "no first order of SᵀS": ("K[a][c] += s, part", "part"),
    "half of the first order": ("K[a][c] += s, part", "K[a][c] += 0.5 * s, part"),
    "half of T_c ρ": (" + e[i][a] * fabs(T[i][c]) + (wide", " + (wide"),
    "no square": (" + (wide[i][a] + e[i][a]) * (wide[i][c] + e[i][c]);", ";"),
    "the margin without P": ("most * (1 + size * size * slack)", "most"),
    "half of S": ("sqrt(1 + most * (1", "sqrt(1 + 0.5 * most * (1"),
}
"""What is wrong with the leaf margin: a piece of leaf_margin_bounds.c, and what is put in its
place."""


POTENTIALS = {
    "powers' factors forgotten": ("by_m * size / scale[m]", "size / scale[m]"),
    "fourth derivatives at the centre": (
        "= [self.arguments[v].most for v in z]",
        "= [0.0] * len(z)",
    ),
    "one scale missing": ("by_l / scale[l]", "by_l"),
    "half of a third power": ("+= np.abs(cubic)", "+= 0.5 * np.abs(cubic)"),
}
"""What is wrong with the bounds of V's derivatives in potentials.py."""


TAYLOR = {
    "no products of degree 1 and 3": ("r = a[1] * b[3] + a[2]", "r = a[2]"),
    "no squares of degree 2": ("a[2] * (b[2] + b[3])", "a[2] * b[3]"),
    "no products of degree 2 and 3": ("a[2] * (b[2] + b[3])", "a[2] * b[2]"),
    "no products of degree 3 and 1": ("a[3] * (b[1] + b[2]", "a[3] * (b[2]"),
    "half of degree 3": ("+ a[3] * (b[1]", "+ 0.5 * a[3] * (b[1]"),
    "the left rest dropped": ("x->r * two + ", ""),
    "the right rest dropped": ("one * y->r + ", ""),
    "both rests dropped": ("x->r * y->r + ", ""),
    "a rest dropped in a sum": ("fabs(a) * x->r + fabs(b) * y->r", "fabs(a) * x->r"),
    "the other rest dropped": ("fabs(a) * x->r + fabs(b) * y->r", "fabs(b) * y->r"),
    "a negative factor": ("{fabs(a[0]), fabs(a[1]), fabs(a[2])}", "{a[0], a[1], a[2]}"),
    "a sine of the other sign": ("{s, c, -0.5 * s, -c / 6}", "{s, c, 0.5 * s, -c / 6}"),
    "a cosine's third term": ("-0.5 * c, s / 6}", "-0.5 * c, -s / 6}"),
    "half of the sine's rest": ("f, 1. / 24, ROUND, sine", "f, 1. / 48, ROUND, sine"),
    "half of the cosine's rest": ("e, 1. / 24, ROUND", "e, 1. / 48, ROUND"),
    "no rest of a series": ("r = fourth * most * most", "r = 0 * most * most"),
    "a smaller fourth derivative": ("fourth = 1. / 40320", "fourth = 1. / 80640"),
    "a power without rest": ("/ 24 * pow(least, s - 4)", "* 0"),
    "half of a power's rest": ("/ 24 * pow(least, s - 4)", "/ 48 * pow(least, s - 4)"),
    "a power's rest at the centre": ("pow(least, s - 4)", "pow(c, s - 4)"),
    "a third of a power's second term": ("((i + 1) * c)", "((i + 2) * c)"),
    "a power's sign": ("v * ((s - i)", "v * ((i - s)"),
}
"""What is wrong with Taylor models: a piece of taylor.h, and what is put in its place."""


COMMUTATOR = {
    "joints beyond forgotten": ("p >= g->k) K += s->tips[p]", "0) K += s->tips[p]"),
    "half of the joints beyond": ("K += s->tips[p] *", "K += 0.5 * s->tips[p] *"),
    "joint l forgotten": ("for (int p = l; p < P; p++)", "for (int p = l + 1; p < P; p++)"),
    "joints between forgotten": ("K += s->tips[l] * H_R;", ";"),
    "half of the joints between": ("K += s->tips[l] * H_R;", "K += 0.5 * s->tips[l] * H_R;"),
    "prismatic joints forgotten": ("if (!g->revolute[p]) K += step[p];", "if (!g->revolute[p]) ;"),
    "turned prismatic joints": ("} else K = H_R;", "} else K = 0;"),
}
"""What is wrong with the bounds of two solutions: a piece of cell_bounds.c, and what is put in its
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
    "the tilt of the other sign": (
        _CELL,
        "back[3] = {-b[0], -b[3], -b[6]}",
        "back[3] = {b[0], b[3], b[6]}",
    ),
    "joints towards the base turn forwards": (_CELL, "if (sign < 0) scale", "if (0) scale"),
    "the frame's place forgotten": (_CELL, "add_vectors(g, e, -1, f->tip, e);", ";"),
    "no rest in J": (
        _CELL,
        "* (y->r + s->eps * size_of(y));\n      }\n      rest",
        "* 0;\n      }\n      rest",
    ),
    "no higher degrees in J": (_CELL, "if (m > k) e += absolute(v);", "if (m > k) e += 0;"),
    "no slopes beside the chart": (_CELL, "e += fabs(B[(j * rows + i) * N + c]) * mean[j];", ";"),
    "no remainder of screws": (_CELL, "norm(x) * (two_v[c] - one_v[c] * (1 - 1e-12))", "0"),
    "no angular remainder": (_CELL, " + norm(x + 3) * (two_w[c] - one_w[c] * (1 - 1e-12));", ";"),
    "the way not turned": (
        _CELL,
        "linear += turned * (at->e + at->p * angle + at->e * angle) +",
        "linear +=",
    ),
    "the middle link not moved": (_CELL, " + moved * angle;", ";"),
    "no linear part of it": (_CELL, "at->step[i] + norms[2 * i] * linear", "at->step[i]"),
}
"""What is wrong with a cell's kernel: the file, a piece of it, and what is put in its place."""

ARM = {
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

ARM_C = {
    "no connection": (
        "add_vectors(g, F[2], -1, F[0], F[2]);",
        "constants(g, NO_VECTOR, F[2]), add_vectors(g, F[2], -1, F[0], F[2]);",
    ),
    "the elbow's force without ρ": (
        "product(g, &rho, &lever, &x), times_model",
        "copy(g, &lever, &x), times_model",
    ),
    "r × w for w × r": ("cross_constant(g, back, w, b);", "cross_constant(g, d, w, b);"),
    "offsets forgotten": ("constant(g, s->o[l], &theta);", "constant(g, 0, &theta);"),
    "the connection's sign": ("back[3] = {-d[0], -d[1], -d[2]}", "back[3] = {-d[0], d[1], -d[2]}"),
    "the shoulder": ("scale(g, -1, F[0] + i);", ";"),
    "t on the other side": ("add(g, &rho, -1, &along, &x)", "add(g, &rho, 1, &along, &x)"),
    "the wrist's force": ("add_vectors(g, F[2], -1, F[0], F[2]);", ";"),
    "the wrist's moment": ("add_vectors(g, whole, 1, x, whole);", ";"),
    "moments about the base": (
        "add_vectors(g, points[c], -1, f->origin, way)",
        "copy_vector(g, points[c], way)",
    ),
    "prismatic joints": (
        "times_model(g, &theta, f->axis, x);",
        "times_model(g, &theta, f->axis, x), x[0].p[0] += all(1);",
    ),
    "couplings": ("add(g, V + i, s->S[l * k + i], &one, V + i)", "add(g, V + i, 2, &one, V + i)"),
    "the places of the points": ("add_vectors(g, f->o, 1, points[c], points[c]);", ";"),
}
"""What is wrong with an arm angle's kernel: a piece of arm_angle.c, and what is put instead."""


def source(name: str, piece: str, instead: str, package: str = PACKAGE) -> str:
    """Read a file of the package, with one piece replaced."""
    text = files(package).joinpath(name).read_text(encoding="utf-8")
    assert not piece or text.count(piece) == 1, f"{piece!r} is there {text.count(piece)} times"
    return text.replace(piece, instead) if piece else text


def wrong(monkeypatch: pytest.MonkeyPatch, name: str, piece: str, instead: str) -> ModuleType:
    """Make a module of the package with one piece replaced."""
    module = ModuleType(f"{PACKAGE}.wrong")
    module.__package__ = PACKAGE
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(source(name, piece, instead), name, "exec"), module.__dict__)
    return module


INVERSE_C = {
    "no R Z_c": ("+ rough[i][6 * f + k];", ";"),
    "half of R Z_c": ("+ rough[i][6 * f + k]", "+ 0.5 * rough[i][6 * f + k]"),
    "no ζ": ("z[k] = Y[i][6 * f + k] +", "z[k] ="),
    "half of ζ": ("z[k] = Y[i][6 * f + k] +", "z[k] = 0.5 * Y[i][6 * f + k] +"),
    "no rounding of Z_c": ("g->eps * (norm(x) * g->beta + norm(x + 3));", "0;"),
    "no rounding of the tool": ("dd) + g->eps * g->beta;", "dd);"),
    "no rounding of sums": ("F[i][c] = eps;", "F[i][c] = 1e-30;"),
    "no rounding at the end": ("(all + eps) * (1 + 64 * eps)", "all"),
    "the tool stands still": ("moved[f] += h[j] * norm(dd[f][j]);", ";"),
    "the tool has no slopes": (
        "dZ[j][i][6 * f + k] + (k < 3 ? 0 : x[k - 3])",
        "dZ[j][i][6 * f + k]",
    ),
    "the tool goes straight": ("norm(value) * bent[f])", "0)"),
    "half of its bend": (
        "0.5 * by.H_R * by.H_R * by.L + by.H_R * by.H_P",
        "0.25 * by.H_R * by.H_R * by.L + by.H_R * by.H_P",
    ),
    "no bend of turning and sliding": (
        "0.5 * by.H_R * by.H_R * by.L + by.H_R * by.H_P",
        "0.5 * by.H_R * by.H_R * by.L",
    ),
    "no slide": ("cross(xi[p] + 3, tip, x);", "x[0] = x[1] = x[2] = 0;"),
    "no changes times moves": ("(norm(wide) + norm(z)) * moved[f]", "0"),
    "no squares": ("+ both + row.square", "+ both"),
    "no linear square": ("+= square_v / (2 * v) +", "+="),
    "no angular square": (" + ratio * square_w / (2 * w);", ";"),
    "no slopes along": ("+ both + row.square", "+ row.square"),
    "apart without slopes": ("sqrt(v * v + 2 * apart_v + square_v)", "sqrt(v * v + square_v)"),
    "apart without angular slopes": (
        "sqrt(w * w + 2 * apart_w + square_w)",
        "sqrt(w * w + square_w)",
    ),
    "apart without squares": ("2 * apart_v + square_v)", "2 * apart_v)"),
    "apart without angular squares": ("2 * apart_w + square_w)", "2 * apart_w)"),
    "the twist about the middle link": ("z[3 + k] += x[3 + k];", "z[3 + k] = x[3 + k];"),
}
"""What is wrong with the kernel of the rates of G_r, inverse_bounds.c."""

_CELL = "cell_bounds.c"

BENT = {
    "no bend": (_CELL, "add(g, p + i, along, side, p + i);", ";"),
    "the radius twice": (_CELL, ", add(g, side, -1, &radius, side);", ";"),
    "no stretch": (
        _CELL,
        "add_product(g, side + 1, &radius, 1, side),",
        "add(g, side, 1, &radius, side),",
    ),
    "the twist of the radius not stretched": (
        _CELL,
        "copy(g, side + 1, twists[s->radial] + i),",
        "constant(g, 1, twists[s->radial] + i),",
    ),
    "the height moves straight": (
        _CELL,
        "add(g, twists[s->upright] + i, along, slope, twists[s->upright] + i);",
        ";",
    ),
    "no slope of the stretch": (_CELL, "add_product(g, slope + 1, &radius, 1, slope);", ";"),
    "slopes without the sides": (
        _CELL,
        "add(g, &part, 1, side + i, slope + i);",
        "copy(g, &part, slope + i);",
    ),
    "the stretch for the bend": (
        _CELL,
        "s->profile + i * (s->bent + 1)",
        "s->profile + (s->bent + 1)",
    ),
    "one degree less": (_CELL, "constant(g, c[s->bent], side + i)", "constant(g, 0, side + i)"),
    "half of the rest of the sides": (
        _CELL,
        "add_product(g, side + i, height, 1, &part), copy",
        "add_product(g, side + i, height, 1, &part), part.r *= 0.5, copy",
    ),
    "no rest of y s": (
        _CELL,
        "add_product(g, side + 1, &radius, 1, side),",
        "add_product(g, side + 1, &radius, 1, side), side->r = all(0),",
    ),
    "half of the rest of the slopes": (
        _CELL,
        "add_product(g, slope + 1, &radius, 1, slope);",
        "add_product(g, slope + 1, &radius, 1, slope), slope->r *= 0.5;",
    ),
}
"""What is wrong with the poses of a sector whose range of radius depends on the height."""

CELL_V = {
    "no slopes of the normals": (_CELL, "* n + i] * Y[i];", "* n + i] * 0;"),
    "half of these": (_CELL, "* n + i] * Y[i];", "* n + i] * 0.5 * Y[i];"),
    "J at q_ref": (_CELL, "J_rest[c] = beside[(N + f) * N + c] + linear", "J_rest[c] = linear"),
    "J of the middle link at F": (_CELL, " + linear * away[0][c] + angular * away[1][c];", ";"),
    "W is W'": (_CELL, "x += z[y] * most;", ";"),
    "no terms of higher degree": (
        _CELL,
        "double x = at->V_rest[f * n + i] + J_rest[i]",
        "double x = J_rest[i]",
    ),
    "J times the other W": (_CELL, "product(g, W + x, work->J", "product(g, W + 5 - x, work->J"),
    "n_ref' dq_ref without F": (_CELL, "add_product(g, &slope, eta + i, -1, y);", ";"),
    "of the other sign": (
        _CELL,
        "add_product(g, &slope, eta + i, -1, y);",
        "add_product(g, &slope, eta + i, 1, y);",
    ),
    "no label": (_CELL, "v -= A[i * N + x] * w->label[x - 6].p[m];", ";"),
    "no moment of the twists": (_CELL, "add_vectors(g, x, 1, moment, x), ", ""),
    "the right Jacobian": (
        _CELL,
        "add_product(g, d, turned + i, -1, out + i);",
        "add_product(g, d, turned + i, 1, out + i);",
    ),
    "no second order of it": (_CELL, "add(g, out + i, -W[i], &y, out + i);", ";"),
    "derivatives without their factor": (_CELL, "x->p[m] * power * unit", "x->p[m] * unit"),
}
"""What is wrong with V along F: a file, a piece of it, and what is put instead."""

ONLY = {
    "F beyond d*": (_CELL, "if (!(away <= d)) return -1;", ";"),
    "d* from q_0": (_CELL, "near[i] = d + at->beside[i], reach", "near[i] = d, reach"),
    "half of the distance from c": (
        _CELL,
        "near[i] = d + at->beside[i], reach",
        "near[i] = d + 0.5 * at->beside[i], reach",
    ),
    "F is q_0": (_CELL, "away = (Y[i] + at->beside[i])", "away = (at->beside[i])"),
    "q_0 is c": (_CELL, "away = (Y[i] + at->beside[i])", "away = (Y[i])"),
    "the other solution from c": (_CELL, "reach[i] = d + away;", "reach[i] = d;"),
    "the first distance": (_CELL, "F, Z)) return level;", "F, Z)) return 0;"),
    "the largest distance only": (
        _CELL,
        "double d = s->near[level * n + i]",
        "double d = s->near[i]",
    ),
    "the slopes at F": (_CELL, "Y[i] + 0.5 * reach[i] : near[i]", "0.5 * reach[i] : near[i]"),
    "no way to the other": (_CELL, "Y[i] + 0.5 * reach[i] : near[i]", "Y[i] : near[i]"),
    "no commutator": (_CELL, "if (commutator(s, norms, reach, D) && ", "if ("),
    "a commutator of d*": (
        _CELL,
        "commutator(s, norms, reach, D)",
        "commutator(s, norms, near, D)",
    ),
    "no slopes beside q_0": (
        _CELL,
        "beside_chart(s, N, N, A, B, at->q, at->wide, near, mean, R);",
        ";",
    ),
    "no distance from c": (
        _CELL,
        "beside[i] = shift[(box * n + i) * (2 + k) + 1 + k];",
        "beside[i] = 0;",
    ),
    "a slope for it": (
        _CELL,
        "shift[(box * n + i) * (2 + k) + 1 + k]",
        "shift[(box * n + i) * (2 + k) + k]",
    ),
    "not the only one": (_CELL, "if (out->level[box] < 0) return;", ";"),
}
"""What is wrong with the distance within which F is the only solution."""
