/* h = a^T sin(k q) + b^T cos(k q), a and b alternate in the table. */
static void arm_potential_@number(const double q[ARM_N], double h[ARM_R], double V[][ARM_N])
{
    static const int joint[@k] = @joints;
    static const double wave[@count][@k] = {
@waves};
    static const double weight[@count][2 * ARM_R] = {
@weights};
    int a, i, j;
    for (a = 0; a < @count; a++) {
        double phase = 0.0, s, c;
        for (j = 0; j < @k; j++) phase += wave[a][j] * q[joint[j]];
        s = sin(phase);
        c = cos(phase);
        for (i = 0; i < ARM_R; i++) {
            const double slope = weight[a][2 * i] * c - weight[a][2 * i + 1] * s;
            h[i] += weight[a][2 * i] * s + weight[a][2 * i + 1] * c;
            for (j = 0; j < @k; j++) V[i][joint[j]] += wave[a][j] * slope;
        }
    }
}
