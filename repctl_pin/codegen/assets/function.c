
/* Newton's method with exchanges of rows, on [x - f(q); c - n_ref^T (q - q_ref)]; return 0 without convergence. */
static int arm_search(const arm_pose *target, double both[][1], const double *leaf, double q[ARM_N])
{
    double A[ARM_N][ARM_N], b[ARM_N], p[3], R[9];
    int swap[ARM_N], i, j, turn;
    for (turn = 0; turn < 12; turn++) {
        double size = 0.0, share;
        arm_chain(q, p, R, A);
        arm_error(p, R, target, b);
        for (j = 0; j < ARM_R; j++) {
            b[ARM_M + j] = leaf ? leaf[j] : 0.0;
            for (i = 0; i < ARM_N; i++) {
                A[ARM_M + j][i] = both[(1 + ARM_R) * i + 1 + j][0];
                b[ARM_M + j] += A[ARM_M + j][i] * (both[(1 + ARM_R) * i][0] - q[i]);
            }
        }
        if (!arm_factor(A, swap)) return 0;
        arm_solve(A, swap, b);
        if (!arm_finite(b, ARM_N)) return 0;
        for (i = 0; i < ARM_N; i++)
            if (fabs(b[i]) > size) size = fabs(b[i]);
        share = size <= 0.3 ? 1.0 : 0.3 / size;
        for (i = 0; i < ARM_N; i++) q[i] += share * b[i];
        if (size < 1e-7) return 1;
    }
    return 0;
}

static const double arm_F_lower[ARM_N] = @lower;
static const double arm_F_upper[ARM_N] = @upper;

/* Compute the coordinates u of a target, and what symmetries of the arm add to q_ref; check the target. */
static arm_status arm_F_coordinates(const arm_pose *target, double u[@k], double shift[ARM_N])
{
    double y[ARM_M];
    int i;
    for (i = 0; i < ARM_N; i++) shift[i] = 0.0;
    if (!arm_rotation(target->R)) return ARM_BAD_NUMBER;
    arm_cell_coordinates(target, y, u);
    if (!arm_finite(y, ARM_M)) return ARM_BAD_NUMBER;
@turned    return arm_cell_inside(y, u) ? ARM_OK : ARM_OUTSIDE;
}

arm_status arm_F(const arm_pose *target, const double *leaf, double q[ARM_N])
{
    double u[@k], shift[ARM_N], both[arm_cell_width][1];
    double x[ARM_N][1], start[ARM_N], goal[12][1], state[1];
    arm_status status;
    int i, j;
    if (leaf && !arm_finite(leaf, ARM_R)) return ARM_BAD_NUMBER;
    status = arm_F_coordinates(target, u, shift);
    if (status != ARM_OK) return status;
    for (i = 0; i < 3; i++) goal[i][0] = target->p[i];
    for (i = 0; i < 9; i++) goal[3 + i][0] = target->R[i];
    arm_chart(u, both);
    for (i = 0; i < ARM_N; i++) {
        both[(1 + ARM_R) * i][0] += shift[i];
        start[i] = both[(1 + ARM_R) * i][0];
        for (j = 0; leaf && j < ARM_R; j++) start[i] += leaf[j] * both[(1 + ARM_R) * i + 1 + j][0];
        x[i][0] = start[i];
    }
    arm_settle_1(goal, both, leaf, x, state);
    if (state[0] > 0.0)
        for (i = 0; i < ARM_N; i++) start[i] = x[i][0];
    else if (!arm_search(target, both, leaf, start))
        return ARM_OUTSIDE;
    for (i = 0; i < ARM_N; i++)
        if (start[i] < arm_F_lower[i] || start[i] > arm_F_upper[i]) return ARM_OUTSIDE;
    for (i = 0; i < ARM_N; i++) q[i] = start[i];
    return ARM_OK;
}

long arm_F_batch(long count, const arm_pose *targets, const double *leaf, double *q)
{
    double both[arm_cell_width][@lanes], x[ARM_N][@lanes], goal[12][@lanes], state[@lanes];
    double u[@k], shift[ARM_N], one[arm_cell_width][1];
    long a;
    int i, j, l;
    if (leaf && !arm_finite(leaf, ARM_R)) return 0;
    for (a = 0; a < count; a += @lanes) {
        for (l = 0; l < @lanes; l++) { /* after the last target, that one again */
            const arm_pose *target = targets + (a + l < count ? a + l : count - 1);
            if (arm_F_coordinates(target, u, shift) != ARM_OK) { /* arm_F says so below */
                for (i = 0; i < @k; i++) u[i] = 0.0;
                for (i = 0; i < ARM_N; i++) shift[i] = 0.0;
            }
            arm_chart(u, one);
            for (i = 0; i < ARM_N; i++) one[(1 + ARM_R) * i][0] += shift[i];
            for (i = 0; i < arm_cell_width; i++) both[i][l] = one[i][0];
            for (i = 0; i < 3; i++) goal[i][l] = target->p[i];
            for (i = 0; i < 9; i++) goal[3 + i][l] = target->R[i];
        }
        for (i = 0; i < ARM_N; i++)
            for (l = 0; l < @lanes; l++) x[i][l] = both[(1 + ARM_R) * i][l];
        for (j = 0; leaf && j < ARM_R; j++)
            for (i = 0; i < ARM_N; i++)
                for (l = 0; l < @lanes; l++) x[i][l] += leaf[j] * both[(1 + ARM_R) * i + 1 + j][l];
        arm_settle_@lanes(goal, both, leaf, x, state);
        for (l = 0; l < @lanes && a + l < count; l++) {
            double *out = q + (a + l) * ARM_N;
            int good = state[l] > 0.0;
            for (i = 0; i < ARM_N; i++) good = good && x[i][l] >= arm_F_lower[i] && x[i][l] <= arm_F_upper[i];
            for (i = 0; good && i < ARM_N; i++) out[i] = x[i][l];
            if (!good && arm_F(targets + a + l, leaf, out) != ARM_OK) return a + l;
        }
    }
    return count;
}
