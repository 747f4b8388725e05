/* e = (p* - p, shortest rotation about the frame's own x and y that aligns its z axis with the target's). */
static void arm_error(const double p[3], const double R[9], const arm_pose *target, double e[ARM_M])
{
    const double z[3] = {R[2], R[5], R[8]}, aim[3] = {target->R[2], target->R[5], target->R[8]};
    const double cosine = z[0] * aim[0] + z[1] * aim[1] + z[2] * aim[2];
    double turn[3], square, share;
    int i;
    turn[0] = z[1] * aim[2] - z[2] * aim[1];
    turn[1] = z[2] * aim[0] - z[0] * aim[2];
    turn[2] = z[0] * aim[1] - z[1] * aim[0];
    square = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2];
    if (square < 1e-24) { /* parallel: 0; opposite: half a turn in any direction */
        for (i = 0; i < 3; i++) turn[i] = cosine > 0.0 ? 0.0 : R[3 * i];
        share = 3.14159265358979323846;
    } else {
        share = arm_angle_per_sine(square, cosine);
    }
    for (i = 0; i < 3; i++) e[i] = target->p[i] - p[i];
    e[3] = (R[0] * turn[0] + R[3] * turn[1] + R[6] * turn[2]) * share;
    e[4] = (R[1] * turn[0] + R[4] * turn[1] + R[7] * turn[2]) * share;
}

static void arm_add_rate(const double R[9], const double twist[6], double dt, double b[ARM_M])
{
    int i;
    for (i = 0; i < 3; i++) b[i] += dt * twist[i];
    b[3] += dt * (R[0] * twist[3] + R[3] * twist[4] + R[6] * twist[5]);
    b[4] += dt * (R[1] * twist[3] + R[4] * twist[4] + R[7] * twist[5]);
}
