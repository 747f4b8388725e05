// A stand-in for MoveIt's robot state, for tests only: its forward kinematics are KDL's.
#pragma once

#include <moveit/robot_model/robot_model.hpp>

#include <Eigen/Geometry>
#include <kdl/treefksolverpos_recursive.hpp>
#include <stdexcept>

namespace moveit::core {

class RobotState {
public:
    explicit RobotState(const RobotModelConstPtr& model) : model_(model), q_(model->tree.getNrOfJoints()) {}

    void setToDefaultValues() { q_.data.setZero(); }

    void setVariablePosition(const std::string& joint, double value)
    {
        updated_ = false;
        for (const auto& [name, element] : model_->tree.getSegments())
            if (element.segment.getJoint().getName() == joint) {
                q_(element.q_nr) = value;
                return;
            }
        throw std::out_of_range(joint);
    }

    void update() { updated_ = true; }

    Eigen::Isometry3d getGlobalLinkTransform(const std::string& link) const
    {
        if (!updated_)
            throw std::logic_error("the state is not updated");
        KDL::Frame frame;
        KDL::TreeFkSolverPos_recursive solver(model_->tree);
        if (solver.JntToCart(q_, frame, link) < 0)
            throw std::out_of_range(link);
        Eigen::Isometry3d place = Eigen::Isometry3d::Identity();
        for (int i = 0; i < 3; ++i) {
            place.translation()[i] = frame.p[i];
            for (int j = 0; j < 3; ++j)
                place.linear()(i, j) = frame.M(i, j);
        }
        return place;
    }

private:
    RobotModelConstPtr model_;
    KDL::JntArray q_;
    bool updated_ = false;
};

}  // namespace moveit::core
