/* The polynomials of a chart. A Number is a double, or a vector of doubles, one for each pose. Included once for each;
   LANED(name) tells their functions apart. */

/* The monomials of u. */
static void LANED(monomials)(const Chart *chart, const Number u[], Number T[]) {
  T[0] = u[0] * 0.0 + 1.0;
  for (int a = 1; a < chart->terms; a++) T[a] = T[chart->parent[a]] * u[chart->factor[a]];
}

/* q_ref and n_ref^T from the monomials, four at a time. */
static void LANED(references)(const Arm *arm, const Chart *chart, const Number T[], Number sum[]) {
  const double *w = chart->weights;
  (void)arm;
  for (int i = 0; i < WIDE; i++) sum[i] = T[0] * 0.0;
  for (int a = 0; a < chart->both; a += 4, w += 4 * WIDE) {
    const Number s = T[a], t = T[a + 1], u = T[a + 2], v = T[a + 3];
    for (int i = 0; i < WIDE; i++) sum[i] += s * w[i] + t * w[WIDE + i] + (u * w[2 * WIDE + i] + v * w[3 * WIDE + i]);
  }
  for (int a = chart->both; a < chart->terms; a += 4, w += 4 * Q_WIDE) {
    const Number s = T[a], t = T[a + 1], u = T[a + 2], v = T[a + 3];
    for (int i = 0; i < Q_WIDE; i++)
      sum[i] += s * w[i] + t * w[Q_WIDE + i] + (u * w[2 * Q_WIDE + i] + v * w[3 * Q_WIDE + i]);
  }
}
