
/* ---- the inverse kinematic function of the cell ------------------------------------------------------------- */

#if defined(__FLT_EVAL_METHOD__) && __FLT_EVAL_METHOD__ != 0 /* numbers wider than double */
#define ARM_NEAREST(x) floor((x) + 0.5)
#else
#define ARM_NEAREST(x) (((x) + 6755399441055744.0) - 6755399441055744.0) /* 1.5 * 2^52 */
#endif
