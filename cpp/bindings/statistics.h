#pragma once
// What the bindings of statistics, icd and subspace share: a prior as Python hands it over, and checks of sizes.
#include "bindings/module.h"
#include "statistics/mrf_prior.h"
#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <stdexcept>

namespace palpate {

using Spacing = std::array<double, 3>;

// Slices first .. end - 1 of a volume; end < 0: to the last.
inline Slices slices_of(const In<float, 3>& f, int first, int end) {
    const int count = int(f.shape(0));
    if (end < 0) end = count;
    if (first < 0 || first > end || end > count) throw std::invalid_argument("slices: expected some of the volume's");
    return {first, end};
}

template <class... Others> void same_size(const In<float, 3>& first, const Others&... others) {
    if (((others.size() != first.size()) || ...)) throw std::invalid_argument("arrays of different sizes");
}

// A prior's potential and neighbours, without its edge; the kernels' table lives as long as this does.
struct PriorKernel {
    PotentialParameters law;
    int neighbours = 26;
    std::shared_ptr<PotentialTable> table;
    std::optional<In<float, 3>> outside; // see Neighbourhood

    explicit PriorKernel(int potential) {
        expect(potential >= 0 && potential <= int(Potential::tabulated), "potential: 0 to 5");
        law.potential = Potential(potential);
    }
    PriorKernel(int potential, double exponent, int around, std::optional<In<float, 2>> columns)
        : PriorKernel(potential) {
        law.exponent = float(exponent);
        neighbours = around;
        if (!columns) return;
        if (columns->shape(0) != 2 || columns->shape(1) != size_t(PotentialTable::size))
            throw std::invalid_argument("table: wrong size");
        table = std::make_shared<PotentialTable>();
        std::copy_n(columns->data(), PotentialTable::size, table->weight);
        std::copy_n(columns->data() + PotentialTable::size, PotentialTable::size, table->value);
        law.table = table.get();
    }
    PriorKernel within(In<float, 3> border) const {
        PriorKernel made = *this;
        made.outside = border;
        return made;
    }
    PotentialParameters with(double edge) const {
        if (law.potential == Potential::tabulated && !table) throw std::invalid_argument("table: none given");
        PotentialParameters made = law;
        made.edge = float(edge);
        return made;
    }
};

inline Neighbourhood neighbourhood_of(const int64_t shape[3], const Spacing& spacing, const PriorKernel& potential,
                                      double edge) {
    Neighbourhood n = neighbourhood(shape, spacing.data(), potential.with(edge), potential.neighbours);
    if (!potential.outside) return n;
    for (int k = 0; k < 3; k++) expect(int64_t(potential.outside->shape(k)) == shape[k], "outside: the volume's shape");
    n.outside = potential.outside->data();
    return n;
}

inline Neighbourhood neighbourhood_of(const In<float, 3>& f, const Spacing& spacing, const PriorKernel& potential,
                                      double edge) {
    const int64_t shape[3] = {int64_t(f.shape(0)), int64_t(f.shape(1)), int64_t(f.shape(2))};
    return neighbourhood_of(shape, spacing, potential, edge);
}

} // namespace palpate
