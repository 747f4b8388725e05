
/*
 * Test whether a pose is within the proved closing radius: ARM_OK (which is 0) or ARM_OUTSIDE.
 *
 * @words: proved.
 * A pose beyond the radius is no error, but a closed path through it is not proved to close. A pose that is not finite is
 * outside.
 */
arm_status arm_within_closing_radius(const arm_pose *pose);
