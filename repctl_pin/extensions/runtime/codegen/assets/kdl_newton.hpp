/*
 * Newton's method for f(q) = x on the leaf h(q) = c of the initial guess: after a closed path of frames, each solved
 * from the one before, the joints are the initial ones.
 */
class ChainIkSolverPos : public KDL::ChainIkSolverPos {
public:
    explicit ChainIkSolverPos(const KDL::Chain& chain, int iterations = 50) : chain_(chain), iterations_(iterations)
    {
        require_chain(chain);
        options_ = defaults();
        for (double& limit : options_.limit)
            limit = 0.3; /* rad or m: longest step of a joint */
    }

    int CartToJnt(const KDL::JntArray& q_init, const KDL::Frame& p_in, KDL::JntArray& q_out) override
    {
        if (q_init.rows() != ARM_N)
            return error = E_SIZE_MISMATCH;
        const Pose target = from_kdl(p_in);
        Joints q = from_kdl(q_init);
        Leaf c{};
        Status status = leaf(q, c);
        for (int i = 0; status == Status::ok && i < iterations_; ++i) {
            Joints next{};
            status = step(q, target, 1.0, nullptr, &c, &options_, nullptr, next);
            double size = 0;
            for (int j = 0; j < ARM_N; ++j)
                size = std::fmax(size, std::fabs(next[j] - q[j]));
            if (status != Status::ok)
                break;
            q = next;
            if (size < 1e-11) {
                to_kdl(q, q_out);
                return error = E_NOERROR;
            }
        }
        return error = status == Status::ok ? int(E_MAX_ITERATIONS_EXCEEDED) : to_kdl(status);
    }

    void updateInternalDataStructures() override { require_chain(chain_); }

private:
    const KDL::Chain& chain_;
    int iterations_;
    Options options_;
};
