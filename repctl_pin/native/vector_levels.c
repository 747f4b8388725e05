/* The kernels of proofs and of cell functions for the vector units of this processor. Every level gives the same numbers, bit by bit.
   HIGHEST is the highest level that build.py built: PLAIN, AVX2 or AVX512. A lesser processor runs a lower one.

   The processor is asked by hand: the compiler's own test of it brings zig's sine and cosine in place of the system's. */

#include "vector_levels.h"

#include "linear_algebra.h"
#include "function.h"

CellBounds cell_bounds_plain;
ArmGradients arm_gradients_plain;
Configuration find_configuration_plain;
Configurations find_configurations_plain;

#define PLAIN 1
#define AVX2 2
#define AVX512 3

#if HIGHEST > PLAIN
#include <cpuid.h>

CellBounds cell_bounds_avx2, cell_bounds_avx512;
ArmGradients arm_gradients_avx2, arm_gradients_avx512;
Configuration find_configuration_avx2, find_configuration_avx512;
Configurations find_configurations_avx2, find_configurations_avx512;

static int level_of_processor(void) {
  unsigned a, b, c, d, saved, high; /* saved: the registers that the system keeps for each process */
  if (!__get_cpuid(1, &a, &b, &c, &d) || !(c >> 27 & 1)) return PLAIN;
  __asm__("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
  if (!__get_cpuid_count(7, 0, &a, &b, &c, &d)) return PLAIN;
  if ((saved & 0xe6) == 0xe6 && b >> 16 & 1 && b >> 17 & 1) return AVX512; /* F and DQ */
  return (saved & 6) == 6 && b >> 5 & 1 ? AVX2 : PLAIN;
}

static int level(void) {
  static int found = 0;
  if (!found) found = level_of_processor();
  return found;
}

#if HIGHEST == AVX512
#define CHOSEN(name) (level() == AVX512 ? name##_avx512 : level() == AVX2 ? name##_avx2 : name##_plain)
#else
#define CHOSEN(name) (level() >= AVX2 ? name##_avx2 : name##_plain)
#endif
#else
#define CHOSEN(name) name##_plain
#endif

EXPORT int cell_bounds(const struct Cell *cell, long K, const double *U, const double *half,
                       const double *shift, const struct Margins *out) {
  return CHOSEN(cell_bounds)(cell, K, U, half, shift, out);
}

EXPORT int arm_gradients(const struct ArmAngle *arm, long K, const double *Q, const double *half, double *P,
                         double *r) {
  return CHOSEN(arm_gradients)(arm, K, Q, half, P, r);
}

int find_configuration(const Arm *arm, const Chart *chart, int keep, const Pose *target, const double *leaf, double q[]) {
  return CHOSEN(find_configuration)(arm, chart, keep, target, leaf, q);
}

void find_configurations(const Arm *arm, const Chart *chart, int keep, int count, const Pose *targets,
                         const double *leaf, int stride, double *q, int status[]) {
  CHOSEN(find_configurations)(arm, chart, keep, count, targets, leaf, stride, q, status);
}
