/* The chart at LANES poses at once: the last index of every array is the pose. Included once for each number of lanes. */

#define LANED_AS(name, lanes) name##_##lanes
#define LANED_WITH(name, lanes) LANED_AS(name, lanes)
#define LANED(name) LANED_WITH(name, LANES)

/* The monomials of u. */
static void LANED(monomials)(const Chart *chart, double u[][LANES], double T[][LANES]) {
  for (int l = 0; l < LANES; l++) T[0][l] = 1.0;
  for (int a = 1; a < chart->terms; a++)
    for (int l = 0; l < LANES; l++) T[a][l] = T[chart->parent[a]][l] * u[chart->factor[a]][l];
}

/* q_ref and n_ref^T from the monomials, four at a time. */
static void LANED(references)(const Arm *arm, const Chart *chart, double T[][LANES], double sum[restrict][LANES]) {
  const double *w = chart->weights;
  for (int i = 0; i < WIDE; i++)
    for (int l = 0; l < LANES; l++) sum[i][l] = 0.0;
  for (int a = 0; a < chart->both; a += 4, w += 4 * WIDE)
    for (int i = 0; i < WIDE; i++)
      for (int l = 0; l < LANES; l++)
        sum[i][l] += T[a][l] * w[i] + T[a + 1][l] * w[WIDE + i]
                     + (T[a + 2][l] * w[2 * WIDE + i] + T[a + 3][l] * w[3 * WIDE + i]);
  for (int a = chart->both; a < chart->terms; a += 4, w += 4 * Q_WIDE)
    for (int i = 0; i < Q_WIDE; i++)
      for (int l = 0; l < LANES; l++)
        sum[i][l] += T[a][l] * w[i] + T[a + 1][l] * w[Q_WIDE + i]
                     + (T[a + 2][l] * w[2 * Q_WIDE + i] + T[a + 3][l] * w[3 * Q_WIDE + i]);
}

/* Sines and cosines: by polynomials, after the nearest quarter turns are removed. */
static void LANED(turns)(const Arm *arm, double angle[][LANES], double sine[][LANES], double cosine[][LANES]) {
  for (int j = 0; j < JOINTS; j++)
    for (int l = 0; l < LANES; l++) {
      const double a = angle[j][l], k = NEAREST(a * 0.6366197723675814), half = 0.5 * k;
      const double odd = 2.0 * fabs(half - NEAREST(half)), quarter = 0.25 * (k - odd);
      const double sign = 1.0 - 4.0 * fabs(quarter - NEAREST(quarter)); /* odd 0 or 1, sign 1 or -1 */
      const double x = (a - k * 1.5707963267341256) - k * 6.077100506506192e-11, z = x * x;
      const double s =
          x + x * z * (-0.16666666666666632 + z * (8.33333333332249e-3 + z * (-1.984126982985795e-4
              + z * (2.7557313707070068e-6 + z * (-2.5050760253406863e-8 + z * 1.58969099521155e-10)))));
      const double c =
          1.0 - (0.5 * z - z * z * (4.16666666666666e-2 + z * (-1.388888888887411e-3 + z * (2.480158728947673e-5
              + z * (-2.7557314351390663e-7 + z * (2.087572321298175e-9 + z * -1.1359647557788195e-11))))));
      sine[j][l] = sign * ((1.0 - odd) * s + odd * c);
      cosine[j][l] = sign * ((1.0 - odd) * c - odd * s);
    }
}

/* Sines and cosines from those of angles at most 0.01 away, by the addition theorems. */
static void LANED(turns_on)(const Arm *arm, double was[][LANES], double angle[][LANES], double sine[][LANES],
                            double cosine[][LANES]) {
  for (int j = 0; j < JOINTS; j++)
    for (int l = 0; l < LANES; l++) {
      const double d = angle[j][l] - was[j][l], z = d * d;
      const double s = d * (1.0 - z * (0.16666666666666666 - z * 8.333333333333333e-3));
      const double less = z * (0.5 - z * (0.041666666666666664 - z * 1.388888888888889e-3)); /* 1 - cos(d) */
      const double up = cosine[j][l] * s - sine[j][l] * less, down = sine[j][l] * s + cosine[j][l] * less;
      sine[j][l] += up;
      cosine[j][l] -= down;
    }
}

