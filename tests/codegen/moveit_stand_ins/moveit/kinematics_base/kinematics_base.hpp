// A stand-in for MoveIt 2's interface of kinematics plugins, for tests only: the same signatures.
#pragma once

#include <geometry_msgs/msg/pose.hpp>
#include <moveit/robot_model/robot_model.hpp>
#include <moveit_msgs/msg/move_it_error_codes.hpp>
#include <rclcpp/rclcpp.hpp>

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace moveit::core {
class RobotState;
}

namespace kinematics {

struct KinematicsQueryOptions {
    bool lock_redundant_joints = false, return_approximate_solution = false;
};

struct KinematicsResult {
    int kinematic_error = 0;
    double solution_percentage = 0;
};

class KinematicsBase {
public:
    using Pose = geometry_msgs::msg::Pose;
    using ErrorCode = moveit_msgs::msg::MoveItErrorCodes;
    using Numbers = std::vector<double>;
    using IKCallbackFn = std::function<void(const Pose&, const Numbers&, ErrorCode&)>;

    virtual ~KinematicsBase() = default;

    virtual bool getPositionIK(const Pose& ik_pose, const Numbers& ik_seed_state, Numbers& solution,
                               ErrorCode& error_code,
                               const KinematicsQueryOptions& options = KinematicsQueryOptions()) const = 0;

    virtual bool getPositionIK(const std::vector<Pose>& ik_poses, const Numbers& ik_seed_state,
                               std::vector<Numbers>& solutions, KinematicsResult& result,
                               const KinematicsQueryOptions& options) const
    {
        ErrorCode code;
        solutions.resize(1);
        result.solution_percentage = 1;
        return ik_poses.size() == 1 && getPositionIK(ik_poses[0], ik_seed_state, solutions[0], code, options);
    }

    virtual bool searchPositionIK(const Pose& ik_pose, const Numbers& ik_seed_state, double timeout, Numbers& solution,
                                  ErrorCode& error_code,
                                  const KinematicsQueryOptions& options = KinematicsQueryOptions()) const = 0;

    virtual bool searchPositionIK(const Pose& ik_pose, const Numbers& ik_seed_state, double timeout,
                                  const Numbers& consistency_limits, Numbers& solution, ErrorCode& error_code,
                                  const KinematicsQueryOptions& options = KinematicsQueryOptions()) const = 0;

    virtual bool searchPositionIK(const Pose& ik_pose, const Numbers& ik_seed_state, double timeout, Numbers& solution,
                                  const IKCallbackFn& solution_callback, ErrorCode& error_code,
                                  const KinematicsQueryOptions& options = KinematicsQueryOptions()) const = 0;

    virtual bool searchPositionIK(const Pose& ik_pose, const Numbers& ik_seed_state, double timeout,
                                  const Numbers& consistency_limits, Numbers& solution,
                                  const IKCallbackFn& solution_callback, ErrorCode& error_code,
                                  const KinematicsQueryOptions& options = KinematicsQueryOptions()) const = 0;

    virtual bool searchPositionIK(const std::vector<Pose>& ik_poses, const Numbers& ik_seed_state, double timeout,
                                  const Numbers& consistency_limits, Numbers& solution,
                                  const IKCallbackFn& solution_callback, ErrorCode& error_code,
                                  const KinematicsQueryOptions& options = KinematicsQueryOptions(),
                                  const moveit::core::RobotState* context_state = nullptr) const
    {
        (void)context_state;
        return ik_poses.size() == 1 && searchPositionIK(ik_poses[0], ik_seed_state, timeout, consistency_limits,
                                                        solution, solution_callback, error_code, options);
    }

    virtual bool getPositionFK(const std::vector<std::string>& link_names, const Numbers& joint_angles,
                               std::vector<Pose>& poses) const = 0;

    virtual bool initialize(const rclcpp::Node::SharedPtr& node, const moveit::core::RobotModel& robot_model,
                            const std::string& group_name, const std::string& base_frame,
                            const std::vector<std::string>& tip_frames, double search_discretization) = 0;

    virtual const std::vector<std::string>& getJointNames() const = 0;

    virtual const std::vector<std::string>& getLinkNames() const = 0;

protected:
    rclcpp::Node::SharedPtr node_;
    moveit::core::RobotModelConstPtr robot_model_;
    std::string group_name_, base_frame_;
    std::vector<std::string> tip_frames_;

    void storeValues(const moveit::core::RobotModel& robot_model, const std::string& group_name,
                     const std::string& base_frame, const std::vector<std::string>& tip_frames, double)
    {
        robot_model_ = {&robot_model, [](const moveit::core::RobotModel*) {}};
        group_name_ = group_name;
        base_frame_ = base_frame;
        tip_frames_ = tip_frames;
    }
};

}  // namespace kinematics
