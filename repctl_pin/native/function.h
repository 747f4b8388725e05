/* The inverse kinematic function q = F(x; c) of a chart. */

#ifndef REPCTL_FUNCTION_H
#define REPCTL_FUNCTION_H

#include "chart.h"

/* What Newton's method needs of a target: u, and what the symmetries add to q_ref there. */
SHARED int find_coordinates(const Arm *arm, const Chart *chart, const Pose *target, double u[], double shift[]);
SHARED double solve_chart(const Arm *arm, const Pose *target, const double *q_ref, const double *n_ref,
                          const double *level, int turns, double longest, double enough, double q[]);
SHARED int joints_allowed(const Arm *arm, int keep, const double *leaf, const double q[]);

/* q = F(x; c), at one target or at up to AT_ONCE; leaf NULL: 0. The joint limits are checked on every leaf but c = 0, on
   that one if keep is 1. OUTSIDE: the target is outside the cell, or q outside the limits. */
SHARED int find_configuration(const Arm *arm, const Chart *chart, int keep, const Pose *target, const double *leaf,
                              double q[]);
typedef int Configuration(const Arm *, const Chart *, int, const Pose *, const double *, double *);
typedef void Configurations(const Arm *, const Chart *, int, int, const Pose *, const double *, int, double *, int *);
SHARED void find_configurations(const Arm *arm, const Chart *chart, int keep, int count, const Pose *targets,
                                const double *leaf, int stride, double *q, int status[]);

#endif
