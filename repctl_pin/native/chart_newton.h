/* Newton's method of a chart, at LANES poses. A Number is a double, or a vector of doubles, one for each pose. Included
   once for each; LANED(name) tells their functions apart. */

/* Sines and cosines: by polynomials, after the nearest quarter turns are removed. */
static void LANED(turns)(const Arm *arm, const Number angle[], Number sine[], Number cosine[]) {
  (void)arm;
  UNFOLDED for (int j = 0; j < JOINTS; j++) {
    const Number a = angle[j], k = NEAREST(a * 0.6366197723675814), half = 0.5 * k, h = half - NEAREST(half);
    const Number odd = 4.0 * h * h, quarter = 0.25 * (k - odd), e = quarter - NEAREST(quarter);
    const Number sign = 1.0 - 8.0 * e * e; /* odd 0 or 1, sign 1 or -1 */
    const Number x = (a - k * 1.5707963267341256) - k * 6.077100506506192e-11, z = x * x;
    const Number s =
        x + x * z * (-0.16666666666666632 + z * (8.33333333332249e-3 + z * (-1.984126982985795e-4
            + z * (2.7557313707070068e-6 + z * (-2.5050760253406863e-8 + z * 1.58969099521155e-10)))));
    const Number c =
        1.0 - (0.5 * z - z * z * (4.16666666666666e-2 + z * (-1.388888888887411e-3 + z * (2.480158728947673e-5
            + z * (-2.7557314351390663e-7 + z * (2.087572321298175e-9 + z * -1.1359647557788195e-11))))));
    sine[j] = sign * ((1.0 - odd) * s + odd * c);
    cosine[j] = sign * ((1.0 - odd) * c - odd * s);
  }
}

/* Sines and cosines from those of angles at most 0.01 away, by the addition theorems. */
static void LANED(turns_on)(const Arm *arm, const Number step[], Number sine[], Number cosine[]) {
  (void)arm;
  UNFOLDED for (int j = 0; j < JOINTS; j++) {
    const Number d = step[j], z = d * d, s = d * (1.0 - z * (0.16666666666666666 - z * 8.333333333333333e-3));
    const Number less = z * (0.5 - z * (0.041666666666666664 - z * 1.388888888888889e-3)); /* 1 - cos(d) */
    const Number up = cosine[j] * s - sine[j] * less, down = sine[j] * s + cosine[j] * less;
    sine[j] += up;
    cosine[j] -= down;
  }
}

/* p and R of the frame, in here; and the origin and the z axis of every joint, in o and z. */
static void LANED(chain)(const Arm *arm, const Number angle[], const Number sine[], const Number cosine[],
                         Number here[12], Number o[][3], Number z[][3]) {
  Number *p = here, *R = here + 3;
  UNFOLDED for (int i = 0; i < 3; i++) p[i] = angle[0] * 0.0 + arm->p[i];
  UNFOLDED for (int i = 0; i < 9; i++) R[i] = angle[0] * 0.0 + arm->R[i];
  UNFOLDED for (int j = 0; j < JOINTS; j++) {
    const double *B = arm->R + 9 * (j + 1), *t = arm->p + 3 * (j + 1);
    Number S[9];
    UNFOLDED for (int i = 0; i < 3; i++) {
      o[j][i] = p[i];
      S[3 * i] = R[3 * i];
      S[3 * i + 1] = R[3 * i + 1];
      S[3 * i + 2] = z[j][i] = R[3 * i + 2];
    }
    if (arm->revolute[j]) {
      const Number c = cosine[j], s = sine[j];
      UNFOLDED for (int i = 0; i < 9; i += 3) {
        S[i] = c * R[i] + s * R[i + 1];
        S[i + 1] = c * R[i + 1] - s * R[i];
      }
    } else
      UNFOLDED for (int i = 0; i < 3; i++) p[i] += S[3 * i + 2] * angle[j];
    UNFOLDED for (int k = 0; k < 3; k++) { /* quarter turns have one entry in each column */
      const double a = B[k], b = B[3 + k], d = B[6 + k];
      if (t[k] != 0.0)
        UNFOLDED for (int i = 0; i < 3; i++) p[i] += S[3 * i + k] * t[k];
      if (b == 0.0 && d == 0.0)
        UNFOLDED for (int i = 0; i < 9; i += 3) R[i + k] = S[i] * a;
      else if (a == 0.0 && b == 0.0)
        UNFOLDED for (int i = 0; i < 9; i += 3) R[i + k] = S[i + 2] * d;
      else if (a == 0.0 && d == 0.0)
        UNFOLDED for (int i = 0; i < 9; i += 3) R[i + k] = S[i + 1] * b;
      else
        UNFOLDED for (int i = 0; i < 9; i += 3) R[i + k] = S[i] * a + S[i + 1] * b + S[i + 2] * d;
    }
  }
}

