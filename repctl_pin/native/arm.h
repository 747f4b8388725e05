/* An arm as tables: chain, potentials, limits, design region; and the functions on them.

   The library and every exported file share this text. In the library the sizes are read from the tables; an exported
   file defines EXPORTED, the sizes N, M, FRAMES, MOST_N, MOST_FRAMES, MOST_JOINTS, TERMS and WIDTH as numbers, and of a
   single frame ROWS and JOINTS, too; SHARED and EXPORT as static, the types Pose, Options and Report as those of its
   header, and its tables as constants. So N - M is written for r, and names here do not end as those of an exported
   header do. */

#ifndef REPCTL_ARM_H
#define REPCTL_ARM_H

#ifndef EXPORTED
#define CHART /* potentials of a cell, and a cell as region */
#define EXPORT __attribute__((visibility("default")))
#define SHARED /* a function that several files of the library call */
#define N (arm->n)
#define M (arm->m)
#define ROWS (arm->m) /* of one frame: M, if it is the only one */
#define JOINTS (arm->joints)
#define MOST_JOINTS (arm->joints)
#define FRAMES (arm->frames)
#define MOST_N 64 /* joints of an arm in structs */
#define MOST_FRAMES (MOST_N / 2) /* frames of a task in structs: each has two coordinates at least */
#define TERMS (part->count)
#define WIDTH ((N - M) * (part->k + 1))

enum { OK, SINGULAR, BAD_NUMBER, OUTSIDE, SLOWED, LIMIT, BODIES, RECOVERING }; /* what functions return */

typedef struct {
  double p[3], R[9]; /* position, rotation by rows */
} Pose;

typedef struct {
  double gain;          /* 1/s; WHOLE_STEP: 1 / dt */
  double limit[MOST_N]; /* joint speeds, rad/s or m/s; HUGE_VAL: none */
  double damping;       /* maximum lambda; 0: none */
  int stay_inside;      /* 1: OUTSIDE if q is outside the region, or the next q beyond the joint limits */
} Options;

typedef struct {
  double damping, slowed; /* lambda used, 0 if none; factor of the speed limits, 1 if none */
} Report;
#define UNROLLED
#elif FRAMES == 1 && defined(__GNUC__) && !defined(__clang__)
#define UNROLLED _Pragma("GCC unroll 16")
#else
#define UNROLLED
#endif

#define FRAME(f) (FRAMES == 1 ? arm : arm->frame + (f)) /* the struct Arm of a frame */
#define WHOLE_STEP (-1.0)

enum { POSE, AXIS, POSITION };              /* kinds of a task */
enum { POLYNOMIALS, FOURIER_SERIES, CELL }; /* kinds of potentials */

struct Chart; /* of a cell */

/* One term of a sum of N - M potentials; it depends on k joints. */
typedef struct {
  int kind, k, count, degree;
  const int *joint;             /* k */
  const int *parent, *factor;   /* count: monomial u[a] = u[parent[a]] z[factor[a]] of polynomials */
  const double *center, *scale; /* k: z = (q - center) scale */
  const double *wave;           /* count k: of a Fourier series */
  const double *weight;         /* count (N - M) (k + 1) of polynomials, count (N - M) 2 of a Fourier series */
  const struct Chart *chart;    /* of a cell */
} Part;

/* |q - center| <= half about one center at least, and |p - position| <= width on some axes; or a cell. */
typedef struct {
  int count, axes;
  const double *center, *half; /* count N, N */
  const int *axis;             /* axes */
  const double *position, *width;
  const struct Chart *chart; /* not NULL: the cell */
} Region;

/* Several frames: each has a struct Arm of its own, with all N joints; their rows stand one below the other, and so do
   positions p (3 FRAMES), rotations R (9 FRAMES), targets (FRAMES) and twists (6 FRAMES). */
typedef struct Arm {
  int n, m, joints, kind, coupled, parts, frames;
  const int *revolute, *bent;   /* joints; the placement after the joint turns: 1 about its x alone, 2 by 90 degrees */
  const int *rows;              /* M: coordinates of the position */
  const double *R, *p;          /* joints + 1 9, joints + 1 3: placements after each joint, which moves along its z */
  const double *S, *offset;     /* joints N, joints: joints of the chain = S q + offset, if coupled; else q */
  const double *lower, *upper;  /* N: joint limits */
  const Part *part;             /* parts */
  const Region *region;         /* NULL: everywhere */
  const struct Arm *frame;      /* frames, if several; then the chain is that of each of them */
} Arm;

/* ---- numbers ---- */

#define RANK_TOLERANCE 1e-6 /* minimum sine of the angle between a row of J_V and the span of the others */

/* Factors of J_V, for several right-hand sides, in memory of the caller. */
typedef struct {
  double *A, *V; /* N N: L and U with 1 / U on the diagonal, or U S; V of A V = U S, which only damp() needs */
  double *s;     /* N: squares of the singular values */
  int *swap;     /* N */
  double square; /* lambda squared, if s is used */
  int by_values; /* 1 if s is used */
} Factors;

SHARED int all_finite(const double *x, int count);
SHARED int factor(const Arm *arm, double A[][N], int swap[]);
SHARED void solve(const Arm *arm, double LU[][N], const int swap[], double x[]);
SHARED int regular(const Arm *arm, double A[][N], int swap[]);
SHARED void decompose(const Arm *arm, double A[][N], double V[][N]);
SHARED void damp(const Arm *arm, Factors *factors, double most);
SHARED void apply_factors(const Arm *arm, const Factors *factors, const double b[], double x[]);

/* ---- the arm at q ---- */

SHARED void place(const Arm *arm, const double q[], double p[], double R[], double J[][N]);
SHARED void find_poses(const Arm *arm, const double q[], Pose pose[]);
SHARED int rotation(const double R[9]);
SHARED double angle_per_sine(double square, double cosine);
SHARED int usable(const Arm *arm, const Pose *target);
SHARED void task_error(const Arm *arm, const double p[], const double R[], const Pose *target, double e[]);
SHARED void frame_error(const Arm *arm, const double p[3], const double R[9], const Pose *target, double e[]);
SHARED void add_frame_rate(const Arm *arm, const double R[9], const double twist[6], double dt, double b[]);
SHARED void add_rate(const Arm *arm, const double R[], const double twist[], double dt, double b[]);
SHARED int within_limits(const Arm *arm, const double q[]);

#endif
