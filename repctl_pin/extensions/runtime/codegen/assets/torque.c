
/* ---- torques ------------------------------------------------------------------------------------------------ */

#define ARM_DIFFERENCE 1e-3 /* half the length of the central difference along qdot, rad or m */

void arm_torque_defaults(arm_gains *gains)
{
    int i;
    for (i = 0; i < ARM_M; i++) gains->stiffness[i] = i < 3 ? 1000.0 : 50.0;
    gains->damping = 1.0;
    gains->leaf_frequency = 20.0;
    gains->leaf_damping = 1.0;
    gains->observer_rate = 200.0;
    for (i = 0; i < ARM_N; i++) gains->observer_limit[i] = 5.0;
}

static int arm_usable_gains(const arm_gains *gains)
{
    int i;
    for (i = 0; i < ARM_M; i++)
        if (!(gains->stiffness[i] > 0.0 && gains->stiffness[i] < HUGE_VAL)) return 0;
    for (i = 0; i < ARM_N; i++)
        if (!(gains->observer_limit[i] > 0.0)) return 0;
    return gains->damping >= 0.0 && gains->damping < HUGE_VAL && gains->leaf_frequency >= 0.0
           && gains->leaf_frequency < HUGE_VAL && gains->leaf_damping >= 0.0 && gains->leaf_damping < HUGE_VAL
           && gains->observer_rate > 0.0 && gains->observer_rate < HUGE_VAL;
}

/* Compute y = A x. */
static void arm_times(double A[ARM_N][ARM_N], const double x[ARM_N], double y[ARM_N])
{
    int i, k;
    for (i = 0; i < ARM_N; i++) {
        y[i] = 0.0;
        for (k = 0; k < ARM_N; k++) y[i] += A[i][k] * x[k];
    }
}

/* Evaluate J_V' qdot, the rate of J_V times qdot, by a central difference along qdot. */
static void arm_curvature(const double q[ARM_N], const double qdot[ARM_N], double bent[ARM_N])
{
    double A[ARM_N][ARM_N], there[ARM_N], behind[ARM_N], h[ARM_R], speed = 0.0, step;
    int i;
    for (i = 0; i < ARM_N; i++) {
        bent[i] = 0.0;
        speed += qdot[i] * qdot[i];
    }
    speed = sqrt(speed);
    if (speed == 0.0) return;
    step = ARM_DIFFERENCE / speed;
    for (i = 0; i < ARM_N; i++) there[i] = q[i] + step * qdot[i];
    arm_slope(there, A);
    arm_potentials(there, h, A + ARM_M);
    arm_times(A, qdot, bent);
    for (i = 0; i < ARM_N; i++) there[i] = q[i] - step * qdot[i];
    arm_slope(there, A);
    arm_potentials(there, h, A + ARM_M);
    arm_times(A, qdot, behind);
    for (i = 0; i < ARM_N; i++) bent[i] = (bent[i] - behind[i]) * (0.5 / step);
}

/* Factor a symmetric M = L L^T; return 0 if M is not symmetric and positive definite. */
static int arm_cholesky(const double M[ARM_N * ARM_N], double L[ARM_N][ARM_N])
{
    int i, j, k;
    for (i = 0; i < ARM_N; i++)
        for (j = 0; j <= i; j++) {
            const double other = M[j * ARM_N + i];
            double sum = M[i * ARM_N + j];
            if (!(fabs(sum - other) <= 1e-9 * sqrt(fabs(M[i * ARM_N + i] * M[j * ARM_N + j])))) return 0;
            for (k = 0; k < j; k++) sum -= L[i][k] * L[j][k];
            if (i > j)
                L[i][j] = sum / L[j][j];
            else if (sum > 0.0)
                L[i][i] = sqrt(sum);
            else
                return 0;
        }
    return 1;
}

/* Compute xddot of the spring and damper from the error e and its rate: with W = sqrt(K) J L^-T and W W^T = U k U^T,
 * sqrt(K) xddot = U (k U^T sqrt(K) e + 2 damping sqrt(k) U^T sqrt(K) rate). */
static void arm_hand(double L[ARM_N][ARM_N], double J[ARM_N][ARM_N], const arm_gains *gains, const double e[ARM_M],
                     const double rate[ARM_M], double xddot[ARM_M])
{
    double W[ARM_N][ARM_N], U[ARM_N][ARM_N], y[ARM_M] = {0.0};
    int a, i, k;
    for (a = 0; a < ARM_N; a++)
        for (i = 0; i < ARM_N; i++) { /* column a: L^-1 sqrt(K_a) J_a; 0 beyond the rows of J */
            W[i][a] = a < ARM_M ? sqrt(gains->stiffness[a]) * J[a][i] : 0.0;
            for (k = 0; k < i; k++) W[i][a] -= L[i][k] * W[k][a];
            W[i][a] /= L[i][i];
        }
    arm_svd(W, U);
    for (k = 0; k < ARM_N; k++) {
        double square = 0.0, spring = 0.0, damper = 0.0, pull;
        for (i = 0; i < ARM_N; i++) square += W[i][k] * W[i][k];
        for (a = 0; a < ARM_M; a++) {
            spring += U[a][k] * sqrt(gains->stiffness[a]) * e[a];
            damper += U[a][k] * sqrt(gains->stiffness[a]) * rate[a];
        }
        pull = square * spring + 2.0 * gains->damping * sqrt(square) * damper;
        for (a = 0; a < ARM_M; a++) y[a] += U[a][k] * pull;
    }
    for (a = 0; a < ARM_M; a++) xddot[a] = y[a] / sqrt(gains->stiffness[a]);
}