/* J_V, the Jacobian and n_ref^T, its rows and columns at their places in the order of elimination. */
static void LANED(fill)(const Arm *arm, const Chart *chart, const Number here[12], Number o[][3], Number z[][3],
                        const Number both[], Number A[][N]) {
  const int *row = chart->row, *column = chart->column;
  const Number *R = here + 3, none = here[0] * 0.0;
  for (int a = 0; a < M && arm->coupled; a++)
    for (int i = 0; i < N; i++) A[row[a]][i] = none;
  UNFOLDED for (int j = 0; j < JOINTS; j++) {
    const Number x = z[j][0], y = z[j][1], w = z[j][2];
    const Number d[3] = {here[0] - o[j][0], here[1] - o[j][1], here[2] - o[j][2]};
    Number part[6] = {x, y, w, none, none, none};
    if (arm->revolute[j]) {
      part[0] = y * d[2] - w * d[1];
      part[1] = w * d[0] - x * d[2];
      part[2] = x * d[1] - y * d[0];
      UNFOLDED for (int k = 0; k < 3; k++) part[3 + k] = arm->kind == AXIS ? R[k] * x + R[3 + k] * y + R[6 + k] * w : z[j][k];
    }
    UNFOLDED for (int a = 0; a < M; a++) {
      const Number entry = part[arm->kind == POSITION ? arm->rows[a] : a];
      if (!arm->coupled)
        A[row[a]][column[j]] = entry;
      else
        UNFOLDED for (int i = 0; i < N; i++) A[row[a]][column[i]] += arm->S[j * N + i] * entry;
    }
  }
  UNFOLDED for (int j = 0; j < N - M; j++)
    UNFOLDED for (int i = 0; i < N; i++) A[row[M + j]][column[i]] = both[Q_WIDE + j * N + i];
}

/* The right-hand side of a Newton step, b: the task error to the goal, and c - h. Sines stand for the angles: for a
   pose, half of the skew part of R* R^T; for an axis, its sines about the tool's x and y. They vanish with the rotation
   error. cosine has the sign of the cosine of that error. */
static void LANED(errors)(const Arm *arm, const Chart *chart, const Number goal[12], const Number here[12],
                          const Number both[], const Number level[], const Number q[], Number b[], Number *cosine) {
  const int *row = chart->row;
  const Number *G = goal + 3, *R = here + 3;
  *cosine = goal[0] * 0.0 + 1.0;
  for (int a = 0; a < M && a < 3; a++) {
    const int at = arm->kind == POSITION ? arm->rows[a] : a;
    b[row[a]] = goal[at] - here[at];
  }
  if (arm->kind == POSE) {
    Number E[9];
    UNFOLDED for (int j = 0; j < 3; j++)
      UNFOLDED for (int k = 0; k < 3; k++)
        E[3 * j + k] = G[3 * j] * R[3 * k] + G[3 * j + 1] * R[3 * k + 1] + G[3 * j + 2] * R[3 * k + 2];
    b[row[3]] = 0.5 * (E[7] - E[5]);
    b[row[4]] = 0.5 * (E[2] - E[6]);
    b[row[5]] = 0.5 * (E[3] - E[1]);
    *cosine = E[0] + E[4] + E[8] - 1.0;
  }
  if (arm->kind == AXIS) {
    const Number x = G[2], y = G[5], w = G[8];
    b[row[3]] = -(R[1] * x + R[4] * y + R[7] * w);
    b[row[4]] = R[0] * x + R[3] * y + R[6] * w;
    *cosine = R[2] * x + R[5] * y + R[8] * w;
  }
  UNFOLDED for (int j = 0; j < N - M; j++) {
    Number sum = level[j];
    UNFOLDED for (int i = 0; i < N; i++) sum += both[Q_WIDE + j * N + i] * (both[i] - q[i]);
    b[row[M + j]] = sum;
  }
}