/* p and R of the frame, in here; and the origin and the z axis of every joint, in o and z. */
static void LANED(chain)(const Arm *arm, double angle[][LANES], double sine[][LANES], double cosine[][LANES],
                         double here[12][LANES], double o[][3][LANES], double z[][3][LANES]) {
  double(*p)[LANES] = here, (*R)[LANES] = here + 3, S[9][LANES];
  for (int l = 0; l < LANES; l++) {
    for (int i = 0; i < 3; i++) p[i][l] = arm->p[i];
    for (int i = 0; i < 9; i++) R[i][l] = arm->R[i];
  }
  for (int j = 0; j < JOINTS; j++) {
    const double *B = arm->R + 9 * (j + 1), *t = arm->p + 3 * (j + 1);
    const int turns = arm->revolute[j];
    for (int i = 0; i < 3; i++)
      for (int l = 0; l < LANES; l++) {
        const double x = R[3 * i][l], y = R[3 * i + 1][l], c = cosine[j][l], s = sine[j][l];
        o[j][i][l] = p[i][l];
        S[3 * i + 2][l] = z[j][i][l] = R[3 * i + 2][l];
        S[3 * i][l] = turns ? c * x + s * y : x;
        S[3 * i + 1][l] = turns ? c * y - s * x : y;
        p[i][l] += S[3 * i][l] * t[0] + S[3 * i + 1][l] * t[1] + S[3 * i + 2][l] * (turns ? t[2] : t[2] + angle[j][l]);
      }
    for (int k = 0; k < 3; k++)
      for (int i = 0; i < 3; i++)
        for (int l = 0; l < LANES; l++)
          R[3 * i + k][l] = S[3 * i][l] * B[k] + S[3 * i + 1][l] * B[3 + k] + S[3 * i + 2][l] * B[6 + k];
  }
}

/* Rows and columns of J_V, the Jacobian and n_ref^T, at their places in the order of elimination. */
static void LANED(fill)(const Arm *arm, const Chart *chart, double here[12][LANES], double o[][3][LANES],
                        double z[][3][LANES], double both[][LANES], double A[][N][LANES]) {
  const int *row = chart->row, *column = chart->column;
  for (int a = 0; a < M && arm->coupled; a++)
    for (int i = 0; i < N; i++)
      for (int l = 0; l < LANES; l++) A[row[a]][i][l] = 0.0;
  for (int j = 0; j < JOINTS; j++) {
    double twist[6][LANES], part[6][LANES];
    for (int l = 0; l < LANES; l++) {
      const double x = z[j][0][l], y = z[j][1][l], w = z[j][2][l];
      const double d[3] = {here[0][l] - o[j][0][l], here[1][l] - o[j][1][l], here[2][l] - o[j][2][l]};
      const int turns = arm->revolute[j];
      twist[0][l] = turns ? y * d[2] - w * d[1] : x;
      twist[1][l] = turns ? w * d[0] - x * d[2] : y;
      twist[2][l] = turns ? x * d[1] - y * d[0] : w;
      twist[3][l] = turns ? x : 0.0;
      twist[4][l] = turns ? y : 0.0;
      twist[5][l] = turns ? w : 0.0;
    }
    for (int a = 0; a < M; a++)
      for (int l = 0; l < LANES; l++)
        part[a][l] = arm->kind == POSITION ? twist[arm->rows[a]][l]
                     : arm->kind == POSE || a < 3
                         ? twist[a][l]
                         : here[a][l] * twist[3][l] + here[3 + a][l] * twist[4][l] + here[6 + a][l] * twist[5][l];
    for (int a = 0; a < M; a++)
      if (!arm->coupled)
        for (int l = 0; l < LANES; l++) A[row[a]][column[j]][l] = part[a][l];
      else
        for (int i = 0; i < N; i++)
          for (int l = 0; l < LANES; l++) A[row[a]][column[i]][l] += arm->S[j * N + i] * part[a][l];
  }
  for (int j = 0; j < N - M; j++)
    for (int i = 0; i < N; i++)
      for (int l = 0; l < LANES; l++) A[row[M + j]][column[i]][l] = both[Q_WIDE + j * N + i][l];
}

