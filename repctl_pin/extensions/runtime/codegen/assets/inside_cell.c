arm_status arm_inside(const double q[ARM_N])
{
    double y[ARM_M], u[arm_cell_k];
    arm_pose there;
    if (!arm_finite(q, ARM_N)) return ARM_BAD_NUMBER;
    arm_place(q, there.p, there.R);
    arm_cell_coordinates(&there, y, u);
    return arm_cell_inside(y, u) ? ARM_OK : ARM_OUTSIDE;
}
