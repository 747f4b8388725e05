
/*
 * Limits kept at run time. A governor moves the joints towards any target or by any twist. It is called once per
 * tick; the first, second and third differences of the joints that it returns, divided by dt, dt^2 and dt^3, never
 * exceed the limits, and the joints stay on one leaf. A plan is followed only if all its samples, up to rest, were
 * checked. So there is always a known stop, whatever the input is.
 *
 *     arm_limits limits;
 *     arm_governor governor;
 *     arm_pose target[ARM_FRAMES];
 *     arm_governor_limits(&limits);                         the speed limits of the URDF
 *     for (i = 0; i < ARM_N; i++) limits.acceleration[i] = 5.0;
 *     if (arm_governor_start(&governor, q, 0.001, &limits) != ARM_OK) ...
 *     for (;;) status = arm_governor_step(&governor, target, NULL, q);         send q to the robot
 */

@structs
/* Fill limits: the speed limits of the URDF (HUGE_VAL if it has none: set them), no acceleration (set it), no jerk
 * limit, margin 0. */
void arm_governor_limits(arm_limits *limits);

/*
 * Begin, or begin again, at rest at q, which the robot was commanded to or where it was measured; its leaf is kept from
 * now on. A tick dt is 0.0001 to 0.1 s. If q is within the margin of a joint limit, or beyond it by at most 0.1 rad (m),
 * the first target or twist moves these joints inside, at most at a tenth of their speed limits, and the leaf is that of
 * the configuration inside. ARM_BAD_NUMBER: dt is out of range, a limit is not above 0 and finite, or a frame is 1e6 m
 * from the base or farther; ARM_LIMIT: q is farther beyond a joint limit; ARM_OUTSIDE: q is outside the region of
 * arm_inside(); ARM_SINGULAR: J_V is singular at q. After any of these the governor holds until a start succeeds.
 */
arm_status arm_governor_start(arm_governor *governor, const double q[ARM_N], double dt, const arm_limits *limits);

/*
 * Compute the next joints to command, which are always within the limits. Call arm_governor_start() first. If the last
 * start was refused, the governor holds: q_next is not written, so it keeps the joints of the last command or of the
 * measurement, and the status is that of the start.
 *
 * target   placement of each frame to move to, as fast as the limits allow; NULL: none
 * twist    velocity (v, omega) of each frame instead, base axes, m/s and rad/s; NULL: none. Without both it stops.
 *
 * ARM_OK          the target is reached, or the twist is the one asked for
 * ARM_SLOWED      on the way, as fast as the limits of speed, acceleration and jerk allow
 * ARM_LIMIT       a joint limit is ahead: it slows down and stops before it
 * ARM_OUTSIDE     the region of arm_inside() ends ahead: it stops before its edge
 * ARM_SINGULAR    J_V is singular ahead, or the target is out of reach: it stops before it; or no motion to it was found
 * ARM_RECOVERING  it moves back inside from beyond a joint limit; the target is followed after that
 * ARM_BAD_NUMBER  target or twist are not finite, no rotation, beyond 1e6, or both are given: it stops
 */
arm_status arm_governor_step(arm_governor *governor, const arm_pose *target, const double *twist,
                             double q_next[ARM_N]);