/* The right-hand side of a Newton step, b: the task error to the goal, and c - h. Sines stand for the angles: for a
   pose, half of the skew part of R* R^T; for an axis, its sines about the tool's x and y. They vanish with the rotation
   error. left has the sign of the cosine of that error. */
static void LANED(errors)(const Arm *arm, const Chart *chart, double goal[12][LANES], double here[12][LANES],
                          double both[][LANES], double level[][LANES], double x[][LANES], double b[][LANES],
                          double left[LANES]) {
  const int *row = chart->row;
  double(*G)[LANES] = goal + 3, (*R)[LANES] = here + 3;
  for (int a = 0; a < M && a < 3; a++) {
    const int at = arm->kind == POSITION ? arm->rows[a] : a;
    for (int l = 0; l < LANES; l++) b[row[a]][l] = goal[at][l] - here[at][l];
  }
  for (int l = 0; l < LANES; l++) left[l] = 1.0;
  if (arm->kind == POSE) {
    double E[9][LANES];
    for (int j = 0; j < 3; j++)
      for (int k = 0; k < 3; k++)
        for (int l = 0; l < LANES; l++)
          E[3 * j + k][l] = G[3 * j][l] * R[3 * k][l] + G[3 * j + 1][l] * R[3 * k + 1][l]
                            + G[3 * j + 2][l] * R[3 * k + 2][l];
    for (int l = 0; l < LANES; l++) {
      b[row[3]][l] = 0.5 * (E[7][l] - E[5][l]);
      b[row[4]][l] = 0.5 * (E[2][l] - E[6][l]);
      b[row[5]][l] = 0.5 * (E[3][l] - E[1][l]);
      left[l] = E[0][l] + E[4][l] + E[8][l] - 1.0;
    }
  }
  if (arm->kind == AXIS)
    for (int l = 0; l < LANES; l++) {
      const double u = G[2][l], v = G[5][l], w = G[8][l];
      b[row[3]][l] = -(R[1][l] * u + R[4][l] * v + R[7][l] * w);
      b[row[4]][l] = R[0][l] * u + R[3][l] * v + R[6][l] * w;
      left[l] = R[2][l] * u + R[5][l] * v + R[8][l] * w;
    }
  for (int j = 0; j < N - M; j++) {
    double *sum = b[row[M + j]];
    for (int l = 0; l < LANES; l++) sum[l] = level[j][l];
    for (int i = 0; i < N; i++)
      for (int l = 0; l < LANES; l++) sum[l] += both[Q_WIDE + j * N + i][l] * (both[i][l] - x[i][l]);
  }
}

/* Factor A = L U in place, without exchanges, with 1 / U on the diagonal; state -1.0 where a pivot is small. */
static void LANED(eliminate)(const Arm *arm, double A[][N][LANES], double state[LANES]) {
  (void)arm;
  for (int k = 0; k < N; k++) {
    for (int l = 0; l < LANES; l++) {
      state[l] = fabs(A[k][k][l]) > 1e-6 ? state[l] : -1.0;
      A[k][k][l] = 1.0 / A[k][k][l];
    }
    for (int i = k + 1; i < N; i++) {
      for (int l = 0; l < LANES; l++) A[i][k][l] *= A[k][k][l];
      for (int j = k + 1; j < N; j++)
        for (int l = 0; l < LANES; l++) A[i][j][l] -= A[i][k][l] * A[k][j][l];
    }
  }
}

