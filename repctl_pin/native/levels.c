/* The Taylor models for the vector units of this processor. Every level gives the same numbers, bit by bit. */

#include "chain.h"
#include "levels.h"

CellBounds cell_bounds_plain;
ArmGradients arm_gradients_plain;

#ifdef __x86_64__
CellBounds cell_bounds_avx2, cell_bounds_avx512;
ArmGradients arm_gradients_avx2, arm_gradients_avx512;

#define CHOSEN(name)                                                       \
  (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") \
       ? name##_avx512                                                     \
       : __builtin_cpu_supports("avx2") ? name##_avx2 : name##_plain)
#else
#define CHOSEN(name) name##_plain
#endif

EXPORT int cell_bounds(const struct Cell *cell, long K, const double *U, const double *half,
                       const struct Margins *out) {
  return CHOSEN(cell_bounds)(cell, K, U, half, out);
}

EXPORT int arm_gradients(const struct ArmAngle *arm, long K, const double *Q, const double *half, double *P,
                         double *r) {
  return CHOSEN(arm_gradients)(arm, K, Q, half, P, r);
}
