
#define ARM_FUNCTION_VECTORS @count

typedef struct {
    arm_pose target;
    double leaf[ARM_R];
    arm_status status;
    double q[ARM_N];
} arm_function_vector;

static const arm_function_vector arm_function_vectors[ARM_FUNCTION_VECTORS] = {
@vectors};
