// Solves poses (p, then the quaternion w, x, y, z) from a file by the plugin in examples/moveit_plugin, built against
// the stand-ins for MoveIt. Prints one line per pose: a 0 and the reason, or a 1 and the joints. Then the other calls.
#include <moveit/kinematics_base/kinematics_base.hpp>

#include <cmath>
#include <cstdio>
#include <kdl_parser/kdl_parser.hpp>
#include <memory>
#include <string>
#include <vector>

std::unique_ptr<kinematics::KinematicsBase> make_plugin();

namespace {

using Base = kinematics::KinematicsBase;

std::string reason(const Base::ErrorCode& code)
{
#ifdef ROOM_FOR_A_REASON
    return std::to_string(code.val) + " " + code.message;
#else
    return std::to_string(code.val);
#endif
}

void require(bool condition, const char* what)
{
    if (!condition)
        std::printf("wrong: %s\n", what);
}

}  // namespace

// moveit_use URDF BASE TIP OTHER_LINK POSES JOINT…
int main(int count, char** argument)
{
    moveit::core::RobotModel model;
    if (!kdl_parser::treeFromFile(argument[1], model.tree))
        return 2;
    const std::string base = argument[2], tip = argument[3], other = argument[4];
    const std::vector<std::string> joints(argument + 6, argument + count);
    model.groups.emplace("arm", std::vector<std::string>(joints.rbegin(), joints.rend()));
    model.groups.emplace("part", std::vector<std::string>(joints.begin() + 1, joints.end()));
    const auto plugin = make_plugin();
    std::vector<double> q, none;
    Base::ErrorCode code;
    Base::Pose pose;
    require(!plugin->getPositionIK(pose, none, q, code), "it solves before it is initialised");
    require(!plugin->initialize(nullptr, model, "leg", base, {tip}, 0.1), "there is no such group");
    require(!plugin->initialize(nullptr, model, "part", base, {tip}, 0.1), "a joint is missing");
    require(!plugin->initialize(nullptr, model, "arm", base, {other}, 0.1), "the tip is another");
    require(!plugin->initialize(nullptr, model, "arm", other, {tip}, 0.1), "the base is another");
    require(!plugin->initialize(nullptr, model, "arm", base, {tip, other}, 0.1), "there are two tips");
    require(plugin->initialize(nullptr, model, "arm", base, {tip}, 0.1), "it refuses its own arm");
    require(plugin->getJointNames() == joints, "the joints are in another order");
    require(plugin->getLinkNames() == std::vector<std::string>{tip}, "the link is another");

    double x[7];
    std::FILE* file = std::fopen(argument[5], "rb");
    while (std::fread(x, sizeof(double), 7, file) == 7) {
        pose.position = {x[0], x[1], x[2]};
        pose.orientation = {x[4], x[5], x[6], x[3]};
        std::vector<double> solution = {7.0}, again;
        std::vector<Base::Pose> found;
        std::vector<std::vector<double>> one;
        if (!plugin->getPositionIK(pose, none, solution, code)) {
            std::printf("0 %s\n", reason(code).c_str());
            require(solution == std::vector<double>{7.0}, "a refusal writes the solution");
            continue;
        }
        std::printf("1");
        for (double value : solution)
            std::printf(" %.17g", value);
        std::puts("");
        const std::vector<double> far(joints.size(), 3.0), wide(joints.size(), 7.0), narrow(joints.size(), 1e-3);
        require(plugin->searchPositionIK(pose, far, 0.1, again, code) && again == solution, "search");
        require(plugin->searchPositionIK(pose, far, 0.1, wide, again, code) && again == solution, "wide limits");
        require(plugin->searchPositionIK(pose, solution, 0.1, narrow, again, code), "narrow limits at the solution");
        require(!plugin->searchPositionIK(pose, far, 0.1, narrow, again, code), "narrow limits");
        require(!plugin->searchPositionIK(pose, far, 0.1, {1.0}, again, code), "one limit for all joints");
        require(code.val == Base::ErrorCode::NO_IK_SOLUTION, "the code of narrow limits");
        const auto refuse = [](const Base::Pose&, const std::vector<double>&, Base::ErrorCode& said) {
            said.val = Base::ErrorCode::GOAL_IN_COLLISION;
        };
        require(!plugin->searchPositionIK(pose, far, 0.1, again, refuse, code), "the callback is not asked");
        require(code.val == Base::ErrorCode::GOAL_IN_COLLISION, "the callback's code is lost");
        const auto agree = [](const Base::Pose&, const std::vector<double>&, Base::ErrorCode&) {};
        require(plugin->searchPositionIK(pose, far, 0.1, wide, again, agree, code), "the callback agrees");
        require(plugin->searchPositionIK({pose}, far, 0.1, {}, again, {}, code), "a list of one pose");
        kinematics::KinematicsResult result;
        require(plugin->getPositionIK({pose}, far, one, result, {}) && one[0] == solution, "several solutions");
        require(plugin->getPositionFK({tip, other}, solution, found) && found.size() == 2, "forward kinematics");
        const geometry_msgs::msg::Point p = found[0].position;
        const double off = std::fabs(p.x - x[0]) + std::fabs(p.y - x[1]) + std::fabs(p.z - x[2]);
        require(off < 1e-9, "forward kinematics of the solution");
        require(!plugin->getPositionFK({"no link"}, solution, found), "a link that does not exist");
        require(!plugin->getPositionFK({tip}, none, found), "no joints");
    }
    std::fclose(file);
    std::puts("end");
}
