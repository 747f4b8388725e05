/* q = F(x; c): the initial guess is not used, the same frame always has the same joints. */
class ChainIkSolverPos : public KDL::ChainIkSolverPos {
public:
    explicit ChainIkSolverPos(const KDL::Chain& chain, const Leaf& c = {}) : chain_(chain), leaf_(c)
    {
        require_chain(chain);
    }

    int CartToJnt(const KDL::JntArray&, const KDL::Frame& p_in, KDL::JntArray& q_out) override
    {
        Joints q{};
        const Status status = F(from_kdl(p_in), &leaf_, q);
        if (status == Status::ok)
            to_kdl(q, q_out);
        return error = to_kdl(status);
    }

    void updateInternalDataStructures() override { require_chain(chain_); }

private:
    const KDL::Chain& chain_;
    Leaf leaf_;
};
