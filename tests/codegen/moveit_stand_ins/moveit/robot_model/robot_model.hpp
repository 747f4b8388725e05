// Stand-ins for MoveIt's robot model, for tests only: a KDL tree, and groups of joints by name.
#pragma once

#include <kdl/tree.hpp>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace moveit::core {

class JointModelGroup {
public:
    explicit JointModelGroup(std::vector<std::string> joints) : joints_(std::move(joints)) {}

    const std::vector<std::string>& getActiveJointModelNames() const { return joints_; }

private:
    std::vector<std::string> joints_;
};

class RobotModel {
public:
    const JointModelGroup* getJointModelGroup(const std::string& name) const
    {
        const auto found = groups.find(name);
        return found == groups.end() ? nullptr : &found->second;
    }

    bool hasLinkModel(const std::string& name) const { return tree.getSegment(name) != tree.getSegments().end(); }

    KDL::Tree tree;
    std::map<std::string, JointModelGroup> groups;
};

using RobotModelConstPtr = std::shared_ptr<const RobotModel>;

}  // namespace moveit::core
