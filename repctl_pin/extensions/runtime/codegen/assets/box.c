static const arm_pose arm_cell_middle = @middle;

/* Compute the coordinates y relative to the cell's middle, m and rad, and the scaled coordinates u. */
static void arm_cell_coordinates(const arm_pose *pose, double y[ARM_M], double u[@k])
{
    int k;
    arm_error(arm_cell_middle.p, arm_cell_middle.R, pose, y);
    for (k = 0; k < @k; k++) u[k] = y[arm_cell_moved[k]] * arm_cell_scale[k];
}

/* Test whether coordinates are in the cell; fixed coordinates to 1e-6 m or rad. */
static int arm_cell_inside(const double y[ARM_M], const double u[@k])
{
    int i;
    for (i = 0; i < ARM_M; i++)
        if (!(arm_cell_widths[i] > 0.0) && !(fabs(y[i]) <= 1e-6)) return 0;
    for (i = 0; i < @k; i++)
        if (!(fabs(u[i]) <= 1.0 + 1e-9)) return 0;
    return 1;
}
