// The inverse kinematic function of a cell, q = F(x), as a kinematics plugin of MoveIt 2. The folder arm/ holds F as
// `repctl export cell.json --name arm` writes it. The same pose always gets the same joints: the seed is not used.
#include "arm.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#if __has_include(<moveit/kinematics_base/kinematics_base.hpp>)
#include <moveit/kinematics_base/kinematics_base.hpp>
#include <moveit/robot_model/robot_model.hpp>
#include <moveit/robot_state/robot_state.hpp>
#else  // before MoveIt 2.12
#include <moveit/kinematics_base/kinematics_base.h>
#include <moveit/robot_model/robot_model.h>
#include <moveit/robot_state/robot_state.h>
#endif
#include <pluginlib/class_list_macros.hpp>
#include <rclcpp/rclcpp.hpp>

namespace repctl_kinematics {
namespace {

using Pose = geometry_msgs::msg::Pose;
using ErrorCode = moveit_msgs::msg::MoveItErrorCodes;
using Options = kinematics::KinematicsQueryOptions;

rclcpp::Logger logger() { return rclcpp::get_logger("repctl_kinematics"); }

// Newer messages have room for the reason.
template <class Code>
auto set_reason(Code& code, const char* reason, int) -> decltype(code.message = reason, void())
{
    code.message = reason;
}
template <class Code>
void set_reason(Code&, const char*, long)
{
}

bool refused(ErrorCode& code, const char* reason, int value = ErrorCode::NO_IK_SOLUTION)
{
    code.val = value;
    set_reason(code, reason, 0);
    RCLCPP_DEBUG(logger(), "%s", reason);
    return false;
}

const char* reason_of(arm::Status status)
{
    switch (status) {
    case arm::Status::outside:
        return "the pose is outside the cell, or a joint would be outside its limits";
    case arm::Status::singular:
        return "the function is singular at this pose";
    default:
        return "the pose is not made of finite numbers and a unit quaternion";
    }
}

// A quaternion whose length differs from 1 by more than 1e-3 becomes NaN, which F refuses.
arm::Pose to_arm(const Pose& pose)
{
    const auto& turn = pose.orientation;
    double length = std::sqrt(turn.w * turn.w + turn.x * turn.x + turn.y * turn.y + turn.z * turn.z);
    if (!(std::fabs(length - 1) < 1e-3))
        length = std::nan("");
    const double w = turn.w / length, x = turn.x / length, y = turn.y / length, z = turn.z / length;
    return {{pose.position.x, pose.position.y, pose.position.z},
            {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), 2 * (x * y + w * z),
             1 - 2 * (x * x + z * z), 2 * (y * z - w * x), 2 * (x * z - w * y), 2 * (y * z + w * x),
             1 - 2 * (x * x + y * y)}};
}

Pose to_message(const Eigen::Isometry3d& place)
{
    const Eigen::Quaterniond turn(place.rotation());
    Pose pose;
    pose.position.x = place.translation().x();
    pose.position.y = place.translation().y();
    pose.position.z = place.translation().z();
    pose.orientation.w = turn.w();
    pose.orientation.x = turn.x();
    pose.orientation.y = turn.y();
    pose.orientation.z = turn.z();
    return pose;
}

double distance(const Eigen::Isometry3d& place, const arm::Pose& pose)
{
    double off = 0;
    for (int i = 0; i < 3; ++i) {
        off = std::fmax(off, std::fabs(place.translation()[i] - pose.p[i]));
        for (int j = 0; j < 3; ++j)
            off = std::fmax(off, std::fabs(place.linear()(i, j) - pose.R[3 * i + j]));
    }
    return off;
}

}  // namespace

class CellKinematics : public kinematics::KinematicsBase {
public:
    using KinematicsBase::getPositionIK;
    using KinematicsBase::searchPositionIK;

    // Compare the group with the arm of the cell: its joints, and the placement of its tip in its base.
    bool initialize(const rclcpp::Node::SharedPtr& node, const moveit::core::RobotModel& robot_model,
                    const std::string& group_name, const std::string& base_frame,
                    const std::vector<std::string>& tip_frames, double search_discretization) override
    {
        ready_ = false;
        node_ = node;
        storeValues(robot_model, group_name, base_frame, tip_frames, search_discretization);
        const auto* group = robot_model.getJointModelGroup(group_name);
        if (group == nullptr || tip_frames_.size() != 1) {
            RCLCPP_ERROR(logger(), "group '%s' needs one tip, and has %zu", group_name.c_str(), tip_frames_.size());
            return false;
        }
        joint_names_.assign(arm::joint_names, arm::joint_names + arm::joints);
        link_names_ = {tip_frames_[0]};
        std::vector<std::string> mine = joint_names_, theirs = group->getActiveJointModelNames();
        std::sort(mine.begin(), mine.end());
        std::sort(theirs.begin(), theirs.end());
        if (mine != theirs) {
            RCLCPP_ERROR(logger(), "the joints of group '%s' are not the %zu joints of the cell, %s to %s",
                         group_name.c_str(), arm::joints, arm::joint_names[0], arm::joint_names[arm::joints - 1]);
            return false;
        }
        const double off = tip_error();
        if (!(off < 1e-6)) {
            RCLCPP_ERROR(logger(),
                         "the tip '%s' of group '%s' is not the frame '%s' of the cell, or the base '%s' not the cell's: "
                         "they are %g m or rad apart; make the cell with --frame %s --base %s",
                         tip_frames_[0].c_str(), group_name.c_str(), arm::frame, base_frame_.c_str(), off,
                         tip_frames_[0].c_str(), base_frame_.c_str());
            return false;
        }
        ready_ = true;
        return true;
    }