arm_status arm_torque(const double q[ARM_N], const double qdot[ARM_N], const double M[ARM_N * ARM_N],
                      const double bias[ARM_N], const arm_pose *target, const double *twist,
                      const double leaf[ARM_R], const arm_gains *gains, double dt, double *observer,
                      double tau[ARM_N])
{
    double A[ARM_N][ARM_N], L[ARM_N][ARM_N], p[3], R[9], h[ARM_R], e[ARM_N], rates[ARM_N], lag[ARM_M] = {0.0};
    double x[ARM_N], d[ARM_N] = {0.0}, force[ARM_N], opposed[ARM_N], pull[ARM_R], estimate[ARM_R], share = 1.0;
    arm_gains defaults;
    int swap[ARM_N], i, k;

    if (!gains) {
        arm_torque_defaults(&defaults);
        gains = &defaults;
    }
    if (!arm_finite(q, ARM_N) || !arm_finite(qdot, ARM_N) || !arm_finite(M, ARM_N * ARM_N)) return ARM_BAD_NUMBER;
    if (!arm_finite(bias, ARM_N) || !arm_finite(leaf, ARM_R) || !arm_rotation(target->R)) return ARM_BAD_NUMBER;
    if (!arm_usable_gains(gains) || !arm_cholesky(M, L)) return ARM_BAD_NUMBER;
    if (observer && !(arm_finite(observer, ARM_R) && dt > 0.0 && gains->observer_rate * dt <= 1.0))
        return ARM_BAD_NUMBER;

    arm_curvature(q, qdot, x);
    arm_chain(q, p, R, A);
    arm_potentials(q, h, A + ARM_M);
    arm_error(p, R, target, e);
    arm_times(A, qdot, rates);
    if (twist) arm_add_rate(R, twist, 1.0, lag);
    for (i = 0; i < ARM_M; i++) lag[i] -= rates[i];
    if (!arm_finite(e, ARM_M) || !arm_finite(lag, ARM_M) || !arm_finite(x, ARM_N)) return ARM_BAD_NUMBER;
    for (i = 0; i < ARM_N; i++)
        if (!arm_finite(A[i], ARM_N)) return ARM_BAD_NUMBER;

    arm_hand(L, A, gains, e, lag, force);
    for (i = 0; i < ARM_R; i++) {
        const double omega = gains->leaf_frequency, hdot = rates[ARM_M + i];
        pull[i] = omega * omega * (leaf[i] - h[i]) - 2.0 * gains->leaf_damping * omega * hdot;
        estimate[i] = observer ? gains->observer_rate * (hdot - observer[i]) : 0.0;
        force[ARM_M + i] = pull[i];
        d[ARM_M + i] = estimate[i];
    }
    for (i = 0; i < ARM_N; i++) x[i] = force[i] - x[i];
    if (!arm_finite(x, ARM_N) || !arm_finite(d, ARM_N)) return ARM_BAD_NUMBER;
    if (!arm_regular(A, swap)) return ARM_SINGULAR;
    arm_solve(A, swap, x);
    arm_solve(A, swap, d);

    for (i = 0; i < ARM_N; i++) {
        force[i] = opposed[i] = 0.0;
        for (k = 0; k < ARM_N; k++) {
            force[i] += M[i * ARM_N + k] * x[k];
            opposed[i] += M[i * ARM_N + k] * d[k];
        }
        if (fabs(opposed[i]) * share > gains->observer_limit[i]) share = gains->observer_limit[i] / fabs(opposed[i]);
    }
    for (i = 0; i < ARM_N; i++) force[i] += bias[i] - share * opposed[i];
    if (!arm_finite(force, ARM_N)) return ARM_BAD_NUMBER;
    if (observer) {
        for (i = 0; i < ARM_R; i++)
            estimate[i] = rates[ARM_M + i] - share / gains->observer_rate * estimate[i] + dt * pull[i];
        if (!arm_finite(estimate, ARM_R)) return ARM_BAD_NUMBER;
        for (i = 0; i < ARM_R; i++) observer[i] = estimate[i];
    }
    for (i = 0; i < ARM_N; i++) tau[i] = force[i];
    return ARM_OK;
}
