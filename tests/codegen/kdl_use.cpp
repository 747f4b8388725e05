// Reads poses (p, R row by row) from a file; solves each with the exported solvers; KDL's own forward
// kinematics judges them. Prints the largest errors, then writes the joints.
#include "arm_kdl.hpp"

#include <algorithm>
#include <cstdio>
#include <kdl/tree.hpp>
#include <kdl_parser/kdl_parser.hpp>
#include <vector>

int main(int, char** argv)
{
    KDL::Tree tree;
    KDL::Chain chain, shorter;
    if (!kdl_parser::treeFromFile(argv[1], tree) || !tree.getChain(argv[2], argv[3], chain))
        return 2;
    KDL::ChainFkSolverPos_recursive forward(chain);
    arm::ChainIkSolverPos solver(chain);
    arm::ChainIkSolverVel velocity(chain);
    KDL::JntArray q(ARM_N), qdot(ARM_N), start(ARM_N);
    for (unsigned i = 0; i < ARM_N; ++i)
        start(i) = std::stod(argv[5 + i]);
    double pose[12], off = 0, rate = 0;
    int solved = 0, failed = 0;
    std::vector<double> joints;
    std::FILE* file = std::fopen(argv[4], "rb");
    while (std::fread(pose, sizeof(double), 12, file) == 12) {
        KDL::Frame target, found, moved;
        for (int i = 0; i < 9; ++i)
            target.M.data[i] = pose[3 + i];
        target.p = KDL::Vector(pose[0], pose[1], pose[2]);
        if (solver.CartToJnt(start, target, q) < 0) {
            ++failed;
            continue;
        }
        ++solved;
        forward.JntToCart(q, found);
        const KDL::Twist error = KDL::diff(found, target);
        for (int i = 0; i < CHECKED; ++i)
            off = std::max(off, std::fabs(error(i)));
        const KDL::Twist twist(KDL::Vector(0.1, -0.2, 0.05), KDL::Vector(0.3, 0.1, -0.2));
        if (velocity.CartToJnt(q, twist, qdot) < 0)
            return 3;
        KDL::JntArray after(ARM_N), before(ARM_N);
        KDL::Frame back;
        for (unsigned i = 0; i < ARM_N; ++i) {
            after(i) = q(i) + 1e-4 * qdot(i);
            before(i) = q(i) - 1e-4 * qdot(i);
            joints.push_back(q(i));
        }
        forward.JntToCart(after, moved);
        forward.JntToCart(before, back);
        const KDL::Twist moving = KDL::diff(back, moved, 2e-4);
        for (int i = 0; i < CHECKED; ++i)
            rate = std::max(rate, std::fabs(moving(i) - twist(i)));
    }
    std::fclose(file);
    std::printf("%d %d %.3g %.3g\n", solved, failed, off, rate);
    file = std::fopen("joints.bin", "wb");
    std::fwrite(joints.data(), sizeof(double), joints.size(), file);
    std::fclose(file);

    // what is refused
    KDL::JntArray few(2), kept(q);
    KDL::Frame nowhere(KDL::Vector(9, 9, 9)), nan(KDL::Vector(std::nan(""), 0, 0));
    if (solver.CartToJnt(start, nowhere, q) >= 0 || solver.CartToJnt(start, nan, q) >= 0 || !(q == kept))
        return 4;
    if (velocity.CartToJnt(few, KDL::Twist(), qdot) != KDL::SolverI::E_SIZE_MISMATCH)
        return 5;
    KDL::Chain reordered;
    for (auto segment = chain.segments.rbegin(); segment != chain.segments.rend(); ++segment)
        reordered.addSegment(*segment);
    KDL::Chain longer(chain);
    longer.addSegment(KDL::Segment(KDL::Joint(KDL::Joint::None), KDL::Frame(KDL::Vector(0, 0, 0.1))));
    for (const KDL::Chain& wrong : {shorter, reordered, longer}) {
        try {
            arm::ChainIkSolverVel refused(wrong);
            return 6;
        } catch (const std::invalid_argument& why) {
            std::printf("%s\n", why.what());
        }
    }
}
