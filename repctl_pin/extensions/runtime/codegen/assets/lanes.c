
/* ---- @lanes at once: the last index of every array is the pose ---- */

/* Compute sines and cosines: by polynomials, after the nearest quarter turns are removed. */
static void arm_turns_@lanes(const double *angle, double *sine, double *cosine)
{
    int i;
    for (i = 0; i < @angles * @lanes; i++) {
        const double k = ARM_NEAREST(angle[i] * 0.6366197723675814), half = 0.5 * k;
        const double odd = 2.0 * fabs(half - ARM_NEAREST(half)), quarter = 0.25 * (k - odd);
        const double sign = 1.0 - 4.0 * fabs(quarter - ARM_NEAREST(quarter)); /* odd 0 or 1, sign 1 or -1 */
        const double x = (angle[i] - k * 1.5707963267341256) - k * 6.077100506506192e-11, z = x * x;
        const double s =
            x + x * z * (-0.16666666666666632 + z * (8.33333333332249e-3 + z * (-1.984126982985795e-4
                + z * (2.7557313707070068e-6 + z * (-2.5050760253406863e-8 + z * 1.58969099521155e-10)))));
        const double c =
            1.0 - (0.5 * z - z * z * (4.16666666666666e-2 + z * (-1.388888888887411e-3 + z * (2.480158728947673e-5
                + z * (-2.7557314351390663e-7 + z * (2.087572321298175e-9 + z * -1.1359647557788195e-11))))));
        sine[i] = sign * ((1.0 - odd) * s + odd * c);
        cosine[i] = sign * ((1.0 - odd) * c - odd * s);
    }
}

/* Compute sines and cosines from those of angles at most 0.01 away, by the addition theorems. */
static void arm_turns_on_@lanes(const double *was, const double *angle, double *sine, double *cosine)
{
    int i;
    for (i = 0; i < @angles * @lanes; i++) {
        const double d = angle[i] - was[i], z = d * d, s = d * (1.0 - z * (0.16666666666666666 - z * 8.333333333333333e-3));
        const double less = z * (0.5 - z * (0.041666666666666664 - z * 1.388888888888889e-3)); /* 1 - cos(d) */
        const double up = cosine[i] * s - sine[i] * less, down = sine[i] * s + cosine[i] * less;
        sine[i] += up;
        cosine[i] -= down;
    }
}

/*
 * Solve f(x) = goal and n_ref^T (x - q_ref) = level from a nearby x, by Newton's method without exchanges of rows. After
 * a step below @keep the factors are kept. Poses have no influence on each other. state is 1.0 where x is exact to
 * 3e-14, -1.0 where another method is needed.
 */
static void arm_settle_@lanes(double goal[][@lanes], double both[][@lanes], double level[][@lanes], double x[][@lanes],
                              double state[@lanes])
{
    double A[ARM_N][ARM_N][@lanes] = {{{0.0}}}, b[ARM_N][@lanes], here[12][@lanes];
    double size[@lanes], before[@lanes], next[@lanes];
    double angle[@angles][@lanes] = {{0.0}}, was[@angles][@lanes], sine[@angles][@lanes], cosine[@angles][@lanes];
    double longest = 1.0;
    int @counters, l, turn, fresh, left = 1;
    for (l = 0; l < @lanes; l++) {
        before[l] = 1.0;
        state[l] = 0.0;
    }
    for (turn = 0; turn < 8 && left; turn++) {
        for (i = 0; i < @angles; i++)
            for (l = 0; l < @lanes; l++) was[i][l] = angle[i][l];
        for (l = 0; l < @lanes; l++) {
@angle
        }
        if (longest > 0.01) arm_turns_@lanes(angle[0], sine[0], cosine[0]);
        else arm_turns_on_@lanes(was[0], angle[0], sine[0], cosine[0]);
        fresh = longest > @keep;
        if (fresh) {
            for (l = 0; l < @lanes; l++) {
@whole
@labels
            }
@factors
        } else {
            for (l = 0; l < @lanes; l++) {
@placement
            }
        }
        for (l = 0; l < @lanes; l++) {
            double cosine_left = 1.0, most = 0.0;
@error
@solution
@steps
            size[l] = most;
            state[l] = cosine_left > 0.0 ? state[l] : -1.0;
        }
        longest = 0.0;
        left = 0;
        for (l = 0; l < @lanes; l++) {
            /* the size of the next step: with new factors, steps fall as their squares, else by a ratio */
            const double ratio = size[l] / before[l], fall = ratio / before[l];
            if (!(size[l] < 0.1)) state[l] = -1.0;
            next[l] = fresh ? (fall > 1.0 ? fall : 1.0) * size[l] * size[l] : ratio * size[l];
            if (state[l] == 0.0 && next[l] < 3e-14) state[l] = 1.0;
            if (state[l] == 0.0) {
                left = 1;
                if (size[l] > longest) longest = size[l];
            }
            before[l] = size[l];
        }
    }
}
