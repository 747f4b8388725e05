/* The control law of a repeatable inverse. */

#ifndef REPCTL_LAW_H
#define REPCTL_LAW_H

#include "arm.h"

SHARED void potentials(const Arm *arm, const double q[], const double p[], const double R[], double J[][N],
                       double h[], double V[][N]);

/* ---- the control law; each returns OK, SINGULAR, BAD_NUMBER or OUTSIDE, and writes its results only with OK ---- */

SHARED int find_leaf(const Arm *arm, const double q[], double c[]);
SHARED int find_inverse(const Arm *arm, const double q[], double G[]);
SHARED int find_velocity(const Arm *arm, const double q[], const double xdot[], double qdot[]);
SHARED int find_inside(const Arm *arm, const double q[]);
SHARED int take_step(const Arm *arm, const double q[], const Pose *target, double dt, const double *twist,
                     const double *leaf, const Options *options, Report *report, double q_next[]);

#endif