static void LANED(substitute)(const Arm *arm, double A[][N][LANES], double b[][LANES]) {
  (void)arm;
  for (int i = 1; i < N; i++)
    for (int k = 0; k < i; k++)
      for (int l = 0; l < LANES; l++) b[i][l] -= A[i][k][l] * b[k][l];
  for (int i = N - 1; i >= 0; i--) {
    for (int k = N - 1; k > i; k--)
      for (int l = 0; l < LANES; l++) b[i][l] -= A[i][k][l] * b[k][l];
    for (int l = 0; l < LANES; l++) b[i][l] *= A[i][i][l];
  }
}

/* Solve f(x) = goal and n_ref^T (x - q_ref) = level from a nearby x, by Newton's method. One pose alone keeps the
   factors after a step below 2e-5; several do not, since each would wait for the others. Poses have no influence on
   each other. state is 1.0 where x is exact to 3e-14, -1.0 where another method is needed. */
static void LANED(settle)(const Arm *arm, const Chart *chart, double goal[12][LANES], double both[][LANES],
                          double level[][LANES], double x[][LANES], double state[LANES]) {
  double A[N][N][LANES], b[N][LANES], here[12][LANES], o[JOINTS][3][LANES], z[JOINTS][3][LANES];
  double angle[JOINTS][LANES], was[JOINTS][LANES], sine[JOINTS][LANES], cosine[JOINTS][LANES];
  double size[LANES], before[LANES], next[LANES], near[LANES], longest = 1.0;
  int left = 1;
  for (int l = 0; l < LANES; l++) {
    before[l] = 1.0;
    state[l] = 0.0;
  }
  for (int turn = 0; turn < 8 && left; turn++) {
    const int fresh = LANES > 1 || longest > 2e-5;
    for (int j = 0; j < JOINTS; j++) {
      for (int l = 0; l < LANES; l++) {
        was[j][l] = angle[j][l];
        angle[j][l] = arm->coupled ? arm->offset[j] : x[j][l];
      }
      for (int i = 0; i < N && arm->coupled; i++)
        for (int l = 0; l < LANES; l++) angle[j][l] += arm->S[j * N + i] * x[i][l];
    }
    if (longest > 0.01)
      LANED(turns)(arm, angle, sine, cosine);
    else
      LANED(turns_on)(arm, was, angle, sine, cosine);
    LANED(chain)(arm, angle, sine, cosine, here, o, z);
    if (fresh) {
      LANED(fill)(arm, chart, here, o, z, both, A);
      LANED(eliminate)(arm, A, state);
    }
    LANED(errors)(arm, chart, goal, here, both, level, x, b, near);
    LANED(substitute)(arm, A, b);
    for (int l = 0; l < LANES; l++) {
      size[l] = 0.0;
      state[l] = near[l] > 0.0 ? state[l] : -1.0;
    }
    for (int i = 0; i < N; i++)
      for (int l = 0; l < LANES; l++) {
        const double step = b[chart->column[i]][l];
        x[i][l] += state[l] == 0.0 || LANES == 1 ? step : 0.0;
        size[l] = fabs(step) > size[l] ? fabs(step) : size[l];
      }
    longest = 0.0;
    left = 0;
    for (int l = 0; l < LANES; l++) {
      /* the size of the next step: with new factors, steps fall as their squares, else by a ratio */
      const double ratio = size[l] / before[l], fall = ratio / before[l];
      if (!(size[l] < 0.1)) state[l] = -1.0;
      next[l] = fresh ? (fall > 1.0 ? fall : 1.0) * size[l] * size[l] : ratio * size[l];
      if (state[l] == 0.0 && next[l] < 3e-14) state[l] = 1.0;
      if (state[l] == 0.0) {
        left = 1;
        if (size[l] > longest) longest = size[l];
      }
      before[l] = size[l];
    }
  }
}

#undef LANED
#undef LANED_WITH
#undef LANED_AS
