
/* ---- the closing radius -------------------------------------------------------------------------------------- */

@library
@tables
arm_status arm_within_closing_radius(const arm_pose *pose)
{
    return in_closing_radius(arm_tables, arm_closing, pose) ? ARM_OK : ARM_OUTSIDE;
}