    bool getPositionIK(const Pose& pose, const std::vector<double>& seed, std::vector<double>& solution,
                       ErrorCode& code, const Options& = Options()) const override
    {
        return solve(pose, seed, {}, solution, {}, code);
    }

    bool searchPositionIK(const Pose& pose, const std::vector<double>& seed, double, std::vector<double>& solution,
                          ErrorCode& code, const Options& = Options()) const override
    {
        return solve(pose, seed, {}, solution, {}, code);
    }

    bool searchPositionIK(const Pose& pose, const std::vector<double>& seed, double,
                          const std::vector<double>& consistency_limits, std::vector<double>& solution,
                          ErrorCode& code, const Options& = Options()) const override
    {
        return solve(pose, seed, consistency_limits, solution, {}, code);
    }

    bool searchPositionIK(const Pose& pose, const std::vector<double>& seed, double, std::vector<double>& solution,
                          const IKCallbackFn& callback, ErrorCode& code, const Options& = Options()) const override
    {
        return solve(pose, seed, {}, solution, callback, code);
    }

    bool searchPositionIK(const Pose& pose, const std::vector<double>& seed, double,
                          const std::vector<double>& consistency_limits, std::vector<double>& solution,
                          const IKCallbackFn& callback, ErrorCode& code, const Options& = Options()) const override
    {
        return solve(pose, seed, consistency_limits, solution, callback, code);
    }

    bool getPositionFK(const std::vector<std::string>& links, const std::vector<double>& joints,
                       std::vector<Pose>& poses) const override
    {
        if (!ready_ || joints.size() != arm::joints)
            return false;
        for (const std::string& link : links)
            if (!robot_model_->hasLinkModel(link))
                return false;
        poses.clear();
        for (const std::string& link : links)
            poses.push_back(to_message(placement(joints, link)));
        return true;
    }

    const std::vector<std::string>& getJointNames() const override { return joint_names_; }

    const std::vector<std::string>& getLinkNames() const override { return link_names_; }

private:
    // F(pose), refused where it is farther from the seed than asked, or where MoveIt's callback refuses it.
    bool solve(const Pose& pose, const std::vector<double>& seed, const std::vector<double>& farthest,
               std::vector<double>& solution, const IKCallbackFn& callback, ErrorCode& code) const
    {
        if (!ready_)
            return refused(code, "the plugin is not initialised");
        if (!farthest.empty() && (farthest.size() != arm::joints || seed.size() != arm::joints))
            return refused(code, "seed and consistency limits must have one number per joint");
        arm::Joints q{};
        const arm::Status status = arm::F(to_arm(pose), nullptr, q);
        if (status != arm::Status::ok)
            return refused(code, reason_of(status));
        for (std::size_t i = 0; i < farthest.size(); ++i)
            if (!(std::fabs(q[i] - seed[i]) <= farthest[i]))
                return refused(code, "the only solution is farther from the seed than the consistency limits allow");
        solution.assign(q.begin(), q.end());
        code.val = ErrorCode::SUCCESS;
        if (callback)
            callback(pose, solution, code);
        return code.val == ErrorCode::SUCCESS;
    }

    // Placement of a link in the base frame, by MoveIt's own forward kinematics.
    Eigen::Isometry3d placement(const std::vector<double>& joints, const std::string& link) const
    {
        moveit::core::RobotState state(robot_model_);
        state.setToDefaultValues();
        for (std::size_t i = 0; i < arm::joints; ++i)
            state.setVariablePosition(joint_names_[i], joints[i]);
        state.update();
        return state.getGlobalLinkTransform(base_frame_).inverse() * state.getGlobalLinkTransform(link);
    }

    // Largest difference between MoveIt's placement of the tip and the cell's, in n + 1 configurations.
    double tip_error() const
    {
        double off = 0;
        for (std::size_t moved = 0; moved <= arm::joints; ++moved) {
            arm::Joints q{};
            for (std::size_t i = 0; i < arm::joints; ++i)
                q[i] = 0.1 * static_cast<double>(i + 1) + (i == moved ? 0.3 : 0.0);
            arm::Pose expected{};
            if (arm::placement(q, expected) != arm::Status::ok)
                return HUGE_VAL;
            off = std::fmax(off, distance(placement({q.begin(), q.end()}, tip_frames_[0]), expected));
        }
        return off;
    }

    std::vector<std::string> joint_names_, link_names_;
    bool ready_ = false;
};

}  // namespace repctl_kinematics

PLUGINLIB_EXPORT_CLASS(repctl_kinematics::CellKinematics, kinematics::KinematicsBase)
