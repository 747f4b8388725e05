
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

/* Decide whether the joint limits are checked: on every leaf but c = 0, where @keep. */
static int arm_F_checked(const double *leaf)
{
    int i, checked = @keep;
    for (i = 0; leaf && i < ARM_R; i++)
        if (leaf[i] != 0.0) checked = 1;
    return checked;
}

/* Test whether the joints are within their limits, without a tolerance. */
static int arm_F_within(const double q[ARM_N])
{
    int i;
    for (i = 0; i < ARM_N; i++)
        if (!(q[i] >= arm_F_lower[i] && q[i] <= arm_F_upper[i])) return 0;
    return 1;
}

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
    double u[@k], shift[ARM_N], both[arm_cell_width][1], level[ARM_R][1];
    double x[ARM_N][1], start[ARM_N], goal[12][1], state[1];
    arm_status status;
    int i, j;
    if (leaf && !arm_finite(leaf, ARM_R)) return ARM_BAD_NUMBER;
    status = arm_F_coordinates(target, u, shift);
    if (status != ARM_OK) return status;
    for (i = 0; i < 3; i++) goal[i][0] = target->p[i];
    for (i = 0; i < 9; i++) goal[3 + i][0] = target->R[i];
    for (j = 0; j < ARM_R; j++) level[j][0] = leaf ? leaf[j] : 0.0;
    arm_chart(u, both);
    for (i = 0; i < ARM_N; i++) {
        both[(1 + ARM_R) * i][0] += shift[i];
        start[i] = both[(1 + ARM_R) * i][0];
        for (j = 0; leaf && j < ARM_R; j++) start[i] += leaf[j] * both[(1 + ARM_R) * i + 1 + j][0];
        x[i][0] = start[i];
    }
    arm_settle_1(goal, both, level, x, state);
    if (state[0] > 0.0)
        for (i = 0; i < ARM_N; i++) start[i] = x[i][0];
    else if (!arm_search(target, both, leaf, start))
        return ARM_OUTSIDE;
    if (arm_F_checked(leaf) && !arm_F_within(start)) return ARM_OUTSIDE;
    for (i = 0; i < ARM_N; i++) q[i] = start[i];
    return ARM_OK;
}

/* Compute q and its status at up to @lanes targets. The leaf of the next target is stride numbers further. */
static void arm_F_lanes(int count, const arm_pose *targets, const double *leaf, int stride, double *q,
                        arm_status status[@lanes])
{
    double both[arm_cell_width][@lanes], level[ARM_R][@lanes], x[ARM_N][@lanes], goal[12][@lanes], state[@lanes];
    double u[@k], shift[ARM_N], one[arm_cell_width][1];
    int i, j, l;
    for (l = 0; l < @lanes; l++) { /* after the last target, that one again */
        const int at = l < count ? l : count - 1;
        const arm_pose *target = targets + at;
        status[l] = arm_F_coordinates(target, u, shift);
        if (status[l] != ARM_OK) {
            for (i = 0; i < @k; i++) u[i] = 0.0;
            for (i = 0; i < ARM_N; i++) shift[i] = 0.0;
        }
        arm_chart(u, one);
        for (i = 0; i < ARM_N; i++) one[(1 + ARM_R) * i][0] += shift[i];
        for (i = 0; i < arm_cell_width; i++) both[i][l] = one[i][0];
        for (i = 0; i < 3; i++) goal[i][l] = target->p[i];
        for (i = 0; i < 9; i++) goal[3 + i][l] = target->R[i];
        for (j = 0; j < ARM_R; j++) level[j][l] = leaf ? leaf[at * stride + j] : 0.0;
    }
    for (i = 0; i < ARM_N; i++)
        for (l = 0; l < @lanes; l++) x[i][l] = both[(1 + ARM_R) * i][l];
    for (j = 0; leaf && j < ARM_R; j++)
        for (i = 0; i < ARM_N; i++)
            for (l = 0; l < @lanes; l++) x[i][l] += level[j][l] * both[(1 + ARM_R) * i + 1 + j][l];
    arm_settle_@lanes(goal, both, level, x, state);
    for (l = 0; l < count; l++) {
        const double *c = leaf ? leaf + l * stride : NULL;
        double found[ARM_N];
        if (status[l] != ARM_OK) continue;
        for (i = 0; i < ARM_N; i++) found[i] = x[i][l];
        if (!(state[l] > 0.0) || (arm_F_checked(c) && !arm_F_within(found))) status[l] = arm_F(targets + l, c, found);
        for (i = 0; i < ARM_N && status[l] == ARM_OK; i++) q[l * ARM_N + i] = found[i];
    }
}

long arm_F_batch(long count, const arm_pose *targets, const double *leaf, double *q)
{
    arm_status status[@lanes];
    long a;
    int l;
    if (leaf && !arm_finite(leaf, ARM_R)) return 0;
    for (a = 0; a < count; a += @lanes) {
        const int few = count - a < @lanes ? (int)(count - a) : @lanes;
        arm_F_lanes(few, targets + a, leaf, 0, q + a * ARM_N, status);
        for (l = 0; l < few; l++)
            if (status[l] != ARM_OK) return a + l;
    }
    return count;
}
