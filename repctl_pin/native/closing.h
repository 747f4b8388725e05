/* A closing radius: every closed path of the frame within it closes. */

#ifndef REPCTL_CLOSING_H
#define REPCTL_CLOSING_H

#include "arm.h"

/* The start pose, or poses along a path, and how far from one of them at least the frame may be. */
typedef struct {
  int count;
  double square, chord; /* squares of the distance, m, and of the chord of the angle: (2 sin(angle / 2))^2 */
  const double *p, *R;  /* count 3, count 9 */
} Closing;

SHARED int in_closing_radius(const Arm *arm, const Closing *closing, const Pose *pose);

#endif
