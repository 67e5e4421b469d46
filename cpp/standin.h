#pragma once
#include "model.h"
namespace palpate {
class StandIn : public Model {
    int n;
public:
    explicit StandIn(int n) : n(n) {}
    int nodes() const override { return n; }
    std::unique_ptr<State> start() const override { auto s = std::make_unique<State>(); s->u.assign(3 * n, 0); return s; }
    void advance(State& s, const Patch* p, const double d[3], int, double f[3]) const override {
        for (auto& x : s.u) x *= 0.9;
        for (int k = 0; k < 3; k++) f[k] = p ? -0.3 * d[k] : 0;
        if (p) { double top = 0; for (int i = 0; i < p->count; i++) top = p->weight[i] > top ? p->weight[i] : top;
            for (int i = 0; i < p->count; i++) for (int k = 0; k < 3; k++) s.u[3 * p->node[i] + k] = d[k] * p->weight[i] / top; }
    }
};
}
