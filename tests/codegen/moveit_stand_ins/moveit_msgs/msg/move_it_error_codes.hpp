// A stand-in for MoveIt's message, for tests only; without ROOM_FOR_A_REASON, an older one.
#pragma once

#include <string>

namespace moveit_msgs::msg {

struct MoveItErrorCodes {
    static constexpr int SUCCESS = 1, FAILURE = 99999, NO_IK_SOLUTION = -31, GOAL_IN_COLLISION = -12;
    int val = 0;
#ifdef ROOM_FOR_A_REASON
    std::string message;
#endif
};

}  // namespace moveit_msgs::msg
