/* Taylor models of the gradient of an arm angle on boxes of joints: see docs/theory.md, "Proved, not sampled".

   With e the elbow and w the wrist, seen from the shoulder, rho = |w| and a = w x e, the gradient of the arm angle is that of
   two forces, alpha at the elbow and beta at the wrist, which the shoulder balances: the moment about each revolute joint's
   axis, the force along each prismatic one.

     alpha = rho a / |a|^2, beta = -(w.e) / rho a / |a|^2 + (w.r) (w x r) / (rho |w x r|^2)    conventional
                                                       or + (w x t) / (rho (rho - w.t))        stereographic

   LANES boxes at a time. */

#define MOST 286 /* monomials of ten variables */
#include "linear_algebra.h"
#include "taylor.h"

typedef struct ArmAngle {
  Space space;
  int P, stereographic;
  const double *R, *p, *a, *bases;    /* P 3 3, P 3, P 3, P 3 3: placements, axes, rotations whose third columns they are */
  const int *before, *revolute, *carries; /* P, P, P 3: joint before, and which of the three points a joint moves */
  const double *S, *o;                /* P k, P: positions of the joints */
  const int *joint;                   /* 3: what carries shoulder, elbow and wrist */
  const double *place, *direction;    /* 3 3, 3 */
} ArmAngle;

typedef struct {
  Model R[3][3], o[3], origin[3], axis[3]; /* after the joint; its origin and axis */
} Frame;

/* The forces at shoulder, elbow and wrist. */
static void force_models(const ArmAngle *s, const Model *e, const Model *w, Model (*F)[3]) {
  const Space *g = &s->space;
  const double *d = s->direction, back[3] = {-d[0], -d[1], -d[2]};
  Model a[3], b[3], square, rho, inverse, lever, x, y, z, along;
  cross_models(g, w, e, a), dot_models(g, w, w, &square), dot_models(g, a, a, &x);
  power_model(g, &square, 0.5, &rho), power_model(g, &square, -0.5, &inverse), power_model(g, &x, -1, &lever);
  product(g, &rho, &lever, &x), times_model(g, &x, a, F[1]);
  dot_models(g, w, e, &x), product(g, &x, &inverse, &y), product(g, &y, &lever, &x), times_model(g, &x, a, F[0]);
  cross_constant(g, back, w, b); /* w x d */
  combine(g, d, w, &along);
  if (s->stereographic) {
    add(g, &rho, -1, &along, &x), product(g, &rho, &x, &y), power_model(g, &y, -1, &z);
  } else {
    dot_models(g, b, b, &x), power_model(g, &x, -1, &y), product(g, &along, &inverse, &x), product(g, &x, &y, &z);
  }
  times_model(g, &z, b, F[2]);
  add_vectors(g, F[2], -1, F[0], F[2]);
  add_vectors(g, F[1], 1, F[2], F[0]);
  for (int i = 0; i < 3; i++) scale(g, -1, F[0] + i);
}

/* LANES boxes q +- h of the k joints that move the points: the gradient's models, P k of them summed to V (k,). */
static void arm_boxes(const ArmAngle *s, const double *Q, const double *half, long at, int count, Frame *frames, Model *V,
                      double *out_P, double *out_r) {
  const Space *g = &s->space;
  int k = g->k, M = g->M;
  Model q[k], theta, sine, cosine, points[3][3], x[3], e[3], w[3], F[3][3], whole[3], load[3], one;
  for (int i = 0; i < k; i++) {
    constant(g, 0, q + i), constant(g, 0, V + i);
    for (int l = 0; l < LANES; l++) {
      long box = at + (l < count ? l : 0);
      q[i].p[0][l] = Q[box * k + i], q[i].p[1 + i][l] = half[box * k + i];
    }
    finish(g, q + i);
  }
  constants(g, NO_VECTOR, frames[0].o);
  identity_models(g, frames[0].R);
  for (int l = 0; l < s->P; l++) {
    Frame *f = frames + 1 + l;
    const Frame *before = frames + 1 + s->before[l];
    copy_vector(g, before->o, f->o);
    for (int c = 0; c < 3; c++) copy_vector(g, before->R[c], f->R[c]);
    combine_columns(g, f->R, s->p + 3 * l, x);
    add_vectors(g, f->o, 1, x, f->o), copy_vector(g, f->o, f->origin);
    turn_frame(g, s->R + 9 * l, 0, f->R);
    combine_columns(g, f->R, s->a + 3 * l, f->axis);
    constant(g, s->o[l], &theta);
    for (int i = 0; i < k; i++)
      if (s->S[l * k + i] != 0) add(g, &theta, s->S[l * k + i], q + i, &theta);
    if (s->revolute[l]) {
      sine_cosine(g, &theta, &sine, &cosine);
      turn_about(g, s->bases + 9 * l, &sine, &cosine, f->R);
    } else {
      times_model(g, &theta, f->axis, x);
      add_vectors(g, f->o, 1, x, f->o);
    }
  }
  for (int c = 0; c < 3; c++) {
    Frame *f = frames + 1 + s->joint[c];
    combine_columns(g, f->R, s->place + 3 * c, points[c]);
    add_vectors(g, f->o, 1, points[c], points[c]);
  }
  add_vectors(g, points[1], -1, points[0], e), add_vectors(g, points[2], -1, points[0], w);
  force_models(s, e, w, F);
  cross_models(g, e, F[1], whole), cross_models(g, w, F[2], x);
  add_vectors(g, whole, 1, x, whole);
  for (int l = 0; l < s->P; l++) {
    const int *on = s->carries + 3 * l;
    const Frame *f = frames + 1 + l;
    int all_three = on[0] && on[1] && on[2];
    if (all_three && !s->revolute[l]) continue; /* the forces balance */
    constants(g, NO_VECTOR, load);
    for (int c = 0; c < 3 && !all_three; c++) {
      if (!on[c]) continue;
      Model way[3];
      add_vectors(g, points[c], -1, f->origin, way);
      if (s->revolute[l]) cross_models(g, way, F[c], x);
      add_vectors(g, load, 1, s->revolute[l] ? x : F[c], load);
    }
    dot_models(g, f->axis, all_three ? whole : load, &one);
    for (int i = 0; i < k; i++)
      if (s->S[l * k + i] != 0) add(g, V + i, s->S[l * k + i], &one, V + i);
  }
  for (int l = 0; l < count; l++)
    for (int i = 0; i < k; i++) {
      out_r[(at + l) * k + i] = V[i].r[l];
      for (int m = 0; m < M; m++) out_P[((at + l) * k + i) * M + m] = V[i].p[m][l];
    }
}

EXPORT int LEVELLED(arm_gradients)(const ArmAngle *s, long K, const double *Q, const double *half, double *P, double *r) {
  Frame *frames = malloc((s->P + 1) * sizeof(Frame));
  Model *V = malloc(s->space.k * sizeof(Model));
  int done = frames && V;
  for (long i = 0; done && i < K; i += LANES)
    arm_boxes(s, Q, half, i, K - i < LANES ? K - i : LANES, frames, V, P, r);
  free(frames), free(V);
  return done;
}
