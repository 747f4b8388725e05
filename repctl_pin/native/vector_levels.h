/* Some files are compiled once for each level of the vector units; vector_levels.c chooses. */

#ifndef REPCTL_LEVELS_H
#define REPCTL_LEVELS_H

#define JOINED(name, level) name##_##level
#define NAMED(name, level) JOINED(name, level)
#define LEVELLED(name) NAMED(name, LEVEL)

struct Cell;
struct Margins;
struct ArmAngle;

typedef int CellBounds(const struct Cell *, long, const double *, const double *, const double *, const struct Margins *);
typedef int ArmGradients(const struct ArmAngle *, long, const double *, const double *, double *, double *);

#endif