/* Factor A = L U in place, without exchanges, with 1 / U on the diagonal; return the sum of the squares of 1 / U. */
static void LANED(eliminate)(const Arm *arm, Number A[][N], Number *squares) {
  (void)arm;
  *squares = A[0][0] * 0.0;
  UNFOLDED for (int k = 0; k < N; k++) {
    const Number scale = 1.0 / A[k][k];
    A[k][k] = scale;
    *squares += scale * scale;
    UNFOLDED for (int i = k + 1; i < N; i++) {
      const Number f = A[i][k] * scale;
      A[i][k] = f;
      UNFOLDED for (int j = k + 1; j < N; j++) A[i][j] -= f * A[k][j];
    }
  }
}

static void LANED(substitute)(const Arm *arm, Number A[][N], Number b[]) {
  (void)arm;
  UNFOLDED for (int k = 0; k < N; k++) {
    const Number known = b[k];
    UNFOLDED for (int i = k + 1; i < N; i++) b[i] -= A[i][k] * known;
  }
  UNFOLDED for (int k = N - 1; k >= 0; k--) {
    const Number known = b[k] * A[k][k];
    b[k] = known;
    UNFOLDED for (int i = 0; i < k; i++) b[i] -= A[i][k] * known;
  }
}

/* Solve f(q) = goal and n_ref^T (q - q_ref) = level from a nearby q, by Newton's method, which keeps the
   factors of J_V after steps below 2e-5. state is 1.0 where q is exact to 3e-14, -1.0 where another method is needed. */
static void LANED(settle)(const Arm *arm, const Chart *chart, const Number goal[12], const Number both[],
                          const Number level[], Number q[], double state[LANES]) {
  Number A[N][N], b[N], here[12], o[JOINTS][3], z[JOINTS][3], angle[JOINTS], step[JOINTS], sine[JOINTS], cosine[JOINTS];
  Number squares = q[0] * 0.0, near, sum, open = squares + 1.0;
  double before[LANES], longest = 1.0;
  int left = 1;
  for (int l = 0; l < LANES; l++) {
    before[l] = 1.0;
    state[l] = 0.0;
  }
  UNFOLDED for (int j = 0; j < JOINTS; j++) angle[j] = sine[j] = cosine[j] = q[0] * 0.0;
  for (int i = 0; i < N; i++) /* the first turn fills it, which no compiler sees */
    UNFOLDED for (int j = 0; j < N; j++) A[i][j] = q[0] * 0.0;
  for (int turn = 0; turn < 8 && left; turn++) {
    const int fresh = longest > 2e-5;
    UNFOLDED for (int j = 0; j < JOINTS; j++) {
      Number theta = q[j];
      if (arm->coupled) {
        theta = q[0] * 0.0 + arm->offset[j];
        UNFOLDED for (int i = 0; i < N; i++) theta += arm->S[j * N + i] * q[i];
      }
      step[j] = theta - angle[j];
      angle[j] = theta;
    }
    if (longest > 0.01)
      LANED(turns)(arm, angle, sine, cosine);
    else
      LANED(turns_on)(arm, step, sine, cosine);
    LANED(chain)(arm, angle, sine, cosine, here, o, z);
    if (fresh) {
      LANED(fill)(arm, chart, here, o, z, both, A);
      LANED(eliminate)(arm, A, &squares);
    }
    LANED(errors)(arm, chart, goal, here, both, level, q, b, &near);
    LANED(substitute)(arm, A, b);
    sum = b[0] * 0.0;
    UNFOLDED for (int i = 0; i < N; i++) {
      const Number d = b[chart->column[i]];
      q[i] += d * open;
      sum += d * d;
    }
    longest = 0.0;
    left = 0;
    for (int l = 0; l < LANES; l++) {
      /* the size of the next step: with new factors, steps fall as their squares, else by a ratio */
      const double size = sqrt(LANE(sum, l)), ratio = size / before[l], fall = ratio / before[l];
      const double next = fresh ? (fall > 1.0 ? fall : 1.0) * size * size : ratio * size;
      if (!(LANE(squares, l) < 1e12 && LANE(near, l) > 0.0 && size < 0.1)) state[l] = -1.0;
      if (state[l] == 0.0 && next < 3e-14) state[l] = 1.0;
      if (state[l] == 0.0) {
        left = 1;
        if (size > longest) longest = size;
      }
      LANE(open, l) = state[l] == 0.0 ? 1.0 : 0.0;
      before[l] = size;
    }
  }
}
