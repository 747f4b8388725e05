/* The polynomials of a chart. A Number is a double, or a vector of doubles, one for each pose. Included once for each;
   LANED(name) tells their functions apart. Without a Number, it is a double. */

#ifndef Number
#define OF_ONE
#define Number double
#define Weight Pair
#define Sum Pair
#define PER PAIR
#define UNFOLDED UNROLLED
#define LANED(name) name##_of_one
#endif

/* The monomials of u, ordered by degree, then by their factors: those of a degree that begin with u_v are u_v times
   the last ones of the degree before, from its first one that begins with u_v. */
static void LANED(monomials)(const Chart *chart, const Number u[], Number T[]) {
  int first[6] = {0}, end = 1, a = 1;
  T[0] = u[0] * 0.0 + 1.0;
  while (a < chart->terms && chart->k) {
    for (int v = 0; v < chart->k; v++) {
      const int room = chart->terms - a, all = end - first[v], count = all < room ? all : room;
      const Number factor = u[v], *from = T + first[v];
      int i = 0;
      for (; i + PER <= count; i += PER) *(Sum *)(T + a + i) = *(const Sum *)(from + i) * factor;
      for (; i < count; i++) T[a + i] = from[i] * factor;
      first[v] = a;
      a += count;
    }
    end = a;
  }
  for (; a < chart->terms; a++) T[a] = u[0] * 0.0;
}

/* q_ref and n_ref^T from the monomials, four at a time. One pose has PER entries of a row in each Sum and each Weight,
   several have one entry of each pose in a Sum. */
static void LANED(references)(const Arm *arm, const Chart *chart, const Number T[], Number both[]) {
  const Weight *w = (const Weight *)chart->weights;
  const int Q = Q_WIDE / PER, ALL = WIDE / PER;
  Sum sum[WIDE], *found = (Sum *)both;
  (void)arm;
  UNFOLDED for (int i = 0; i < ALL; i++) sum[i] = w[0] * 0.0 * T[0];
  for (int a = 0; a < chart->both; a += 4, w += 4 * ALL) {
    const Number s = T[a], t = T[a + 1], u = T[a + 2], v = T[a + 3];
    UNFOLDED for (int i = 0; i < ALL; i++) sum[i] += s * w[i] + t * w[ALL + i] + (u * w[2 * ALL + i] + v * w[3 * ALL + i]);
  }
  for (int a = chart->both; a < chart->terms; a += 4, w += 4 * Q) {
    const Number s = T[a], t = T[a + 1], u = T[a + 2], v = T[a + 3];
    UNFOLDED for (int i = 0; i < Q; i++) sum[i] += s * w[i] + t * w[Q + i] + (u * w[2 * Q + i] + v * w[3 * Q + i]);
  }
  UNFOLDED for (int i = 0; i < ALL; i++) found[i] = sum[i];
}

#ifdef OF_ONE
#undef OF_ONE
#undef Number
#undef Weight
#undef Sum
#undef PER
#undef UNFOLDED
#undef LANED
#endif
