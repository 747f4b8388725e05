/* Test whether a pose is within a closing radius. */

#include <math.h>

#include "closing.h"

/* |x - p|^2 <= square in the task's coordinates, and |R - R_0|^2 / 2, or |z - z_0|^2 of the tool axes, <= chord. */
SHARED int in_closing_radius(const Arm *arm, const Closing *closing, const Pose *pose) {
  for (int a = 0; a < closing->count; a++) {
    const double *p = closing->p + 3 * a, *R = closing->R + 9 * a;
    double away = 0.0, turned = 0.0;
    for (int i = 0; i < M && i < 3; i++) {
      const int row = arm->kind == POSITION ? arm->rows[i] : i;
      away += (pose->p[row] - p[row]) * (pose->p[row] - p[row]);
    }
    for (int i = arm->kind == AXIS ? 2 : 0; i < 9 && arm->kind != POSITION; i += arm->kind == AXIS ? 3 : 1)
      turned += (pose->R[i] - R[i]) * (pose->R[i] - R[i]);
    if (arm->kind == POSE) turned /= 2.0;
    if (away <= closing->square && turned <= closing->chord) return 1;
  }
  return 0;
}
